//! The order in depth of superpixels: the D3R of "Boosting monocular depth".

use super::depth_range;
use crate::Result;
use crate::raster::{Map, Mask, same_shape};
use ndarray::Array2;
use std::cmp::Ordering;

/// Superpixels of the published code.
const SEGMENTS: usize = 5000;
const COMPACTNESS: f64 = 20.0;
const ITERATIONS: usize = 5;
/// Neighbours count whose true depths differ by more than this factor.
const MIN_RATIO: f64 = 1.1;
/// Depths whose ratio is at most this are a tie.
const TIE_RATIO: f64 = 1.01;

/// Pairs of neighbouring superpixels of a truth whose depths differ.
///
/// Superpixels (SLIC) are those of the true disparity (5000, compactness 20; disparity scaled to 0 to 100 over the mask). A pair is that of
/// the centres of two that touch and whose true depths differ by more than 10 %. Centres outside the mask or without depth are left out.
#[derive(Debug, Clone)]
pub struct SuperpixelPairs {
    /// Row and column of both centres, and the order of their true depths.
    pairs: Vec<(Pixel, Pixel, Ordering)>,
    shape: Pixel,
}

type Pixel = (usize, usize);

impl SuperpixelPairs {
    /// Of a true depth and the pixels that count, `[height, width]`.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) where the shapes differ.
    pub fn new(truth: Map<'_>, mask: Mask<'_>) -> Result<Self> {
        let disparity = truth.mapv(|g| if g > 0.0 { g.recip() } else { 0.0 });
        let (low, high) = depth_range(disparity.view(), mask).unwrap_or((0.0, 1.0));
        let gain = if high > low { 100.0 / (high - low) } else { 1.0 };
        let scaled = disparity.mapv(|d| (d - low) * gain);
        let (labels, centres) = slic(scaled.view(), mask, SEGMENTS)?;
        let centre = |segment: u32| {
            let place = centres.get(segment as usize).copied().flatten()?;
            (mask[place] && truth[place] > 0.0).then_some(place)
        };
        let pair = |(a, b)| {
            let (a, b) = (centre(a)?, centre(b)?);
            let [first, second] = [a, b].map(|at| f64::from(truth[at]));
            (first.max(second) > MIN_RATIO * first.min(second)).then(|| (a, b, order(truth, a, b)))
        };
        Ok(Self { pairs: neighbours(&labels).into_iter().filter_map(pair).collect(), shape: truth.dim() })
    }
}

/// Depth discontinuity disagreement ratio (Miangoleh et al., CVPR 2021): share of the pairs of neighbouring superpixels whose order in
/// the prediction (ties within 1 %) is not that in the truth; nothing where there are none. Blind to a scale of either side.
///
/// \\[ \frac{1}{|Q|} \sum_{(a,b) \in Q} \mathbb 1\\{\operatorname{ord}(p_a, p_b) \ne \operatorname{ord}(g_a, g_b)\\},\qquad
///     \operatorname{ord}(u, v) = \begin{cases} +1 & u / v > 1.01 \\\\ -1 & v / u > 1.01 \\\\ 0 & \text{otherwise} \end{cases} \\]
///
/// with \\(Q\\) the [`SuperpixelPairs`] of the truth \\(g\\); the prediction is `[height, width]`.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the shapes differ.
pub fn d3r(prediction: Map<'_>, truth: &SuperpixelPairs) -> Result<Option<f64>> {
    same_shape("the prediction", prediction.dim(), truth.shape)?;
    let wrong = truth.pairs.iter().filter(|(a, b, truth)| order(prediction, *a, *b) != *truth).count();
    Ok((!truth.pairs.is_empty()).then(|| wrong as f64 / truth.pairs.len() as f64))
}

/// The order of two depths of a map.
fn order(map: Map<'_>, a: Pixel, b: Pixel) -> Ordering {
    let (a, b) = (f64::from(map[a]), f64::from(map[b]));
    (a > TIE_RATIO * b).cmp(&(b > TIE_RATIO * a))
}

/// Segment of each pixel `[height, width]`, counted from 0; nothing where it is masked out.
type Labels = Array2<Option<u32>>;

