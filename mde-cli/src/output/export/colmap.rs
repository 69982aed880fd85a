//! COLMAP's text model of one camera, one picture and a thinned cloud.

use crate::several::cloud::RefinedView;
use std::fmt::Write as _;

/// About so many points are written: enough to align or to start splats from.
const POINTS: usize = 20_000;
/// COLMAP's pixel centres are at halves, ours at integers.
const HALF: f64 = 0.5;

/// Names and texts of `cameras.txt`, `images.txt` and `points3D.txt`.
pub(crate) fn files(scene: &RefinedView<'_>) -> [(&'static str, String); 3] {
    let camera = scene.camera;
    let cameras = format!(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, fx, fy, cx, cy\n1 PINHOLE {} {} {} {} {} {}\n",
        camera.width,
        camera.height,
        camera.fx,
        camera.fy,
        camera.cx + HALF,
        camera.cy + HALF
    );
    let (rows, columns) = scene.depth.dim();
    let step = ((rows * columns) as f64 / POINTS as f64).sqrt().ceil().max(1.0) as usize;
    let mut seen = Vec::new();
    let mut points = String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, (IMAGE_ID, POINT2D_IDX)\n");
    for row in (step / 2..rows).step_by(step) {
        for column in (step / 2..columns).step_by(step) {
            let Some(point) = scene.point(row, column) else { continue };
            let (index, [r, g, b]) = (seen.len(), scene.colour(row, column));
            let (id, [x, y, z]) = (index + 1, [point.x, point.y, point.z]);
            let _ = writeln!(points, "{id} {x:.6} {y:.6} {z:.6} {r} {g} {b} 0 1 {index}");
            seen.push(format!("{} {} {id}", column as f64 + HALF, row as f64 + HALF));
        }
    }
    let images = format!(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then (X, Y, POINT3D_ID)\n\
         1 1 0 0 0 0 0 0 1 {}\n{}\n",
        super::IMAGE,
        seen.join(" ")
    );
    [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", points)]
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
