//! Captures with poses, in the files of other programs.

use crate::error::{message, raise};
use crate::refine::{Motion, given, motion};
use mde_cli::mde_mvs::capture::{CaptureFiles, Distortion, Lens, PosedCapture};
use mde_cli::mde_prior::photo::{image_size, read_image};
use mde_cli::naming::Naming;
use mde_cli::scene::camera::{GivenCamera, KnownCamera};
use numpy::{IntoPyArray, PyArray2, PyArray3};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};

/// Name, image, mask, intrinsics and pose of a photograph.
type Posed<'py> = (String, Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<bool>>, [f64; 4], Motion);

/// The photographs of a capture, `image` first and then the nearest, all or at most `most`; nothing where the path holds no capture. The
/// second value is the number of all.
#[pyfunction]
#[pyo3(signature = (path, image, intrinsics, fov, most))]
pub(crate) fn read_capture<'py>(
    py: Python<'py>,
    path: PathBuf,
    image: PathBuf,
    intrinsics: Option<[f64; 4]>,
    fov: Option<f64>,
    most: Option<usize>,
) -> PyResult<Option<(Vec<Posed<'py>>, usize)>> {
    let given = given(intrinsics, fov);
    let fault = |text: String| raise(format!("views {}: {text}", path.display()));
    let Some(capture) = py.detach(|| capture(&path, &image, &given)).map_err(fault)? else { return Ok(None) };
    let reference = capture.position(&image).map_err(raise)?;
    let views = py.detach(|| {
        capture
            .nearest(reference, most.unwrap_or(capture.frames.len()))
            .into_iter()
            .map(|index| {
                let frame = &capture.frames[index];
                let named = |e: &dyn std::fmt::Display| format!("{}: {e}", frame.photograph.display());
                let photo = read_image(&frame.photograph).map_err(message)?;
                Ok((frame, frame.view(photo.pixels.view()).map_err(|e| named(&e))?))
            })
            .collect::<Result<Vec<_>, String>>()
    });
    let views = views.map_err(raise)?.into_iter().map(|(frame, view)| {
        let camera = view.camera;
        (
            frame.photograph.display().to_string(),
            view.image.into_pyarray(py),
            view.mask.into_pyarray(py),
            [camera.fx, camera.fy, camera.cx, camera.cy],
            motion(&view.pose),
        )
    });
    Ok(Some((views.collect(), capture.frames.len())))
}

fn capture(path: &Path, image: &Path, given: &GivenCamera) -> Result<Option<PosedCapture>, String> {
    let Some(files) = CaptureFiles::find(path) else { return Ok(None) };
    let mut lens = None;
    if files.needs_lens() {
        let size = image_size(image)
            .ok_or_else(|| format!("{}: no readable image; check the path", image.display()))?;
        let known = KnownCamera::new(given, None, size, Naming::Keywords).map_err(message)?;
        lens = Some(Lens { camera: known.camera, distortion: Distortion::default() });
    }
    files.read(lens.as_ref(), &|path| image_size(path)).map(Some).map_err(message)
}
