//! Captures with poses, in the files of other programs.

use crate::error::{message, raise};
use crate::refine::camera::{Given, KnownCamera};
use crate::refine::{Motion, motion};
use mde_cli::mde_mvs::capture::{
    Distortion, Frame, Lens, PixelCentres, read_colmap, read_transforms, read_tum,
};
use mde_cli::mde_prior::photo::{image_size, read_image};
use numpy::{IntoPyArray, PyArray2, PyArray3};
use pyo3::prelude::*;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Name, image, mask, intrinsics and pose of a photograph.
type Posed<'py> = (String, Bound<'py, PyArray3<f32>>, Bound<'py, PyArray2<bool>>, [f64; 4], Motion);

/// The photographs of a capture, `image` first and then the nearest, at most `most`; nothing where the path holds no capture. The
/// second value is the number of all.
#[pyfunction]
#[pyo3(signature = (path, image, intrinsics, fov, most))]
pub(crate) fn read_capture<'py>(
    py: Python<'py>,
    path: PathBuf,
    image: PathBuf,
    intrinsics: Option<[f64; 4]>,
    fov: Option<f64>,
    most: usize,
) -> PyResult<Option<(Vec<Posed<'py>>, usize)>> {
    let given = match (intrinsics, fov) {
        (Some(intrinsics), _) => Given::Intrinsics(intrinsics),
        (None, Some(fov)) => Given::FieldOfView(fov),
        _ => Given::Nothing,
    };
    let fault = |text: String| raise(format!("views {}: {text}", path.display()));
    let Some(frames) = py.detach(|| frames(&path, &image, given)).map_err(fault)? else { return Ok(None) };
    let Some(reference) = frames.iter().position(|frame| same(&frame.photograph, &image)) else {
        let some: Vec<String> = frames.iter().take(3).map(|f| f.photograph.display().to_string()).collect();
        return Err(raise(format!(
            "{}: not a photograph of this capture; give one of its {}, such as {}",
            image.display(),
            frames.len(),
            some.join(", ")
        )));
    };
    let views = py.detach(|| {
        nearest(&frames, reference, most)
            .into_iter()
            .map(|index| {
                let frame = &frames[index];
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
    Ok(Some((views.collect(), frames.len())))
}

fn frames(path: &Path, image: &Path, given: Given) -> Result<Option<Vec<Frame>>, String> {
    let size = |path: &Path| image_size(path);
    let within = |name: &str| path.join(name).is_file();
    let read = if path.is_file() && path.extension() == Some(OsStr::new("json")) {
        read_transforms(path, PixelCentres::Integers, &size)
    } else if within("transforms.json") {
        read_transforms(&path.join("transforms.json"), PixelCentres::Integers, &size)
    } else if let Some((model, images)) = colmap_model(path) {
        read_colmap(&model, &images, &size)
    } else if within("groundtruth.txt") && within("rgb.txt") {
        let [width, height] = image_size(image)
            .ok_or_else(|| format!("{}: no readable image; check the path", image.display()))?;
        let camera = KnownCamera::new(given, None, height, width).map_err(message)?.camera;
        read_tum(path, &Lens { camera, distortion: Distortion::default() }, &size)
    } else {
        return Ok(None);
    };
    Ok(Some(read.map_err(message)?.frames))
}

/// Folder of a COLMAP model and of its photographs: `DIR` or `DIR/sparse/0`, beside `DIR/images`.
fn colmap_model(path: &Path) -> Option<(PathBuf, PathBuf)> {
    let is_model =
        |folder: &Path| ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file());
    let images = |root: &Path| {
        let folder = root.join("images");
        if folder.is_dir() { folder } else { root.to_owned() }
    };
    let nested = path.join("sparse").join("0");
    if is_model(&nested) {
        return Some((nested, images(path)));
    }
    let root = match path.ends_with("sparse/0") {
        true => path.parent().and_then(Path::parent).unwrap_or(path),
        false => path,
    };
    is_model(path).then(|| (path.to_owned(), images(root)))
}

/// The reference, then the frames of the nearest camera centres.
fn nearest(frames: &[Frame], reference: usize, most: usize) -> Vec<usize> {
    let centre = |index: usize| frames[index].pose.inverse().translation.vector;
    let mut order: Vec<usize> = (0..frames.len()).collect();
    let key = |index: &usize| (*index != reference, (centre(*index) - centre(reference)).norm());
    order.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    order.truncate(most.max(2));
    order
}

fn same(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}
