use super::*;
use crate::poses::MAX_FEATURES;
use crate::poses::neighbours::all;
use crate::poses::tests::{camera, photographs, with_errors};
use crate::synthetic::{Plane, pose_at, render};
use mde_uncertainty::random::CounterRng;
use mde_warp::PosedView;
use nalgebra::{DMatrix, DVector};
use ndarray::Array2;
use proptest::prelude::*;
use rand::RngExt;

fn ratio(first: usize, second: usize, log: f64, sigma: f64) -> LogRatio {
    LogRatio { first, second, log, sigma }
}

fn uniform(seed: u64, index: usize) -> f64 {
    CounterRng::new(seed, "scales-test", 0, index as u64).random()
}

/// Factors of mean 0, and pairs of a connected graph: a random tree and some more.
fn graph(count: usize, more: usize, seed: u64) -> (Vec<f64>, Vec<[usize; 2]>) {
    let logs: Vec<f64> = (0..count).map(|i| uniform(seed, i) - 0.5).collect();
    let mean = logs.iter().sum::<f64>() / count as f64;
    let index = |at: usize, below: usize| (uniform(seed + 1000, at) * below as f64) as usize;
    let mut pairs: Vec<[usize; 2]> = (1..count).map(|i| [index(i, i), i]).collect();
    let further = (0..more).map(|k| [0, 1].map(|end| index(count + 2 * k + end, count)));
    pairs.extend(further.filter(|[a, b]| a != b));
    (logs.into_iter().map(|log| log - mean).collect(), pairs)
}

fn ratios(logs: &[f64], pairs: &[[usize; 2]], noise: f64, seed: u64) -> Vec<LogRatio> {
    let of_pair = |(k, &[a, b]): (usize, &[usize; 2])| {
        let sigma = 0.01 + 0.05 * uniform(seed + 1, k);
        let error = 3.0_f64.sqrt() * (2.0 * uniform(seed + 2, k) - 1.0);
        ratio(a, b, logs[b] - logs[a] + noise * sigma * error, sigma)
    };
    pairs.iter().enumerate().map(of_pair).collect()
}

proptest! {
    /// Bit for bit, with noise, and whichever photograph of a pair is the first.
    #[test]
    fn the_order_of_the_ratios_changes_nothing(count in 2..30_usize, more in 0..40_usize, seed in 0..1000_u64) {
        let (logs, pairs) = graph(count, more, seed);
        let given = ratios(&logs, &pairs, 1.0, seed);
        let mut turned = given.clone();
        turned.rotate_left(given.len() / 3);
        turned.reverse();
        for ratio in turned.iter_mut().step_by(2) {
            *ratio = LogRatio { first: ratio.second, second: ratio.first, log: -ratio.log, ..*ratio };
        }
        prop_assert_eq!(common_scale(count, &given).unwrap(), common_scale(count, &turned).unwrap());
    }

    /// Factors and deviations are those of a dense solution while no residual is beyond the cut, but for the photograph's own error.
    #[test]
    fn the_factors_are_those_of_dense_least_squares(count in 2..60_usize, more in 0..60_usize, seed in 0..1000_u64) {
        let (logs, pairs) = graph(count, more, seed);
        let given = ratios(&logs, &pairs, 0.2, seed);
        let mut normal = DMatrix::<f64>::zeros(count, count);
        let mut right = DVector::zeros(count);
        for r in &given {
            let weight = 1.0 / (r.sigma * r.sigma);
            for (i, sign) in [(r.first, -1.0), (r.second, 1.0)] {
                right[i] += sign * weight * r.log;
                for (j, other) in [(r.first, -1.0), (r.second, 1.0)] {
                    normal[(i, j)] += sign * other * weight;
                }
            }
        }
        // The pseudo-inverse of a matrix of which only the constant vector is in the null space.
        let constant = DMatrix::from_element(count, count, 1.0 / count as f64);
        let inverse = (normal + &constant).try_inverse().unwrap() - constant;
        let expected: DVector<f64> = &inverse * right;
        for (i, found) in common_scale(count, &given).unwrap().iter().enumerate() {
            prop_assert!((found.log - expected[i]).abs() < 1e-7, "{} {}", found.log, expected[i]);
            prop_assert_eq!((found.component, found.photographs), (0, count));
            let own = given.iter().filter(|r| r.first == i || r.second == i).map(|r| r.sigma).fold(1.0, f64::min);
            let least = own * (0.5 - 0.5 / count as f64).sqrt();
            prop_assert!((found.sigma / inverse[(i, i)].sqrt().max(least) - 1.0).abs() < 1e-6);
        }
    }

    /// With every pair of eight photographs, one wrong ratio moves no factor by as much as the deviation of a ratio.
    #[test]
    fn a_wrong_ratio_does_not_move_the_others(seed in 0..200_u64, wrong in 0..28_usize, by in 0.3..3.0_f64) {
        let logs: Vec<f64> = graph(8, 0, seed).0;
        let mut given = ratios(&logs, &all(8), 0.5, seed);
        given.iter_mut().for_each(|ratio| ratio.sigma = 0.02);
        let before = common_scale(8, &given).unwrap();
        given[wrong].log += by;
        for (after, before) in common_scale(8, &given).unwrap().iter().zip(&before) {
            prop_assert!((after.log - before.log).abs() < 0.02, "{} {}", after.log, before.log);
        }
    }
}

