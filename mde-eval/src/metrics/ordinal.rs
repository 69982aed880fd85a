//! Does the prediction keep the order in depth of pairs of pixels?

use crate::raster::{Map, same_shape};
use crate::{Error, Result};

/// A pixel's row and column.
pub type Pixel = (usize, usize);

/// Share of pairs whose order in the prediction is not that in the truth.
///
/// \\[ \frac{1}{|Q|} \sum_{(a,b) \in Q} \mathbb 1\\{\operatorname{ord}(p_a, p_b) \ne \operatorname{ord}(g_a, g_b)\\},\qquad
///     \operatorname{ord}(u, v) = \begin{cases} +1 & u / v > \tau \\\\ -1 & v / u > \tau \\\\ 0 & \text{otherwise} \end{cases} \\]
///
/// with \\(Q\\) the pairs whose true depths differ by more than the factor `min_ratio` and \\(\tau\\) the `tie_ratio`.
/// Nothing where \\(Q\\) is empty. Blind to a scale of either side.
///
/// # Errors
/// [`Error::Shape`] where the maps differ; [`Error::Value`] for a pair off the map, or a depth that is not positive and finite.
pub fn ordinal_error(
    prediction: Map<'_>,
    truth: Map<'_>,
    pairs: &[(Pixel, Pixel)],
    min_ratio: f64,
    tie_ratio: f64,
) -> Result<Option<f64>> {
    same_shape("the prediction", prediction.dim(), truth.dim())?;
    let read = |what, map: Map<'_>, at: Pixel, index| {
        let depth = map.get(at).map_or(f64::NAN, |&d| f64::from(d));
        let sound = depth > 0.0 && depth.is_finite();
        let fault = Error::Value { what, index, value: depth, expected: "on the map, positive and finite" };
        if sound { Ok(depth) } else { Err(fault) }
    };
    let (mut kept, mut wrong) = (0_usize, 0_usize);
    for (index, &(a, b)) in pairs.iter().enumerate() {
        let (g_a, g_b) =
            (read("a pair's true depth", truth, a, index)?, read("a pair's true depth", truth, b, index)?);
        if g_a.max(g_b) <= min_ratio * g_a.min(g_b) && min_ratio > 1.0 {
            continue;
        }
        let what = "a pair's predicted depth";
        let (p_a, p_b) = (read(what, prediction, a, index)?, read(what, prediction, b, index)?);
        kept += 1;
        wrong += usize::from(order(p_a, p_b, tie_ratio) != order(g_a, g_b, tie_ratio));
    }
    Ok((kept > 0).then(|| wrong as f64 / kept as f64))
}

fn order(a: f64, b: f64, tie_ratio: f64) -> i8 {
    if a > tie_ratio * b {
        1
    } else if b > tie_ratio * a {
        -1
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    #[test]
    fn order_ties_and_the_ratio_gate() {
        let truth = array![[1.0, 1.005, 2.0]];
        let pairs = [((0, 0), (0, 1)), ((0, 0), (0, 2)), ((0, 2), (0, 1))];
        let error = |p: Array2<f32>, min| ordinal_error(p.view(), truth.view(), &pairs, min, 1.01).unwrap();
        assert_eq!(error(truth.clone(), 1.0), Some(0.0));
        assert_eq!(error(array![[5.0, 5.0, 5.0]], 1.0), Some(2.0 / 3.0));
        assert_eq!(error(array![[5.0, 5.0, 5.0]], 1.1), Some(1.0));
        assert_eq!(error(array![[2.0, 2.0, 1.0]], 3.0), None);
        assert!(ordinal_error(array![[0.0, 1.0, 1.0]].view(), truth.view(), &pairs, 1.0, 1.01).is_err());
    }
}
