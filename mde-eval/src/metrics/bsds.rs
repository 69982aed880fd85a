//! Thinned edges matched one to one: the Berkeley benchmark's precision and recall.

mod matching;
mod pooled;

use super::edges::harmonic;
use crate::Result;
use crate::raster::{Gradient, same_shape};
use matching::Matching;
use ndarray::{Array2, ArrayView2};
pub use pooled::{average_precision, ods, ois};
use serde::{Deserialize, Serialize};

/// Largest distance of a match, as a fraction of the image's diagonal: 6 pixels at 640 x 480.
pub const MAX_DISTANCE: f64 = 0.0075;

/// Thresholds of the prediction at which [`BoundaryCounts`] counts, in metres of Sobel gradient (gain 8): a factor
/// \\(2^{1/4}\\) apart from 0.02 to 5.1.
pub const THRESHOLDS: [f64; 33] = {
    // Powers of two are exact; between them, the three quarter steps.
    const QUARTERS: [f64; 4] = [1.0, 1.189_207_115_002_721, std::f64::consts::SQRT_2, 1.681_792_830_507_429];
    let mut thresholds = [0.0; 33];
    let mut k = 0;
    while k < 33 {
        thresholds[k] = 0.02 * (1_u32 << (k / 4)) as f64 * QUARTERS[k % 4];
        k += 1;
    }
    thresholds
};

/// Matched boundary pixels of one image.
///
/// Predicted and true boundary pixels are local maxima of the gradient across the edge (thinned); a predicted one may be
/// matched to one true one within the largest distance. At each threshold the matching is as large as can be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct BoundaryCounts {
    /// True boundary pixels.
    pub truth: u32,
    /// Predicted boundary pixels at each of [`THRESHOLDS`].
    pub predicted: Vec<u32>,
    /// How many of them are matched.
    pub matched: Vec<u32>,
    /// The best \\(F_1\\) over every threshold of this image.
    pub best: f64,
    /// Area under precision over recall, as average precision over every threshold.
    pub average_precision: f64,
}

/// Boundary pixels of `prediction` matched to those of `truth` after Martin, Fowlkes and Malik (PAMI 2004), as MindTheEdge (Talker
/// et al., CVPR 2024) applies it to depth.
///
/// Maps are `[height, width]` in metres, aligned. The truth's boundary pixels have a Sobel gradient (gain 8) of at
/// least `threshold`; the prediction's threshold is swept, so that what is best over all of them does not see its contrast.
/// Nothing where the truth has no boundary.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the shapes differ.
pub fn boundary_counts(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
    threshold: f64,
) -> Result<Option<BoundaryCounts>> {
    Ok(Thinned::new(prediction, mask)?.against(&Thinned::new(truth, mask)?, threshold))
}

/// A map's thinned gradient.
pub(crate) struct Thinned(Array2<f64>);

impl Thinned {
    pub(crate) fn new(map: ArrayView2<'_, f32>, mask: ArrayView2<'_, bool>) -> Result<Self> {
        same_shape("the mask", mask.dim(), map.dim())?;
        let mut values = map.mapv(f64::from);
        values.zip_mut_with(&mask, |value, keep| {
            *value = if *keep && value.is_finite() { *value } else { 0.0 }
        });
        Ok(Self(Gradient::sobel(&values).thin(mask, f64::MIN_POSITIVE)))
    }

