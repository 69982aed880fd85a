//! The order in depth of superpixels: the D3R of "Boosting monocular depth".

use super::depth_range;
use crate::Result;
use crate::raster::{Map, Mask, Superpixels, same_shape};
use std::cmp::Ordering;

/// Superpixels of the published code.
const SEGMENTS: usize = 5000;
const COMPACTNESS: f64 = 20.0;
const ITERATIONS: usize = 5;
/// Neighbours count whose true depths differ by more than this factor.
const MIN_RATIO: f64 = 1.1;
/// Depths whose ratio is at most this are a tie.
const TIE_RATIO: f64 = 1.01;

/// A pixel's row and column.
type Pixel = (usize, usize);

/// Neighbouring superpixel centres across the truth's depth discontinuities, to be compared with many predictions.
#[derive(Debug, Clone, PartialEq)]
pub struct SuperpixelPairs {
    shape: (usize, usize),
    /// With the order of their true depths.
    pairs: Vec<(Pixel, Pixel, Ordering)>,
}

impl SuperpixelPairs {
    /// The pairs of a truth `[height, width]` after Miangoleh et al. (CVPR 2021): superpixels (SLIC) of its
    /// disparity (5000, compactness 20; disparity scaled to 0 to 100 over the mask), and pairs of those that touch and whose true
    /// depths differ by more than 10 %. Centres outside the mask or without depth are left out.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) where the mask differs.
    pub fn new(truth: Map<'_>, mask: Mask<'_>) -> Result<Self> {
        same_shape("the mask", mask.dim(), truth.dim())?;
        let disparity = truth.mapv(|g| if g > 0.0 { g.recip() } else { 0.0 });
        let (low, high) = depth_range(disparity.view(), mask).unwrap_or((0.0, 1.0));
        let gain = if high > low { 100.0 / (high - low) } else { 1.0 };
        let scaled = disparity.mapv(|d| (d - low) * gain);
        let found = Superpixels::slic(scaled.view(), mask, SEGMENTS, COMPACTNESS, ITERATIONS)?;
        let centre = |segment: u32| {
            let place = found.centres.get(segment as usize).copied().flatten()?;
            (mask[place] && truth[place] > 0.0).then_some(place)
        };
        let pair = |(a, b): (u32, u32)| {
            let (a, b) = (centre(a)?, centre(b)?);
            let [first, second] = [a, b].map(|at| f64::from(truth[at]));
            let apart = first.max(second) > MIN_RATIO * first.min(second);
            apart.then(|| (a, b, order(truth, a, b)))
        };
        let pairs = found.neighbours().into_iter().filter_map(pair).collect();
        Ok(Self { shape: truth.dim(), pairs })
    }

    /// Depth discontinuity disagreement ratio: share of the pairs whose order in the prediction (ties within 1 %) is not that in the
    /// truth; nothing where there are none. Blind to a scale of either side.
    ///
    /// \\[ \frac{1}{|Q|} \sum_{(a,b) \in Q} \mathbb 1\\{\operatorname{ord}(p_a, p_b) \ne \operatorname{ord}(g_a, g_b)\\},\qquad
    ///     \operatorname{ord}(u, v) = \begin{cases} +1 & u / v > 1.01 \\\\ -1 & v / u > 1.01 \\\\ 0 & \text{otherwise} \end{cases} \\]
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) where the prediction has another shape than the truth.
    pub fn d3r(&self, prediction: Map<'_>) -> Result<Option<f64>> {
        same_shape("the prediction", prediction.dim(), self.shape)?;
        let wrong = self.pairs.iter().filter(|(a, b, truth)| order(prediction, *a, *b) != *truth).count();
        Ok((!self.pairs.is_empty()).then(|| wrong as f64 / self.pairs.len() as f64))
    }
}

/// The order of two depths of a map.
fn order(map: Map<'_>, a: Pixel, b: Pixel) -> Ordering {
    let (a, b) = (f64::from(map[a]), f64::from(map[b]));
    if a > TIE_RATIO * b {
        Ordering::Greater
    } else if b > TIE_RATIO * a {
        Ordering::Less
    } else {
        Ordering::Equal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    #[test]
    fn the_truth_has_its_own_order_and_its_inverse_the_other() {
        let truth =
            Array2::from_shape_fn((60, 80), |(y, x)| if (x / 20 + y / 20) % 2 == 0 { 1.0 } else { 2.0 });
        let mask = Array2::from_elem((60, 80), true);
        let pairs = SuperpixelPairs::new(truth.view(), mask.view()).unwrap();
        assert_eq!(pairs.d3r(truth.view()).unwrap(), Some(0.0));
        assert_eq!(pairs.d3r(truth.mapv(f32::recip).view()).unwrap(), Some(1.0));
        let flat = Array2::from_elem((60, 80), 3.0);
        // Ties are another order.
        assert_eq!(pairs.d3r(flat.view()).unwrap(), Some(1.0));
        let of_flat = SuperpixelPairs::new(flat.view(), mask.view()).unwrap();
        assert_eq!(of_flat.d3r(truth.view()).unwrap(), None);
        assert!(pairs.d3r(Array2::ones((3, 3)).view()).is_err());
    }
}
