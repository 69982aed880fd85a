//! The order in depth of superpixels: the D3R and ORD of "Boosting monocular depth".

use super::depth_range;
use super::ordinal::{Pixel, ordinal_error};
use crate::Result;
use crate::raster::{Map, Mask, Superpixels, same_shape};
use mde_uncertainty::random::CounterRng;
use rand::RngExt;

/// Superpixels of the published code.
pub const SEGMENTS: usize = 5000;
const COMPACTNESS: f64 = 20.0;
const ITERATIONS: usize = 5;
/// Random partners of each superpixel for [`OrderErrors::ord`].
const PARTNERS: usize = 3;

/// Disagreement on the order in depth of superpixel centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrderErrors {
    /// Depth discontinuity disagreement ratio: share of neighbouring centres whose true depths differ by more than 10 % and whose
    /// order is not the truth's (ties within 1 %); nothing where there are none.
    pub d3r: Option<f64>,
    /// Ordinal error: share of random pairs of centres whose order is not the truth's (ties within 3 %).
    pub ord: Option<f64>,
}

/// Pairs of superpixel centres of the truth, to be compared with many predictions.
#[derive(Debug, Clone, PartialEq)]
pub struct SuperpixelPairs {
    neighbours: Vec<(Pixel, Pixel)>,
    random: Vec<(Pixel, Pixel)>,
}

impl SuperpixelPairs {
    /// The pairs of a truth `[height, width]` after Miangoleh et al. (CVPR 2021): superpixels (SLIC) of its
    /// disparity (5000, compactness 20; disparity scaled to 0 to 100 over the mask), pairs of those that touch, and for each
    /// three random others (the same for every seed and method). Centres outside the mask are left out.
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
            mask.get(place).copied().unwrap_or(false).then_some(place)
        };
        let both = |(a, b): (u32, u32)| Some((centre(a)?, centre(b)?));
        let neighbours = found.neighbours().into_iter().filter_map(both).collect();
        let places: Vec<Pixel> = (0..found.centres.len() as u32).filter_map(centre).collect();
        let mut rng = CounterRng::new(0, "superpixel-pairs", 0, 0);
        let mut random = Vec::new();
        for &place in &places {
            for _ in 0..PARTNERS {
                let other = places[rng.random_range(0..places.len())];
                if other != place {
                    random.push((place, other));
                }
            }
        }
        Ok(Self { neighbours, random })
    }

    /// How often `prediction` has another order than the truth.
    ///
    /// # Errors
    /// As [`ordinal_error`]: both maps need a depth at every centre.
    pub fn compare(&self, prediction: Map<'_>, truth: Map<'_>) -> Result<OrderErrors> {
        Ok(OrderErrors {
            d3r: ordinal_error(prediction, truth, &self.neighbours, 1.1, 1.01)?,
            ord: ordinal_error(prediction, truth, &self.random, 1.0, 1.03)?,
        })
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
        let own = pairs.compare(truth.view(), truth.view()).unwrap();
        assert_eq!((own.d3r, own.ord), (Some(0.0), Some(0.0)));
        let inverse = truth.mapv(|g| 1.0 / g);
        let other = pairs.compare(inverse.view(), truth.view()).unwrap();
        assert_eq!(other.d3r, Some(1.0));
        assert!(other.ord.is_some_and(|o| o > 0.3 && o < 0.7), "{other:?}");
        let flat = Array2::from_elem((60, 80), 3.0);
        let of_flat = SuperpixelPairs::new(flat.view(), mask.view()).unwrap();
        assert_eq!(of_flat.compare(truth.view(), flat.view()).unwrap().d3r, None);
    }
}
