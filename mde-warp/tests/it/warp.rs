//! Theorems of the forward warp.

use crate::support::{BLUE, RED, TwoPlanes, gaussian, image_of, pixel, plane, two_planes};
use approx::assert_relative_eq;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::proptest::gaussian_depth_of;
use mde_warp::nalgebra::Point2;
use mde_warp::ndarray::{Array2, Array3, s};
use mde_warp::proptest::{pinhole, pinhole_of, pose};
use mde_warp::{Error, PinholeCamera, Pose, WarpConfig, WarpedView, forward_warp};
use proptest::prelude::*;

fn warp(image: &Array3<f32>, depth: &GaussianDepth, camera: &PinholeCamera, target: &Pose) -> WarpedView {
    forward_warp(image.view(), depth, camera, &Pose::identity(), camera, target, &WarpConfig::default())
        .unwrap()
}

/// The first covered pixels of a pixel's row and column on either side; all, where there are none.
fn ends(depth: &Array2<f32>, (row, column): (usize, usize)) -> Vec<(usize, usize)> {
    let (height, width) = depth.dim();
    let covered = |at: &(usize, usize)| depth[*at] > 0.0;
    let ends = [
        (0..column).rev().map(|c| (row, c)).find(covered),
        (column + 1..width).map(|c| (row, c)).find(covered),
        (0..row).rev().map(|r| (r, column)).find(covered),
        (row + 1..height).map(|r| (r, column)).find(covered),
    ];
    let found: Vec<_> = ends.into_iter().flatten().collect();
    if found.is_empty() { depth.indexed_iter().map(|(at, _)| at).filter(covered).collect() } else { found }
}

/// A camera, an image and depths of its size.
fn anything(max_side: usize) -> impl Strategy<Value = (PinholeCamera, Array3<f32>, GaussianDepth)> {
    pinhole(max_side).prop_flat_map(|camera| {
        let (height, width) = camera.dim();
        (Just(camera), image_of(height, width), gaussian_depth_of(height, width))
    })
}

