use super::gradient::Gradient;
use super::{blur, same_shape};
use crate::Result;
use crate::raster::{Map, Mask};
use ndarray::Array2;

/// Canny's edge detector (1986), as scikit-image has it, with a mask: `[height, width]` in, edge pixels out.
///
/// Gaussian smoothing with `sigma` pixels that ignores what is masked out (normalised convolution, cut off at 4 sigma), Sobel
/// gradients (gain 8), non-maximum suppression between interpolated neighbours, and hysteresis: pixels of at least
/// `low` that touch, over eight neighbours, a pixel of at least `high`. Pixels on the border of the image or of the
/// mask are no edges.
///
/// # Errors
/// [`Error::Shape`](crate::Error::Shape) where the mask differs.
pub(crate) fn canny(map: Map<'_>, mask: Mask<'_>, sigma: f64, low: f64, high: f64) -> Result<Array2<bool>> {
    same_shape("the mask", mask.dim(), map.dim())?;
    let weights = mask.mapv(|keep| f64::from(u8::from(keep)));
    let mut values = map.mapv(f64::from);
    values.zip_mut_with(&mask, |value, keep| *value = if *keep && value.is_finite() { *value } else { 0.0 });
    let (mut smooth, share) = (blur(values, sigma), blur(weights, sigma));
    smooth.zip_mut_with(&share, |value, share| *value /= share + f64::EPSILON);
    let strength = Gradient::sobel(&smooth).thin(mask, low);
    Ok(hysteresis(&strength, high))
}

/// Pixels above 0 that are joined, over eight neighbours, to one of at least `high`.
fn hysteresis(strength: &Array2<f64>, high: f64) -> Array2<bool> {
    let (height, width) = strength.dim();
    let mut edges = Array2::from_elem((height, width), false);
    let mut open: Vec<(usize, usize)> =
        strength.indexed_iter().filter(|(_, s)| **s > 0.0 && **s >= high).map(|(at, _)| at).collect();
    while let Some((y, x)) = open.pop() {
        if std::mem::replace(&mut edges[(y, x)], true) {
            continue;
        }
        for v in y.saturating_sub(1)..(y + 2).min(height) {
            for u in x.saturating_sub(1)..(x + 2).min(width) {
                if strength[(v, u)] > 0.0 && !edges[(v, u)] {
                    open.push((v, u));
                }
            }
        }
    }
    edges
}
