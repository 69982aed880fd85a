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

/// Depth discontinuity disagreement ratio (Miangoleh et al., CVPR 2021): share of the pairs of neighbouring superpixels whose order in
/// the prediction (ties within 1 %) is not that in the truth; nothing where there are none. Blind to a scale of either side.
///
/// \\[ \frac{1}{|Q|} \sum_{(a,b) \in Q} \mathbb 1\\{\operatorname{ord}(p_a, p_b) \ne \operatorname{ord}(g_a, g_b)\\},\qquad
///     \operatorname{ord}(u, v) = \begin{cases} +1 & u / v > 1.01 \\\\ -1 & v / u > 1.01 \\\\ 0 & \text{otherwise} \end{cases} \\]
///
/// Superpixels (SLIC) are those of the true disparity (5000, compactness 20; disparity scaled to 0 to 100 over the mask), \\(Q\\) the
/// pairs of centres of those that touch and whose true depths differ by more than 10 %. Centres outside the mask or without depth
/// are left out. Maps are `[height, width]`.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the shapes differ.
pub fn d3r(prediction: Map<'_>, truth: Map<'_>, mask: Mask<'_>) -> Result<Option<f64>> {
    same_shape("the prediction", prediction.dim(), truth.dim())?;
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
    let (mut pairs, mut wrong) = (0_usize, 0_usize);
    for (a, b) in found.neighbours() {
        let (Some(a), Some(b)) = (centre(a), centre(b)) else { continue };
        let [first, second] = [a, b].map(|at| f64::from(truth[at]));
        if first.max(second) > MIN_RATIO * first.min(second) {
            pairs += 1;
            wrong += usize::from(order(prediction, a, b) != order(truth, a, b));
        }
    }
    Ok((pairs > 0).then(|| wrong as f64 / pairs as f64))
}

/// The order of two depths of a map.
fn order(map: Map<'_>, a: (usize, usize), b: (usize, usize)) -> Ordering {
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
        let of =
            |prediction: &Array2<f32>, truth: &Array2<f32>| d3r(prediction.view(), truth.view(), mask.view());
        assert_eq!(of(&truth, &truth).unwrap(), Some(0.0));
        assert_eq!(of(&truth.mapv(f32::recip), &truth).unwrap(), Some(1.0));
        let flat = Array2::from_elem((60, 80), 3.0);
        // Ties are another order.
        assert_eq!(of(&flat, &truth).unwrap(), Some(1.0));
        assert_eq!(of(&truth, &flat).unwrap(), None);
        assert!(of(&Array2::ones((3, 3)), &truth).is_err());
    }
}
