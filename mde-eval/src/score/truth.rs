use super::map::EDGE_THRESHOLDS;
use crate::Result;
use crate::metrics::dbe::boundaries;
use crate::metrics::edges::edges;
use crate::metrics::superpixel::SuperpixelPairs;
use crate::raster::Marked;
use ndarray::Array2;

/// What the scores of the depth need of the truth alone.
pub(super) struct Truth {
    /// True depth `[height, width]` in metres, 0 where a pixel does not count.
    pub(super) depth: Array2<f32>,
    /// Pixels that count, `[height, width]`.
    pub(super) pixels: Array2<bool>,
    /// At each of [`EDGE_THRESHOLDS`].
    pub(super) edges: Vec<Marked>,
    /// Canny's edges.
    pub(super) boundaries: Marked,
    pub(super) superpixels: SuperpixelPairs,
}

impl Truth {
    pub(super) fn new(depth: Array2<f32>, pixels: Array2<bool>) -> Result<Self> {
        let (map, mask) = (depth.view(), pixels.view());
        let marked = |threshold| edges(map, mask, threshold).map(Marked::new);
        let (edges, (boundaries, superpixels)) = rayon::join(
            || EDGE_THRESHOLDS.into_iter().map(marked).collect::<Result<Vec<_>>>(),
            || (boundaries(map, mask).map(Marked::new), SuperpixelPairs::new(map, mask)),
        );
        let (edges, boundaries, superpixels) = (edges?, boundaries?, superpixels?);
        Ok(Self { depth, pixels, edges, boundaries, superpixels })
    }
}
