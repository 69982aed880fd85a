use ndarray::{Zip, s};

use crate::{DepthKind, Error, PriorDepth, Result};

/// The mean of a prediction and of the prediction of the mirror image, turned back: errors that depend on the side cancel.
///
/// With \\( F \\) the mirror and \\( P(x) \\) the prediction of an image, this is \\( \tfrac12 \bigl(P(x) + F P(F x)\bigr) \\).
/// `straight` is \\( P(x) \\), `mirrored` is \\( P(F x) \\) as the model gives it, both `[height, width]`. Where only one of
/// the two has a value, that value is taken. What a kind leaves open is matched first, over the pixels that both have: the mean
/// of relative depths, the mean and the standard deviation of disparities.
///
/// ```
/// use mde_prior::augment::flip_average;
/// use mde_prior::ndarray::array;
/// use mde_prior::{DepthKind, PriorDepth};
///
/// let straight = PriorDepth::from_values(array![[1.0, 2.0, 0.0]], DepthKind::Metric)?;
/// let mirrored = PriorDepth::from_values(array![[5.0, 3.0, 0.0]], DepthKind::Metric)?;
/// assert_eq!(flip_average(straight, &mirrored)?.map, array![[1.0, 2.5, 5.0]]);
/// # Ok::<(), mde_prior::Error>(())
/// ```
///
/// # Errors
/// [`Error::Input`] for predictions of two sizes or kinds.
pub fn flip_average(mut straight: PriorDepth, mirrored: &PriorDepth) -> Result<PriorDepth> {
    let [one, other] = [&straight, mirrored].map(|prior| format!("{} {:?}", prior.kind, prior.map.dim()));
    if one != other {
        return Err(Error::Input(format!(
            "the prior gave {one} for the image but {other} for its mirror image; both must agree to be averaged"
        )));
    }
    let (map, valid) = (mirrored.map.slice(s![.., ..;-1]), mirrored.valid.slice(s![.., ..;-1]));
    let pairs = straight.map.iter().zip(&straight.valid).zip(map.iter().zip(valid));
    let both =
        pairs.filter(|((_, a), (_, b))| **a && **b).map(|((a, _), (b, _))| (f64::from(*a), f64::from(*b)));
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

/// Scale and shift that match the second of each pair to the first, as far as the kind leaves them open.
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
