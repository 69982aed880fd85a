use super::*;
use mde_uncertainty::normal::quantile;
use mde_uncertainty::random::CounterRng;
use mde_warp::proptest::pose;
use nalgebra::Point3;
use proptest::prelude::*;
use rand::RngExt;

/// An exact scene of `count` points seen by every photograph, the first its reference and the anchor of two thirds of them.
fn scene(poses: &[Pose], count: usize, seed: u64) -> Bundle {
    let views = poses.len();
    let (focal, centre) = (Vector2::new(500.0, 510.0), Vector2::new(320.0, 240.0));
    let lens = Lens { focal, centre, assumed: false, noise: 1.0 };
    let mut tracks = Vec::new();
    for i in 0..count {
        let mut rng = CounterRng::new(seed, "bundle-test", 0, i as u64);
        let mut uniform = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
        let z = uniform(2.0, 6.0);
        let point = Point3::new(uniform(-0.5, 0.5) * z, uniform(-0.4, 0.4) * z, z);
        let pixel = |v: usize| {
            let p = poses[v] * point;
            (Point2::from(lens.project(&p.coords, 0.0)), p.z)
        };
        let anchor = if i % 3 == 0 { 1 % views } else { 0 };
        let (at, depth) = pixel(anchor);
        let others = (0..views).filter(|&v| v != anchor).map(|v| (v, pixel(v).0)).collect();
        let prior = Some(depth.ln());
        tracks.push(Observed { anchor, pixel: at, inverse_depth: depth.recip(), prior, views: others });
    }
    let mut cameras = Cameras::new(vec![lens; views], poses.to_vec(), tracks.len());
    cameras.prior_sigmas = vec![0.8; views];
    Bundle { cameras, tracks }
}

fn motions() -> Vec<Pose> {
    let first = Vector6::new(-0.4, 0.05, 0.1, 0.02, -0.1, 0.03);
    let second = Vector6::new(0.3, -0.2, 0.05, -0.05, 0.12, -0.02);
    vec![Pose::identity(), exp(&first), exp(&second)]
}

fn disturbed(mut bundle: Bundle, size: f64, seed: u64) -> Bundle {
    let mut rng = CounterRng::new(seed, "bundle-noise", 0, 0);
    let mut uniform = move || size * (2.0 * rng.random::<f64>() - 1.0);
    for pose in bundle.cameras.poses.iter_mut().skip(1) {
        *pose = exp(&Vector6::from_fn(|_, _| uniform())) * *pose;
    }
    for track in &mut bundle.tracks {
        track.inverse_depth *= (3.0 * uniform()).exp();
    }
    bundle
}

fn apart(a: &Pose, b: &Pose) -> f64 {
    a.rotation.angle_to(&b.rotation) + (a.translation.vector - b.translation.vector).norm()
}

/// The length of a single translation is the unit; what is across it is not.
#[test]
fn the_unit_is_no_part_of_the_covariance() {
    let bundle = scene(&motions()[..2], 60, 1);
    let covariance = bundle.covariance(1.0).0.block(1, 1).unwrap();
    let along = twist(&bundle.cameras.poses[1].translation.vector, &Vector3::zeros());
    assert!((covariance * along).norm() < 1e-9 * covariance.norm(), "{covariance}");
    let across = Vector6::new(0.0, along.z, -along.y, 0.0, 0.0, 0.0).normalize();
    assert!(across.dot(&(covariance * across)) > 1e-9);
}

#[test]
fn an_exact_scene_is_recovered() {
    for seed in 0..5 {
        let truth = scene(&motions(), 60, seed);
        let mut bundle = disturbed(truth.clone(), 0.05, seed);
        bundle.adjust(100);
        for (found, pose) in bundle.cameras.poses.iter().zip(&truth.cameras.poses) {
            assert!(apart(found, pose) < 1e-6, "{}", apart(found, pose));
        }
        for (found, track) in bundle.tracks.iter().zip(&truth.tracks) {
            assert!((found.inverse_depth / track.inverse_depth - 1.0).abs() < 1e-6);
        }
    }
}

