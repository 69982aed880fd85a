use crate::Result;
use crate::metrics::boundary::boundary_f1;
use crate::metrics::dbe::{BoundaryErrors, boundaries, boundary_errors};
use crate::metrics::edges::{Edges, edge_curve, edges};
use crate::metrics::sharpness::{sharpness, sharpness_by_edges};
use crate::metrics::superpixel::{SuperpixelPairs, d3r};
use crate::raster::{Map, gather};
use ndarray::Array2;
use std::sync::{Arc, OnceLock};

/// Thresholds of the edge scores, metres of Sobel gradient (gain 8).
const EDGE_THRESHOLDS: [f64; 2] = [0.25, 0.5];
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
    /// At each of [`EDGE_THRESHOLDS`], on both sides.
    pub(super) f1: Vec<f64>,
    /// At each of [`EDGE_THRESHOLDS`] of the truth, the prediction's threshold swept; nothing where the truth has no edge.
    pub(super) f1_max: Vec<Option<f64>>,
    pub(super) sharpness_on_off: [Option<f64>; 2],
    /// Nothing where the truth has no boundary.
    pub(super) dbe: Option<BoundaryErrors>,
    pub(super) d3r: Option<f64>,
    pub(super) boundary_f1: f64,
    /// Nothing where no pixel is left.
    pub(super) sharpness: Option<f64>,
}

impl DepthMap {
    pub(super) fn new(map: Map<'_>, truth: &Truth) -> Result<Self> {
        let (true_depth, mask) = (truth.depth.view(), truth.pixels.view());
        let edge_scores = |(threshold, true_edges): (f64, &Edges)| {
            let curve = edge_curve(map, mask, true_edges, EDGE_TOLERANCE)?;
            // One point of the curve is the fixed threshold's score; without true edges it is 0.
            let f1 = curve.as_ref().map_or(0.0, |curve| curve.at(threshold).f1());
            Ok((f1, curve.map(|curve| curve.f1_max())))
        };
        let edge_scores = EDGE_THRESHOLDS.into_iter().zip(&truth.edges).map(edge_scores);
        let (edges, (dbe, boundary_f1)) = rayon::join(
            || edge_scores.collect::<Result<(Vec<_>, Vec<_>)>>(),
            || {
                let errors = boundaries(map, mask).and_then(|own| boundary_errors(&own, &truth.boundaries));
                (errors, boundary_f1(map, true_depth, mask))
            },
        );
        let (f1, f1_max) = edges?;
        Ok(Self {
            predicted: gather(map, mask),
            true_depths: gather(true_depth, mask),
            f1,
            f1_max,
            sharpness_on_off: sharpness_by_edges(map, mask, &truth.edges[BAND_EDGES], BAND)?,
            dbe: dbe?,
            d3r: d3r(map, &truth.superpixels)?,
            boundary_f1: boundary_f1?,
            sharpness: sharpness(map, mask).ok(),
        })
    }
}

/// Edges and superpixels of a truth: computed for its first prediction, and shared by all that leave the same pixels to count.
///
/// A [`Subject`](super::Subject) refers to it. Scores are the same with and without it.
#[derive(Debug, Default)]
pub struct TruthCache(OnceLock<Arc<Truth>>);

impl TruthCache {
    /// What was computed first where it is of the same depths and pixels, else computed here.
    pub(super) fn truth(&self, depth: &Array2<f32>, pixels: &Array2<bool>) -> Result<Arc<Truth>> {
        if let Some(known) = self.0.get().filter(|known| known.depth == depth && known.pixels == pixels) {
            return Ok(known.clone());
        }
        let truth = Arc::new(Truth::new(depth.clone(), pixels.clone())?);
        // Nothing where another one is there already.
        let _ = self.0.set(truth.clone());
        Ok(truth)
    }
}

/// What the scores of the depth need of the truth alone.
#[derive(Debug)]
pub(super) struct Truth {
    /// True depth `[height, width]` in metres, 0 where a pixel does not count.
    depth: Array2<f32>,
    /// Pixels that count, `[height, width]`.
    pixels: Array2<bool>,
    /// At each of [`EDGE_THRESHOLDS`].
    edges: Vec<Edges>,
    boundaries: Edges,
    superpixels: SuperpixelPairs,
}

impl Truth {
    fn new(depth: Array2<f32>, pixels: Array2<bool>) -> Result<Self> {
        let (map, mask) = (depth.view(), pixels.view());
        let of_threshold = |threshold| edges(map, mask, threshold);
        let (edges, superpixels) = rayon::join(
            || EDGE_THRESHOLDS.into_iter().map(of_threshold).collect::<Result<_>>(),
            || SuperpixelPairs::new(map, mask),
        );
        let (edges, boundaries, superpixels) = (edges?, boundaries(map, mask)?, superpixels?);
        Ok(Self { edges, boundaries, superpixels, depth, pixels })
    }
}
