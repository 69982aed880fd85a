//! COLMAP's files of depth maps: the model of photographs with the thinned cloud of one, and the dense workspace of a capture.

use super::{ColmapPoint, Frame, colmap_map, colmap_text};
use crate::cloud::{ConsistentPoint, DepthView, seen};
use ndarray::Array3;
use rayon::prelude::*;

/// The photographs to fuse, a file of the workspace; written last, and nothing is fused without it.
pub const COLMAP_FUSION: &str = "stereo/fusion.cfg";
/// About so many points are written: enough to align or to start splats from.
const POINTS: usize = 20_000;
/// Largest sigma over depth of a pixel that is written. COLMAP fuses depths that differ by 1 % at most; with this sigma one pair in nine
/// does so by chance.
const VAGUE: f32 = 0.05;

/// Names and texts of the files of a model of some photographs with about 20,000 points of the first, whose maps `view` has.
pub fn colmap_view(view: &DepthView<'_>, photographs: &[Frame]) -> [(&'static str, String); 3] {
    let (rows, columns) = view.depth.dim();
    let step = ((rows * columns) as f64 / POINTS as f64).sqrt().ceil().max(1.0) as usize;
    let places = |side: usize| (step / 2..side).step_by(step);
    let pixels = places(rows).flat_map(|row| places(columns).map(move |column| [row, column]));
    let points = pixels.filter_map(|pixel @ [row, column]| {
        let (position, colour) = (view.point(row, column)?, view.colour(row, column));
        Some(ColmapPoint { position, colour, seen: vec![(0, pixel)] })
    });
    colmap_text(photographs, &points.collect::<Vec<_>>())
}

