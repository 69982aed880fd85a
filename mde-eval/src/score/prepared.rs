use super::map::EDGE_THRESHOLDS;
use super::{Aligned, ScoreConfig, Scores, Subject, score_own, score_with};
use crate::Result;
use crate::align::Alignment;
use crate::metrics::dbe::boundaries;
use crate::metrics::edges::edges;
use crate::metrics::superpixel::SuperpixelPairs;
use crate::raster::{Map, Marked, Mask};
use ndarray::{Array2, Zip};

/// A truth made ready for many predictions: its edges, distances to them and superpixels are computed once.
///
/// What depends on the truth depends on the pixels that count, too. A prediction that misses some of them, or that comes with
/// another truth or mask, is scored all the same, as slowly as by [`score`](super::score). Either way the scores are those of
/// [`score`](super::score), to the last bit.
///
/// ```
/// use mde_eval::ndarray::Array2;
/// use mde_eval::score::{Prepared, ScoreConfig, Subject, score};
///
/// let truth = Array2::from_shape_fn((48, 64), |(_, x)| if x < 32 { 1.0 } else { 2.0 + 0.01 * x as f32 });
/// let config = ScoreConfig::default();
/// let prepared = Prepared::new(truth.view(), None, &config)?;
/// for gain in [0.5, 0.6] {
///     let prediction = truth.mapv(|z| gain * z.powf(0.9));
///     let subject = Subject::new(prediction.view(), truth.view());
///     assert_eq!(prepared.score(&subject)?, score(&subject, &config)?);
/// }
/// # Ok::<(), mde_eval::Error>(())
/// ```
pub struct Prepared {
    truth: Truth,
    config: ScoreConfig,
}

impl Prepared {
    /// Of a truth `[height, width]` in metres and the pixels that may count, all without a mask.
    ///
    /// # Errors
    /// As [`score`](super::score) of the truth itself.
    pub fn new(truth: Map<'_>, mask: Option<Mask<'_>>, config: &ScoreConfig) -> Result<Self> {
        config.validate()?;
        let pixels = Subject { prediction: truth, sigma: None, truth, mask }.pixels(config)?;
        let depth = Zip::from(truth).and(&pixels).map_collect(|&g, &keep| if keep { g } else { 0.0 });
        Ok(Self { truth: Truth::new(depth, pixels)?, config: config.clone() })
    }

    /// Which pixels count and how they are scored.
    pub fn config(&self) -> &ScoreConfig {
        &self.config
    }

    /// As [`score`](super::score).
    ///
    /// # Errors
    /// As [`score`](super::score).
    pub fn score(&self, subject: &Subject<'_>) -> Result<Scores> {
        score_own(subject, &self.config, Some(&self.truth))
    }

    /// As [`score_aligned`](super::score_aligned).
    ///
    /// # Errors
    /// As [`score`](super::score).
    pub fn score_aligned(&self, subject: &Subject<'_>, alignment: &Alignment) -> Result<Scores> {
        score_with(subject, alignment, &self.config, Some(&self.truth))
    }
}

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

    /// Whether it was made from the truth and the pixels of a subject.
    pub(super) fn is_of(&self, aligned: &Aligned) -> bool {
        self.pixels == aligned.pixels && self.depth == aligned.truth
    }
}
