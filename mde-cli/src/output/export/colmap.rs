//! COLMAP's models: of one photograph with a thinned cloud, and the dense workspace of a capture.

use super::{IMAGE, RefinedView, frame, subfolder};
use crate::error::Result;
use mde_mvs::capture::{ColmapPoint, Frame, colmap_map, colmap_text};
use mde_mvs::cloud::{ConsistentPoint, DepthView, seen};
use mde_prior::photo::write_image;
use mde_prior::write_atomic;
use ndarray::Array3;
use rayon::prelude::*;
use std::path::Path;

/// The folder of the model or the workspace.
pub const FOLDER: &str = "colmap";
/// The photographs to fuse, from [`FOLDER`]'s parent; written last, and nothing is fused without it.
pub const LIST: &str = "colmap/stereo/fusion.cfg";
/// About so many points are written: enough to align or to start splats from.
const POINTS: usize = 20_000;
/// Largest sigma over depth of a pixel that is written. COLMAP fuses depths that differ by 1 % at most; with this sigma one pair in nine
/// does so by chance.
const VAGUE: f32 = 0.05;

/// Writes a photograph and its model, in the frame of its camera.
pub(crate) fn write(folder: &Path, view: &DepthView<'_>) -> Result<()> {
    let (rows, columns) = view.depth.dim();
    let step = ((rows * columns) as f64 / POINTS as f64).sqrt().ceil().max(1.0) as usize;
    let places = |side: usize| (step / 2..side).step_by(step);
    let pixels = places(rows).flat_map(|row| places(columns).map(move |column| [row, column]));
    let points = pixels.filter_map(|pixel @ [row, column]| {
        let (position, colour) = (view.point(row, column)?, view.colour(row, column));
        Some(ColmapPoint { position, colour, seen: vec![(0, pixel)] })
    });
    write_model(folder, "sparse/0", &[frame(view, IMAGE.into())], &points.collect::<Vec<_>>())?;
    Ok(write_image(subfolder(folder, "colmap/images")?.join(IMAGE), view.image)?)
}

/// Writes the workspace: the photographs as they were refined, named after their folders, their poses, depths and normals, and a subset of
/// the `points`. Their tracks tell COLMAP which photographs overlap.
pub(crate) fn write_dense(
    folder: &Path,
    views: &[RefinedView<'_>],
    points: &[ConsistentPoint],
) -> Result<()> {
    let place = |name: &str| subfolder(folder, &format!("{FOLDER}/{name}"));
    let (images, stereo) = (place("images")?, place("stereo")?);
    let (depths, normals) = (place("stereo/depth_maps")?, place("stereo/normal_maps")?);
    let names: Vec<_> = views.iter().map(|view| format!("{}.png", view.folder)).collect();
    names.par_iter().zip(views).try_for_each(|(name, view)| -> Result<()> {
        let [depth, normal] = maps(&view.map);
        let file = format!("{name}.geometric.bin");
        write_atomic(&depths.join(&file), &colmap_map(depth.view()))?;
        write_atomic(&normals.join(&file), &colmap_map(normal.view()))?;
        Ok(write_image(images.join(name), view.map.image)?)
    })?;
    let frames: Vec<_> = views.iter().zip(&names).map(|(view, name)| frame(&view.map, name.into())).collect();
    write_model(folder, "sparse", &frames, &tracks(views, points))?;
    let lines = |more: &str| names.iter().map(|name| format!("{name}\n{more}")).collect::<String>();
    // As COLMAP's undistorter writes it: the 20 photographs that share most points.
    write_atomic(&stereo.join("patch-match.cfg"), lines("__auto__, 20\n").as_bytes())?;
    Ok(write_atomic(&folder.join(LIST), lines("").as_bytes())?)
}

fn write_model(folder: &Path, inside: &str, frames: &[Frame], points: &[ColmapPoint]) -> Result<()> {
    let model = subfolder(folder, &format!("{FOLDER}/{inside}"))?;
    for (name, text) in colmap_text(frames, points) {
        write_atomic(&model.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// Each of some points with every photograph that confirms it.
fn tracks(views: &[RefinedView<'_>], points: &[ConsistentPoint]) -> Vec<ColmapPoint> {
    let track = |point: &ConsistentPoint| {
        let pixel @ [row, column] = point.pixel;
        let own = &views[point.view].map;
        let relative = point.sigma / own.depth[pixel];
        let others = views.iter().enumerate().filter(|(index, _)| *index != point.view);
        let others = others
            .filter_map(|(index, view)| Some((index, seen(&view.map, &point.position, relative)?.into())));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::export::tests::{SIZE, with_plane};
    use mde_mvs::capture::{read_colmap, read_colmap_depths};
    use mde_mvs::cloud::consistent_points;
    use mde_warp::Pose;
    use nalgebra::{Point2, Vector3};
    use ndarray::{Array2, Axis};
    use proptest::prelude::*;
    use std::fs;

    #[test]
    fn every_point_of_a_photograph_is_at_its_pixel() {
        let place = tempfile::tempdir().unwrap();
        with_plane(|view| {
            write(place.path(), view).unwrap();
            let found = read_colmap_depths(&place.path().join("colmap/sparse/0"), IMAGE).unwrap();
            assert_eq!((found.size, found.depths.len()), ([SIZE.1, SIZE.0], SIZE.0 * SIZE.1 - 1));
            for (pixel, depth) in found.depths {
                let near = pixel.map(f64::round);
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
            let named = maps.iter().zip(["photo-0", "photo-1", "photo-2"]);
            let views: Vec<_> =
                named.map(|(map, folder)| RefinedView { map: *map, folder, png_scale: 1000.0 }).collect();
            write_dense(place.path(), &views, &consistent_points(&maps)).unwrap();
        });
        let file = |name: &str| place.path().join(FOLDER).join(name);
        let text = |name: &str| fs::read_to_string(file(name)).unwrap();
        assert_eq!(text("stereo/fusion.cfg"), "photo-0.png\nphoto-1.png\nphoto-2.png\n");
        assert!(text("stereo/patch-match.cfg").starts_with("photo-0.png\n__auto__, 20\nphoto-1.png\n"));
        for (folder, head, value) in [("depth_maps", "8&6&1&", 2.0_f32), ("normal_maps", "8&6&3&", -1.0)] {
            let bytes = fs::read(file(&format!("stereo/{folder}/photo-1.png.geometric.bin"))).unwrap();
            assert!(bytes.starts_with(head.as_bytes()) && bytes.ends_with(&value.to_le_bytes()), "{folder}");
        }
        let size = |path: &Path| path.is_file().then_some([SIZE.1, SIZE.0]);
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
