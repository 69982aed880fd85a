use super::ScoreConfig;
use super::truth::Truth;
use crate::Result;
use crate::metrics::boundary::boundary_f1;
use crate::metrics::bsds::{BoundaryCounts, Thinned};
use crate::metrics::dbe::{BoundaryErrors, boundaries, errors_against};
use crate::metrics::edges::EdgeSweep;
use crate::metrics::occlusion::occlusion_f1;
use crate::metrics::ordinal::{PairSampling, ordinal_error};
use crate::metrics::sharpness::EdgeSplit;
use crate::metrics::soft_edge::soft_edge_error_within;
use crate::metrics::superpixel::OrderErrors;
use crate::metrics::{depth, sharpness};
use crate::raster::gather;
use ndarray::ArrayView2;
use serde::{Deserialize, Serialize};

/// Scores of one aligned depth map.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
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
    /// [Boundary F1 at radii of 1, 2 and 3 pixels](crate::metrics::occlusion::occlusion_f1).
    pub occlusion_f1: [f64; 3],
    /// [Thinned edges matched one to one](crate::metrics::bsds), one entry for every threshold of the truth.
    pub boundaries: Vec<BoundaryScores>,
    /// [Depth boundary errors](crate::metrics::dbe), pixels, with the truth's own Canny edges as boundaries: accuracy; nothing where there are
    /// none.
    pub dbe_accuracy: Option<f64>,
    /// Their completeness.
    pub dbe_completeness: Option<f64>,
    /// [Soft edge error](crate::metrics::soft_edge) about the truth's edges at the band's threshold, m.
    pub see: Option<f64>,
    /// [Order of random pairs across discontinuities](crate::metrics::ordinal), nothing where the truth has no discontinuity.
    pub d3r_like: Option<f64>,
    /// [Order of superpixels across discontinuities](crate::metrics::superpixel), likewise.
    pub d3r: Option<f64>,
    /// [Order of superpixels anywhere](crate::metrics::superpixel).
    pub ord: Option<f64>,
}

/// Thinned edges matched one to one, at one threshold of the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct BoundaryScores {
    /// Sobel gradient (gain 8) from which on the truth's thinned pixels are boundaries, metres.
    pub threshold: f64,
    /// The counts, to be pooled over images; nothing where the truth has no boundary.
    pub counts: Option<BoundaryCounts>,
}

impl DepthScores {
    /// The edge scores at a requested threshold and tolerance.
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

/// Of `prediction`, `[height, width]`, aligned.
pub(super) fn scores(
    prediction: ArrayView2<'_, f32>,
    truth: &Truth,
    config: &ScoreConfig,
) -> Result<DepthScores> {
    let (map, mask) = (truth.depth.view(), truth.pixels.view());
    let ((pixels, edges), (boundaries, rest)) = rayon::join(
        || (pixel_scores(prediction, truth, config), edge_scores(prediction, truth, config)),
        || (boundary_scores(prediction, truth, config), Rest::new(prediction, truth, config)),
    );
    let rest = rest?;
    Ok(DepthScores {
        edges: edges?,
        boundaries: boundaries?,
        sharpness_on: rest.sharpness.on,
        sharpness_off: rest.sharpness.off,
        boundary_f1: boundary_f1(prediction, map, mask)?,
        occlusion_f1: rest.occlusion,
        dbe_accuracy: rest.dbe.map(|e| e.accuracy),
        dbe_completeness: rest.dbe.map(|e| e.completeness),
        see: rest.see,
        d3r: rest.order.d3r,
        ord: rest.order.ord,
        ..pixels?
    })
}

/// Scores that need no edges; those that do are left empty.
fn pixel_scores(prediction: ArrayView2<'_, f32>, truth: &Truth, config: &ScoreConfig) -> Result<DepthScores> {
    let mask = truth.pixels.view();
    let (p, g) = (gather(prediction, mask), gather(truth.depth.view(), mask));
    let PairSampling { min_ratio, tie_ratio, .. } = config.pairs;
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
        d3r_like: ordinal_error(prediction, truth.depth.view(), &truth.pairs, min_ratio, tie_ratio)?,
        ..DepthScores::default()
    })
}

fn boundary_scores(
    prediction: ArrayView2<'_, f32>,
    truth: &Truth,
    config: &ScoreConfig,
) -> Result<Vec<BoundaryScores>> {
    let predicted = Thinned::new(prediction, truth.pixels.view())?;
    let score =
        |&threshold: &f64| BoundaryScores { threshold, counts: predicted.against(&truth.thinned, threshold) };
    Ok(config.boundary_thresholds.iter().map(score).collect())
}

/// Scores that need the truth's edges.
struct Rest {
    sharpness: EdgeSplit,
    occlusion: [f64; 3],
    dbe: Option<BoundaryErrors>,
    see: Option<f64>,
    order: OrderErrors,
}

impl Rest {
    fn new(prediction: ArrayView2<'_, f32>, truth: &Truth, config: &ScoreConfig) -> Result<Self> {
        let (map, mask) = (truth.depth.view(), truth.pixels.view());
        let band = truth.edges_at(config.band_threshold)?.distance.view();
        Ok(Self {
            sharpness: sharpness::sharpness_by_distance(prediction, mask, band, config.band)?,
            occlusion: occlusion_f1(prediction, map, mask)?,
            dbe: errors_against(boundaries(prediction, mask)?.view(), &truth.boundaries)?,
            see: soft_edge_error_within(prediction, map, mask, band)?,
            order: truth.superpixels.compare(prediction, map)?,
        })
    }
}

fn edge_scores(
    prediction: ArrayView2<'_, f32>,
    truth: &Truth,
    config: &ScoreConfig,
) -> Result<Vec<EdgeScores>> {
    let sweep = EdgeSweep::new(prediction, truth.pixels.view(), &config.edge_tolerances)?;
    let mut scores = Vec::new();
    for &threshold in &config.edge_thresholds {
        let true_edges = truth.edges_at(threshold)?;
        for &tolerance in &config.edge_tolerances {
            let curve = sweep.curve(true_edges, tolerance)?;
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
