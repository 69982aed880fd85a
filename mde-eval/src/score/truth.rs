use super::ScoreConfig;
use crate::metrics::bsds::Thinned;
use crate::metrics::dbe::boundaries;
use crate::metrics::edges::edges;
use crate::metrics::ordinal::Pixel;
use crate::metrics::superpixel::SuperpixelPairs;
use crate::raster::Marked;
use crate::{Error, Result};
use ndarray::Array2;

/// What the scores of the depth need of the truth alone.
pub(super) struct Truth {
    /// True depth `[height, width]` in metres, 0 where a pixel does not count.
    pub(super) depth: Array2<f32>,
    /// Pixels that count, `[height, width]`.
    pub(super) pixels: Array2<bool>,
    /// Edges at every threshold of the edge scores and of the band.
    edges: Vec<(f64, Marked)>,
    pub(super) thinned: Thinned,
    /// Canny's edges.
    pub(super) boundaries: Marked,
    pub(super) superpixels: SuperpixelPairs,
    /// Random pairs for the depth-discontinuity disagreement.
    pub(super) pairs: Vec<(Pixel, Pixel)>,
}

impl Truth {
    pub(super) fn new(depth: Array2<f32>, pixels: Array2<bool>, config: &ScoreConfig) -> Result<Self> {
        let (map, mask) = (depth.view(), pixels.view());
        let mut thresholds = config.edge_thresholds.clone();
        thresholds.push(config.band_threshold);
        thresholds.sort_by(f64::total_cmp);
        thresholds.dedup();
        let marked = |&threshold: &f64| Ok((threshold, Marked::new(edges(map, mask, threshold)?)));
        let ((edges, thinned), (boundaries, (superpixels, pairs))) = rayon::join(
            || {
                let edges = thresholds.iter().map(marked).collect::<Result<Vec<_>>>();
                (edges, Thinned::new(map, mask))
            },
            || {
                let boundaries = boundaries(map, mask).map(Marked::new);
                (boundaries, (SuperpixelPairs::new(map, mask), config.pairs.draw(mask)))
            },
        );
        let (edges, thinned) = (edges?, thinned?);
        let (boundaries, superpixels) = (boundaries?, superpixels?);
        Ok(Self { depth, pixels, edges, thinned, boundaries, superpixels, pairs })
    }

    /// The edges at a threshold of the configuration that this was made with.
    pub(super) fn edges_at(&self, threshold: f64) -> Result<&Marked> {
        let found = self.edges.iter().find(|(at, _)| *at == threshold);
        found.map(|(_, edges)| edges).ok_or_else(|| Error::Config {
            field: "the edge threshold",
            value: threshold.to_string(),
            remedy: "use one of those prepared",
        })
    }
}
