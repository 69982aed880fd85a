//! The metrics of `mde-eval` for arrays.

use crate::error::raise;
use mde_eval::align::AlignmentRule;
use mde_eval::metrics::ordinal::{PairSampling, ordinal_error as ordinal};
use mde_eval::metrics::sparsification::{self, Reduction};
use mde_eval::metrics::superpixel::SuperpixelPairs;
use mde_eval::metrics::{
    boundary, bsds, calibration, dbe, depth, edges, occlusion, rank, sharpness, soft_edge,
};
use mde_eval::score::{self, ScoreConfig, Subject};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use std::fmt::Display;

type List<'py> = PyReadonlyArray1<'py, f64>;
type Map<'py> = PyReadonlyArray2<'py, f32>;
type Mask<'py> = PyReadonlyArray2<'py, bool>;

/// Runs `work` while other threads of Python run.
fn free<T: Send, E: Display + Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, E> + Send,
) -> PyResult<T> {
    py.detach(work).map_err(raise)
}

/// As [`free`], on two lists.
fn of_lists<T: Send, E: Display + Send>(
    py: Python<'_>,
    lists: [&List<'_>; 2],
    work: impl FnOnce(&[f64], &[f64]) -> Result<T, E> + Send,
) -> PyResult<T> {
    let [a, b] = lists.map(|list| list.as_array());
    free(py, || work(&a.to_vec(), &b.to_vec()))
}

/// A metric of two lists of depths, of that name.
#[pyfunction]
#[pyo3(signature = (name, prediction, truth))]
pub(crate) fn depth_metric(
    py: Python<'_>,
    name: &str,
    prediction: List<'_>,
    truth: List<'_>,
) -> PyResult<f64> {
    let metric = match name {
        "mse" => depth::mse,
        "rmse" => depth::rmse,
        "abs_rel" => depth::abs_rel,
        "sq_rel" => depth::sq_rel,
        "rmse_log" => depth::rmse_log,
        "log10" => depth::log10,
        "silog" => depth::silog,
        "irmse" => depth::irmse,
        _ => return Err(unknown(name)),
    };
    of_lists(py, [&prediction, &truth], metric)
}

/// Share within a factor of 1.25^k.
#[pyfunction]
#[pyo3(signature = (prediction, truth, k))]
pub(crate) fn delta(py: Python<'_>, prediction: List<'_>, truth: List<'_>, k: i32) -> PyResult<f64> {
    of_lists(py, [&prediction, &truth], |prediction, truth| depth::delta(prediction, truth, k))
}

/// A metric of errors and their standard deviations, of that name.
#[pyfunction]
#[pyo3(signature = (name, errors, sigma))]
pub(crate) fn sigma_metric(py: Python<'_>, name: &str, errors: List<'_>, sigma: List<'_>) -> PyResult<f64> {
    let metric = match name {
        "nll" => calibration::nll,
        "crps" => calibration::crps,
        "mean_z2" => calibration::mean_z2,
        "rms_sigma" => calibration::rms_sigma,
        "mace" => calibration::mace,
        _ => return Err(unknown(name)),
    };
    of_lists(py, [&errors, &sigma], metric)
}

/// Share of the errors within the central interval of that level.
#[pyfunction]
#[pyo3(signature = (errors, sigma, level))]
pub(crate) fn coverage(py: Python<'_>, errors: List<'_>, sigma: List<'_>, level: f64) -> PyResult<f64> {
    of_lists(py, [&errors, &sigma], |errors, sigma| calibration::coverage(errors, sigma, level))
}

/// Expected normalised calibration error.
#[pyfunction]
#[pyo3(signature = (errors, sigma, bins))]
pub(crate) fn ence(py: Python<'_>, errors: List<'_>, sigma: List<'_>, bins: usize) -> PyResult<f64> {
    of_lists(py, [&errors, &sigma], |errors, sigma| calibration::ence(errors, sigma, bins))
}

/// Mean, root of the mean square, and area of the distances between observed and nominal coverage.
#[pyfunction]
#[pyo3(signature = (errors, sigma))]
pub(crate) fn calibration_errors(
    py: Python<'_>,
    errors: List<'_>,
    sigma: List<'_>,
) -> PyResult<(f64, f64, f64)> {
    let found = of_lists(py, [&errors, &sigma], calibration::calibration_errors)?;
    Ok((found.mean, found.root_mean_square, found.area))
}

/// Pairs of sigma and cost, and their correlation.
type Bins = (Vec<(f64, f64)>, Option<f64>);

/// Mean sigma and mean cost by percentile of sigma, and their Spearman correlation.
#[pyfunction]
#[pyo3(signature = (costs, sigma, bins))]
pub(crate) fn costs_by_sigma(
    py: Python<'_>,
    costs: List<'_>,
    sigma: List<'_>,
    bins: usize,
) -> PyResult<Bins> {
    of_lists(py, [&costs, &sigma], |costs, sigma| -> mde_eval::Result<_> {
        let found = sparsification::costs_by_uncertainty(costs, sigma, bins)?;
        let correlation = sparsification::spearman_of_bins(&found)?;
        Ok((found.iter().map(|bin| (bin.sigma, bin.cost)).collect(), correlation))
    })
}

/// Nominal and observed coverage.
#[pyfunction]
#[pyo3(signature = (errors, sigma))]
pub(crate) fn reliability(py: Python<'_>, errors: List<'_>, sigma: List<'_>) -> PyResult<Vec<(f64, f64)>> {
    of_lists(py, [&errors, &sigma], calibration::reliability)
}

/// Spearman's correlation.
#[pyfunction]
#[pyo3(signature = (x, y))]
pub(crate) fn spearman(py: Python<'_>, x: List<'_>, y: List<'_>) -> PyResult<Option<f64>> {
    of_lists(py, [&x, &y], rank::spearman)
}

/// AUSE, AURG, and the curves: removed, by sigma, by the oracle.
type Sparsification = (f64, f64, Vec<f64>, Vec<f64>, Vec<f64>);

/// Sparsification of costs by sigma.
#[pyfunction]
#[pyo3(signature = (costs, sigma, root, poggi))]
pub(crate) fn sparsification_curves(
    py: Python<'_>,
    costs: List<'_>,
    sigma: List<'_>,
    root: bool,
    poggi: bool,
) -> PyResult<Sparsification> {
    let reduction = if root { Reduction::RootMean } else { Reduction::Mean };
    let sparsify = if poggi { sparsification::sparsify_poggi } else { sparsification::sparsify };
    let found = of_lists(py, [&costs, &sigma], |costs, sigma| sparsify(costs, sigma, reduction))?;
    Ok((found.ause(), found.aurg(), found.removed, found.by_sigma, found.oracle))
}

/// Mean gradient of a map.
#[pyfunction]
#[pyo3(signature = (map, mask))]
pub(crate) fn mean_gradient(py: Python<'_>, map: Map<'_>, mask: Mask<'_>) -> PyResult<f64> {
    let (map, mask) = (map.as_array(), mask.as_array());
    free(py, || sharpness::sharpness(map, mask))
}

/// Mean gradient of a map within a band of pixels about edges, and beyond it.
#[pyfunction]
#[pyo3(signature = (map, mask, edges, band))]
pub(crate) fn mean_gradient_by_edges(
    py: Python<'_>,
    map: Map<'_>,
    mask: Mask<'_>,
    edges: Mask<'_>,
    band: f64,
) -> PyResult<(Option<f64>, Option<f64>)> {
    let maps = (map.as_array(), mask.as_array(), edges.as_array());
    let found = free(py, || sharpness::sharpness_by_edges(maps.0, maps.1, maps.2, band))?;
    Ok((found.on, found.off))
}

/// Edges of a map.
#[pyfunction]
#[pyo3(signature = (map, mask, threshold))]
pub(crate) fn edge_map<'py>(
    py: Python<'py>,
    map: Map<'py>,
    mask: Mask<'py>,
    threshold: f64,
) -> PyResult<Bound<'py, numpy::PyArray2<bool>>> {
    let (map, mask) = (map.as_array(), mask.as_array());
    let found = free(py, || edges::edges(map, mask, threshold))?;
    Ok(numpy::IntoPyArray::into_pyarray(found, py))
}

