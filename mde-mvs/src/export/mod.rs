//! The bytes of files for other programs: depth maps, points and surfaces as PLY and glTF.

pub mod glb;
pub mod ply;

/// A slanted plane with a hole, for the tests of the formats.
#[cfg(test)]
pub(crate) mod tests {
    use crate::cloud::DepthView;
    use crate::surface::{Surface, Vertex};
    use mde_warp::{PinholeCamera, Pose};
    use ndarray::{Array2, Array3};

    pub(crate) const SIZE: (usize, usize) = (6, 8);

    /// A surface of one triangle, orange.
    pub(super) fn triangle() -> Surface {
        let vertex = |x: f32| Vertex {
            position: [x, 1.0, 2.0],
            normal: [0.0, 0.0, -1.0],
            colour: [1.0, 0.5, 0.0],
            sigma: 0.1,
        };
        Surface { vertices: [0.0, 1.0, 2.0].map(vertex).to_vec(), triangles: vec![[0, 2, 1]] }
    }

    pub(crate) fn with_plane(test: impl FnOnce(&DepthView<'_>)) {
        let camera = PinholeCamera::new(10.0, 12.0, 3.5, 2.5, SIZE.1, SIZE.0).unwrap();
        // z = 2 + 0.5 x, with x = (u - cx) / fx * z.
        let mut depth = Array2::from_shape_fn(SIZE, |(_, u)| {
            (2.0 / (1.0 - 0.5 * (u as f64 - camera.cx) / camera.fx)) as f32
        });
        let mut sigma = depth.mapv(|d| 0.1 * d);
        (depth[(2, 3)], sigma[(2, 3)]) = (0.0, f32::INFINITY);
        let image = Array3::from_shape_fn((SIZE.0, SIZE.1, 3), |(v, u, c)| (v * 8 + u + c) as f32 / 50.0);
        test(&DepthView {
            image: image.view(),
            camera,
            pose: Pose::identity(),
            depth: depth.view(),
            sigma: sigma.view(),
        });
    }
}
