//! Theorems of reprojection.

use crate::support::{gaussian, pixel, plane, two_planes};
use approx::assert_relative_eq;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::proptest::gaussian_depth_of;
use mde_warp::nalgebra::Point2;
use mde_warp::ndarray::{Array2, Array3};
use mde_warp::proptest::{pinhole, pinhole_of, pose};
use mde_warp::{Error, PinholeCamera, Pose, ReprojectConfig, WarpConfig, forward_warp, reproject};
use proptest::collection::vec;
use proptest::prelude::*;

fn to(depth: &GaussianDepth, camera: &PinholeCamera, target: &Pose) -> GaussianDepth {
    reproject(depth, camera, &Pose::identity(), camera, target, &ReprojectConfig::default()).unwrap()
}

/// The known pixels of a map: `(row, column)`, mean, variance.
fn known(map: &GaussianDepth) -> impl Iterator<Item = ((usize, usize), f64, f64)> {
    let (height, width) = map.dim();
    let pixels = (0..height * width).map(move |i| (i / width, i % width));
    pixels.filter_map(|at| map.get(at.0, at.1).map(|(mean, variance)| (at, mean.into(), variance.into())))
}

/// Where a target pixel's point lies in the source camera (at the origin): column, row and z.
fn source_of(camera: &PinholeCamera, target: &Pose, at: Point2<f64>, depth: f64) -> (Point2<f64>, f64) {
    let point = target.inverse() * camera.unproject(at, depth);
    (camera.project(&point).unwrap(), point.z)
}

/// dz' / dz along a source ray, by central differences of the projection.
fn gain(camera: &PinholeCamera, target: &Pose, from: Point2<f64>, z: f64) -> f64 {
    let there = |z: f64| (target * camera.unproject(from, z)).z;
    (there(z + 1e-4) - there(z - 1e-4)) / 2e-4
}

/// Depths of any size, variances of any size.
fn wild(height: usize, width: usize) -> impl Strategy<Value = GaussianDepth> {
    let any_size = || (-45.0..38.5_f32).prop_map(|exponent| 10_f32.powf(exponent));
    let mean =
        prop_oneof![1 => Just(0.0), 1 => any_size().prop_map(|m| -m), 2 => 0.5..1.5_f32, 2 => any_size()];
    let variance = prop_oneof![1 => Just(0.0), 5 => any_size()];
    let pixels = height * width;
    (vec(mean, pixels), vec(variance, pixels)).prop_map(move |(mean, variance)| {
        let map = |values| Array2::from_shape_vec((height, width), values).unwrap();
        GaussianDepth::new(map(mean), map(variance)).unwrap()
    })
}

