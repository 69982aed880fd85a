//! The stages alone.

use crate::error::raise;
use crate::refine::{Camera, Object, rigid};
use crate::settings::Settings;
use mde_cli::mde_fusion::{self, BayesFuser, Fuser, Prior, Sample};
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_uncertainty::termination::{self, InBinVariance, weights};
use mde_cli::mde_warp::{self, Pose, WarpConfig};
use ndarray::{Array1, Array2, ArrayView2, Zip};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Depth with a standard deviation of the same shape, infinite where missing.
fn gaussian(depth: ArrayView2<'_, f32>, sigma: ArrayView2<'_, f32>) -> PyResult<GaussianDepth> {
    if let Some(value) = sigma.iter().find(|value| **value < 0.0 || value.is_nan()) {
        return Err(raise(format!("sigma holds {value}; give 0 or more, and infinity where missing")));
    }
    let known = |z: f32, s: f32| s.is_finite() && z > 0.0;
    let variance =
        Zip::from(depth).and(sigma).map_collect(|&z, &s| if known(z, s) { s * s } else { f32::INFINITY });
    GaussianDepth::new(depth.to_owned(), variance).map_err(raise)
}

/// Eq. 7-17 for a prior and reprojected views.
#[pyfunction]
pub(crate) fn fuse<'py>(
    py: Python<'py>,
    prior: PyReadonlyArray2<'py, f32>,
    prior_sigma: Option<PyReadonlyArray2<'py, f32>>,
    depths: Vec<PyReadonlyArray2<'py, f32>>,
    sigmas: Vec<PyReadonlyArray2<'py, f32>>,
    settings: &Settings,
) -> PyResult<Object<'py>> {
    if depths.len() != sigmas.len() {
        return Err(raise(format!("{} depths but {} sigmas; give one for each", depths.len(), sigmas.len())));
    }
    let prior = match &prior_sigma {
        Some(sigma) => Prior::with_variance(gaussian(prior.as_array(), sigma.as_array())?),
        None => Prior::new(prior.as_array().to_owned()),
    };
    let prior = prior.map_err(raise)?;
    let views = depths.iter().zip(&sigmas).map(|(depth, sigma)| gaussian(depth.as_array(), sigma.as_array()));
    let views = views.collect::<PyResult<Vec<_>>>()?;
    let fused = py
        .detach(|| BayesFuser::new(settings.0.config.fusion.clone())?.fuse(&prior, &views))
        .map_err(|e: mde_fusion::Error| raise(e))?;
    let parts = PyDict::new(py);
    let maps = [("", &fused.depth), ("aggregated_", &fused.aggregated), ("aligned_", &fused.aligned)];
    for (name, depth) in maps {
        parts.set_item(format!("{name}depth"), depth.mean().to_owned().into_pyarray(py))?;
        parts.set_item(format!("{name}sigma"), depth.sigma().into_pyarray(py))?;
    }
    parts.set_item("report", serde_json::to_string(&fused.report).map_err(raise)?)?;
    Ok(parts.into_any())
}

/// Eq. 11-13: `(a, b, effective_support, correlation, relative_spread)`, or nothing where the line is not determined.
#[pyfunction]
pub(crate) fn affine_wls(
    py: Python<'_>,
    u: PyReadonlyArray1<'_, f64>,
    v: PyReadonlyArray1<'_, f64>,
    variance: PyReadonlyArray1<'_, f64>,
) -> Option<[f64; 5]> {
    let (u, v, variance) = (u.as_array(), v.as_array(), variance.as_array());
    let fit = py.detach(|| {
        let lists = u.iter().zip(v).zip(variance);
        let samples: Vec<Sample> = lists.map(|((&u, &v), &variance)| Sample { u, variance, v }).collect();
        mde_fusion::affine_wls(&samples)
    })?;
    let affine = fit.affine;
    Some([affine.a, affine.b, fit.effective_support, fit.correlation, fit.relative_spread])
}

/// Eq. 2-5 for rays `[rays, bins]`: opacity, mean, variance of each ray, and the weights of its bins.
#[pyfunction]
pub(crate) fn termination_moments<'py>(
    py: Python<'py>,
    density: PyReadonlyArray2<'py, f64>,
    depth: PyReadonlyArray2<'py, f64>,
    extent: PyReadonlyArray2<'py, f64>,
    uniform: bool,
) -> ([Bound<'py, PyArray1<f64>>; 3], Bound<'py, PyArray2<f64>>) {
    let rule = if uniform { InBinVariance::Uniform } else { InBinVariance::Midpoint };
    let (density, depth, extent) = (density.as_array(), depth.as_array(), extent.as_array());
    let (rays, bins) = density.dim();
    let mut all = Array2::zeros((rays, bins));
    let [mut opacity, mut mean, mut variance] = [(); 3].map(|()| Array1::zeros(rays));
    py.detach(|| {
        for (index, mut row) in all.outer_iter_mut().enumerate() {
            let [density, depth, extent] = [density, depth, extent].map(|map| map.row(index).to_vec());
            let mut found = vec![0.0; bins];
            weights(&density, &extent, &mut found);
            let moments = termination::moments(&found, &depth, &extent, rule);
            (opacity[index], mean[index], variance[index]) =
                (moments.opacity, moments.mean, moments.variance);
            row.iter_mut().zip(found).for_each(|(to, weight)| *to = weight);
        }
    });
    ([opacity, mean, variance].map(|list| list.into_pyarray(py)), all.into_pyarray(py))
}

/// Eq. 1: an image with its depth, seen from another pose. `source` has its camera and the motion to the other, `target` that and
/// its `(height, width)`.
#[pyfunction]
pub(crate) fn forward_warp<'py>(
    py: Python<'py>,
    image: PyReadonlyArray3<'py, f32>,
    depth: PyReadonlyArray2<'py, f32>,
    sigma: PyReadonlyArray2<'py, f32>,
    source: (Camera, [[f64; 4]; 4]),
    target: Option<(Camera, (usize, usize))>,
    tear: f64,
) -> PyResult<Object<'py>> {
    let (camera, pose) = source;
    let source = camera.of(depth.as_array().dim())?.camera;
    let target = match target {
        Some((camera, size)) => camera.of(size)?.camera,
        None => source,
    };
    let pose = rigid("pose", &pose)?;
    let (image, depth) = (image.as_array().to_owned(), gaussian(depth.as_array(), sigma.as_array())?);
    let config = WarpConfig { tear };
    let warped = py
        .detach(|| {
            let start = Pose::identity();
            mde_warp::forward_warp(image.view(), &depth, &source, &start, &target, &pose, &config)
        })
        .map_err(raise)?;
    let parts = PyDict::new(py);
    parts.set_item("image", warped.view.image.into_owned().into_pyarray(py))?;
    parts.set_item("depth", warped.depth.into_pyarray(py))?;
    let sigma = warped.view.hypotheses.first().map(GaussianDepth::sigma).unwrap_or_default();
    parts.set_item("sigma", sigma.into_pyarray(py))?;
    parts.set_item("mask", warped.view.mask.into_owned().into_pyarray(py))?;
    parts.set_item("hole_fraction", warped.hole_fraction)?;
    parts.set_item("outside_fraction", warped.outside_fraction)?;
    Ok(parts.into_any())
}
