//! Files of photographs, maps and pictures.

use crate::error::raise;
use mde_cli::mde_prior::format::write_npy;
use mde_cli::mde_prior::photo::{decode_image, encode_rgb_png, read_image};
use mde_cli::output::preview::{depth_picture_within, sigma_picture_within, usual_range};
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// A photograph `[height, width, 3]` in 0 to 1, upright, and its EXIF's focal length in millimetres of 35 mm film.
type Photo<'py> = (Bound<'py, PyArray3<f32>>, Option<f64>);

/// Of a file.
#[pyfunction]
pub(crate) fn read_photo(py: Python<'_>, path: PathBuf) -> PyResult<Photo<'_>> {
    let photo = py.detach(|| read_image(&path)).map_err(raise)?;
    Ok((photo.pixels.into_pyarray(py), photo.focal_35mm))
}

/// Of the bytes of a file.
#[pyfunction]
pub(crate) fn decode_photo<'py>(py: Python<'py>, data: &[u8]) -> PyResult<Photo<'py>> {
    let photo = py.detach(|| decode_image(data)).map_err(raise)?;
    Ok((photo.pixels.into_pyarray(py), photo.focal_35mm))
}

/// Writes a map as NPY.
#[pyfunction]
pub(crate) fn save_npy(py: Python<'_>, path: PathBuf, map: PyReadonlyArray2<'_, f32>) -> PyResult<()> {
    let map = map.as_array();
    py.detach(|| write_npy(path, map)).map_err(raise)
}

/// The PNG of an image `[height, width, 3]`.
#[pyfunction]
pub(crate) fn encode_png(py: Python<'_>, image: PyReadonlyArray3<'_, u8>) -> PyResult<Py<PyBytes>> {
    let image = image.as_array();
    Ok(PyBytes::new(py, &py.detach(|| encode_rgb_png(image)).map_err(raise)?).unbind())
}

/// A map in colours `[height, width, 3]`, from 1 % to 99 % of its known values, and these two.
#[pyfunction]
pub(crate) fn picture<'py>(
    py: Python<'py>,
    map: PyReadonlyArray2<'py, f32>,
    colours: &str,
) -> PyResult<(Bound<'py, PyArray3<u8>>, [f64; 2])> {
    let map = map.as_array();
    let draw = match colours {
        "depth" => depth_picture_within,
        "sigma" => sigma_picture_within,
        _ => return Err(raise(format!("colours is {colours:?}; give depth or sigma"))),
    };
    let (pixels, range) = py.detach(|| {
        let range = usual_range(map.iter());
        (draw(map, range), range)
    });
    Ok((pixels.into_pyarray(py), range))
}