/// A wrong focal length common to all photographs, and the scales of the further priors, are found too, in the unit of the
/// reference's prior.
#[test]
fn focal_length_and_scales_of_priors_are_recovered() {
    let mut truth = scene(&motions(), 80, 7);
    // Almost no weight, so that the exact answer is the least.
    truth.cameras.focal_sigma = 1e6;
    let prior_scales = [1.25_f64.ln(), 1.25_f64.ln() - 0.7];
    for track in &mut truth.tracks {
        track.prior = track.prior.map(|p| p + prior_scales[track.anchor]);
    }
    let mut bundle = disturbed(truth, 0.02, 3);
    bundle.cameras.lenses.iter_mut().for_each(|lens| {
        lens.assumed = true;
        lens.focal /= 1.15;
    });
    bundle.adjust(200);
    let Cameras { log_focal, log_scales, poses, .. } = bundle.cameras;
    assert!((log_focal - 1.15_f64.ln()).abs() < 1e-6, "{log_focal}");
    assert!((log_scales[1] - 0.7).abs() < 1e-6, "{}", log_scales[1]);
    let mut expected = motions()[2];
    expected.translation.vector *= 1.25;
    assert!(apart(&poses[2], &expected) < 1e-6, "{}", apart(&poses[2], &expected));
}

/// The distortion of a lens is found, and none in the photographs of a pinhole camera.
#[test]
fn a_distortion_of_the_lens_is_found() {
    let straight = scene(&motions(), 80, 5);
    let bent = |radial: f64| {
        let mut bundle = straight.clone();
        let lens = bundle.cameras.lenses[0];
        // Where the pixel without the distortion is the one of the pinhole camera.
        let bend = |pixel: &mut Point2<f64>| {
            let at = *pixel;
            (0..40).for_each(|_| *pixel = at - radial * lens.bend(pixel));
        };
        for track in &mut bundle.tracks {
            bend(&mut track.pixel);
            track.views.iter_mut().for_each(|(_, pixel)| bend(pixel));
        }
        bundle.adjust(100);
        bundle.distortion()
    };
    assert_eq!([0.0, 0.01].map(bent), [None, None]);
    for radial in [-0.06, 0.1] {
        assert!((bent(radial).unwrap() - radial).abs() < 1e-3, "{:?}", bent(radial));
    }
}

/// Without a prior depths are inverse, and one that starts beyond infinity comes back.
#[test]
fn depths_come_back_from_beyond_infinity() {
    let mut truth = scene(&motions(), 60, 3);
    truth.tracks.iter_mut().for_each(|track| track.prior = None);
    let poses = truth.cameras.poses.clone();
    truth.cameras.given = Some(Given { poses, rotation_sigma: 1.0, centre_sigma: 1.0 });
    let mut bundle = truth.clone();
    bundle.tracks.iter_mut().for_each(|track| track.inverse_depth = -0.02);
    bundle.adjust(100);
    for (found, track) in bundle.tracks.iter().zip(&truth.tracks) {
        assert!((found.inverse_depth / track.inverse_depth - 1.0).abs() < 1e-5);
    }
}

/// The spread of a prior is measured, widened by the tracks that share an error.
#[test]
fn the_spread_of_a_prior_is_measured() {
    let mut bundle = scene(&motions(), 300, 6);
    for (i, track) in bundle.tracks.iter_mut().enumerate() {
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        track.prior = track.prior.map(|p| p + 0.1 * side);
    }
    bundle.measure_priors();
    let sigmas = &bundle.cameras.prior_sigmas;
    for (sigma, tracks) in sigmas.iter().zip([200.0_f64, 100.0]) {
        assert!((sigma - 1.4826 * 0.1 * (tracks / 30.0).sqrt()).abs() < 1e-9);
    }
    assert_eq!(sigmas[2], 0.8);
}

/// Wrong matches among the right ones move the poses little under Huber's loss.
#[test]
fn wrong_matches_move_little() {
    let mut truth = scene(&motions(), 150, 4);
    for track in truth.tracks.iter_mut().step_by(10) {
        track.views[0].1 += Vector2::new(20.0, -15.0);
    }
    let mut bundle = disturbed(truth.clone(), 0.02, 5);
    bundle.adjust(100);
    for (found, pose) in bundle.cameras.poses.iter().zip(&truth.cameras.poses) {
        assert!(found.rotation.angle_to(&pose.rotation).to_degrees() < 0.05);
    }
}

