//! The files of results.

use crate::error::raise;
use mde_cli::error::{Error, Result};
use mde_cli::mde_mvs::cloud::DepthView;
use mde_cli::mde_prior::CertaintyMeaning;
use mde_cli::mde_prior::format::DepthPng;
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_warp::{PinholeCamera, Pose};
use mde_cli::nalgebra::{Quaternion, Translation3, UnitQuaternion};
use mde_cli::output::every::write_all;
use mde_cli::output::export::{self, Format};
use mde_cli::output::files::{self, Beside, ResultFiles};
use mde_cli::output::folder;
use mde_cli::prior::origin::METRES;
use mde_cli::refiner::finish::Other;
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use serde::Deserialize;
use serde::de::{IntoDeserializer, value};
use std::path::PathBuf;

/// A map by its name.
type Named<'py> = (String, PyReadonlyArray2<'py, f32>);

/// fx, fy, cx, cy, width, height.
type CameraParts = (f64, f64, f64, f64, usize, usize);

/// The parts of a result that its folder has.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Saved<'py> {
    depth: PyReadonlyArray2<'py, f32>,
    variance: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
    prior: PyReadonlyArray2<'py, f32>,
    /// Further maps of files of their names: `lower`, `upper`.
    more: Vec<Named<'py>>,
    /// Components of sigma by their names.
    components: Vec<Named<'py>>,
    confidence: Option<PyReadonlyArray2<'py, f32>>,
    error: Option<PyReadonlyArray2<'py, f32>>,
    evidence: Vec<Named<'py>>,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    image: PyReadonlyArray3<'py, f32>,
    /// Pictures by the names of their files.
    pictures: Vec<(String, PyReadonlyArray3<'py, u8>)>,
    /// Names, pictures, cameras and poses of the others.
    others: Vec<(String, PyReadonlyArray3<'py, u8>, CameraParts, [f64; 7])>,
    /// The photographs above the preview.
    strip: Vec<PyReadonlyArray3<'py, f32>>,
    unit: String,
    camera: CameraParts,
}

/// Writes the files of a result into a folder, and those of the formats that are named.
#[pyfunction]
pub(crate) fn save_result(
    py: Python<'_>,
    folder: PathBuf,
    parts: Saved<'_>,
    export: Vec<String>,
) -> PyResult<()> {
    let formats = formats(&export)?;
    let unit = unit(&parts.unit);
    let depth = GaussianDepth::new(parts.depth.as_array().to_owned(), parts.variance.as_array().to_owned())
        .map_err(raise)?;
    let png = DepthPng::new(unit, depth.mean().iter().copied());
    let camera = camera_of(parts.camera).map_err(raise)?;
    let [confidence, error] =
        [(CertaintyMeaning::Confidence, &parts.confidence), (CertaintyMeaning::Error, &parts.error)]
            .map(|(meaning, map)| map.as_ref().map(|map| (meaning, map.as_array())));
    let pictures = parts.pictures.iter().map(|(name, one)| (name.clone(), one.as_array().to_owned()));
    let other =
        |(name, picture, camera, pose): &(String, PyReadonlyArray3<'_, u8>, CameraParts, [f64; 7])| {
            let (name, picture) = (name.clone(), picture.as_array().to_owned());
            Ok(Other { name, picture, camera: camera_of(*camera)?, pose: pose_of(*pose) })
        };
    let others = parts.others.iter().map(other).collect::<Result<_>>().map_err(raise)?;
    let (sigma, prior, image) = (parts.sigma.as_array(), parts.prior.as_array(), parts.image.as_array());
    let beside = Beside {
        more: named(&parts.more),
        components: named(&parts.components),
        certainty: confidence.or(error),
        evidence: named(&parts.evidence),
        pictures: pictures.collect(),
        others,
        strip: parts.strip.iter().map(|one| one.as_array().to_owned()).collect(),
        truth: None,
    };
    let files = ResultFiles { depth: &depth, sigma, prior, image, camera, png, beside };
    let write = || -> Result<()> {
        files.write(&folder)?;
        formats.iter().try_for_each(|format| files.export(*format, &folder))
    };
    py.detach(write).map_err(raise)
}

fn formats(names: &[String]) -> PyResult<Vec<Format>> {
    let format = |name: &String| -> std::result::Result<Format, value::Error> {
        Format::deserialize(name.as_str().into_deserializer())
    };
    let formats: std::result::Result<_, _> = names.iter().map(format).collect();
    formats.map_err(|error| raise(Error::Argument(format!("export: {error}"))))
}

/// The unit of a result by its name.
fn unit(name: &str) -> &'static str {
    [METRES, "capture"].into_iter().find(|known| *known == name).unwrap_or("unscaled")
}

fn camera_of((fx, fy, cx, cy, width, height): CameraParts) -> Result<PinholeCamera> {
    Ok(PinholeCamera::new(fx, fy, cx, cy, width, height)?)
}

/// The inverse of [`parts_of`](super::parts_of).
fn pose_of([w, i, j, k, x, y, z]: [f64; 7]) -> Pose {
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    Pose::from_parts(Translation3::new(x, y, z), rotation)
}

fn named<'m>(maps: &'m [Named<'_>]) -> Vec<files::Named<'m>> {
    maps.iter().map(|(name, map)| (name.as_str(), map.as_array())).collect()
}

/// A photograph that the others refined.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Placed<'py> {
    folder: String,
    /// sRGB in 0 to 1, `[height, width, 3]`.
    image: PyReadonlyArray3<'py, f32>,
    camera: CameraParts,
    /// World to camera.
    pose: [f64; 7],
    depth: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
}

/// Writes `transforms.json` and `cloud.ply` of all photographs, and the formats of `export` that are of them all. The result is the number of points.
#[pyfunction]
pub(crate) fn save_all(
    py: Python<'_>,
    folder: PathBuf,
    photographs: Vec<Placed<'_>>,
    unit: &str,
    export: Vec<String>,
) -> PyResult<usize> {
    let unit = self::unit(unit);
    let formats = formats(&export)?;
    let views = photographs.iter().map(|one| {
        let depth = one.depth.as_array();
        let map = DepthView {
            image: one.image.as_array(),
            camera: camera_of(one.camera)?,
            pose: pose_of(one.pose),
            depth,
            sigma: one.sigma.as_array(),
        };
        let png_scale = DepthPng::new(unit, depth.iter().copied()).scale;
        let (camera, pose) = (map.camera, map.pose);
        Ok((export::Placed { camera, pose, folder: &one.folder, png_scale }, map))
    });
    let (placed, maps): (Vec<_>, Vec<_>) =
        views.collect::<Result<Vec<_>>>().map_err(raise)?.into_iter().unzip();
    py.detach(|| write_all(&folder, (&placed, &maps), unit, &formats)).map_err(raise)
}

/// Gives a finished folder the name of another, which is removed: in one exchange where the file system can.
#[pyfunction]
pub(crate) fn replace_folder(py: Python<'_>, new: PathBuf, target: PathBuf) -> PyResult<()> {
    Ok(py.detach(|| folder::exchange(&new, &target))?)
}

/// Adds the names of a folder's files to its record: `mde refine --force` replaces no folder with files that its record lacks.
#[pyfunction]
pub(crate) fn list_files(py: Python<'_>, folder: PathBuf) -> PyResult<()> {
    Ok(py.detach(|| folder::list_files(&folder))?)
}