/// The files of a dense workspace for COLMAP's `stereo_fusion`, given to `write` by their paths within it: poses, depths, normals, and about
/// 20,000 of the `points`, whose tracks tell COLMAP which photographs overlap. The photographs themselves, with the names that stand beside
/// the views, belong into its folder `images`. Maps are given side by side, [`COLMAP_FUSION`] comes last.
///
/// # Errors
/// The first of `write`, which ends the work.
pub fn colmap_workspace<E: Send>(
    views: &[(DepthView<'_>, String)],
    points: &[ConsistentPoint],
    write: impl Fn(&str, &[u8]) -> Result<(), E> + Sync,
) -> Result<(), E> {
    views.par_iter().try_for_each(|(view, name)| {
        let [depth, normal] = maps(view);
        write(&format!("stereo/depth_maps/{name}.geometric.bin"), &colmap_map(depth.view()))?;
        write(&format!("stereo/normal_maps/{name}.geometric.bin"), &colmap_map(normal.view()))
    })?;
    let frames: Vec<_> = views.iter().map(|(view, name)| Frame::new(view.camera, view.pose, name)).collect();
    for (name, text) in colmap_text(&frames, &tracks(views, points)) {
        // The second is where trainers of splats look.
        for folder in ["sparse", "sparse/0"] {
            write(&format!("{folder}/{name}"), text.as_bytes())?;
        }
    }
    let lines = |more: &str| views.iter().map(|(_, name)| format!("{name}\n{more}")).collect::<String>();
    // As COLMAP's undistorter writes it: the 20 photographs that share most points.
    write("stereo/patch-match.cfg", lines("__auto__, 20\n").as_bytes())?;
    write(COLMAP_FUSION, lines("").as_bytes())
}

/// Each of some points with every photograph that confirms it.
fn tracks(views: &[(DepthView<'_>, String)], points: &[ConsistentPoint]) -> Vec<ColmapPoint> {
    let track = |point: &ConsistentPoint| {
        let pixel @ [row, column] = point.pixel;
        let own = &views[point.view].0;
        let relative = point.sigma / own.depth[pixel];
        let others = views.iter().enumerate().filter(|(index, _)| *index != point.view);
        let others = others.filter_map(|(index, (view, _))| {
            Some((index, seen(view, &point.position, relative, f32::INFINITY)?.into()))
        });
        ColmapPoint {
            position: point.position,
            colour: own.colour(row, column),
            seen: std::iter::once((point.view, pixel)).chain(others).collect(),
        }
    };
    points.iter().step_by(points.len().div_ceil(POINTS).max(1)).map(track).collect()
}

/// Depths, and unit normals in the frame of the camera, `[channels, height, width]`; both 0 where one is missing or vague.
fn maps(view: &DepthView<'_>) -> [Array3<f32>; 2] {
    let (height, width) = view.depth.dim();
    let [mut depths, mut normals] = [1, 3].map(|channels| Array3::zeros((channels, height, width)));
    for ((row, column), &depth) in view.depth.indexed_iter() {
        let Some(point) = view.point(row, column) else { continue };
        let normal = view.normal(row, column, point);
        if view.sigma[(row, column)] > VAGUE * depth || normal.norm_squared() == 0.0 {
            continue;
        }
        depths[(0, row, column)] = depth;
        for (channel, value) in normal.iter().enumerate() {
            normals[(channel, row, column)] = *value as f32;
        }
    }
    [depths, normals]
}

#[cfg(all(test, feature = "surface"))]
mod tests {
    use super::*;
    use crate::capture::{KnownDepth, read_colmap, read_colmap_depths};
    use crate::cloud::consistent_points;
    use crate::export::tests::{SIZE, with_plane};
    use mde_warp::Pose;
    use nalgebra::{Point2, Vector3};
    use ndarray::{Array2, Axis};
    use proptest::prelude::*;
    use std::fs;
    use std::path::Path;

    #[test]
    fn every_point_of_a_photograph_is_at_its_pixel() {
        let place = tempfile::tempdir().unwrap();
        with_plane(|view| {
            let files = colmap_view(view, &[Frame::new(view.camera, view.pose, "image.png")]);
            files.iter().for_each(|(name, text)| fs::write(place.path().join(name), text).unwrap());
            let (size, found) = read_colmap_depths(place.path(), "image.png").unwrap();
            assert_eq!((size, found.len()), (SIZE, SIZE.0 * SIZE.1 - 1));
            for KnownDepth { x, y, depth, .. } in found {
                let (pixel, near) = (Point2::new(x, y), Point2::new(x.round(), y.round()));
                assert!((pixel - near).norm() < 1e-4, "{pixel}");
                assert!((view.depth[(near.y as usize, near.x as usize)] - depth as f32).abs() < 1e-4);
            }
        });
    }

    #[test]
    fn a_workspace_has_the_maps_and_each_point_in_all_photographs_that_show_it() {
        let place = tempfile::tempdir().unwrap();
        let (depth, sigma) = (Array2::from_elem(SIZE, 2.0), Array2::from_elem(SIZE, 0.05));
        with_plane(|view| {
            // Of a wall, a pixel apart.
            let map = |shift: f64| DepthView {
                pose: Pose::translation(-shift * 2.0 / view.camera.fx, 0.0, 0.0),
                depth: depth.view(),
                sigma: sigma.view(),
                ..*view
            };
            let maps = [map(0.0), map(1.0), map(2.0)];
            let named = maps.iter().zip(0..).map(|(map, index)| (*map, format!("photo-{index}.png")));
            let write = |name: &str, bytes: &[u8]| {
                let path = place.path().join(name);
                fs::create_dir_all(path.parent().unwrap())?;
                fs::write(path, bytes)
            };
            colmap_workspace(&named.collect::<Vec<_>>(), &consistent_points(&maps), write).unwrap();
        });
        let file = |name: &str| place.path().join(name);
        let text = |name: &str| fs::read_to_string(file(name)).unwrap();
        assert_eq!(text("stereo/fusion.cfg"), "photo-0.png\nphoto-1.png\nphoto-2.png\n");
        assert!(text("stereo/patch-match.cfg").starts_with("photo-0.png\n__auto__, 20\nphoto-1.png\n"));
        for (folder, head, value) in [("depth_maps", "8&6&1&", 2.0_f32), ("normal_maps", "8&6&3&", -1.0)] {
            let bytes = fs::read(file(&format!("stereo/{folder}/photo-1.png.geometric.bin"))).unwrap();
            assert!(bytes.starts_with(head.as_bytes()) && bytes.ends_with(&value.to_le_bytes()), "{folder}");
        }
        let size = |path: &Path| path.starts_with(file("images")).then_some([SIZE.1, SIZE.0]);
        let read = read_colmap(&file("sparse"), &file("images"), &size).unwrap();
        // The first photograph shows all but two columns of what the third does.
        let in_all = read.points.iter().filter(|point| point.frames.len() == 3).count();
        assert_eq!((read.frames.len(), in_all), (3, SIZE.0 * (SIZE.1 - 2)));
    }

    proptest! {
        /// A plane's normals are its own, towards the camera; a vague or missing pixel has neither depth nor normal.
        #[test]
        fn only_a_sure_pixel_has_depth_and_normal(x in -0.5..0.5_f64, y in -0.5..0.5_f64, far in 0.1..100.0_f64) {
            let plane = Vector3::new(x, y, -1.0).normalize();
            with_plane(|view| {
                let depth = Array2::from_shape_fn(SIZE, |(row, column)| {
                    let ray = view.camera.unproject(Point2::new(column as f64, row as f64), 1.0);
                    (-far / plane.dot(&ray.coords)) as f32
                });
                let (mut sigma, mut expected) = (0.02 * &depth, depth.clone());
                (sigma[(4, 5)], sigma[(2, 3)]) = (0.11 * depth[(4, 5)], f32::INFINITY);
                (expected[(4, 5)], expected[(2, 3)]) = (0.0, 0.0);
                let [found, normal] = maps(&DepthView { depth: depth.view(), sigma: sigma.view(), ..*view });
                assert_eq!(found.index_axis(Axis(0), 0), expected);
                for (at, z) in expected.indexed_iter() {
                    let normal = Vector3::from_fn(|channel, _| f64::from(normal[(channel, at.0, at.1)]));
                    let expected = if *z > 0.0 { plane } else { Vector3::zeros() };
                    assert!((normal - expected).norm() < 1e-3, "{at:?}: {normal}");
                }
            });
        }
    }
}
