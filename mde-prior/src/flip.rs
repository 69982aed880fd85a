use ndarray::{ArrayView3, Zip, s};

use crate::{DepthKind, DepthPrior, Error, PriorDepth, Result};

/// Averages a prior over the image and its mirror image: half of its random error about left and right goes away, at
/// twice the cost.
///
/// With \\( F \\) the mirror, \\( \tfrac12 \bigl(P(x) + F P(F x)\bigr) \\). Where only one of the two has a value, that one
/// is taken. What a kind leaves open differs between the two answers, so it is matched first, over the pixels that both
/// have: the mean of relative depths, the mean and the standard deviation of disparities.
///
/// ```
/// use mde_prior::{DepthKind, DepthPrior, FlipAverage, PriorDepth, Result};
/// use mde_prior::ndarray::{Array3, ArrayView3, array, s};
///
/// struct Red;
/// impl DepthPrior for Red {
///     fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
///         PriorDepth::from_values(image.slice(s![.., .., 0]).to_owned(), DepthKind::Metric)
///     }
/// }
///
/// let image = Array3::from_shape_fn((2, 3, 3), |(y, x, _)| (1 + x + y) as f32 / 8.0);
/// assert_eq!(FlipAverage(Red).predict(image.view())?, Red.predict(image.view())?);
/// # Ok::<(), mde_prior::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct FlipAverage<P>(pub P);

impl<P: DepthPrior> DepthPrior for FlipAverage<P> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let mut straight = self.0.predict(image.view())?;
        // A model may want contiguous rows, so the mirror image is copied.
        let mirrored = self.0.predict(image.slice(s![.., ..;-1, ..]).to_owned().view())?;
        if mirrored.kind != straight.kind || mirrored.map.dim() != straight.map.dim() {
            return Err(Error::Input(format!(
                "the prior gave {} {:?} for the image but {} {:?} for its mirror image; it can't be flip averaged",
                straight.kind,
                straight.map.dim(),
                mirrored.kind,
                mirrored.map.dim()
            )));
        }
        let (map, valid) = (mirrored.map.slice(s![.., ..;-1]), mirrored.valid.slice(s![.., ..;-1]));
        let pairs = straight.map.iter().zip(&straight.valid).zip(map.iter().zip(valid));
        let both = pairs
            .filter(|((_, a), (_, b))| **a && **b)
            .map(|((a, _), (b, _))| (f64::from(*a), f64::from(*b)));
        let (scale, shift) = gauge(straight.kind, both);
        Zip::from(&mut straight.map).and(&mut straight.valid).and(map).and(valid).for_each(
            |a, a_valid, &b, &b_valid| {
                let b = (scale * f64::from(b) + shift) as f32;
                if *a_valid && b_valid {
                    *a = (0.5 * (f64::from(*a) + f64::from(b))) as f32;
                } else if b_valid {
                    *a = b;
                    *a_valid = true;
                }
            },
        );
        Ok(straight)
    }
}

/// Scale and shift that bring the second of each pair to the gauge of the first, as far as the kind leaves it open.
fn gauge(kind: DepthKind, pairs: impl Iterator<Item = (f64, f64)> + Clone) -> (f64, f64) {
    let count = pairs.clone().count().max(1) as f64;
    let (a, b) = pairs.clone().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / count, b + y / count));
    match kind {
        DepthKind::RelativeDepth if b > 0.0 => (a / b, 0.0),
        DepthKind::AffineDisparity => {
            let spread = pairs.fold((0.0, 0.0), |(va, vb), (x, y)| {
                (va + (x - a) * (x - a) / count, vb + (y - b) * (y - b) / count)
            });
            let scale = if spread.1 > 0.0 { (spread.0 / spread.1).sqrt() } else { 1.0 };
            (scale, a - scale * b)
        }
        _ => (1.0, 0.0),
    }
}
