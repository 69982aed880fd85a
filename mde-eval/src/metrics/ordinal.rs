//! Does the prediction keep the order in depth of pairs of pixels?

use crate::raster::same_shape;
use crate::{Error, Result};
use mde_uncertainty::random::CounterRng;
use ndarray::ArrayView2;
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// A pixel's row and column.
pub type Pixel = (usize, usize);

/// How pairs are drawn and compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct PairSampling {
    /// How many pairs are drawn; those outside the mask or below `min-ratio` then fall away.
    pub count: usize,
    /// Largest distance in a pair, in pixels (Euclidean); without one, both ends fall anywhere in the image.
    pub radius: Option<u32>,
    /// Ratio that the true depths of a pair must exceed to count, 1 for all pairs.
    pub min_ratio: f64,
    /// Ratio up to which two depths are a tie.
    pub tie_ratio: f64,
    /// Seed of the draw. The same seed and image size give the same pairs for every method.
    pub seed: u64,
}

impl PairSampling {
    /// Depth-discontinuity disagreement ("D3R-like"): pairs within 12 pixels whose true depths differ by more than 10 %, ties
    /// within 1 %. D3R proper (Miangoleh et al., CVPR 2021) takes neighbouring superpixel centres instead.
    pub const fn discontinuities() -> Self {
        Self { count: 400_000, radius: Some(12), min_ratio: 1.1, tie_ratio: 1.01, seed: 0 }
    }

    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`] names the field and what it must be.
    pub fn validate(&self) -> Result<()> {
        let fault =
            |field, value: f64, remedy| Err(Error::Config { field, value: value.to_string(), remedy });
        if self.radius == Some(0) {
            return fault("radius", 0.0, "use at least 1 pixel, or leave it out");
        }
        for (field, value) in [("min-ratio", self.min_ratio), ("tie-ratio", self.tie_ratio)] {
            if !(value >= 1.0 && value.is_finite()) {
                return fault(field, value, "use a ratio of at least 1");
            }
        }
        Ok(())
    }

    /// The pairs for a mask `[height, width]`: first pixel uniform over the image, second uniform over the disc around it (or the
    /// image), both in the mask and different. The draw itself does not depend on the mask.
    pub fn draw(&self, mask: ArrayView2<'_, bool>) -> Vec<(Pixel, Pixel)> {
        let (height, width) = mask.dim();
        if height == 0 || width == 0 {
            return Vec::new();
        }
        let mut rng = CounterRng::new(self.seed, "ordinal-pairs", 0, 0);
        let mut pairs = Vec::new();
        for _ in 0..self.count {
            let first = (rng.random_range(0..height), rng.random_range(0..width));
            let second = match self.radius {
                None => Some((rng.random_range(0..height), rng.random_range(0..width))),
                Some(radius) => within_disc(&mut rng, first, i64::from(radius)),
            };
            if let Some(second) = second
                && first != second
                && mask.get(second).is_some_and(|&keep| keep)
                && mask[first]
            {
                pairs.push((first, second));
            }
        }
        pairs
    }
}

/// A pixel around `centre`, uniform over the disc; nothing where it falls off the top or left.
fn within_disc(rng: &mut CounterRng, centre: Pixel, radius: i64) -> Option<Pixel> {
    let (dy, dx) = loop {
        let (dy, dx) = (rng.random_range(-radius..=radius), rng.random_range(-radius..=radius));
        if dy * dy + dx * dx <= radius * radius {
            break (dy as isize, dx as isize);
        }
    };
    Some((centre.0.checked_add_signed(dy)?, centre.1.checked_add_signed(dx)?))
}

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
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    pairs: &[(Pixel, Pixel)],
    min_ratio: f64,
    tie_ratio: f64,
) -> Result<Option<f64>> {
    same_shape("the prediction", prediction.dim(), truth.dim())?;
    let read = |what, map: ArrayView2<'_, f32>, at: Pixel, index| {
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

impl Default for PairSampling {
    fn default() -> Self {
        Self::discontinuities()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, array};

    #[test]
    fn pairs_are_reproducible_in_the_mask_and_within_the_radius() {
        let mask = Array2::from_shape_fn((30, 40), |(y, x)| (y + x) % 3 != 0);
        let sampling = PairSampling { count: 5000, radius: Some(5), ..PairSampling::default() };
        let pairs = sampling.draw(mask.view());
        assert_eq!(pairs, sampling.draw(mask.view()));
        assert_ne!(pairs, PairSampling { seed: 1, ..sampling }.draw(mask.view()));
        assert!(pairs.len() > 1500);
        for (a, b) in pairs {
            assert!(mask[a] && mask[b] && a != b);
            assert!(a.0.abs_diff(b.0).pow(2) + a.1.abs_diff(b.1).pow(2) <= 25);
        }
    }

    #[test]
    fn a_mask_removes_pairs_and_moves_none() {
        let sampling = PairSampling { count: 2000, ..PairSampling::default() };
        let all = sampling.draw(Array2::from_elem((20, 20), true).view());
        let mask = Array2::from_shape_fn((20, 20), |(y, _)| y > 4);
        let some = sampling.draw(mask.view());
        let expected: Vec<_> = all.into_iter().filter(|&(a, b)| mask[a] && mask[b]).collect();
        assert_eq!(some, expected);
    }

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