/// Superpixels by SLIC (Achanta et al., PAMI 2012) of one channel, without its last step (joining fragments): about `count` segments that
/// start on a grid of side \\(S\\); each pixel goes to the nearest of the nine centres around it by
///
/// \\[ (v - v_k)^2 + \left(\tfrac{m}{S}\right)^2 \\|x - x_k\\|^2, \\]
///
/// with \\(m\\) = [`COMPACTNESS`]; centres move to the mean of their pixels, [`ITERATIONS`] times. `map` is `[height, width]`, best scaled
/// to 0 to 100 as lightness is. Pixels outside the mask belong to no segment.
///
/// With the labels, the centre of each segment: row and column of its mean place, rounded; nothing where no pixel is left.
fn slic(map: Map<'_>, mask: Mask<'_>, count: usize) -> Result<(Labels, Vec<Option<Pixel>>)> {
    same_shape("the mask", mask.dim(), map.dim())?;
    let (height, width) = map.dim();
    let side = ((height * width) as f64 / count as f64).sqrt().max(1.0);
    let (rows, columns) = ((height as f64 / side).ceil() as usize, (width as f64 / side).ceil() as usize);
    let mut labels = Array2::from_shape_fn((height, width), |(y, x)| {
        let cell = |at: usize, of: usize| ((at as f64 / side) as usize).min(of.saturating_sub(1));
        mask[(y, x)].then(|| (cell(y, rows) * columns + cell(x, columns)) as u32)
    });
    let weight = ((COMPACTNESS / side).powi(2)) as f32;
    let mut means = segment_means(map, &labels, rows * columns);
    for _ in 0..ITERATIONS {
        for ((y, x), label) in labels.indexed_iter_mut() {
            let Some(label) = label else { continue };
            let (row, column) = ((y as f64 / side) as usize, (x as f64 / side) as usize);
            let mut best = f32::INFINITY;
            for r in row.saturating_sub(1)..(row + 2).min(rows) {
                for c in column.saturating_sub(1)..(column + 2).min(columns) {
                    let Some([v, my, mx]) = means[r * columns + c] else { continue };
                    let (dy, dx) = (y as f32 - my, x as f32 - mx);
                    let distance = (map[(y, x)] - v).powi(2) + weight * (dy * dy + dx * dx);
                    if distance < best {
                        (best, *label) = (distance, (r * columns + c) as u32);
                    }
                }
            }
        }
        means = segment_means(map, &labels, rows * columns);
    }
    let place = |[_, y, x]: [f32; 3]| ((y + 0.5) as usize, (x + 0.5) as usize);
    let centres = means.into_iter().map(|mean| mean.map(place)).collect();
    Ok((labels, centres))
}

/// Pairs of segments that touch over an edge of a pixel, the smaller first, each once.
fn neighbours(labels: &Labels) -> Vec<(u32, u32)> {
    let mut pairs = Vec::new();
    for ((y, x), label) in labels.indexed_iter() {
        for other in [(y + 1, x), (y, x + 1)] {
            if let (Some(a), Some(Some(b))) = (label, labels.get(other))
                && a != b
            {
                pairs.push((*a.min(b), *a.max(b)));
            }
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Mean value, row and column of each segment.
fn segment_means(map: Map<'_>, labels: &Labels, count: usize) -> Vec<Option<[f32; 3]>> {
    let mut sums = vec![[0.0_f64; 4]; count];
    for ((y, x), label) in labels.indexed_iter() {
        if let Some(sum) = label.and_then(|label| sums.get_mut(label as usize)) {
            let terms = [f64::from(map[(y, x)]), y as f64, x as f64, 1.0];
            sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
    }
    sums.into_iter().map(|[v, y, x, n]| (n > 0.0).then(|| [v / n, y / n, x / n].map(|m| m as f32))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_truth_has_its_own_order_and_its_inverse_the_other() {
        let truth =
            Array2::from_shape_fn((60, 80), |(y, x)| if (x / 20 + y / 20) % 2 == 0 { 1.0 } else { 2.0 });
        let mask = Array2::from_elem((60, 80), true);
        let of = |prediction: &Array2<f32>, truth: &Array2<f32>| {
            d3r(prediction.view(), &SuperpixelPairs::new(truth.view(), mask.view()).unwrap())
        };
        assert_eq!(of(&truth, &truth).unwrap(), Some(0.0));
        assert_eq!(of(&truth.mapv(f32::recip), &truth).unwrap(), Some(1.0));
        let flat = Array2::from_elem((60, 80), 3.0);
        // Ties are another order.
        assert_eq!(of(&flat, &truth).unwrap(), Some(1.0));
        assert_eq!(of(&truth, &flat).unwrap(), None);
        assert!(of(&Array2::ones((3, 3)), &truth).is_err());
    }

    #[test]
    fn a_flat_map_stays_a_grid_and_a_step_is_followed() {
        let mask = Array2::from_elem((40, 60), true);
        let (flat, centres) = slic(Array2::zeros((40, 60)).view(), mask.view(), 24).unwrap();
        assert_eq!((centres.len(), neighbours(&flat).len()), (24, 4 * 5 + 3 * 6));
        let step = Array2::from_shape_fn((40, 60), |(_, x)| if x < 27 { 0.0 } else { 100.0 });
        let (cut, _) = slic(step.view(), mask.view(), 24).unwrap();
        assert!((0..40).all(|y| cut[(y, 26)] != cut[(y, 27)]));
    }

    #[test]
    fn masked_pixels_have_no_segment() {
        let mask = Array2::from_shape_fn((20, 20), |(y, _)| y > 9);
        let (labels, _) = slic(Array2::ones((20, 20)).view(), mask.view(), 16).unwrap();
        assert!(labels.indexed_iter().all(|((y, _), label)| label.is_some() == (y > 9)));
        assert!(slic(Array2::ones((2, 2)).view(), mask.view(), 4).is_err());
    }
}
