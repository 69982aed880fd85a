//! The fundamental matrix of two photographs, which no focal length is needed for.

use super::msac::{Ransac, msac, score};
use super::roots::real_roots;
use nalgebra::{DMatrix, Matrix3, Point2, SMatrix, SVector, Vector2, Vector3};

/// Steps of the local optimisation of a new best model.
const LOCAL_STEPS: usize = 4;
/// Points that a model needs.
const SAMPLE: usize = 7;

/// A pixel of one photograph and one of another.
pub(super) type PixelPair = (Point2<f64>, Point2<f64>);

/// Squared distance in pixels of a pair from the nearest pair that obeys `f`, to first order (Sampson, 1982).
pub(super) fn sampson(f: &Matrix3<f64>, (p, q): &PixelPair) -> f64 {
    let (p, q) = (Vector3::new(p.x, p.y, 1.0), Vector3::new(q.x, q.y, 1.0));
    let (line, back) = (f * p, f.transpose() * q);
    let below = line.xy().norm_squared() + back.xy().norm_squared();
    q.dot(&line).powi(2) / below.max(f64::MIN_POSITIVE)
}

/// The pairs that obey one matrix, \\( p_2^\top F p_1 = 0 \\), within `threshold` pixels: samples of seven (MSAC's score), each new best optimised by
/// reweighted least squares (LO-RANSAC; Chum, Matas and Kittler, 2003).
///
/// Nothing where no model has more than the seven pairs that make it.
pub(super) fn filter(
    pairs: &[PixelPair],
    threshold: f64,
    ransac: &Ransac,
) -> Option<(Matrix3<f64>, Vec<usize>)> {
    if pairs.len() <= SAMPLE {
        return None;
    }
    let (first, second) = (conditioning(pairs.iter().map(|p| p.0)), conditioning(pairs.iter().map(|p| p.1)));
    let conditioned: Vec<PixelPair> =
        pairs.iter().map(|(p, q)| (first.transform_point(p), second.transform_point(q))).collect();
    let limit = threshold * threshold;
    let plain = |f: Matrix3<f64>| second.transpose() * f * first;
    let distance = |f: &Matrix3<f64>, i: usize| sampson(f, &pairs[i]);
    let score = |f: &Matrix3<f64>| score(pairs.len(), limit, |i| distance(f, i));
    let models = |chosen: [usize; SAMPLE]| {
        seven_points(chosen.map(|i| conditioned[i])).into_iter().map(plain).collect()
    };
    let optimised = |mut f: Matrix3<f64>, mut value: f64| {
        for _ in 0..LOCAL_STEPS {
            let weights: Vec<f64> =
                pairs.iter().map(|pair| (1.0 - sampson(&f, pair) / limit).max(0.0)).collect();
            let Some(next) = weighted(&conditioned, &weights).map(plain) else { break };
            let next_value = score(&next);
            if next_value <= value {
                break;
            }
            (f, value) = (next, next_value);
        }
        (f, value)
    };
    let matrix = msac(pairs.len(), limit, ransac, models, distance, optimised)?;
    let inliers: Vec<usize> = (0..pairs.len()).filter(|&i| distance(&matrix, i) < limit).collect();
    (inliers.len() > SAMPLE).then_some((matrix, inliers))
}

/// Hartley's conditioning: mean 0 and a mean distance of \\( \sqrt 2 \\).
fn conditioning(points: impl ExactSizeIterator<Item = Point2<f64>> + Clone) -> Matrix3<f64> {
    let count = points.len() as f64;
    let mean = points.clone().map(|p| p.coords).sum::<Vector2<f64>>() / count;
    let spread = points.map(|p| (p.coords - mean).norm()).sum::<f64>() / count;
    let s = std::f64::consts::SQRT_2 / spread.max(1e-9);
    Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0)
}

fn row((p, q): &PixelPair) -> SVector<f64, 9> {
    SVector::from([q.x * p.x, q.x * p.y, q.x, q.y * p.x, q.y * p.y, q.y, p.x, p.y, 1.0])
}

/// The one or three matrices of rank 2 that seven pairs leave.
fn seven_points(pairs: [PixelPair; SAMPLE]) -> Vec<Matrix3<f64>> {
    let mut a = SMatrix::<f64, 7, 9>::zeros();
    for (i, pair) in pairs.iter().enumerate() {
        a.set_row(i, &row(pair).transpose());
    }
    let Some([g, h]) = null_space(a) else { return Vec::new() };
    let [g, h] = [g, h].map(|f| Matrix3::from_row_slice(f.as_slice()));
    // det(h + x (g - h)) is a cubic; four values give its coefficients.
    let at = |x: f64| (h + (g - h) * x).determinant();
    let (d0, d1, m1, d2) = (at(0.0), at(1.0), at(-1.0), at(2.0));
    let square = 0.5 * (d1 + m1) - d0;
    let odd = 0.5 * (d1 - m1);
    let cube = (d2 - d0 - 4.0 * square - 2.0 * odd) / 6.0;
    real_roots([d0, odd - cube, square, cube]).into_iter().map(|x| h + (g - h) * x).collect()
}

