use super::Aligned;
use crate::Result;
use crate::metrics::boundary::boundary_f1;
use crate::metrics::dbe::{BoundaryErrors, boundaries, boundary_errors};
use crate::metrics::edges::{self, edge_curve};
use crate::metrics::sharpness::{EdgeSplit, sharpness, sharpness_by_edges};
use crate::metrics::superpixel::d3r;
use crate::raster::gather;

/// Thresholds of the edge scores, metres of Sobel gradient (gain 8).
const EDGE_THRESHOLDS: [f64; 2] = [0.25, 0.5];
/// Tolerance of the edge scores, pixels.
const EDGE_TOLERANCE: u32 = 1;
/// Threshold of the truth's edges between on-edge and off-edge sharpness.
const BAND_THRESHOLD: f64 = 0.5;
/// How far from a true edge a pixel is still on it, pixels.
const BAND: f64 = 3.0;

/// An aligned depth map beside its truth, with what several metrics share.
pub(super) struct DepthMap {
    /// The pixels that count.
    pub(super) predicted: Vec<f64>,
    /// The truth of the same pixels.
    pub(super) true_depths: Vec<f64>,
    /// At each of [`EDGE_THRESHOLDS`].
    pub(super) edges: Vec<EdgeScores>,
    /// Sharpness on and off the true edges.
    pub(super) split: EdgeSplit,
    /// Nothing where the truth has no boundary.
    pub(super) boundaries: Option<BoundaryErrors>,
    pub(super) d3r: Option<f64>,
    pub(super) boundary_f1: f64,
    /// Nothing where no pixel is left.
    pub(super) sharpness: Option<f64>,
}

/// Edge scores at one threshold of the truth.
pub(super) struct EdgeScores {
    /// With the same threshold on both sides.
    pub(super) f1: f64,
    /// With the prediction's threshold swept; nothing where the truth has no edge.
    pub(super) f1_max: Option<f64>,
}

impl DepthMap {
    pub(super) fn new(aligned: &Aligned) -> Result<Self> {
        let (map, truth, mask) = (aligned.depth.view(), aligned.truth.view(), aligned.pixels.view());
        let edge_scores = |threshold| {
            let curve = edge_curve(map, truth, mask, threshold, EDGE_TOLERANCE)?;
            // One point of the curve is the fixed threshold's score; without true edges it is 0.
            let f1 = curve.as_ref().map_or(0.0, |curve| curve.at(threshold).f1());
            Ok(EdgeScores { f1, f1_max: curve.map(|curve| curve.f1_max()) })
        };
        let errors = || -> Result<_> {
            let [predicted, known] = [boundaries(map, mask)?, boundaries(truth, mask)?];
            boundary_errors(predicted.view(), known.view())
        };
        let (edges, (boundaries, d3r)) = rayon::join(
            || EDGE_THRESHOLDS.into_iter().map(edge_scores).collect::<Result<_>>(),
            || (errors(), d3r(map, truth, mask)),
        );
        Ok(Self {
            predicted: gather(map, mask),
            true_depths: gather(truth, mask),
            edges: edges?,
            split: sharpness_by_edges(map, mask, edges::edges(truth, mask, BAND_THRESHOLD)?.view(), BAND)?,
            boundaries: boundaries?,
            d3r: d3r?,
            boundary_f1: boundary_f1(map, truth, mask)?,
            sharpness: sharpness(map, mask).ok(),
        })
    }
}
