//! Files for other programs.

pub mod colmap;
pub mod transforms;

use crate::error::{Error, Result};
use mde_warp::{PinholeCamera, Pose};
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Where a refined photograph was taken, and where its files are.
#[derive(Debug, Clone, Copy)]
pub struct Placed<'v> {
    /// The camera of its maps.
    pub camera: PinholeCamera,
    /// World to camera, in the unit of its depth.
    pub pose: Pose,
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

/// A folder within another, made where it is missing.
pub(super) fn subfolder(folder: &Path, name: &str) -> Result<PathBuf> {
    let path = folder.join(name);
    match fs::create_dir_all(&path) {
        Ok(()) => Ok(path),
        Err(error) => Err(Error::external(format!("{}: can't make this folder: {error}", path.display()))),
    }
}