proptest! {
    #[test]
    fn the_identity_changes_nothing((camera, image, depth) in anything(12), at in pose(3.0, 90.0)) {
        let warped = forward_warp(image.view(), &depth, &camera, &at, &camera, &at, &WarpConfig::default()).unwrap();
        prop_assert_eq!(&warped.view.mask, &depth.support());
        prop_assert_eq!(&warped.depth, &depth.mean());
        prop_assert_eq!(&warped.view.hypotheses[0], &depth);
        for ((row, column, channel), &colour) in warped.view.image.indexed_iter() {
            prop_assert!(depth.get(row, column).is_none() || colour == image[(row, column, channel)]);
        }
        let missing = depth.support().iter().filter(|&&known| !known).count();
        prop_assert_eq!(warped.hole_fraction, missing as f64 / warped.depth.len() as f64);
        prop_assert_eq!(warped.outside_fraction, 0.0);
    }

    /// A level surface moves by f B / z pixels: by whole pixels exactly, by parts of one as bilinear interpolation does.
    #[test]
    fn a_level_plane_moves_by_its_parallax(
        camera in pinhole_of(24, 16),
        image in image_of(16, 24),
        z in 0.5..8.0_f32,
        whole in -6..=6_i32,
        part in 0.0..1.0_f64,
    ) {
        let depth = gaussian(Array2::from_elem((16, 24), z), 0.04);
        let step = |pixels: f64| Pose::translation(-pixels * f64::from(z) / camera.fx, 0.0, 0.0);
        let moved = warp(&image, &depth, &camera, &step(f64::from(whole)));
        for ((row, column), &covered) in moved.view.mask.indexed_iter() {
            let from = column as i32 + whole;
            prop_assert_eq!(covered, (0..24).contains(&from));
            if covered {
                prop_assert_eq!(moved.depth[(row, column)], z);
                prop_assert_eq!(moved.view.image.slice(s![row, column, ..]), image.slice(s![row, from, ..]));
            }
        }
        let moved = warp(&image, &depth, &camera, &step(part));
        for row in 0..16 {
            for column in 0..23 {
                let [left, right] = [0, 1].map(|k| f64::from(image[(row, column + k, 1)]));
                let colour = f64::from(moved.view.image[(row, column, 1)]);
                assert_relative_eq!(colour, left + part * (right - left), epsilon = 1e-6);
            }
        }
    }

    /// The target has a camera of its own.
    #[test]
    fn planes_stay_planes(camera in pinhole_of(24, 20), other in pinhole_of(21, 15), plane in plane(), target in pose(0.1, 5.0)) {
        let (depth, image) = (gaussian(plane.map(&camera), 0.01), Array3::zeros((20, 24, 3)));
        let config = WarpConfig::default();
        let warped = forward_warp(image.view(), &depth, &camera, &Pose::identity(), &other, &target, &config).unwrap();
        prop_assert_eq!(warped.depth.dim(), (15, 21));
        prop_assert!(warped.view.mask.iter().any(|&covered| covered));
        // The whole plane was seen, so an empty pixel looks past the source. Its depth is that of an end of its gap, by which
        // it may be misjudged.
        let misjudged = warped.depth.indexed_iter().filter(|&(at, &z)| {
            let seen = |end: (usize, usize)| {
                let point = other.unproject(pixel(at.0, at.1), f64::from(warped.depth[end]));
                let inside = |p: Point2<f64>| (-0.5..23.5).contains(&p.x) && (-0.5..19.5).contains(&p.y);
                camera.project(&(target.inverse() * point)).is_some_and(inside)
            };
            z == 0.0 && ends(&warped.depth, at).into_iter().any(seen)
        });
        prop_assert!((warped.hole_fraction * 315.0).round() as usize <= misjudged.count());
        for ((row, column), &z) in warped.depth.indexed_iter().filter(|(_, z)| **z > 0.0) {
            let expected = plane.depth_from(&other, &target, pixel(row, column));
            assert_relative_eq!(f64::from(z), expected, max_relative = 1e-6);
        }
    }

    /// Every depth that comes out lies on one of the two levels, and has that level's colour; so has every filled pixel
    /// one of the two colours.
    #[test]
    fn two_surfaces_never_mix(camera in pinhole_of(20, 16), scene in two_planes(20, 16), target in pose(0.2, 5.0)) {
        let depth = gaussian(scene.depth(&camera), 0.01);
        let warped = warp(&scene.image(&camera), &depth, &camera, &target);
        for ((row, column), &z) in warped.depth.indexed_iter() {
            let colour = warped.view.image.slice(s![row, column, ..]).to_vec();
            if warped.view.mask[(row, column)] {
                let near = scene.level(&camera, &target, pixel(row, column), z);
                prop_assert!(near.is_some(), "depth {z} at {row}, {column} is on neither surface");
                prop_assert_eq!(colour, if near == Some(true) { RED } else { BLUE });
            } else {
                prop_assert!(colour == RED || colour == BLUE || colour == [0.0; 3], "filled with {colour:?}");
            }
        }
    }

    /// Behind an object the gap is f B (1/near - 1/far) wide; past the frame it is f B / far.
    #[test]
    fn gaps_have_their_analytic_width(
        near in 1.0..2.0_f32,
        ratio in 1.3..3.0_f32,
        shift in 0.0..14.0_f64,
        start in 18..30_usize,
    ) {
        let camera = PinholeCamera::from_fov(60.0, 64, 6).unwrap();
        let scene = TwoPlanes { near, far: near * ratio, rows: (0, 6), columns: (start, start + 10) };
        let depth = gaussian(scene.depth(&camera), 0.01);
        // The near surface moves left by `shift` pixels, the far one by less.
        let baseline = shift * f64::from(near) / camera.fx;
        let warped = warp(&scene.image(&camera), &depth, &camera, &Pose::translation(-baseline, 0.0, 0.0));
        let far_shift = camera.fx * baseline / f64::from(scene.far);
        let width = |fraction: f64| fraction * 64.0;
        prop_assert!((width(warped.hole_fraction) - (shift - far_shift)).abs() <= 1.0);
        prop_assert!((width(warped.outside_fraction) - far_shift).abs() <= 1.0);
        // What the gap is filled with is the far surface.
        let filled = warped.view.mask.indexed_iter().filter(|(_, m)| !**m).map(|(at, _)| at);
        for (row, column) in filled {
            prop_assert_eq!(warped.view.image.slice(s![row, column, ..]).to_vec(), BLUE);
        }
    }

    /// A pole one pixel wide is one pixel wide wherever it lands.
    #[test]
    fn thin_structures_stay(shift in 0.01..0.99_f64, column in 5..20_usize, lone_row in prop::option::of(1..7_usize)) {
        let camera = PinholeCamera::from_fov(60.0, 32, 8).unwrap();
        let rows = lone_row.map_or((0, 8), |row| (row, row + 1));
        let scene = TwoPlanes { near: 1.0, far: 2.0, rows, columns: (column, column + 1) };
        let target = Pose::translation(shift / camera.fx, 0.0, 0.0);
        let warped = warp(&scene.image(&camera), &gaussian(scene.depth(&camera), 0.01), &camera, &target);
        for row in rows.0..rows.1 {
            let near = warped.depth.row(row).iter().filter(|&&z| z == 1.0).count();
            prop_assert!(near == 1 || (near == 2 && (shift - 0.5).abs() < 1e-6), "{near} pixels in row {row}");
        }
    }

    #[test]
    fn every_empty_pixel_is_counted_once((camera, image, depth) in anything(10), target in pose(1.0, 60.0)) {
        let warped = warp(&image, &depth, &camera, &target);
        let empty = warped.view.mask.iter().filter(|&&covered| !covered).count() as f64 / warped.depth.len() as f64;
        assert_relative_eq!(warped.hole_fraction + warped.outside_fraction, empty, epsilon = 1e-12);
        prop_assert!(warped.view.validate().is_ok());
        prop_assert_eq!(&warped.view.mask, &warped.depth.mapv(|z| z > 0.0));
        prop_assert_eq!(&warped.view.mask, &warped.view.hypotheses[0].support());
        // Bilinear interpolation stays within the colours that there are.
        prop_assert!(warped.view.image.iter().all(|c| (0.0..=1.0).contains(c)));
    }
}

