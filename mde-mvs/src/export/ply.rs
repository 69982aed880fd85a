//! Binary PLY: points with colour, normal and sigma, and the triangles between them.

use crate::cloud::{ConsistentPoint, DepthView, byte};
use crate::surface::Surface;
use nalgebra::{Point3, Vector3};
use ndarray::ArrayView2;

/// The points of a depth map in the frame of its camera; where it is known, with the number of other photographs that confirm each.
pub fn encode(view: &DepthView<'_>, confirmed: Option<ArrayView2<'_, f32>>, unit: &str) -> Vec<u8> {
    let mut cloud = Cloud { more: confirmed.map_or("", |_| CONFIRMED), ..Cloud::default() };
    for ((row, column), &sigma) in view.sigma.indexed_iter() {
        let Some(point) = view.point(row, column) else { continue };
        let confirmed = confirmed.map(|map| map[(row, column)] as u8);
        cloud.push(point, view.normal(row, column, point), view.colour(row, column), sigma, confirmed);
    }
    cloud.encode("camera frame", unit)
}

const CONFIRMED: &str = "property uchar confirmed\n";

/// The points that several `views` confirm, with the normals and colours of the pixels that they are of, and the number of other views that
/// confirm each; `frame` names the world.
pub fn encode_points(
    points: &[ConsistentPoint],
    views: &[DepthView<'_>],
    frame: &str,
    unit: &str,
) -> Vec<u8> {
    let mut cloud = Cloud { more: CONFIRMED, ..Cloud::default() };
    for found in points {
        let (view, [row, column]) = (&views[found.view], found.pixel);
        let normal = view.point(row, column).map_or_else(Vector3::zeros, |p| view.normal(row, column, p));
        let normal = view.pose.rotation.inverse() * normal;
        let confirmed = u8::try_from(found.confirmed).unwrap_or(u8::MAX);
        cloud.push(found.position, normal, view.colour(row, column), found.sigma, Some(confirmed));
    }
    cloud.encode(frame, unit)
}

/// The surface of a capture; `frame` names the world.
pub fn encode_surface(surface: &Surface, frame: &str, unit: &str) -> Vec<u8> {
    let mut cloud = Cloud { triangles: &surface.triangles, ..Cloud::default() };
    for vertex in &surface.vertices {
        let [position, normal] = [vertex.position, vertex.normal].map(|v| Vector3::from(v).cast());
        cloud.push(position.into(), normal, vertex.colour.map(byte), vertex.sigma, None);
    }
    cloud.encode(frame, unit)
}

/// Points with normal, colour and sigma; x right, y down, z forward.
#[derive(Default)]
struct Cloud<'t> {
    bytes: Vec<u8>,
    count: usize,
    /// A further property of a point.
    more: &'static str,
    triangles: &'t [[u32; 3]],
}

impl Cloud<'_> {
    /// Adds a point with its unit normal, the standard deviation of its depth and the further property.
    fn push(
        &mut self,
        point: Point3<f64>,
        normal: Vector3<f64>,
        colour: [u8; 3],
        sigma: f32,
        more: Option<u8>,
    ) {
        let numbers = point.coords.iter().chain(&normal).map(|v| *v as f32);
        numbers.for_each(|number| self.bytes.extend(number.to_le_bytes()));
        self.bytes.extend(colour);
        self.bytes.extend(sigma.to_le_bytes());
        self.bytes.extend(more);
        self.count += 1;
    }

    /// The file.
    fn encode(self, frame: &str, unit: &str) -> Vec<u8> {
        let header = format!(
            "ply\nformat binary_little_endian 1.0\n\
             comment {frame}: x right, y down, z forward; unit: {unit}; sigma is the depth's standard deviation\n\
             element vertex {}\n\
             property float x\nproperty float y\nproperty float z\n\
             property float nx\nproperty float ny\nproperty float nz\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\n\
             property float sigma\n{}{}end_header\n",
            self.count,
            self.more,
            match self.triangles.len() {
                0 => String::new(),
                count => format!("element face {count}\nproperty list uchar uint vertex_indices\n"),
            }
        );
        let face = |corners: &[u32; 3]| -> Vec<u8> {
            std::iter::once(3).chain(corners.iter().flat_map(|corner| corner.to_le_bytes())).collect()
        };
        let faces = self.triangles.iter().flat_map(face).collect();
        [header.into_bytes(), self.bytes, faces].concat()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::tests::{SIZE, triangle, with_plane};
    use ndarray::Array2;

    #[test]
    fn a_surface_has_its_vertices_and_triangles() {
        let bytes = encode_surface(&triangle(), "world", "m");
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains("element vertex 3\n") && text.contains("element face 1\n"), "{text}");
        assert_eq!(bytes[bytes.len() - 13..], [3, 0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(bytes[bytes.len() - 13 - 31..][24..27], [255, 128, 0]);
    }

    #[test]
    fn a_planes_points_lie_on_it_and_their_normals_face_the_camera() {
        with_plane(|scene| {
            let counts = Array2::from_shape_fn(SIZE, |(_, x)| x as f32);
            let bytes = encode(scene, Some(counts.view()), "m");
            let end = b"end_header\n";
            let start = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
            let header = std::str::from_utf8(&bytes[..start]).unwrap();
            let count = SIZE.0 * SIZE.1 - 1;
            assert!(header.contains(&format!("element vertex {count}\n")), "{header}");
            assert!(header.contains(CONFIRMED) && !encode(scene, None, "m").starts_with(&bytes[..start]));
            assert_eq!(bytes.len() - start, count * 32);
            assert_eq!([bytes[start + 31], bytes[start + 63]], [0, 1]);
            let expected = Vector3::new(0.5, 0.0, -1.0).normalize();
            for vertex in bytes[start..].chunks_exact(32) {
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
