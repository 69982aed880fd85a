use super::truth::Truth;
use crate::Result;
use crate::metrics::boundary::boundary_f1;
use crate::metrics::dbe::{BoundaryErrors, boundaries, boundary_errors};
use crate::metrics::edges::{Edges, edge_curve};
use crate::metrics::sharpness::{EdgeSplit, sharpness, sharpness_by_edges};
use crate::metrics::superpixel::d3r;
use crate::raster::{Map, gather};

/// Thresholds of the edge scores, metres of Sobel gradient (gain 8).
pub(super) const EDGE_THRESHOLDS: [f64; 2] = [0.25, 0.5];
/// Tolerance of the edge scores, pixels.
const EDGE_TOLERANCE: u32 = 1;
/// The truth's edges between on-edge and off-edge sharpness: those at 0.5 m of [`EDGE_THRESHOLDS`].
const BAND_EDGES: usize = 1;
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
    pub(super) fn new(map: Map<'_>, truth: &Truth) -> Result<Self> {
        let (true_depth, mask) = (truth.depth.view(), truth.pixels.view());
        let edge_scores = |(threshold, true_edges): (f64, &Edges)| {
            let curve = edge_curve(map, mask, true_edges, EDGE_TOLERANCE)?;
            // One point of the curve is the fixed threshold's score; without true edges it is 0.
            let f1 = curve.as_ref().map_or(0.0, |curve| curve.at(threshold).f1());
            Ok(EdgeScores { f1, f1_max: curve.map(|curve| curve.f1_max()) })
        };
        let (edges, (boundaries, boundary_f1)) = rayon::join(
            || EDGE_THRESHOLDS.into_iter().zip(&truth.edges).map(edge_scores).collect::<Result<_>>(),
            || {
                let errors = boundaries(map, mask).and_then(|own| boundary_errors(&own, &truth.boundaries));
                (errors, boundary_f1(map, true_depth, mask))
            },
        );
        Ok(Self {
            predicted: gather(map, mask),
            true_depths: gather(true_depth, mask),
            edges: edges?,
            split: sharpness_by_edges(map, mask, &truth.edges[BAND_EDGES], BAND)?,
            boundaries: boundaries?,
            d3r: d3r(map, &truth.superpixels)?,
            boundary_f1: boundary_f1?,
            sharpness: sharpness(map, mask).ok(),
        })
    }
}