#[test]
fn components_are_apart_and_a_photograph_without_ratios_is_one() {
    let given = [ratio(0, 3, 0.4, 0.1), ratio(4, 5, 1.0, 0.1), ratio(3, 6, 0.2, 0.1)];
    let found = common_scale(7, &given).unwrap();
    let component: Vec<usize> = found.iter().map(|f| f.component).collect();
    assert_eq!(component, [0, 1, 2, 0, 3, 3, 0]);
    assert_eq!(found.iter().map(|f| f.photographs).collect::<Vec<_>>(), [3, 1, 1, 3, 2, 2, 3]);
    for alone in [1, 2] {
        assert_eq!((found[alone].log, found[alone].sigma), (0.0, 0.0));
    }
    assert!((found[5].log - 0.5).abs() < 1e-12 && (found[4].log + 0.5).abs() < 1e-12);
    assert!((found[5].sigma - 0.05).abs() < 1e-12);
    assert!((found[0].log + found[3].log + found[6].log).abs() < 1e-12);
    assert_eq!(common_scale(0, &[]).unwrap(), []);
}

/// Residuals of eight times their deviations, as where the deviations are too small: those of the factors grow likewise.
#[test]
fn deviations_grow_with_the_residuals() {
    let (logs, _) = graph(12, 0, 3);
    let sigma = |noise: f64| common_scale(12, &ratios(&logs, &all(12), noise, 3)).unwrap()[4].sigma;
    // With 66 ratios of 12 photographs, 1.7 of the growth is hidden by the photograph's own error.
    let grown = sigma(8.0) / sigma(0.1);
    assert!((2.5..8.0).contains(&grown), "{grown}");
}

/// A video of some thousand photographs with a few loops.
#[test]
fn a_long_chain_takes_no_time() {
    let count = 4000;
    let (logs, _) = graph(count, 0, 1);
    let next = (0..count).flat_map(|i| (1..4).map(move |step| [i, i + step])).filter(|[_, b]| *b < count);
    let keys = all(20).into_iter().map(|pair| pair.map(|i| 200 * i));
    let pairs: Vec<[usize; 2]> = next.chain(keys).collect();
    let start = std::time::Instant::now();
    let found = common_scale(count, &ratios(&logs, &pairs, 0.1, 1)).unwrap();
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
    let worst = found.iter().zip(&logs).map(|(f, log)| (f.log - log).abs()).fold(0.0, f64::max);
    assert!(worst < 0.05, "{worst}");
}

#[test]
fn what_is_no_ratio_is_refused() {
    let text = |r: LogRatio| common_scale(3, &[r]).unwrap_err().to_string();
    assert!(text(ratio(0, 3, 0.1, 0.1)).contains("0 and 3"));
    assert!(text(ratio(1, 1, 0.1, 0.1)).contains("1 and 1"));
    assert!(text(ratio(0, 1, f64::NAN, 0.1)).contains("ratio"));
    for sigma in [0.0, -0.1, 1e-160, 1e200, f64::INFINITY, f64::NAN] {
        assert!(text(ratio(0, 1, 0.1, sigma)).contains("sigma"), "{sigma}");
    }
}

