use super::ScoreConfig;
use crate::Result;
use crate::metrics::boundary::boundary_f1;
use crate::metrics::edges::{EdgeSweep, edges};
use crate::metrics::ordinal::sampled_ordinal_error;
use crate::metrics::{depth, sharpness};
use crate::raster::gather;
use ndarray::ArrayView2;
use serde::{Deserialize, Serialize};

/// Scores of one aligned depth map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct DepthScores {
    /// [Mean squared error](depth::mse), m².
    pub mse: f64,
    /// [Its root](depth::rmse), m.
    pub rmse: f64,
    /// [Mean absolute relative error](depth::abs_rel).
    pub abs_rel: f64,
    /// [Mean squared relative error](depth::sq_rel), m.
    pub sq_rel: f64,
    /// [RMS error of the logarithms](depth::rmse_log).
    pub rmse_log: f64,
    /// [Mean absolute difference of the decimal logarithms](depth::log10).
    pub log10: f64,
    /// [Scale-invariant logarithmic error](depth::silog), percent.
    pub silog: f64,
    /// [RMS error of the inverse depths](depth::irmse), 1/m.
    pub irmse: f64,
    /// [Share within a factor 1.25, 1.25², 1.25³](depth::delta).
    pub delta: [f64; 3],
    /// [Mean gradient over the median depth](sharpness::sharpness), per pixel; nothing where the mask has no inside.
    pub sharpness: Option<f64>,
    /// The same near true edges, nothing where there are none.
    pub sharpness_on: Option<f64>,
    /// The same away from them.
    pub sharpness_off: Option<f64>,
    /// One entry for every threshold and tolerance.
    pub edges: Vec<EdgeScores>,
    /// [Scale-invariant boundary F1](crate::metrics::boundary::boundary_f1).
    pub boundary_f1: f64,
    /// [Depth-discontinuity disagreement](crate::metrics::ordinal), nothing where the truth has no discontinuity.
    pub d3r_like: Option<f64>,
}

impl DepthScores {
    /// The edge scores at a threshold and tolerance that were asked for.
    pub fn edges_at(&self, threshold: f64, tolerance: u32) -> Option<&EdgeScores> {
        self.edges.iter().find(|e| e.threshold == threshold && e.tolerance == tolerance)
    }
}

/// Edge scores at one threshold of the truth and one tolerance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct EdgeScores {
    /// `edge_f1@0.25m_r1`: threshold and tolerance belong beside the number.
    pub name: String,
    /// Sobel gradient (gain 8) from which on a pixel is an edge, metres.
    pub threshold: f64,
    /// Tolerance, pixels.
    pub tolerance: u32,
    /// [Edge F1](crate::metrics::edges::edge_f1) with the same threshold on both sides.
    pub f1: f64,
    /// Its precision.
    pub precision: f64,
    /// Its recall.
    pub recall: f64,
    /// [F1max](crate::metrics::edges::EdgeCurve::f1_max), the prediction's threshold swept; nothing where the truth has no
    /// edge.
    pub f1_max: Option<f64>,
    /// [Average precision](crate::metrics::edges::EdgeCurve::average_precision) of the same curve.
    pub average_precision: Option<f64>,
}

pub(super) fn scores(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
    config: &ScoreConfig,
) -> Result<DepthScores> {
    let (p, g) = (gather(prediction, mask), gather(truth, mask));
    let band_edges = edges(truth, mask, config.band_threshold)?;
    let split = sharpness::sharpness_by_edges(prediction, mask, band_edges.view(), config.band)?;
    Ok(DepthScores {
        mse: depth::mse(&p, &g)?,
        rmse: depth::rmse(&p, &g)?,
        abs_rel: depth::abs_rel(&p, &g)?,
        sq_rel: depth::sq_rel(&p, &g)?,
        rmse_log: depth::rmse_log(&p, &g)?,
        log10: depth::log10(&p, &g)?,
        silog: depth::silog(&p, &g)?,
        irmse: depth::irmse(&p, &g)?,
        delta: [depth::delta(&p, &g, 1)?, depth::delta(&p, &g, 2)?, depth::delta(&p, &g, 3)?],
        sharpness: sharpness::sharpness(prediction, mask).ok(),
        sharpness_on: split.on,
        sharpness_off: split.off,
        edges: edge_scores(prediction, truth, mask, config)?,
        boundary_f1: boundary_f1(prediction, truth, mask)?,
        d3r_like: sampled_ordinal_error(prediction, truth, mask, &config.pairs)?,
    })
}

fn edge_scores(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
    config: &ScoreConfig,
) -> Result<Vec<EdgeScores>> {
    let sweep = EdgeSweep::new(prediction, mask, &config.edge_tolerances)?;
    let mut scores = Vec::new();
    for &threshold in &config.edge_thresholds {
        let true_edges = edges(truth, mask, threshold)?;
        for &tolerance in &config.edge_tolerances {
            let curve = sweep.curve(&true_edges, tolerance)?;
            // One point of the curve is the fixed threshold's score; without true edges both are 0.
            let fixed = curve.as_ref().map(|curve| curve.at(threshold)).unwrap_or_default();
            scores.push(EdgeScores {
                name: format!("edge_f1@{threshold}m_r{tolerance}"),
                threshold,
                tolerance,
                f1: fixed.f1,
                precision: fixed.precision,
                recall: fixed.recall,
                f1_max: curve.as_ref().map(|curve| curve.f1_max()),
                average_precision: curve.as_ref().map(|curve| curve.average_precision()),
            });
        }
    }
    Ok(scores)
}
