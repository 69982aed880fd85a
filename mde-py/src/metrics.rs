//! The scores, the alignments and the curves of `mde-eval` for arrays.

use crate::error::raise;
use mde_eval::align::AlignmentRule;
use mde_eval::metrics::{calibration, edges, sparsification};
use mde_eval::score::{self, ScoreConfig, Subject};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

type List<'py> = PyReadonlyArray1<'py, f64>;
type Map<'py> = PyReadonlyArray2<'py, f32>;
type Mask<'py> = PyReadonlyArray2<'py, bool>;
type Table<'py> = Bound<'py, PyArray2<f64>>;

/// A curve of two lists, one row a point.
fn curve<'py, T: Into<[f64; N]> + Send, const N: usize>(
    py: Python<'py>,
    lists: [List<'_>; 2],
    work: impl FnOnce(&[f64], &[f64]) -> mde_eval::Result<Vec<T>> + Send,
) -> PyResult<Table<'py>> {
    let [a, b] = lists.map(|list| list.as_array().to_vec());
    let points = py.detach(|| work(&a, &b)).map_err(raise)?;
    Ok(Array2::from(points.into_iter().map(T::into).collect::<Vec<_>>()).into_pyarray(py))
}

/// Nominal and observed coverage.
#[pyfunction]
pub(crate) fn reliability<'py>(py: Python<'py>, errors: List<'py>, sigma: List<'py>) -> PyResult<Table<'py>> {
    curve(py, [errors, sigma], calibration::reliability)
}

/// Mean sigma and mean cost by percentile of sigma.
#[pyfunction]
pub(crate) fn costs_by_sigma<'py>(
    py: Python<'py>,
    costs: List<'py>,
    sigma: List<'py>,
    bins: usize,
) -> PyResult<Table<'py>> {
    curve(py, [costs, sigma], |costs, sigma| sparsification::costs_by_uncertainty(costs, sigma, bins))
}

/// Share removed, cost of the rest by sigma and by the oracle.
#[pyfunction]
pub(crate) fn sparsification_curve<'py>(
    py: Python<'py>,
    costs: List<'py>,
    sigma: List<'py>,
    root: bool,
) -> PyResult<Table<'py>> {
    use sparsification::Reduction::{Mean, RootMean};
    curve(py, [costs, sigma], |costs, sigma| {
        let found = sparsification::sparsify(costs, sigma, if root { RootMean } else { Mean })?;
        let rows = found.removed.iter().zip(&found.by_sigma).zip(&found.oracle);
        Ok(rows.map(|((removed, sigma), oracle)| [*removed, *sigma, *oracle]).collect())
    })
}

/// Threshold, precision and recall over all thresholds of the prediction.
#[pyfunction]
pub(crate) fn edge_curve<'py>(
    py: Python<'py>,
    prediction: Map<'py>,
    truth: Map<'py>,
    mask: Mask<'py>,
    threshold: f64,
    tolerance: u32,
) -> PyResult<Option<Table<'py>>> {
    let (prediction, truth, mask) = (prediction.as_array(), truth.as_array(), mask.as_array());
    let found = py.detach(|| {
        let true_edges = edges::edges(truth, mask, threshold)?;
        edges::edge_curve(prediction, mask, &true_edges, tolerance)
    });
    let found = found.map_err(raise)?;
    Ok(found.map(|curve| {
        let rows: Vec<_> = curve.points.iter().map(|p| [p.threshold, p.precision, p.recall]).collect();
        Array2::from(rows).into_pyarray(py)
    }))
}

/// Fits a prediction to the truth: the aligned map, and the alignment as JSON.
#[pyfunction]
pub(crate) fn align<'py>(
    py: Python<'py>,
    prediction: Map<'py>,
    truth: Map<'py>,
    rule: &str,
    mask: Option<Mask<'py>>,
) -> PyResult<(Bound<'py, PyArray2<f32>>, String)> {
    let rule: AlignmentRule = serde_json::from_value(rule.into()).map_err(|_| {
        raise(format!(
            "alignment is {rule:?}; give none, median, median-ratio, least-squares-depth or least-squares-disparity"
        ))
    })?;
    let config = ScoreConfig { alignment: rule, max_depth: f64::MAX, ..ScoreConfig::default() };
    let prediction = prediction.as_array();
    let mask = mask.as_ref().map(|mask| mask.as_array());
    let subject = Subject { mask, ..Subject::new(prediction, truth.as_array()) };
    let fitted = py.detach(|| subject.fit(&config).map(|fitted| (fitted, fitted.apply(prediction))));
    let (fitted, aligned) = fitted.map_err(raise)?;
    let text = serde_json::to_string(&fitted).map_err(raise)?;
    Ok((aligned.into_pyarray(py), text))
}

/// All scores as JSON; `config` is a JSON object of the fields that differ from the defaults.
#[pyfunction]
pub(crate) fn score_maps(
    py: Python<'_>,
    prediction: Map<'_>,
    truth: Map<'_>,
    sigma: Option<Map<'_>>,
    mask: Option<Mask<'_>>,
    config: &str,
) -> PyResult<String> {
    let config: ScoreConfig = serde_json::from_str(config).map_err(|e| raise(format!("config: {e}")))?;
    let sigma = sigma.as_ref().map(|sigma| sigma.as_array());
    let mask = mask.as_ref().map(|mask| mask.as_array());
    let subject = Subject { sigma, mask, ..Subject::new(prediction.as_array(), truth.as_array()) };
    let scores = py.detach(|| score::score(&subject, &config)).map_err(raise)?;
    serde_json::to_string(&scores).map_err(raise)
}
