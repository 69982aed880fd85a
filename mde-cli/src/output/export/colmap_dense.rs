//! COLMAP's dense workspace: what its `stereo_fusion` and meshers read.

use super::colmap::{POINTS, SparsePoint, model};
use super::subfolder;
use crate::error::Result;
use crate::several::cloud::{ConsistentPoint, RefinedView, seen};
use mde_prior::photo::write_image;
use mde_prior::write_atomic;
use rayon::prelude::*;
use std::path::Path;

/// The workspace's folder.
pub const FOLDER: &str = "colmap";
/// The photographs to fuse, from [`FOLDER`]'s parent; written last, and nothing is fused without it.
pub const LIST: &str = "colmap/stereo/fusion.cfg";
/// Largest sigma over depth of a pixel that is written. COLMAP fuses depths that differ by 1 % at most; with this sigma one pair in nine
/// does so by chance.
const VAGUE: f32 = 0.05;

/// Writes the workspace into [`FOLDER`]: the photographs as they were refined, named after their folders, their poses, depths and normals,
/// and a subset of the `points`. Their tracks tell COLMAP which photographs overlap.
///
/// # Errors
/// [`Error::Prior`](crate::error::Error::Prior) or [`Error::External`](crate::error::Error::External) for a file that can't be written.
pub(crate) fn write(folder: &Path, views: &[RefinedView<'_>], points: &[ConsistentPoint]) -> Result<()> {
    let place = |name: &str| subfolder(folder, &format!("{FOLDER}/{name}"));
    let (images, sparse) = (place("images")?, place("sparse")?);
    let (depths, normals) = (place("stereo/depth_maps")?, place("stereo/normal_maps")?);
    let named: Vec<_> = views.iter().map(|view| (format!("{}.png", view.folder), *view)).collect();
    named.par_iter().try_for_each(|(name, view)| -> Result<()> {
        let [depth, normal] = maps(view);
        let file = format!("{name}.geometric.bin");
        write_atomic(&depths.join(&file), &depth)?;
        write_atomic(&normals.join(&file), &normal)?;
        Ok(write_image(images.join(name), view.image)?)
    })?;
    for (name, text) in model(&named, &tracks(views, points)) {
        write_atomic(&sparse.join(name), text.as_bytes())?;
    }
    let lines = |more: &str| named.iter().map(|(name, _)| format!("{name}\n{more}")).collect::<String>();
    // As COLMAP's undistorter writes it: the 20 photographs that share most points.
    write_atomic(&folder.join(FOLDER).join("stereo/patch-match.cfg"), lines("__auto__, 20\n").as_bytes())?;
    Ok(write_atomic(&folder.join(LIST), lines("").as_bytes())?)
}

/// Each of some points with every photograph that confirms it.
fn tracks(views: &[RefinedView<'_>], points: &[ConsistentPoint]) -> Vec<SparsePoint> {
    let track = |point: &ConsistentPoint| {
        let [row, column] = point.pixel;
        let own = &views[point.view];
        let relative = point.sigma / own.depth[(row, column)];
        let others = views.iter().enumerate().filter(|(index, _)| *index != point.view);
        let others = others.filter_map(|(index, view)| Some((index, seen(view, &point.position, relative)?)));
        SparsePoint {
            position: point.position,
            colour: own.colour(row, column),
            seen: [(point.view, (row, column))].into_iter().chain(others).collect(),
        }
    };
    points.iter().step_by(points.len().div_ceil(POINTS).max(1)).map(track).collect()
}

/// Depths, and unit normals in the frame of the camera; both 0 where one is missing or vague.
fn maps(view: &RefinedView<'_>) -> [Vec<u8>; 2] {
    let (height, width) = view.depth.dim();
    let mut depths = vec![0.0; height * width];
    let mut normals = vec![0.0; 3 * height * width];
    for (place, ((row, column), &depth)) in view.depth.indexed_iter().enumerate() {
        let Some(point) = view.point(row, column) else { continue };
        let normal = view.normal(row, column, point);
        if view.sigma[(row, column)] > VAGUE * depth || normal.norm_squared() == 0.0 {
            continue;
        }
        depths[place] = depth;
        for (channel, value) in normal.iter().enumerate() {
            normals[channel * height * width + place] = *value as f32;
        }
    }
    [mat([width, height, 1], &depths), mat([width, height, 3], &normals)]
}

/// COLMAP's `Mat<float>`: sizes as text, then the channels one after the other, row by row.
fn mat([width, height, channels]: [usize; 3], values: &[f32]) -> Vec<u8> {
    let mut bytes = format!("{width}&{height}&{channels}&").into_bytes();
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::several::cloud::consistent_points;
    use mde_warp::{PinholeCamera, Pose};
    use nalgebra::{Point2, Vector3};
    use ndarray::{Array2, Array3};
    use proptest::prelude::*;
    use std::fs;

    const SIZE: (usize, usize) = (12, 16);

    fn camera() -> PinholeCamera {
        PinholeCamera::from_fov(60.0, SIZE.1, SIZE.0).unwrap()
    }

    /// Calls `test` with views of a wall at depth 2, `step` pixels apart.
    fn with_wall(count: usize, step: f64, test: impl FnOnce(&[RefinedView<'_>])) {
        let (depth, sigma) = (Array2::from_elem(SIZE, 2.0), Array2::from_elem(SIZE, 0.05));
        let image = Array3::from_elem((SIZE.0, SIZE.1, 3), 0.5);
        let folders: Vec<String> = (0..count).map(|index| format!("photo-{index}")).collect();
        let views = folders.iter().enumerate().map(|(index, folder)| RefinedView {
            folder,
            image: image.view(),
            camera: camera(),
            pose: Pose::translation(-step * index as f64 * 2.0 / camera().fx, 0.0, 0.0),
            depth: depth.view(),
            sigma: sigma.view(),
            png_scale: 1000.0,
        });
        test(&views.collect::<Vec<_>>());
    }

    /// Sizes and values of a file of COLMAP's matrices.
    fn read(bytes: &[u8]) -> ([usize; 3], Vec<f32>) {
        let ends: Vec<usize> = (0..bytes.len()).filter(|&i| bytes[i] == b'&').take(3).collect();
        let text = std::str::from_utf8(&bytes[..ends[2]]).unwrap();
        let sizes: Vec<usize> = text.split('&').map(|number| number.parse().unwrap()).collect();
        let values = bytes[ends[2] + 1..].chunks_exact(4).map(|v| f32::from_le_bytes(v.try_into().unwrap()));
        (sizes.try_into().unwrap(), values.collect())
    }

    #[test]
    fn a_workspace_has_the_maps_and_each_point_in_all_photographs_that_show_it() {
        let place = tempfile::tempdir().unwrap();
        with_wall(3, 2.0, |views| write(place.path(), views, &consistent_points(views)).unwrap());
        let file = |name: &str| place.path().join(FOLDER).join(name);
        let text = |name: &str| fs::read_to_string(file(name)).unwrap();
        assert_eq!(text("stereo/fusion.cfg"), "photo-0.png\nphoto-1.png\nphoto-2.png\n");
        assert!(text("stereo/patch-match.cfg").starts_with("photo-0.png\n__auto__, 20\nphoto-1.png\n"));
        for (folder, channels) in [("depth_maps", 1), ("normal_maps", 3)] {
            let bytes = fs::read(file(&format!("stereo/{folder}/photo-1.png.geometric.bin"))).unwrap();
            let (sizes, values) = read(&bytes);
            let area = SIZE.0 * SIZE.1;
            assert_eq!((sizes, values.len()), ([SIZE.1, SIZE.0, channels], channels * area));
            let last = if channels == 1 { 2.0 } else { -1.0 };
            assert!(values[values.len() - area..].iter().all(|value| *value == last), "{folder}");
        }
        assert!(file("images/photo-2.png").is_file());

        // Every observation is where the point projects to, half a pixel further than with centres at integers.
        let images = text("sparse/images.txt");
        let rows: Vec<Vec<f64>> = images.lines().skip(2).step_by(2).map(numbers).collect();
        let (mut tracks, camera) = (0, camera());
        for line in text("sparse/points3D.txt").lines().skip(1).map(numbers) {
            tracks += line[8..].len() / 2;
            for seen in line[8..].chunks_exact(2) {
                let (view, place) = (seen[0] as usize - 1, 3 * seen[1] as usize);
                let moved = 2.0 * view as f64;
                let x = camera.fx * line[1] / line[3] + camera.cx + 0.5 - moved;
                let y = camera.fy * line[2] / line[3] + camera.cy + 0.5;
                let found = &rows[view][place..place + 3];
                assert!((found[0] - x).abs() < 1e-4 && (found[1] - y).abs() < 1e-4, "{found:?} {line:?}");
                assert_eq!(found[2], line[0]);
            }
        }
        assert_eq!(tracks, rows.iter().map(|row| row.len() / 3).sum::<usize>());
        // The first sees all but four columns of what the third does.
        assert!(tracks >= 3 * SIZE.0 * (SIZE.1 - 4), "{tracks}");
    }

    fn numbers(line: &str) -> Vec<f64> {
        line.split(' ').map(|word| word.parse().unwrap()).collect()
    }

    #[test]
    fn a_vague_or_missing_pixel_has_neither_depth_nor_normal() {
        with_wall(1, 0.0, |views| {
            let mut sigma = views[0].sigma.to_owned();
            (sigma[(3, 4)], sigma[(5, 6)], sigma[(7, 8)]) = (0.11, f32::INFINITY, 0.09);
            let [depth, normal] = maps(&RefinedView { sigma: sigma.view(), ..views[0] });
            let ((_, depth), (_, normal)) = (read(&depth), read(&normal));
            let zero: Vec<usize> = (0..depth.len()).filter(|&i| depth[i] == 0.0).collect();
            assert_eq!(zero, [3 * SIZE.1 + 4, 5 * SIZE.1 + 6]);
            assert!(zero.iter().all(|place| normal[2 * SIZE.0 * SIZE.1 + place] == 0.0));
        });
    }

    proptest! {
        /// A plane's normals are its own, towards the camera.
        #[test]
        fn normals_of_a_plane(x in -0.5..0.5_f64, y in -0.5..0.5_f64, distance in 0.1..100.0_f64) {
            let plane = Vector3::new(x, y, -1.0).normalize();
            let depth = Array2::from_shape_fn(SIZE, |(row, column)| {
                let ray = camera().unproject(Point2::new(column as f64, row as f64), 1.0);
                (-distance / plane.dot(&ray.coords)) as f32
            });
            let sigma = depth.mapv(|z| 0.01 * z);
            with_wall(1, 0.0, |views| {
                let view = RefinedView { depth: depth.view(), sigma: sigma.view(), ..views[0] };
                let (_, values) = read(&maps(&view)[1]);
                let (area, mut worst) = (SIZE.0 * SIZE.1, 0.0_f64);
                for place in 0..area {
                    let found = Vector3::from_fn(|c, _| f64::from(values[c * area + place]));
                    worst = worst.max((found - plane).norm());
                }
                assert!(worst < 1e-3, "{worst}");
            });
        }
    }
}
