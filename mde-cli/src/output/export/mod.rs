//! Files for other programs.

pub mod colmap;
pub(super) mod glb;
pub(super) mod ply;
pub mod transforms;

use crate::error::{Error, Result};
use mde_mvs::capture::{Distortion, Frame, Lens};
use mde_mvs::cloud::DepthView;
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A refined photograph with its pose, and where its files are.
#[derive(Debug, Clone, Copy)]
pub struct RefinedView<'v> {
    /// Image, camera, pose and depth.
    pub map: DepthView<'v>,
    /// The folder of its files, from that of the files of all; empty where they are the same.
    pub folder: &'v str,
    /// Steps per unit of its `depth.png`.
    pub png_scale: f64,
}

/// A kind of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// `cloud.ply`: points with colour, normal and sigma (binary).
    Ply,
    /// `mesh.glb`: textured mesh, torn at depth edges, y up.
    Glb,
    /// `depth.exr`: channels Y and Z (refined), sigma and prior.
    Exr,
    /// `colmap/`: `images/` and `sparse/0/`.
    Colmap,
    /// `colmap/`: a dense workspace of COLMAP, of a whole capture.
    ColmapDense,
    /// `mesh.ply` and `mesh.glb`: one surface of a whole capture.
    Mesh,
    /// `transforms.json`: camera, depth and sigma for nerfstudio.
    Transforms,
    /// `sigma/`: the components of sigma (NPY).
    Sigma,
    /// `field.safetensors`: the field of the last iteration.
    Field,
}

/// Each format with its name as an argument, and its files and what is in them.
pub const FORMATS: [(Format, &str, &str); 9] = [
    (Format::Ply, "ply", "cloud.ply: points with colour, normal and sigma (binary)"),
    (Format::Glb, "glb", "mesh.glb: textured mesh, torn at depth edges, y up"),
    (Format::Exr, "exr", "depth.exr: channels Y and Z (refined), sigma and prior"),
    (Format::Colmap, "colmap", "colmap/: images/ and sparse/0/"),
    (
        Format::ColmapDense,
        "colmap-dense",
        "colmap/: a dense workspace of the capture, for COLMAP's stereo_fusion",
    ),
    (Format::Mesh, "mesh", "mesh.ply and mesh.glb: one surface of the capture, with colours and sigma"),
    (Format::Transforms, "transforms", "transforms.json: camera, depth and sigma for nerfstudio"),
    (Format::Sigma, "sigma", "sigma/: the components of sigma (NPY)"),
    (Format::Field, "field", "field.safetensors: the fitted field, for mde render"),
];

impl Format {
    /// Whether it is of all photographs of a capture, not of each.
    pub fn is_of_capture(self) -> bool {
        matches!(self, Self::ColmapDense | Self::Mesh)
    }
}

impl FromStr for Format {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        FORMATS.into_iter().find(|format| format.1 == name).map(|format| format.0).ok_or_else(|| {
            let names = FORMATS.map(|format| format.1).join(", ");
            Error::Argument(format!("export: {name:?} is no format; give some of {names}"))
        })
    }
}

/// The photograph in a folder of results.
pub(super) const IMAGE: &str = "image.png";

/// A view as a frame of a capture, with its photograph in that file.
fn frame(view: &DepthView<'_>, photograph: PathBuf) -> Frame {
    let lens = Lens { camera: view.camera, distortion: Distortion::default() };
    Frame { photograph, lens, pose: view.pose }
}

/// A folder within another, made where it is missing.
pub(super) fn subfolder(folder: &Path, name: &str) -> Result<PathBuf> {
    let path = folder.join(name);
    match fs::create_dir_all(&path) {
        Ok(()) => Ok(path),
        Err(error) => Err(Error::external(format!("{}: can't make this folder: {error}", path.display()))),
    }
}

/// A slanted plane with a hole, for the tests of the formats.
#[cfg(test)]
pub(crate) mod tests {
    use mde_mvs::cloud::DepthView;
    use mde_mvs::surface::{Surface, Vertex};
    use mde_warp::{PinholeCamera, Pose};
    use ndarray::{Array2, Array3};

    pub(crate) const SIZE: (usize, usize) = (6, 8);

    /// A surface of one triangle, orange.
    pub(crate) fn triangle() -> Surface {
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