/// A wall with a second one before it, from that pose, and its depth.
fn photograph(pose: Pose) -> (PosedView, Array2<f32>) {
    let planes = [Plane::slanted(2.0, 0.5, 0.1), Plane::slanted(2.1, -0.6, 0.0)];
    render(&planes, camera(), pose, 6.0 * 2.0 / camera().fx)
}

fn prepared((view, depth): (PosedView, Array2<f32>)) -> Prepared {
    Prepared::new(&photographs(&[(view, depth.into_shared())])[0], MAX_FEATURES).unwrap()
}

/// Five photographs, moved, turned on the spot and from the same place, whose priors have other factors and errors of 10 %: the
/// factors are found to 3 %, and within three of their own deviations; one of another place is alone.
#[test]
fn factors_of_rendered_photographs_are_found() {
    let poses = [
        Pose::identity(),
        pose_at([0.15, 0.02, 0.0], [0.02, -0.04, 0.01]),
        pose_at([0.0, 0.0, 0.25], [0.0; 3]),
        pose_at([0.0; 3], [0.03, -0.08, 0.02]),
        Pose::identity(),
    ];
    let truth = [0.1_f64, -0.3, 0.25, 0.0, -0.05];
    let shot = |(pose, log): (&Pose, f64)| {
        let (view, depth) = photograph(*pose);
        prepared((view, with_errors(&depth, (-log).exp() as f32)))
    };
    let mut shots: Vec<Prepared> = poses.iter().zip(truth).map(shot).collect();
    shots.push(prepared(photograph(pose_at([0.0, 40.0, 0.0], [0.0; 3]))));
    assert!(shots.iter().all(|shot| shot.features.keypoints.len() > 200));

    let mut found = Vec::new();
    for [first, second] in all(shots.len()) {
        let Some([log, sigma]) = Prepared::log_ratio(&shots[first], &shots[second], 7) else { continue };
        found.push(ratio(first, second, log, sigma));
        if second < 5 {
            let error = log - (truth[second] - truth[first]);
            assert!(error.abs() < 0.05, "{first} {second}: {error} +- {sigma}");
        }
    }
    assert_eq!(found.len(), 10);
    let factors = common_scale(shots.len(), &found).unwrap();
    for (i, (factor, log)) in factors.iter().zip(truth).enumerate() {
        assert!((factor.log - log).abs() < 0.03, "{i}: {} {log}", factor.log);
        assert!((factor.log - log).abs() < 3.0 * factor.sigma + 0.005, "{i}: {factor:?} {log}");
        assert!(factor.sigma < 0.03, "{i}: {factor:?}");
    }
    assert_eq!((factors[5].photographs, factors[5].component), (1, 1));
}

/// The very same photograph twice, as frames of a video may be: no epipolar geometry is determined, the ratio is.
#[test]
fn the_same_photograph_twice_has_the_ratio_of_its_priors() {
    let (view, depth) = photograph(Pose::identity());
    let (a, b) = (prepared((view.clone(), depth.clone())), prepared((view, depth * 1.25)));
    let [log, sigma] = Prepared::log_ratio(&a, &b, 0).unwrap();
    assert!((log + 1.25_f64.ln()).abs() < 1e-6 && sigma == LEAST_SIGMA, "{log} {sigma}");
}

#[test]
fn threads_change_no_ratio_and_a_photograph_needs_a_prior() {
    let a = prepared(photograph(Pose::identity()));
    let b = prepared(photograph(pose_at([0.15, 0.02, 0.0], [0.02, -0.04, 0.01])));
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Prepared::log_ratio(&a, &b, 3))
    };
    assert!(of(1).is_some());
    assert_eq!(of(1), of(4));
    assert!(Prepared::log_ratio(&a, &Prepared { prior: None, ..b }, 3).is_none());
}
