//! `transforms.json` of photographs with their depth, as nerfstudio's data parser reads it.

use super::{IMAGE, Placed};
use crate::error::Result;
use mde_mvs::capture::{Frame, transforms_json};
use mde_prior::format::MILLIMETRES;
use std::path::Path;

/// Name of the file.
pub const FILE: &str = "transforms.json";

/// Cameras, poses, depths, sigmas and confidences. Depth is the PNG: nerfstudio takes thousandths of the poses' unit, in NumPy files too.
pub(crate) fn write(path: &Path, views: &[Placed<'_>]) -> Result<()> {
    let file = |view: &Placed<'_>, name: &str| match view.folder {
        "" => name.to_owned(),
        folder => format!("{folder}/{name}"),
    };
    let frame = |view: &Placed<'_>| Frame::new(view.camera, view.pose, file(view, IMAGE));
    let frames: Vec<Frame> = views.iter().map(frame).collect();
    let text = transforms_json(&frames, Path::new(""), |index| {
        let view = &views[index];
        let other = Some(view.png_scale).filter(|scale| *scale != MILLIMETRES);
        [
            ("depth_file_path", "depth.png"),
            ("sigma_file_path", "sigma.npy"),
            ("confidence_file_path", "confidence.png"),
        ]
        .map(|(key, name)| (key, file(view, name)))
        .into_iter()
        // nerfstudio's option of that name.
        .chain(other.map(|scale| ("depth_unit_scale_factor", scale.recip().to_string())))
        .collect()
    });
    Ok(mde_prior::write_atomic(path, text.as_bytes())?)
}
