//! Edge precision, recall and F1 of depth maps.
//!
//! At a *fixed* threshold these reward any added gradient: an unsharp mask and white noise both raise them. The
//! [curve](EdgeCurve) over all thresholds of the prediction is invariant to its contrast; its best point is **F1max**.

use crate::Result;
use crate::error::check;
use crate::raster::{Map, Mask, dilate, distance_to, erode, same_shape, sobel};
use ndarray::{Array2, Zip};

/// Marked pixels of a map, and how far every pixel is from them.
#[derive(Debug, Clone, PartialEq)]
pub struct Edges {
    /// Whether a pixel is marked, `[height, width]`.
    pub pixels: Array2<bool>,
    /// Euclidean distance to the nearest marked pixel, `[height, width]`, in pixels; infinite where none is marked.
    pub distance: Array2<f64>,
}

impl Edges {
    /// Of marked pixels, `[height, width]`.
    pub fn new(pixels: Array2<bool>) -> Self {
        Self { distance: distance_to(pixels.view()), pixels }
    }

    /// How far each marked pixel is from the nearest of `other`.
    pub(super) fn distances_to(&self, other: &Self) -> Vec<f64> {
        self.pixels.iter().zip(&other.distance).filter(|(edge, _)| **edge).map(|(_, d)| *d).collect()
    }
}

/// \\(2PR / (P + R)\\), 0 where both are 0.
pub(super) fn harmonic(precision: f64, recall: f64) -> f64 {
    if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 }
}

/// Edge pixels of a depth map, `[height, width]`: \\(|\nabla D| > t\\) with the un-normalised
/// Sobel gradient (gain 8), read only where the whole 3 x 3 window lies in the mask.
///
/// A threshold of 0.25 m is thus a slope of 0.031 m per pixel.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where map and mask differ.
pub fn edges(map: Map<'_>, mask: Mask<'_>, threshold: f64) -> Result<Edges> {
    Ok(Edges::new(masked_gradient(map, mask)?.mapv(|g| f64::from(g) > threshold)))
}

/// One point of an [`EdgeCurve`]: predicted edges are the pixels with a gradient of at least `threshold`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EdgePoint {
    /// Gradient (gain 8) from which on a pixel is a predicted edge, in the map's unit.
    pub threshold: f64,
    /// Share of the predicted edge pixels that are near a true one; 0 without predicted edges.
    pub precision: f64,
    /// Share of the true edge pixels that are near a predicted one; 0 without true edges.
    pub recall: f64,
}

impl EdgePoint {
    /// \\(2PR / (P + R)\\), 0 where both are 0.
    pub fn f1(&self) -> f64 {
        harmonic(self.precision, self.recall)
    }
}

/// Precision and recall over every threshold of the prediction, the truth's edges fixed.
///
/// Points are in order of falling threshold and rising recall; the thresholds are all the distinct positive gradients of
/// the prediction, so the curve depends on the *order* of the gradients alone and no monotone change of contrast moves it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EdgeCurve {
    /// The points, steepest threshold first.
    pub points: Vec<EdgePoint>,
}

impl EdgeCurve {
    /// **F1max**: \\(\max_t F_1(t)\\), 0 where the prediction is flat. Over one image it is the "OIS" of the Berkeley benchmark, without
    /// thinning and one-to-one matching.
    pub fn f1_max(&self) -> f64 {
        self.points.iter().map(EdgePoint::f1).fold(0.0, f64::max)
    }

    /// Precision and recall where the predicted edges are the gradients *above* `threshold`.
    pub fn at(&self, threshold: f64) -> EdgePoint {
        let above = self.points.partition_point(|point| point.threshold > threshold);
        EdgePoint { threshold, ..self.points[..above].last().copied().unwrap_or_default() }
    }
}

