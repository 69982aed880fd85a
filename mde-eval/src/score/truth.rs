use super::map::EDGE_THRESHOLDS;
use crate::Result;
use crate::metrics::dbe::boundaries;
use crate::metrics::edges::{Edges, edges};
use crate::metrics::superpixel::SuperpixelPairs;
use ndarray::Array2;
use std::sync::{Arc, OnceLock};

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
    pub(super) depth: Array2<f32>,
    /// Pixels that count, `[height, width]`.
    pub(super) pixels: Array2<bool>,
    /// At each of [`EDGE_THRESHOLDS`].
    pub(super) edges: Vec<Edges>,
    pub(super) boundaries: Edges,
    pub(super) superpixels: SuperpixelPairs,
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