/// Precision, recall and F1 of edges.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask, threshold, tolerance))]
pub(crate) fn edge_f1(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
    threshold: f64,
    tolerance: u32,
) -> PyResult<(f64, f64, f64)> {
    let maps = (prediction.as_array(), truth.as_array(), mask.as_array());
    let score = free(py, || edges::edge_f1(maps.0, maps.1, maps.2, threshold, tolerance))?;
    Ok((score.precision, score.recall, score.f1))
}

/// F1max and average precision over all thresholds of the prediction.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask, threshold, tolerance))]
pub(crate) fn edge_curve(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
    threshold: f64,
    tolerance: u32,
) -> PyResult<Option<(f64, f64)>> {
    let maps = (prediction.as_array(), truth.as_array(), mask.as_array());
    let curve = free(py, || edges::edge_curve(maps.0, maps.1, maps.2, threshold, tolerance))?;
    Ok(curve.map(|curve| (curve.f1_max(), curve.average_precision())))
}

/// F1 at the best threshold and average precision of thinned edges, matched one to one.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask, threshold))]
pub(crate) fn boundary_matches(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
    threshold: f64,
) -> PyResult<Option<(f64, f64)>> {
    let maps = (prediction.as_array(), truth.as_array(), mask.as_array());
    let counts = free(py, || bsds::boundary_counts(maps.0, maps.1, maps.2, threshold))?;
    Ok(counts.map(|counts| (counts.best, counts.average_precision)))
}

/// Scale-invariant boundary F1.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask))]
pub(crate) fn boundary_f1(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
) -> PyResult<f64> {
    let maps = (prediction.as_array(), truth.as_array(), mask.as_array());
    free(py, || boundary::boundary_f1(maps.0, maps.1, maps.2))
}