/// Edge precision and recall with a tolerance in pixels, the truth's edges fixed and the prediction's threshold swept; nothing where the
/// truth has no edge.
///
/// After Hu et al., "Revisiting single image depth estimation" (WACV 2019), with four repairs: the border is
/// replicated instead of padded with zeros, [`edges`] stay a pixel away from the mask's border, \\(F = 0\\) where
/// \\(P + R = 0\\), and an edge pixel counts as found within `tolerance` pixels by exact Euclidean distance,
///
/// \\[ P = \frac{|\\{x \in E_p : \mathrm{dist}(x, E_g) \le r\\}|}{|E_p|},\qquad
///     R = \frac{|\\{x \in E_g : \mathrm{dist}(x, E_p) \le r\\}|}{|E_g|},\qquad F_1 = \frac{2PR}{P+R} \\]
///
/// Maps are `[height, width]` in metres, aligned. [`EdgeCurve::at`] the threshold of the truth's [`edges`] is the F1 at a fixed threshold.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the shapes differ; [`Error::Config`](crate::Error::Config) for a tolerance above 64 pixels.
pub fn edge_curve(
    prediction: Map<'_>,
    mask: Mask<'_>,
    true_edges: &Edges,
    tolerance: u32,
) -> Result<Option<EdgeCurve>> {
    check([("the edge tolerance", tolerance.into(), tolerance <= 64, "use at most 64 pixels")])?;
    same_shape("the prediction", prediction.dim(), true_edges.pixels.dim())?;
    let total = true_edges.pixels.iter().filter(|&&edge| edge).count();
    if total == 0 {
        return Ok(None);
    }
    let gradient = masked_gradient(prediction, mask)?;
    // A true edge is found once the threshold falls to the steepest predicted gradient within the tolerance.
    let steepest = dilate(gradient.view(), tolerance);
    let reached = true_edges.pixels.iter().zip(&steepest).filter(|&(&edge, &g)| edge && g > 0.0);
    let mut found_at: Vec<f32> = reached.map(|(_, &g)| g).collect();
    found_at.sort_unstable_by(|a, b| b.total_cmp(a));
    // Gradients, and whether a true edge is near, the steepest first; flat pixels are no edges.
    let sloped = gradient.iter().zip(&true_edges.distance).filter(|(g, _)| **g > 0.0);
    let mut falling: Vec<(f32, bool)> = sloped.map(|(&g, &d)| (g, d <= f64::from(tolerance))).collect();
    falling.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let mut points = Vec::new();
    let (mut predicted, mut hits) = (0, 0);
    for tied in falling.chunk_by(|a, b| a.0 == b.0) {
        let threshold = tied[0].0;
        predicted += tied.len();
        hits += tied.iter().filter(|(_, near)| *near).count();
        let found = found_at.partition_point(|g| *g >= threshold);
        points.push(EdgePoint {
            threshold: f64::from(threshold),
            precision: share(hits, predicted),
            recall: share(found, total),
        });
    }
    Ok(Some(EdgeCurve { points }))
}

/// Sobel gradient where the whole window lies in the mask, 0 elsewhere.
fn masked_gradient(map: Map<'_>, mask: Mask<'_>) -> Result<Array2<f32>> {
    same_shape("the mask", mask.dim(), map.dim())?;
    let mut gradient = sobel(map);
    // Also drops what is not a number, should the masked-out part of the map hold one.
    Zip::from(&mut gradient).and(&erode(mask)).for_each(|g, &keep| *g = if keep { g.max(0.0) } else { 0.0 });
    Ok(gradient)
}

fn share(part: usize, of: usize) -> f64 {
    if of == 0 { 0.0 } else { part as f64 / of as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn maps() -> impl Strategy<Value = (Array2<f32>, Array2<f32>, Array2<bool>)> {
        (3..14_usize, 3..14_usize).prop_flat_map(|(h, w)| {
            let levels = move |count: u8| {
                let values = proptest::collection::vec(1..=count, h * w);
                values.prop_map(move |values| Array2::from_shape_vec((h, w), values).unwrap())
            };
            // Few distinct depths make ties; one pixel in sixteen is masked out.
            let map = move || levels(5).prop_map(|map| map.mapv(|d| f32::from(d) * 0.5));
            (map(), map(), levels(16).prop_map(|mask| mask.mapv(|d| d > 1)))
        })
    }

    proptest! {
        #[test]
        fn the_curve_at_a_threshold_is_the_score_there((p, g, mask) in maps(), r in 0..4_u32, t in 0.1..9.0_f64) {
            let true_edges = edges(g.view(), mask.view(), 1.0).unwrap();
            let curve = edge_curve(p.view(), mask.view(), &true_edges, r).unwrap();
            prop_assert_eq!(curve.is_some(), true_edges.pixels.iter().any(|edge| *edge));
            let Some(curve) = curve else { return Ok(()) };
            // The distance transform on one side, grey dilation on the other.
            let predicted = edges(p.view(), mask.view(), t).unwrap();
            let found = |of: &Edges, by: &Edges| {
                let distances = of.distances_to(by);
                share(distances.iter().filter(|d| **d <= f64::from(r)).count(), distances.len())
            };
            let (precision, recall) = (found(&predicted, &true_edges), found(&true_edges, &predicted));
            let expected = EdgePoint { threshold: t, precision, recall };
            prop_assert_eq!(curve.at(t), expected);
            prop_assert!(curve.f1_max() >= expected.f1());
        }

        #[test]
        fn f1_max_does_not_see_contrast((p, g, mask) in maps(), power in -6..7_i32, r in 0..3_u32) {
            let true_edges = edges(g.view(), mask.view(), 1.0).unwrap();
            let f1_max = |p: &Array2<f32>| {
                edge_curve(p.view(), mask.view(), &true_edges, r).unwrap().map(|curve| curve.f1_max())
            };
            // A power of two scales every gradient without rounding.
            prop_assert_eq!(f1_max(&p.mapv(|d| d * 2_f32.powi(power))), f1_max(&p));
        }
    }
}