proptest! {
    #[test]
    fn the_identity_changes_nothing(
        (camera, depth) in pinhole(12).prop_flat_map(|c| (Just(c), gaussian_depth_of(c.height, c.width))),
        at in pose(3.0, 90.0),
        front in 0.0..0.02_f64,
        tear in 0.0..0.5_f64,
    ) {
        let config = ReprojectConfig { front, tear, ..ReprojectConfig::default() };
        prop_assert_eq!(&reproject(&depth, &camera, &at, &camera, &at, &config).unwrap(), &depth);
    }

    #[test]
    fn a_plane_there_and_back_is_the_plane(
        camera in pinhole_of(24, 20),
        other in pinhole_of(31, 17),
        plane in plane(),
        target in pose(0.1, 5.0),
    ) {
        let (depth, origin, config) = (gaussian(plane.map(&camera), 0.01), Pose::identity(), ReprojectConfig::default());
        let there = reproject(&depth, &camera, &origin, &other, &target, &config).unwrap();
        for ((row, column), mean, _) in known(&there) {
            let expected = plane.depth_from(&other, &target, pixel(row, column));
            assert_relative_eq!(mean, expected, max_relative = 1e-6);
        }
        let back = reproject(&there, &other, &target, &camera, &origin, &config).unwrap();
        // Exact between four known pixels of the other image. At the rim the slope may be unknown, and half a pixel off.
        for row in 0..20 {
            for column in 0..24 {
                let z = plane.depth(&camera, pixel(row, column));
                let seen = other.project(&(target * camera.unproject(pixel(row, column), z)));
                let between = seen.filter(|p| p.x >= 0.0 && p.y >= 0.0).is_some_and(|p| {
                    let ends = |x: f64| [x.floor() as usize, x.ceil() as usize];
                    ends(p.y).iter().all(|&r| ends(p.x).iter().all(|&c| there.get(r, c).is_some()))
                });
                match back.get(row, column) {
                    Some((mean, _)) => {
                        assert_relative_eq!(f64::from(mean), z, max_relative = if between { 1e-5 } else { 0.02 });
                    }
                    None => prop_assert!(!between, "{row}, {column} is lost"),
                }
            }
        }
    }

    /// Var z' = (dz'/dz)^2 Var z, the derivative taken numerically along the source ray of each target pixel, with a variance
    /// that changes over the image.
    #[test]
    fn the_variance_goes_along_the_ray(camera in pinhole_of(24, 20), plane in plane(), target in pose(0.1, 25.0)) {
        let field = |at: Point2<f64>| 0.01 + 0.002 * at.x + 0.001 * at.y;
        let variance = Array2::from_shape_fn((20, 24), |(row, column)| field(pixel(row, column)) as f32);
        let depth = GaussianDepth::new(plane.map(&camera), variance).unwrap();
        for ((row, column), mean, variance) in known(&to(&depth, &camera, &target)) {
            let (from, z) = source_of(&camera, &target, pixel(row, column), mean);
            // Beyond the outermost pixel centres the nearest pixel's variance holds.
            let within = Point2::new(from.x.clamp(0.0, 23.0), from.y.clamp(0.0, 19.0));
            let expected = gain(&camera, &target, from, z).powi(2) * field(within);
            let tolerance = if within == from { 1e-4 } else { 0.3 };
            assert_relative_eq!(variance, expected, max_relative = tolerance);
        }
    }

    /// Far behind the front by the tear threshold, however uncertain, is another surface.
    #[test]
    fn two_surfaces_never_mix(
        camera in pinhole_of(20, 16),
        scene in two_planes(20, 16),
        target in pose(0.2, 5.0),
        sigma in 0.0..10.0_f32,
    ) {
        let there = to(&gaussian(scene.depth(&camera), sigma * sigma), &camera, &target);
        for ((row, column), mean, _) in known(&there) {
            let level = scene.level(&camera, &target, pixel(row, column), mean as f32);
            prop_assert!(level.is_some(), "depth {mean} at {row}, {column} is on neither surface");
        }
    }

    /// Samples of one map are not independent: their mixture never has less variance than the best of them.
    #[test]
    fn folds_do_not_lower_the_variance(
        camera in pinhole_of(16, 12),
        noise in vec(-0.02..0.02_f32, 16 * 12),
        target in pose(1.5, 5.0),
    ) {
        let mean = Array2::from_shape_vec((12, 16), noise).unwrap().mapv(|n| 2.0 * (1.0 + n));
        let there = to(&gaussian(mean, 0.01), &camera, &target);
        for ((row, column), mean, variance) in known(&there) {
            let (from, z) = source_of(&camera, &target, pixel(row, column), mean);
            // The gain varies over the few source pixels that meet at a fold, by at most the rotation's slope.
            let gain = gain(&camera, &target, from, z);
            prop_assert!(variance >= 0.01 * (gain * gain - 0.15), "{variance} at {row}, {column}");
            // The depths and, beyond the outermost pixel centres, half a pixel of their slopes along rows and columns.
            prop_assert!((1.879..2.121).contains(&z), "{z} at {row}, {column}");
        }
    }

    /// GaussianDepth refuses a NaN, so a result is free of them; and what is known is positive.
    #[test]
    fn any_input_gives_a_map(
        ((camera, depth), other) in (pinhole(7).prop_flat_map(|c| (Just(c), wild(c.height, c.width))), pinhole(7)),
        source in pose(3.0, 180.0),
        target in pose(3.0, 180.0),
        (tear, front, front_sigmas) in (0.0..=1.0_f64, 0.0..=1.0_f64, 0.0..10.0_f64),
    ) {
        let config = ReprojectConfig { tear, front, front_sigmas };
        let there = reproject(&depth, &camera, &source, &other, &target, &config).unwrap();
        prop_assert_eq!(there.dim(), other.dim());
        prop_assert!(known(&there).all(|(_, mean, _)| mean > 0.0 && mean.is_finite()));
        let image = Array3::from_elem((camera.height, camera.width, 3), 0.5);
        let warp = WarpConfig { tear };
        let view = forward_warp(image.view(), &depth, &camera, &source, &other, &target, &warp).unwrap();
        prop_assert!(view.view.validate().is_ok());
    }
}

#[test]
fn errors_say_what_does_not_fit() {
    let camera = PinholeCamera::from_fov(60.0, 4, 3).unwrap();
    let (depth, origin) = (gaussian(Array2::ones((3, 4)), 0.1), Pose::identity());
    let run = |camera: &PinholeCamera, config: &ReprojectConfig| {
        reproject(&depth, camera, &origin, camera, &origin, config).unwrap_err()
    };
    let config = ReprojectConfig::default();
    let wide = run(&camera.resized(5, 3).unwrap(), &config);
    assert_eq!(wide, Error::Shape { what: "depth", found: vec![3, 4], expected: vec![3, 5] });
    let flat = run(&PinholeCamera { fx: 0.0, ..camera }, &config);
    assert!(matches!(flat, Error::Camera { field: "fx", .. }));
    let negative = run(&camera, &ReprojectConfig { front: -0.1, ..config.clone() });
    assert!(matches!(negative, Error::Config(at) if at.field == "front"));
}