/// Occlusion-boundary F1 at radii of 1 to 3 pixels.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask))]
pub(crate) fn occlusion_f1(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
) -> PyResult<[f64; 3]> {
    let maps = (prediction.as_array(), truth.as_array(), mask.as_array());
    free(py, || occlusion::occlusion_f1(maps.0, maps.1, maps.2))
}

/// Accuracy and completeness of depth boundaries, pixels.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask))]
pub(crate) fn boundary_errors(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
) -> PyResult<Option<(f64, f64)>> {
    let (prediction, truth, mask) = (prediction.as_array(), truth.as_array(), mask.as_array());
    let errors = free(py, || {
        let (predicted, true_ones) = (dbe::boundaries(prediction, mask)?, dbe::boundaries(truth, mask)?);
        dbe::boundary_errors(predicted.view(), true_ones.view())
    })?;
    Ok(errors.map(|errors| (errors.accuracy, errors.completeness)))
}

/// Soft edge error at those edges.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask, edges))]
pub(crate) fn soft_edge_error(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
    edges: Mask<'_>,
) -> PyResult<Option<f64>> {
    let maps = (prediction.as_array(), truth.as_array());
    let masks = (mask.as_array(), edges.as_array());
    free(py, || soft_edge::soft_edge_error(maps.0, maps.1, masks.0, masks.1))
}

/// Wrong order of random pairs.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask, sampling))]
pub(crate) fn ordinal_error(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
    sampling: (usize, Option<u32>, f64, f64, u64),
) -> PyResult<Option<f64>> {
    let (count, radius, min_ratio, tie_ratio, seed) = sampling;
    let sampling = PairSampling { count, radius, min_ratio, tie_ratio, seed };
    sampling.validate().map_err(raise)?;
    let (prediction, truth, mask) = (prediction.as_array(), truth.as_array(), mask.as_array());
    free(py, || ordinal(prediction, truth, &sampling.draw(mask), min_ratio, tie_ratio))
}

/// Wrong order of superpixels: D3R and ORD.
#[pyfunction]
#[pyo3(signature = (prediction, truth, mask))]
pub(crate) fn superpixel_order(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    mask: Mask<'_>,
) -> PyResult<(Option<f64>, Option<f64>)> {
    let (prediction, truth, mask) = (prediction.as_array(), truth.as_array(), mask.as_array());
    let errors = free(py, || SuperpixelPairs::new(truth, mask)?.compare(prediction, truth))?;
    Ok((errors.d3r, errors.ord))
}

/// Fits a prediction to the truth: the aligned map, and the alignment as JSON.
#[pyfunction]
#[pyo3(signature = (prediction, truth, rule, mask))]
pub(crate) fn align<'py>(
    py: Python<'py>,
    prediction: Map<'py>,
    truth: Map<'py>,
    rule: &str,
    mask: Option<Mask<'py>>,
) -> PyResult<(Bound<'py, numpy::PyArray2<f32>>, String)> {
    let rule: AlignmentRule = serde_json::from_value(rule.into()).map_err(|_| alignment(rule))?;
    let config = ScoreConfig { alignment: rule, max_depth: f64::MAX, ..ScoreConfig::default() };
    let prediction = prediction.as_array();
    let mut subject = Subject::new(prediction, truth.as_array());
    if let Some(mask) = &mask {
        subject = subject.with_mask(mask.as_array());
    }
    let (fitted, aligned) = free(py, || -> mde_eval::Result<_> {
        let fitted = subject.fit(&config)?;
        let aligned = fitted.apply(prediction);
        Ok((fitted, aligned))
    })?;
    let text = serde_json::to_string(&fitted).map_err(raise)?;
    Ok((numpy::IntoPyArray::into_pyarray(aligned, py), text))
}

/// All scores as JSON; `config` is a JSON object of the fields that differ from the defaults.
#[pyfunction]
#[pyo3(signature = (prediction, truth, sigma, mask, config))]
pub(crate) fn score_maps(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    sigma: Option<Map<'_>>,
    mask: Option<Mask<'_>>,
    config: &str,
) -> PyResult<String> {
    let config: ScoreConfig = serde_json::from_str(config).map_err(|e| raise(format!("config: {e}")))?;
    let mut subject = Subject::new(prediction.as_array(), truth.as_array());
    if let Some(sigma) = &sigma {
        subject = subject.with_sigma(sigma.as_array());
    }
    if let Some(mask) = &mask {
        subject = subject.with_mask(mask.as_array());
    }
    let scores = free(py, || score::score(&subject, &config))?;
    serde_json::to_string(&scores).map_err(raise)
}

fn unknown(name: &str) -> PyErr {
    raise(format!("no metric {name:?}"))
}

fn alignment(rule: &str) -> PyErr {
    raise(format!(
        "alignment is {rule:?}; give none, median, median-ratio, least-squares-depth or least-squares-disparity"
    ))
}
