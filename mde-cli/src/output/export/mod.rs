//! Files for other programs.

pub mod colmap;
pub mod transforms;

use crate::error::{Error, Result};
use mde_warp::{PinholeCamera, Pose};
use serde::Deserialize;
use std::fs;
use std::path::{Path, PathBuf};

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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "program", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// cloud.ply: points with colour, normal and sigma (binary).
    Ply,
    /// mesh.glb: textured mesh, torn at depth edges, y up.
    Glb,
    /// depth.exr: channels Y and Z (refined), sigma and prior.
    Exr,
    /// colmap/: images/ and sparse/0/, of all photographs that were used.
    Colmap,
    /// colmap/: a dense workspace of the capture, for COLMAP's fusion.
    ColmapDense,
    /// mesh.ply and mesh.glb: one surface of the capture, with colours and sigma.
    Mesh,
    /// transforms.json: cameras, depth and sigma for nerfstudio, of all photographs that were used.
    Transforms,
    /// sigma/: the components of sigma (NPY).
    Sigma,
    /// field.safetensors: the fitted field, for mde render.
    Field,
}

impl Format {
    /// Whether it is of all photographs of a capture, not of each.
    pub fn is_of_capture(self) -> bool {
        matches!(self, Self::ColmapDense | Self::Mesh)
    }
}

/// The photograph in a folder of results.
pub(super) const IMAGE: &str = "image.png";

/// A folder within another, made where it is missing.
pub(super) fn subfolder(folder: &Path, name: &str) -> Result<PathBuf> {
    let path = folder.join(name);
    let fault = |error| Error::external(format!("{}: can't make this folder: {error}", path.display()));
    fs::create_dir_all(&path).map_err(fault)?;
    Ok(path)
}