/// The covariance is that of repeated estimates under noise of the assumed size, which the residuals measure.
#[test]
fn the_covariance_is_that_of_repeated_estimates() {
    let truth = scene(&motions(), 60, 9);
    let noise = 0.3;
    let mut sums = [Matrix6::<f64>::zeros(); 3];
    let runs = 150;
    let mut measured = 0.0;
    for run in 0..runs {
        let mut bundle = truth.clone();
        for (i, track) in bundle.tracks.iter_mut().enumerate() {
            let mut rng = CounterRng::new(run, "bundle-pixel", 0, i as u64);
            for (_, pixel) in &mut track.views {
                *pixel += noise * Vector2::from_fn(|_, _| quantile(rng.random()));
            }
        }
        // Exact depths of a strong prior: its spread is no part of what is compared.
        bundle.adjust(50);
        measured += bundle.noise() / runs as f64;
        for (v, sum) in sums.iter_mut().enumerate().skip(1) {
            let moved = bundle.cameras.poses[v] * truth.cameras.poses[v].inverse();
            let delta = twist(&moved.translation.vector, &moved.rotation.scaled_axis());
            *sum += delta * delta.transpose() / runs as f64;
        }
    }
    assert!((measured / noise - 1.0).abs() < 0.05, "{measured}");
    let mut loose = truth;
    loose.cameras.prior_sigmas = vec![1e3; 3];
    // With the scale held by exact priors, only directions that pixels decide are compared: the rotation.
    let poses = loose.covariance(noise).0;
    for (v, sum) in sums.iter().enumerate().skip(1) {
        let claimed = poses.block(v, v).unwrap();
        for k in 3..6 {
            let ratio = sum[(k, k)] / claimed[(k, k)];
            assert!((0.6..1.6).contains(&ratio), "view {v}, axis {k}: {ratio}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// The gradient of the normal equations is that of the cost, by central differences over every parameter.
    #[test]
    fn the_gradient_is_that_of_the_cost(first in pose(0.5, 20.0), second in pose(0.5, 20.0), third in pose(0.5, 20.0), seed in 0..1000_u64) {
        let mut bundle = disturbed(scene(&[first, second, third], 12, seed), 0.05, seed);
        bundle.cameras.lenses[0].assumed = true;
        bundle.cameras.lenses[2].assumed = true;
        bundle.cameras.log_focal = 0.05;
        bundle.cameras.radial = Some(-0.03);
        bundle.tracks.iter_mut().step_by(2).for_each(|track| track.prior = None);
        bundle.cameras.log_scales[1] = 0.1;
        let mut poses = bundle.cameras.poses.clone();
        poses[1] = exp(&Vector6::repeat(0.02)) * poses[1];
        bundle.cameras.given = Some(Given { poses, rotation_sigma: 0.02, centre_sigma: 0.05 });
        let layout = bundle.layout();
        let size = layout.size;
        let normal = bundle.normal(&layout, 1.0);
        let step = 1e-6;
        let scale = 1.0 + normal.vector.amax();
        // Along one of all parameters, the common ones first.
        let cost = |i: usize, by: f64| {
            let mut moved = bundle.clone();
            let mut steps = DVector::zeros(size + bundle.tracks.len());
            steps[i] = by;
            moved.step(&layout, &steps.rows(0, size).into_owned(), &steps.as_slice()[size..]);
            moved.cost()
        };
        let slopes = normal.vector.iter().copied().chain(normal.depths.iter().map(|depth| depth.slope));
        for (i, expected) in slopes.enumerate() {
            let slope = (cost(i, step) - cost(i, -step)) / (2.0 * step);
            prop_assert!((slope - expected).abs() < 1e-5 * scale, "{} {} {}", i, slope, expected);
        }
    }

    /// No step that is kept raises the cost, wherever it starts.
    #[test]
    fn the_cost_never_rises(first in pose(0.5, 20.0), second in pose(0.5, 20.0), size in 0.0..0.5_f64, seed in 0..1000_u64) {
        let start = disturbed(scene(&[Pose::identity(), first, second], 20, seed), size, seed);
        let cost_after = |steps: usize| {
            let mut bundle = start.clone();
            bundle.adjust(steps);
            bundle.cost()
        };
        let costs: Vec<f64> = (0..30).map(cost_after).collect();
        prop_assert!(costs.windows(2).all(|pair| pair[1] <= pair[0]) && costs[0] == start.cost());
    }

    /// A damped step by elimination of the depths solves the whole system.
    #[test]
    fn elimination_solves_the_whole_system(seed in 0..1000_u64, damping in 1e-6..1.0_f64) {
        let bundle = disturbed(scene(&motions(), 10, seed), 0.05, seed);
        let layout = bundle.layout();
        let size = layout.size;
        let normal = bundle.normal(&layout, 1.0);
        let tracks = normal.depths.len();
        let mut whole = DMatrix::zeros(size + tracks, size + tracks);
        let mut right = DVector::zeros(size + tracks);
        let mut corner = normal.matrix.clone();
        corner.fill_upper_triangle_with_lower_triangle();
        whole.view_mut((0, 0), (size, size)).copy_from(&corner);
        right.rows_mut(0, size).copy_from(&normal.vector);
        for (t, DepthRow { shared, curvature, slope }) in normal.depths.iter().enumerate() {
            whole[(size + t, size + t)] = *curvature;
            right[size + t] = *slope;
            for &(i, a) in shared {
                whole[(i, size + t)] = a;
                whole[(size + t, i)] = a;
            }
        }
        for i in 0..size + tracks {
            whole[(i, i)] *= 1.0 + damping;
        }
        let expected = -whole.lu().solve(&right).unwrap();
        let (common, depths) = normal.step(damping).unwrap();
        prop_assert_eq!(common.len() + depths.len(), expected.len());
        for (found, expected) in common.iter().chain(&depths).zip(&expected) {
            prop_assert!((found - expected).abs() < 1e-6 * (1.0 + expected.abs()));
        }
    }
}

/// With a small parallax and a prior without shape, near and far may be exchanged: the start on the other side leads back to the exact poses.
#[test]
fn an_adjustment_that_exchanged_near_and_far_is_reversed() {
    let aside = |x: f64, y: f64| exp(&Vector6::new(x, y, 0.0, 0.0, 4.0 * x, 0.0));
    let poses =
        [Pose::identity(), aside(-0.06, 0.0), aside(0.06, 0.02), aside(-0.12, 0.03), aside(0.12, -0.02)];
    let mut truth = scene(&poses, 80, 3);
    truth.tracks.iter_mut().for_each(|track| track.prior = Some(1.3));
    truth.cameras.prior_sigmas = vec![100.0; poses.len()];
    let solved = |mut bundle: Bundle| {
        bundle.adjust(100);
        (bundle.clone().misses().iter().sum::<f64>(), bundle)
    };
    let (wrong, found) = solved(truth.reversed());
    let (right, found) = solved(found.reversed());
    assert!(wrong > 10.0 && right < 1e-3, "{wrong} {right}");
    let inverse = |bundle: &Bundle| -> Vec<f64> { bundle.tracks.iter().map(|t| t.inverse_depth).collect() };
    let unit = inverse(&found)[0] / inverse(&truth)[0];
    assert!(inverse(&found).iter().zip(inverse(&truth)).all(|(w, v)| (w / v / unit - 1.0).abs() < 0.01));
}

/// A photograph that is turned and stands elsewhere is posed anew by the points of those before it.
#[test]
fn a_photograph_that_went_astray_is_posed_anew() {
    let mut poses = motions();
    poses.push(exp(&Vector6::new(0.1, 0.3, -0.1, 0.04, -0.02, 0.1)));
    let truth = scene(&poses, 60, 5);
    let mut astray = truth.clone();
    astray.cameras.poses[3] = exp(&Vector6::new(-1.0, 0.4, 2.0, 0.05, -0.04, 0.03)) * poses[3];
    let found = astray.regrown(&[0, 1, 2, 3], &[0, 0, 0, 1]);
    let off: Vec<f64> = found.cameras.poses.iter().zip(&poses).map(|(a, b)| apart(a, b)).collect();
    assert!(off.iter().all(|off| *off < 1e-6), "{off:?}");
}
