//! `transforms.json` of photographs with their depth, as nerfstudio's data parser reads it.

use crate::error::Result;
use crate::output::export::IMAGE;
use crate::refiner::depth_png::MILLIMETRES;
use crate::several::cloud::RefinedView;
use mde_mvs::capture::{Distortion, Frame, Lens, transforms_json};
use std::path::Path;

/// Name of the file.
pub const FILE: &str = "transforms.json";

/// Cameras, poses, depths, sigmas and confidences. Depth is the PNG: nerfstudio takes thousandths of the poses' unit, in NumPy files too.
///
/// # Errors
/// [`Error::Prior`](crate::error::Error::Prior) where the file can't be written.
pub(crate) fn write(path: &Path, photographs: &[RefinedView<'_>]) -> Result<()> {
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
    let text = transforms_json(&frames, Path::new(""), |index| {
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
