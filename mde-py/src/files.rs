//! Files: photographs, camera intrinsics, maps and pictures.

use crate::error::raise;
use colorous::{Gradient, MAGMA, VIRIDIS};
use mde_cli::Intrinsics;
use mde_cli::mde_prior::format::{write_npy, write_npz};
use mde_cli::mde_prior::photo::{decode_image, encode_rgb_png, read_image, write_rgb_png};
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_uncertainty::statistics::quantile_sorted;
use mde_cli::pictures16::{DepthPng, METRES, write_confidence};
use ndarray::Array3;
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// The colour of missing pixels, as in the program's previews.
const MISSING: [u8; 3] = [128; 3];

/// A photograph `[height, width, 3]` in 0 to 1, upright, and its EXIF's focal length in millimetres of 35 mm film.
#[pyfunction]
#[pyo3(signature = (path))]
pub(crate) fn read_photo(py: Python<'_>, path: PathBuf) -> PyResult<(Bound<'_, PyArray3<f32>>, Option<f64>)> {
    let photo = py.detach(|| read_image(&path)).map_err(raise)?;
    Ok((photo.pixels.into_pyarray(py), photo.focal_35mm))
}

/// As [`read_photo`], of the bytes of a file.
#[pyfunction]
#[pyo3(signature = (data))]
pub(crate) fn decode_photo<'py>(
    py: Python<'py>,
    data: &[u8],
) -> PyResult<(Bound<'py, PyArray3<f32>>, Option<f64>)> {
    let photo = py.detach(|| decode_image(data)).map_err(raise)?;
    Ok((photo.pixels.into_pyarray(py), photo.focal_35mm))
}

/// fx, fy, cx, cy of a text for an image of that size.
#[pyfunction]
#[pyo3(signature = (text, height, width))]
pub(crate) fn parse_intrinsics(text: &str, height: usize, width: usize) -> PyResult<[f64; 4]> {
    let camera = Intrinsics::parse(text).and_then(|k| k.camera(0, [width, height])).map_err(raise)?;
    Ok([camera.fx, camera.fy, camera.cx, camera.cy])
}

/// Writes a map as NPY.
#[pyfunction]
#[pyo3(signature = (path, map))]
pub(crate) fn save_npy(path: PathBuf, map: PyReadonlyArray2<'_, f32>) -> PyResult<()> {
    write_npy(path, map.as_array()).map_err(raise)
}

/// Writes maps by their names as NPZ.
#[pyfunction]
#[pyo3(signature = (path, maps))]
pub(crate) fn save_npz(path: PathBuf, maps: Vec<(String, PyReadonlyArray2<'_, f32>)>) -> PyResult<()> {
    let views: Vec<_> = maps.iter().map(|(name, map)| (name.as_str(), map.as_array())).collect();
    write_npz(path, &views).map_err(raise)
}

/// Writes `depth.png` and `confidence.png` into a folder.
#[pyfunction]
#[pyo3(signature = (folder, depth, variance, unit))]
pub(crate) fn save_pictures16(
    folder: PathBuf,
    depth: PyReadonlyArray2<'_, f32>,
    variance: PyReadonlyArray2<'_, f32>,
    unit: &str,
) -> PyResult<()> {
    let unit = match unit {
        METRES => METRES,
        "capture" => "capture",
        _ => "unscaled",
    };
    let maps = (depth.as_array().to_owned(), variance.as_array().to_owned());
    let depth = GaussianDepth::new(maps.0, maps.1).map_err(raise)?;
    let png = DepthPng::new(unit, depth.mean().iter().copied());
    png.write(&folder.join("depth.png"), depth.mean()).map_err(raise)?;
    write_confidence(&folder.join("confidence.png"), &depth).map_err(raise)
}

/// Writes an image `[height, width, 3]` as PNG.
#[pyfunction]
#[pyo3(signature = (path, image))]
pub(crate) fn save_rgb(path: PathBuf, image: PyReadonlyArray3<'_, u8>) -> PyResult<()> {
    write_rgb_png(path, image.as_array()).map_err(raise)
}

/// The PNG of an image `[height, width, 3]`.
#[pyfunction]
#[pyo3(signature = (image))]
pub(crate) fn encode_png<'py>(
    py: Python<'py>,
    image: PyReadonlyArray3<'py, u8>,
) -> PyResult<Bound<'py, PyBytes>> {
    Ok(PyBytes::new(py, &encode_rgb_png(image.as_array()).map_err(raise)?))
}

/// A map in colours `[height, width, 3]`, from 1 % to 99 % of its known values, and these two.
#[pyfunction]
#[pyo3(signature = (map, colours))]
pub(crate) fn picture<'py>(
    py: Python<'py>,
    map: PyReadonlyArray2<'py, f32>,
    colours: &str,
) -> PyResult<(Bound<'py, PyArray3<u8>>, [f64; 2])> {
    let gradient: &Gradient = match colours {
        "viridis" => &VIRIDIS,
        "magma" => &MAGMA,
        _ => return Err(raise(format!("colours is {colours:?}; give viridis or magma"))),
    };
    let map = map.as_array();
    let known = |value: f32| value.is_finite() && value > 0.0;
    let mut values: Vec<f32> = map.iter().copied().filter(|value| known(*value)).collect();
    values.sort_unstable_by(f32::total_cmp);
    let [low, high] = [0.01, 0.99].map(|p| quantile_sorted(&values, p).unwrap_or(0.0));
    let mut picture = Array3::zeros((map.nrows(), map.ncols(), 3));
    for ((y, x), &value) in map.indexed_iter() {
        let share = if high > low { (f64::from(value) - low) / (high - low) } else { 0.5 };
        let colour = match known(value) {
            true => gradient.eval_continuous(share.clamp(0.0, 1.0)).as_array(),
            false => MISSING,
        };
        (0..3).for_each(|c| picture[(y, x, c)] = colour[c]);
    }
    Ok((picture.into_pyarray(py), [low, high]))
}
