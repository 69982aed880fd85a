use super::prepared::Truth;
use crate::Result;
use crate::metrics::boundary::boundary_f1;
use crate::metrics::dbe::{BoundaryErrors, boundaries, errors_against};
use crate::metrics::edges::EdgeSweep;
use crate::metrics::sharpness::{EdgeSplit, sharpness, sharpness_by_distance};
use crate::raster::{Map, Marked, gather};

/// Thresholds of the edge scores, metres of Sobel gradient (gain 8).
pub(super) const EDGE_THRESHOLDS: [f64; 2] = [0.25, 0.5];
/// Tolerance of the edge scores, pixels.
const EDGE_TOLERANCE: u32 = 1;
/// The truth's edges between on-edge and off-edge sharpness: those at 0.5 m of [`EDGE_THRESHOLDS`].
const BAND_EDGES: usize = 1;
/// How far from a true edge a pixel is still on it, pixels.
const BAND: f64 = 3.0;

/// An aligned depth map beside its truth, with what several metrics share.
pub(super) struct DepthMap<'a> {
    /// `[height, width]`, as `truth`.
    map: Map<'a>,
    truth: &'a Truth,
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
}

/// Edge scores at one threshold of the truth.
pub(super) struct EdgeScores {
    /// With the same threshold on both sides.
    pub(super) f1: f64,
    /// With the prediction's threshold swept; nothing where the truth has no edge.
    pub(super) f1_max: Option<f64>,
}

impl<'a> DepthMap<'a> {
    pub(super) fn new(map: Map<'a>, truth: &'a Truth) -> Result<Self> {
        let mask = truth.pixels.view();
        let (edges, (split, (boundaries, d3r))) = rayon::join(
            || edge_scores(map, truth),
            || {
                let split = sharpness_by_distance(map, mask, truth.edges[BAND_EDGES].distance.view(), BAND);
                let errors =
                    boundaries(map, mask).and_then(|own| errors_against(own.view(), &truth.boundaries));
                (split, (errors, truth.superpixels.d3r(map)))
            },
        );
        let (predicted, true_depths) = (gather(map, mask), gather(truth.depth.view(), mask));
        let (edges, split, boundaries, d3r) = (edges?, split?, boundaries?, d3r?);
        Ok(Self { map, truth, predicted, true_depths, edges, split, boundaries, d3r })
    }

    pub(super) fn boundary_f1(&self) -> Result<f64> {
        boundary_f1(self.map, self.truth.depth.view(), self.truth.pixels.view())
    }

    pub(super) fn sharpness(&self) -> Result<f64> {
        sharpness(self.map, self.truth.pixels.view())
    }
}

fn edge_scores(map: Map<'_>, truth: &Truth) -> Result<Vec<EdgeScores>> {
    let sweep = EdgeSweep::new(map, truth.pixels.view(), EDGE_TOLERANCE)?;
    let scores = |(threshold, true_edges): (f64, &Marked)| {
        let curve = sweep.curve(true_edges)?;
        // One point of the curve is the fixed threshold's score; without true edges it is 0.
        let f1 = curve.as_ref().map_or(0.0, |curve| curve.at(threshold).f1);
        Ok(EdgeScores { f1, f1_max: curve.map(|curve| curve.f1_max()) })
    };
    EDGE_THRESHOLDS.into_iter().zip(&truth.edges).map(scores).collect()
}
