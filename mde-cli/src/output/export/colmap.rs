//! COLMAP's text model: one camera, one picture and a thinned cloud, or those of a whole capture.

use crate::several::cloud::RefinedView;
use nalgebra::Point3;
use std::fmt::Write as _;

/// About so many points are written: enough to align or to start splats from.
pub(super) const POINTS: usize = 20_000;
/// COLMAP's pixel centres are at halves, ours at integers.
const HALF: f64 = 0.5;

/// A point of the model.
pub(super) struct SparsePoint {
    pub(super) position: Point3<f64>,
    pub(super) colour: [u8; 3],
    /// Views that show it, with row and column.
    pub(super) seen: Vec<(usize, (usize, usize))>,
}

/// Names and texts of `cameras.txt`, `images.txt` and `points3D.txt` of a photograph.
pub(crate) fn files(scene: &RefinedView<'_>) -> [(&'static str, String); 3] {
    let (rows, columns) = scene.depth.dim();
    let step = ((rows * columns) as f64 / POINTS as f64).sqrt().ceil().max(1.0) as usize;
    let pixels = (step / 2..rows)
        .step_by(step)
        .flat_map(|row| (step / 2..columns).step_by(step).map(move |column| (row, column)));
    let point = |pixel: (usize, usize)| {
        let position = scene.point(pixel.0, pixel.1)?;
        Some(SparsePoint { position, colour: scene.colour(pixel.0, pixel.1), seen: vec![(0, pixel)] })
    };
    model(&[(super::IMAGE.to_owned(), *scene)], &pixels.filter_map(point).collect::<Vec<_>>())
}

/// The same files of several views with the names of their pictures.
pub(super) fn model(
    views: &[(String, RefinedView<'_>)],
    points: &[SparsePoint],
) -> [(&'static str, String); 3] {
    let mut cameras = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, fx, fy, cx, cy\n");
    let mut images =
        String::from("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then (X, Y, POINT3D_ID)\n");
    let mut cloud = String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, (IMAGE_ID, POINT2D_IDX)\n");
    let mut seen = vec![Vec::new(); views.len()];
    for (id, point) in (1..).zip(points) {
        let ([x, y, z], [r, g, b]) = (point.position.coords.into(), point.colour);
        let _ = write!(cloud, "{id} {x:.6} {y:.6} {z:.6} {r} {g} {b} 0");
        for &(view, (row, column)) in &point.seen {
            let _ = write!(cloud, " {} {}", view + 1, seen[view].len());
            seen[view].push(format!("{} {} {id}", column as f64 + HALF, row as f64 + HALF));
        }
        cloud.push('\n');
    }
    for (id, ((name, view), seen)) in (1..).zip(views.iter().zip(seen)) {
        let (camera, pose) = (view.camera, view.pose);
        let _ = writeln!(
            cameras,
            "{id} PINHOLE {} {} {} {} {} {}",
            camera.width,
            camera.height,
            camera.fx,
            camera.fy,
            camera.cx + HALF,
            camera.cy + HALF
        );
        let (q, t) = (pose.rotation, pose.translation);
        let _ = writeln!(
            images,
            "{id} {} {} {} {} {} {} {} {id} {name}\n{}",
            q.w,
            q.i,
            q.j,
            q.k,
            t.x,
            t.y,
            t.z,
            seen.join(" ")
        );
    }
    [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", cloud)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::export::tests::{SIZE, with_plane};

    fn lines(text: &str) -> Vec<Vec<f64>> {
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        lines.map(|line| line.split(' ').filter_map(|word| word.parse().ok()).collect()).collect()
    }

    #[test]
    fn every_point_projects_to_its_pixel() {
        with_plane(|scene| {
            let [(_, cameras), (_, images), (_, points)] = files(scene);
            let [id, width, height, fx, fy, cx, cy] = lines(&cameras)[0][..] else { panic!("{cameras}") };
            assert_eq!((id, width, height), (1.0, SIZE.1 as f64, SIZE.0 as f64));
            let images = lines(&images);
            assert_eq!(images[0], [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
            let (seen, points) = (&images[1], lines(&points));
            assert_eq!((seen.len(), points.len()), (3 * (SIZE.0 * SIZE.1 - 1), SIZE.0 * SIZE.1 - 1));
            for (place, point) in seen.chunks(3).zip(&points) {
                let [id, x, y, z] = point[..4] else { panic!("{point:?}") };
                assert!((fx * x / z + cx - place[0]).abs() < 1e-4, "{place:?} {point:?}");
                assert!((fy * y / z + cy - place[1]).abs() < 1e-4, "{place:?} {point:?}");
                assert_eq!((place[2], point[9]), (id, id - 1.0));
            }
        });
    }
}
