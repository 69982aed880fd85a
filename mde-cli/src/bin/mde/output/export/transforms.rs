//! `transforms.json` of photographs with their depth, as nerfstudio's data parser reads it.

use super::IMAGE;
use anyhow::Result;
use mde_mvs::capture::{Distortion, Frame, Lens, transforms_json_with};
use mde_warp::{PinholeCamera, Pose};
use std::path::Path;

use crate::output::pictures16::MILLIMETRES;

pub(crate) const FILE: &str = "transforms.json";

/// A photograph and the folder with its results.
pub(crate) struct Exposed<'e> {
    /// Beside the file; empty where that is in the same folder.
    pub(crate) folder: &'e str,
    pub(crate) camera: PinholeCamera,
    /// World to camera, in the unit of the depth.
    pub(crate) pose: Pose,
    /// Steps per unit of its depth.png.
    pub(crate) png_scale: f64,
}

/// Cameras, poses, depths, sigmas and confidences. Depth is the PNG: nerfstudio takes thousandths of the poses' unit, in NumPy files too.
pub(crate) fn write(path: &Path, photographs: &[Exposed<'_>]) -> Result<()> {
    let file = |folder: &str, name: &str| match folder {
        "" => name.to_owned(),
        _ => format!("{folder}/{name}"),
    };
    let frames: Vec<Frame> = photographs
        .iter()
        .map(|photograph| Frame {
            photograph: file(photograph.folder, IMAGE).into(),
            lens: Lens { camera: photograph.camera, distortion: Distortion::default() },
            pose: photograph.pose,
        })
        .collect();
    let text = transforms_json_with(&frames, Path::new(""), |index| {
        let other = Some(photographs[index].png_scale).filter(|scale| *scale != MILLIMETRES);
        [
            ("depth_file_path", "depth.png"),
            ("sigma_file_path", "sigma.npy"),
            ("confidence_file_path", "confidence.png"),
        ]
        .map(|(key, name)| (key, file(photographs[index].folder, name)))
        .into_iter()
        // nerfstudio's option of that name.
        .chain(other.map(|scale| ("depth_unit_scale_factor", scale.recip().to_string())))
        .collect()
    });
    Ok(mde_prior::write_atomic(path, text.as_bytes())?)
}
