//! Files: photographs, camera intrinsics, maps and pictures.

use crate::error::raise;
use mde_cli::error::Result;
use mde_cli::mde_prior::CertaintyMeaning;
use mde_cli::mde_prior::format::write_npy;
use mde_cli::mde_prior::photo::{decode_image, encode_rgb_png, read_image, write_rgb_png};
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_warp::PinholeCamera;
use mde_cli::output::export::{Exported, Format};
use mde_cli::output::maps::Maps;
use mde_cli::output::preview::{depth_picture_within, sigma_picture_within, usual_range};
use mde_cli::refiner::depth_png::{DepthPng, METRES};
use mde_cli::scene::intrinsics::Intrinsics;
use ndarray::{ArrayView2, ArrayView3};
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};

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
pub(crate) fn save_npy(py: Python<'_>, path: PathBuf, map: PyReadonlyArray2<'_, f32>) -> PyResult<()> {
    let map = map.as_array();
    py.detach(|| write_npy(path, map)).map_err(raise)
}

/// The parts of a result that its folder has.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Saved<'py> {
    depth: PyReadonlyArray2<'py, f32>,
    variance: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
    prior: PyReadonlyArray2<'py, f32>,
    /// Further maps of files of their names: `lower`, `upper`.
    more: Vec<(String, PyReadonlyArray2<'py, f32>)>,
    /// Components of sigma by their names.
    components: Vec<(String, PyReadonlyArray2<'py, f32>)>,
    confidence: Option<PyReadonlyArray2<'py, f32>>,
    error: Option<PyReadonlyArray2<'py, f32>>,
    evidence: Vec<(String, PyReadonlyArray2<'py, f32>)>,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    image: PyReadonlyArray3<'py, f32>,
    /// Pictures by the names of their files.
    pictures: Vec<(String, PyReadonlyArray3<'py, u8>)>,
    /// The photographs above the preview.
    strip: Vec<PyReadonlyArray3<'py, f32>>,
    unit: String,
    /// fx, fy, cx, cy.
    camera: [f64; 4],
}

/// Writes the files of a result into a folder, and those of the formats that are named.
#[pyfunction]
#[pyo3(signature = (folder, parts, export))]
pub(crate) fn save_result(
    py: Python<'_>,
    folder: PathBuf,
    parts: Saved<'_>,
    export: Vec<String>,
) -> PyResult<()> {
    let formats = export.iter().map(|name| name.parse().map_err(raise)).collect::<PyResult<Vec<_>>>()?;
    let views = parts.views();
    py.detach(|| views.write(&folder, &formats)).map_err(raise)
}

/// [`Saved`] without the interpreter.
struct Views<'m> {
    depth: ArrayView2<'m, f32>,
    variance: ArrayView2<'m, f32>,
    sigma: ArrayView2<'m, f32>,
    prior: ArrayView2<'m, f32>,
    more: Vec<Named<'m>>,
    components: Vec<Named<'m>>,
    certainty: Option<(CertaintyMeaning, ArrayView2<'m, f32>)>,
    evidence: Vec<Named<'m>>,
    image: ArrayView3<'m, f32>,
    pictures: Vec<(&'m str, ArrayView3<'m, u8>)>,
    strip: Vec<ArrayView3<'m, f32>>,
    unit: &'static str,
    camera: [f64; 4],
}

impl Saved<'_> {
    fn views(&self) -> Views<'_> {
        let confidence = self.confidence.as_ref().map(|map| (CertaintyMeaning::Confidence, map.as_array()));
        let error = self.error.as_ref().map(|map| (CertaintyMeaning::Error, map.as_array()));
        let certainty = confidence.or(error);
        Views {
            depth: self.depth.as_array(),
            variance: self.variance.as_array(),
            sigma: self.sigma.as_array(),
            prior: self.prior.as_array(),
            more: named(&self.more),
            components: named(&self.components),
            certainty,
            evidence: named(&self.evidence),
            image: self.image.as_array(),
            pictures: self.pictures.iter().map(|(name, one)| (name.as_str(), one.as_array())).collect(),
            strip: self.strip.iter().map(|one| one.as_array()).collect(),
            unit: unit(&self.unit),
            camera: self.camera,
        }
    }
}

impl Views<'_> {
    fn write(self, folder: &Path, formats: &[Format]) -> Result<()> {
        let Self { unit, image, prior, .. } = self;
        let depth = GaussianDepth::new(self.depth.to_owned(), self.variance.to_owned())?;
        let png = DepthPng::new(unit, depth.mean().iter().copied());
        let pictures = self.pictures.iter().map(|(name, one)| ((*name).to_owned(), one.to_owned()));
        Maps {
            depth: &depth,
            sigma: self.sigma,
            prior,
            more: &self.more,
            evidence: &self.evidence,
            image,
            pictures: &pictures.collect::<Vec<_>>(),
            strip: &self.strip.iter().map(|one| one.to_owned()).collect::<Vec<_>>(),
            truth: None,
            png: &png,
        }
        .write(folder)?;
        let [fx, fy, cx, cy] = self.camera;
        let (height, width) = depth.dim();
        let camera = PinholeCamera::new(fx, fy, cx, cy, width, height)?;
        let scene = Exported {
            unit,
            image,
            camera: &camera,
            depth: &depth,
            prior,
            components: self.components,
            certainty: self.certainty,
            png_scale: png.scale,
        };
        formats.iter().try_for_each(|format| scene.write(*format, folder))
    }
}

/// The unit of a result by its name.
pub(crate) fn unit(name: &str) -> &'static str {
    match name {
        METRES => METRES,
        "capture" => "capture",
        _ => "unscaled",
    }
}

/// A map by its name.
type Named<'m> = (&'m str, ArrayView2<'m, f32>);

fn named<'m>(maps: &'m [(String, PyReadonlyArray2<'_, f32>)]) -> Vec<Named<'m>> {
    maps.iter().map(|(name, map)| (name.as_str(), map.as_array())).collect()
}

/// Writes an image `[height, width, 3]` as PNG.
#[pyfunction]
#[pyo3(signature = (path, image))]
pub(crate) fn save_rgb(py: Python<'_>, path: PathBuf, image: PyReadonlyArray3<'_, u8>) -> PyResult<()> {
    let image = image.as_array();
    py.detach(|| write_rgb_png(path, image)).map_err(raise)
}

/// The PNG of an image `[height, width, 3]`.
#[pyfunction]
#[pyo3(signature = (image))]
pub(crate) fn encode_png<'py>(
    py: Python<'py>,
    image: PyReadonlyArray3<'py, u8>,
) -> PyResult<Bound<'py, PyBytes>> {
    let image = image.as_array();
    Ok(PyBytes::new(py, &py.detach(|| encode_rgb_png(image)).map_err(raise)?))
}

/// A map in colours `[height, width, 3]`, from 1 % to 99 % of its known values, and these two.
#[pyfunction]
#[pyo3(signature = (map, colours))]
pub(crate) fn picture<'py>(
    py: Python<'py>,
    map: PyReadonlyArray2<'py, f32>,
    colours: &str,
) -> PyResult<(Bound<'py, PyArray3<u8>>, [f64; 2])> {
    let map = map.as_array();
    let draw = match colours {
        "viridis" => depth_picture_within,
        "magma" => sigma_picture_within,
        _ => return Err(raise(format!("colours is {colours:?}; give viridis or magma"))),
    };
    let (pixels, range) = py.detach(|| {
        let range = usual_range(map.iter());
        (draw(map, range).pixels().to_owned(), range)
    });
    Ok((pixels.into_pyarray(py), range))
}