    pub(crate) fn against(&self, truth: &Self, threshold: f64) -> Option<BoundaryCounts> {
        if self.0.dim() != truth.0.dim() {
            return None;
        }
        let mut matching = Matching::new(&truth.0, threshold);
        let total = matching.truth();
        if total == 0 {
            return None;
        }
        let mut predicted: Vec<(f64, (usize, usize))> =
            self.0.indexed_iter().filter(|(_, g)| **g > 0.0).map(|(at, g)| (*g, at)).collect();
        predicted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut counts = BoundaryCounts {
            truth: total as u32,
            predicted: vec![0; THRESHOLDS.len()],
            matched: vec![0; THRESHOLDS.len()],
            best: 0.0,
            average_precision: 0.0,
        };
        let (mut taken, mut matched, mut recall) = (0_u32, 0_u32, 0.0);
        for tied in predicted.chunk_by(|a, b| a.0 == b.0) {
            taken += tied.len() as u32;
            matched += tied.iter().filter(|(_, at)| matching.add(*at)).count() as u32;
            let precision = f64::from(matched) / f64::from(taken);
            let now = f64::from(matched) / total as f64;
            counts.best = counts.best.max(harmonic(precision, now));
            counts.average_precision += (now - recall) * precision;
            recall = now;
            let reached = THRESHOLDS.partition_point(|t| *t <= tied[0].0);
            for k in 0..reached {
                (counts.predicted[k], counts.matched[k]) = (taken, matched);
            }
        }
        Some(counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A factor of 2 is four steps of the thresholds: the sweep moves along and its best stays.
        #[test]
        fn contrast_moves_the_sweep_along(depths in proptest::collection::vec(1..6_u8, 12 * 16)) {
            let truth = Array2::from_shape_vec((12, 16), depths.iter().map(|d| f32::from(*d)).collect()).unwrap();
            let prediction = Array2::from_shape_fn((12, 16), |(y, x)| 0.25 * truth[(y, 15 - x)]);
            let mask = Array2::from_elem((12, 16), true);
            let counts = |p: &Array2<f32>| boundary_counts(p.view(), truth.view(), mask.view(), 0.5).unwrap();
            let (plain, scaled) = (counts(&prediction), counts(&prediction.mapv(|d| 2.0 * d)));
            if let (Some(plain), Some(scaled)) = (plain, scaled) {
                prop_assert_eq!(&plain.predicted[..29], &scaled.predicted[4..]);
                prop_assert_eq!(&plain.matched[..29], &scaled.matched[4..]);
            }
        }

        #[test]
        fn what_is_best_does_not_see_contrast(
            depths in proptest::collection::vec(1..6_u8, 12 * 16), gain in -4..5_i32
        ) {
            let truth = Array2::from_shape_vec((12, 16), depths.iter().map(|d| f32::from(*d)).collect()).unwrap();
            let prediction = Array2::from_shape_fn((12, 16), |(y, x)| truth[(11 - y, x)]);
            let mask = Array2::from_elem((12, 16), true);
            let counts = |p: &Array2<f32>| boundary_counts(p.view(), truth.view(), mask.view(), 0.5).unwrap();
            let (plain, scaled) = (counts(&prediction), counts(&prediction.mapv(|d| d * 2_f32.powi(gain))));
            prop_assert_eq!(plain.as_ref().map(|c| c.best), scaled.as_ref().map(|c| c.best));
            prop_assert_eq!(plain.map(|c| c.average_precision), scaled.map(|c| c.average_precision));
        }
    }

    #[test]
    fn a_perfect_map_is_perfect() {
        let truth =
            Array2::from_shape_fn((40, 60), |(y, x)| if (x / 20 + y / 15) % 2 == 0 { 1.0 } else { 3.0 });
        let mask = Array2::from_elem((40, 60), true);
        let counts = boundary_counts(truth.view(), truth.view(), mask.view(), 0.25).unwrap().unwrap();
        assert_eq!((counts.best, counts.average_precision), (1.0, 1.0));
        for pooled in [ods, ois, average_precision] {
            assert_eq!(pooled([&counts, &counts]).unwrap(), Some(1.0));
        }
        let flat = Array2::from_elem((40, 60), 2.0);
        assert!(boundary_counts(truth.view(), flat.view(), mask.view(), 0.25).unwrap().is_none());
        let none = boundary_counts(flat.view(), truth.view(), mask.view(), 0.25).unwrap().unwrap();
        assert_eq!((none.best, none.predicted[0]), (0.0, 0));
    }
}
