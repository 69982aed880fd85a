use super::truth::Truth;
use crate::Result;
use crate::metrics::dbe::{BoundaryErrors, boundaries, errors_against};
use crate::metrics::edges::EdgeSweep;
use crate::metrics::sharpness::{EdgeSplit, sharpness_by_distance};
use crate::metrics::superpixel::OrderErrors;
use crate::raster::{Map, gather};

/// Thresholds of the edge scores, metres of Sobel gradient (gain 8).
pub(super) const EDGE_THRESHOLDS: [f64; 3] = [0.25, 0.5, 1.0];
/// Tolerances of the edge scores, pixels.
const EDGE_TOLERANCES: [u32; 3] = [0, 1, 2];
/// The truth's edges between on-edge and off-edge sharpness: those at 0.5 m of [`EDGE_THRESHOLDS`].
const BAND_EDGES: usize = 1;
/// How far from a true edge a pixel is still on it, pixels.
const BAND: f64 = 3.0;

/// An aligned depth map beside its truth, with what several metrics share.
pub(super) struct DepthMap<'a> {
    /// `[height, width]`, as `truth`.
    pub(super) map: Map<'a>,
    pub(super) truth: &'a Truth,
    /// The pixels that count.
    pub(super) predicted: Vec<f64>,
    /// The truth of the same pixels.
    pub(super) true_depths: Vec<f64>,
    edges: Vec<EdgeScores>,
    pub(super) sharpness: EdgeSplit,
    /// Nothing where the truth has no boundary.
    pub(super) boundaries: Option<BoundaryErrors>,
    pub(super) order: OrderErrors,
}

/// Edge scores at one threshold of the truth and one tolerance.
pub(super) struct EdgeScores {
    threshold: f64,
    tolerance: u32,
    /// With the same threshold on both sides.
    pub(super) f1: f64,
    /// With the prediction's threshold swept; nothing where the truth has no edge.
    pub(super) f1_max: Option<f64>,
    pub(super) average_precision: Option<f64>,
}

impl<'a> DepthMap<'a> {
    pub(super) fn new(map: Map<'a>, truth: &'a Truth) -> Result<Self> {
        let mask = truth.pixels.view();
        let (edges, (sharpness, (boundaries, order))) = rayon::join(
            || edge_scores(map, truth),
            || {
                let split = sharpness_by_distance(map, mask, truth.edges[BAND_EDGES].distance.view(), BAND);
                let errors =
                    boundaries(map, mask).and_then(|own| errors_against(own.view(), &truth.boundaries));
                (split, (errors, truth.superpixels.compare(map, truth.depth.view())))
            },
        );
        let (predicted, true_depths) = (gather(map, mask), gather(truth.depth.view(), mask));
        let (edges, sharpness, boundaries, order) = (edges?, sharpness?, boundaries?, order?);
        Ok(Self { map, truth, predicted, true_depths, edges, sharpness, boundaries, order })
    }

    /// One of the edge scores at a threshold and tolerance.
    pub(super) fn edges(
        &self,
        threshold: f64,
        tolerance: u32,
        of: fn(&EdgeScores) -> Option<f64>,
    ) -> Result<Option<f64>> {
        let found = self.edges.iter().find(|e| e.threshold == threshold && e.tolerance == tolerance);
        Ok(found.and_then(of))
    }
}

fn edge_scores(map: Map<'_>, truth: &Truth) -> Result<Vec<EdgeScores>> {
    let sweep = EdgeSweep::new(map, truth.pixels.view(), &EDGE_TOLERANCES)?;
    let mut scores = Vec::new();
    for (threshold, true_edges) in EDGE_THRESHOLDS.into_iter().zip(&truth.edges) {
        for tolerance in EDGE_TOLERANCES {
            let curve = sweep.curve(true_edges, tolerance)?;
            // One point of the curve is the fixed threshold's score; without true edges it is 0.
            scores.push(EdgeScores {
                threshold,
                tolerance,
                f1: curve.as_ref().map_or(0.0, |curve| curve.at(threshold).f1),
                f1_max: curve.as_ref().map(|curve| curve.f1_max()),
                average_precision: curve.as_ref().map(|curve| curve.average_precision()),
            });
        }
    }
    Ok(scores)
}