/// Two vectors that span the null space of a 7 x 9 matrix of full rank: Gaussian elimination with full pivoting.
fn null_space(mut a: SMatrix<f64, 7, 9>) -> Option<[SVector<f64, 9>; 2]> {
    let mut order: [usize; 9] = std::array::from_fn(|i| i);
    for k in 0..7 {
        let (mut r, mut c, mut largest) = (k, k, 0.0);
        for i in k..7 {
            for j in k..9 {
                if a[(i, j)].abs() > largest {
                    (r, c, largest) = (i, j, a[(i, j)].abs());
                }
            }
        }
        if largest < 1e-10 {
            return None;
        }
        a.swap_rows(k, r);
        a.swap_columns(k, c);
        order.swap(k, c);
        for i in (0..7).filter(|&i| i != k) {
            let factor = a[(i, k)] / a[(k, k)];
            for j in k..9 {
                a[(i, j)] -= factor * a[(k, j)];
            }
        }
    }
    Some([7, 8].map(|free| {
        let mut x = SVector::<f64, 9>::zeros();
        for k in 0..7 {
            x[order[k]] = -a[(k, free)] / a[(k, k)];
        }
        x[order[free]] = 1.0;
        x.normalize()
    }))
}

/// Least squares over weighted pairs, then the nearest matrix of rank 2.
fn weighted(pairs: &[PixelPair], weights: &[f64]) -> Option<Matrix3<f64>> {
    if weights.iter().filter(|w| **w > 0.0).count() < 8 {
        return None;
    }
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (pair, &weight) in pairs.iter().zip(weights).filter(|(_, w)| **w > 0.0) {
        let row = row(pair);
        normal += row * row.transpose() * weight;
    }
    let eigen = DMatrix::from_column_slice(9, 9, normal.as_slice()).symmetric_eigen();
    let smallest = eigen.eigenvalues.imin();
    let svd = Matrix3::from_row_iterator(eigen.eigenvectors.column(smallest).iter().copied()).svd(true, true);
    let (u, vt, mut s) = (svd.u?, svd.v_t?, svd.singular_values);
    let least = s.imin();
    s[least] = 0.0;
    Some(u * Matrix3::from_diagonal(&s) * vt)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_uncertainty::random::CounterRng;
    use nalgebra::{Point3, UnitQuaternion};
    use rand::RngExt;

    /// Pairs of a turned and moved camera of focal length 500, of which the last `wrong` are unrelated.
    fn scene(count: usize, wrong: usize, noise: f64, seed: u64) -> Vec<PixelPair> {
        let turn = UnitQuaternion::from_euler_angles(0.03, -0.1, 0.05);
        (0..count)
            .map(|i| {
                let mut rng = CounterRng::new(seed, "epipolar-test", 0, i as u64);
                let mut uniform = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
                let z = uniform(2.0, 6.0);
                let point = Point3::new(uniform(-0.5, 0.5) * z, uniform(-0.4, 0.4) * z, z);
                let there = turn * point + Vector3::new(0.3, -0.1, 0.05);
                let pixel = |p: Point3<_>| Point2::new(500.0 * p.x / p.z + 320.0, 500.0 * p.y / p.z + 240.0);
                let mut shaken = |p: Point2<_>| p + Vector2::from_fn(|_, _| uniform(-noise, noise));
                let first = shaken(pixel(point));
                let second = shaken(pixel(there));
                let elsewhere = Point2::new(uniform(0.0, 640.0), uniform(0.0, 480.0));
                (first, if i + wrong >= count { elsewhere } else { second })
            })
            .collect()
    }

    #[test]
    fn seven_exact_pairs_give_a_matrix_that_all_obey() {
        let pairs = scene(60, 0, 0.0, 1);
        let chosen = std::array::from_fn(|i| (pairs[7 * i].0 / 500.0, pairs[7 * i].1 / 500.0));
        let found = seven_points(chosen);
        let scaled: Vec<PixelPair> = pairs.iter().map(|(p, q)| (p / 500.0, q / 500.0)).collect();
        let worst = |f: &Matrix3<f64>| scaled.iter().map(|p| sampson(f, p)).fold(0.0, f64::max);
        assert!(found.iter().map(worst).fold(f64::INFINITY, f64::min) < 1e-16);
    }

    /// With more wrong pairs than right ones, nearly all right ones are kept and few others.
    #[test]
    fn unrelated_pairs_are_left_out() {
        for seed in 0..5 {
            let pairs = scene(300, 160, 0.5, seed);
            let (_, found) = filter(&pairs, 1.5, &Ransac { seed, purpose: "test", stream: 0 }).unwrap();
            let right = found.iter().filter(|&&i| i < 140).count();
            assert!(right >= 133, "{right} of 140 with seed {seed}");
            // A line 3 pixels wide through 640 x 480 holds about one per cent.
            assert!(found.len() - right <= 8, "{} wrong", found.len() - right);
        }
    }

    #[test]
    fn few_or_equal_pairs_give_nothing() {
        let ransac = Ransac { seed: 0, purpose: "test", stream: 0 };
        assert!(filter(&scene(7, 0, 0.0, 0), 1.0, &ransac).is_none());
        assert!(filter(&[(Point2::origin(), Point2::origin()); 20], 1.0, &ransac).is_none());
    }
}
