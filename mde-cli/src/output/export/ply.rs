//! Binary PLY: points with colour, normal and sigma.

use crate::output::export::Exported;
use nalgebra::{Point3, Vector3};

pub(super) fn encode(scene: &Exported<'_>) -> Vec<u8> {
    let (rows, columns) = scene.depth.dim();
    let mut cloud = Cloud::default();
    for row in 0..rows {
        for column in 0..columns {
            let Some(point) = scene.point(row, column) else { continue };
            let normal = normal(scene, row, column, point);
            let sigma = scene.depth.variance()[(row, column)].sqrt();
            cloud.push(point, normal, scene.colour(row, column), sigma);
        }
    }
    cloud.encode("camera frame", scene.unit)
}

/// Points with normal, colour and sigma; x right, y down, z forward.
#[derive(Default)]
pub struct Cloud {
    bytes: Vec<u8>,
    count: usize,
}

impl Cloud {
    /// Adds a point with its unit normal and the standard deviation of its depth.
    pub fn push(&mut self, point: Point3<f64>, normal: Vector3<f64>, colour: [u8; 3], sigma: f32) {
        let numbers = point.coords.iter().chain(&normal).map(|v| *v as f32);
        numbers.for_each(|number| self.bytes.extend(number.to_le_bytes()));
        self.bytes.extend(colour);
        self.bytes.extend(sigma.to_le_bytes());
        self.count += 1;
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The file.
    pub fn encode(self, frame: &str, unit: &str) -> Vec<u8> {
        let header = format!(
            "ply\nformat binary_little_endian 1.0\n\
             comment {frame}: x right, y down, z forward; unit: {unit}; sigma is the depth's standard deviation\n\
             element vertex {}\n\
             property float x\nproperty float y\nproperty float z\n\
             property float nx\nproperty float ny\nproperty float nz\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\n\
             property float sigma\nend_header\n",
            self.count
        );
        [header.into_bytes(), self.bytes].concat()
    }
}

/// The surface's unit normal, towards the camera; 0 where no neighbour is known.
pub fn normal(scene: &Exported<'_>, row: usize, column: usize, point: Point3<f64>) -> Vector3<f64> {
    let at = |row: Option<usize>, column: Option<usize>| scene.point(row?, column?);
    let (row, column) = (Some(row), Some(column));
    let along = |before: Option<Point3<f64>>, after: Option<Point3<f64>>| {
        let steps = [before.map(|p| point - p), after.map(|p| p - point)];
        // The neighbour nearer in depth lies on the same surface.
        steps.into_iter().flatten().min_by(|a, b| a.z.abs().total_cmp(&b.z.abs()))
    };
    let less = |index: Option<usize>| index?.checked_sub(1);
    let more = |index: Option<usize>| Some(index? + 1);
    let right = along(at(row, less(column)), at(row, more(column)));
    let down = along(at(less(row), column), at(more(row), column));
    let (Some(right), Some(down)) = (right, down) else { return Vector3::zeros() };
    let normal = down.cross(&right).try_normalize(0.0).unwrap_or_default();
    if normal.dot(&point.coords) > 0.0 { -normal } else { normal }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::export::tests::{SIZE, with_plane};

    #[test]
    fn a_planes_points_lie_on_it_and_their_normals_face_the_camera() {
        with_plane(|scene| {
            let bytes = encode(scene);
            let end = b"end_header\n";
            let start = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
            let header = std::str::from_utf8(&bytes[..start]).unwrap();
            let count = SIZE.0 * SIZE.1 - 1;
            assert!(header.contains(&format!("element vertex {count}\n")), "{header}");
            assert_eq!(bytes.len() - start, count * 31);
            let expected = Vector3::new(0.5, 0.0, -1.0).normalize();
            for vertex in bytes[start..].chunks_exact(31) {
                let number = |place: usize| {
                    f64::from(f32::from_le_bytes(vertex[place..place + 4].try_into().unwrap()))
                };
                let [x, z, sigma] = [number(0), number(8), number(27)];
                assert!((z - 2.0 - 0.5 * x).abs() < 1e-5, "{x} {z}");
                assert!((sigma - 0.1 * z).abs() < 1e-5, "{sigma} {z}");
                let normal = Vector3::new(number(12), number(16), number(20));
                assert!((normal - expected).norm() < 1e-4, "{normal}");
            }
            let first = [0, 1, 2].map(|c| scene.colour(0, 0)[c]);
            assert_eq!(bytes[start + 24..start + 27], first);
        });
    }
}