/// With nothing torn, the gap between two surfaces is a ramp: the tear threshold is what keeps them apart.
#[test]
fn an_untorn_mesh_does_mix() {
    let camera = PinholeCamera::from_fov(60.0, 32, 4).unwrap();
    let scene = TwoPlanes { near: 1.0, far: 2.0, rows: (0, 4), columns: (10, 20) };
    let (image, depth) = (scene.image(&camera), gaussian(scene.depth(&camera), 0.01));
    let target = Pose::translation(-6.0 / camera.fx, 0.0, 0.0);
    let config = WarpConfig { tear: 1.0 };
    let warped =
        forward_warp(image.view(), &depth, &camera, &Pose::identity(), &camera, &target, &config).unwrap();
    assert!(warped.depth.iter().any(|&z| z > 1.1 && z < 1.9));
    assert_eq!(warped.hole_fraction, 0.0);
}

#[test]
fn holes_are_filled_from_at_most_128_pixels_away() {
    let camera = PinholeCamera::from_fov(60.0, 1280, 1).unwrap();
    let scene = TwoPlanes { near: 1.0, far: 4.0, rows: (0, 1), columns: (400, 800) };
    let (image, depth) = (scene.image(&camera), gaussian(scene.depth(&camera), 0.01));
    let target = Pose::translation(-320.0 / camera.fx, 0.0, 0.0);
    let warped = warp(&image, &depth, &camera, &target);
    // The gap is columns 480 to 719, its far end at 720.
    for column in 480..=720 {
        let blue = if column >= 720 - 128 { 1.0 } else { 0.0 };
        assert_eq!(warped.view.image[(0, column, 2)], blue, "column {column}");
    }
    assert_eq!(warped.hole_fraction, 240.0 / 1280.0);
}

#[test]
fn errors_say_what_does_not_fit() {
    let camera = PinholeCamera::from_fov(60.0, 4, 3).unwrap();
    let (image, depth) = (Array3::<f32>::zeros((3, 4, 3)), gaussian(Array2::ones((3, 4)), 0.1));
    let (origin, config) = (Pose::identity(), WarpConfig::default());
    let run = |image: &Array3<f32>, depth: &GaussianDepth, pose: &Pose, config: &WarpConfig| {
        forward_warp(image.view(), depth, &camera, &origin, &camera, pose, config).unwrap_err()
    };
    let small = run(&image, &GaussianDepth::missing(2, 4), &origin, &config);
    assert!(matches!(&small, Error::Shape { what: "depth", .. }), "{small}");
    let grey = run(&Array3::zeros((3, 4, 1)), &depth, &origin, &config);
    assert!(grey.to_string().contains("[3, 4, 1]"), "{grey}");
    let nan = Pose::translation(f64::NAN, 0.0, 0.0);
    assert!(matches!(run(&image, &depth, &nan, &config), Error::Pose { which: "target" }));
    let torn = run(&image, &depth, &origin, &WarpConfig { tear: f64::NAN });
    assert!(matches!(torn, Error::Config(at) if at.field == "tear"));
}
