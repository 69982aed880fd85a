//! Gain and bias per channel between two photographs of the same place.
//!
//! Cameras that choose their own exposure and white balance render one surface in two colours. Pixels that a depth map
//! joins give pairs of colours \\( (x, y) \\), and per channel
//!
//! \\[ y \approx g\, x + b . \\]
//!
//! Both sides carry noise, so the line is the one of least *orthogonal* distance (Deming), which does not flatten \\( g \\)
//! as ordinary regression does; wrong pairs are held down by Huber weights at 1.345 robust deviations.

use mde_uncertainty::statistics::median;
use mde_warp::PosedView;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3};

use super::edge::colour;
use crate::Result;
use crate::raster::bilinear;
use crate::statistics::robust_deviation;
use mde_warp::transfer::Transfer;

/// Fewer pairs than this fit no line.
const MIN_PAIRS: usize = 64;
/// More pairs than this are thinned.
const MAX_PAIRS: usize = 20_000;
/// Colours this near to 0 or 1 may be clipped.
const CLIPPED: f64 = 0.02;
/// Rounds of reweighting.
const ROUNDS: usize = 12;
/// Huber's constant: 95 % efficiency for Gaussian residuals.
const HUBER: f64 = 1.345;
/// A channel whose pairs correlate less than this gets an offset only.
const MIN_CORRELATION: f64 = 0.5;

/// Colours of one photograph as another would have taken them, per channel: `gain * x + bias`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, rename_all = "kebab-case"))]
pub struct Exposure {
    /// Factor of each of red, green, blue; positive.
    pub gain: [f32; 3],
    /// Offset of each, in units of sRGB in [0, 1].
    pub bias: [f32; 3],
}

impl Default for Exposure {
    fn default() -> Self {
        Self { gain: [1.0; 3], bias: [0.0; 3] }
    }
}

impl Exposure {
    /// One colour.
    pub fn apply(&self, colour: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| self.gain[c] * colour[c] + self.bias[c])
    }

    /// Every colour of an image `[height, width, 3]`; values may leave [0, 1].
    pub fn apply_to(&self, image: ArrayView3<'_, f32>) -> Array3<f32> {
        Array3::from_shape_fn(image.dim(), |at| self.gain[at.2] * image[at] + self.bias[at.2])
    }
}

/// Fits the exposure of `view` to `reference` through the reference's depth.
///
/// `depth` is z in the unit of the poses, 0 where it is not verified: give only pixels that other photographs confirm.
/// With fewer than 64 pairs the result is the identity.
///
/// # Errors
/// [`Error::View`](crate::Error::View) for a view that [`PosedView::validate`] refuses, or a depth map of another size than the reference.
pub fn fit_exposure(reference: &PosedView, view: &PosedView, depth: ArrayView2<'_, f32>) -> Result<Exposure> {
    reference.validate()?;
    view.validate()?;
    reference.camera.check_map("depth", depth.dim())?;
    let there = carried(reference, view, depth);
    let pair = |((y, x), there): ((usize, usize), &Option<_>)| Some(((*there)?, colour(reference, y, x)));
    let pairs: Vec<_> = there.indexed_iter().filter_map(pair).collect();
    let some: Vec<_> = pairs.iter().copied().step_by(pairs.len() / MAX_PAIRS + 1).collect();
    Ok(fit_pairs(&some))
}

/// The colours of `view` where the depth of each pixel of the reference lands.
pub(super) fn carried(
    reference: &PosedView,
    view: &PosedView,
    depth: ArrayView2<'_, f32>,
) -> Array2<Option<[f32; 3]>> {
    let transfer = Transfer::new(reference, view);
    Array2::from_shape_fn(depth.dim(), |(y, x)| {
        let z = depth[(y, x)];
        if !(z > 0.0 && z.is_finite() && reference.mask[(y, x)]) {
            return None;
        }
        let seen = transfer.at(x as f64, y as f64, 1.0 / f64::from(z))?;
        sample(view, seen.x, seen.y)
    })
}

/// Fits the exposure that takes the first colour of each pair to the second. With fewer than 64 pairs the result is the identity.
pub fn fit_pairs(pairs: &[([f32; 3], [f32; 3])]) -> Exposure {
    let mut exposure = Exposure::default();
    for c in 0..3 {
        let usable = |x: f64| (CLIPPED..=1.0 - CLIPPED).contains(&x);
        let channel = pairs.iter().map(|(x, y)| [x[c], y[c]].map(f64::from));
        let channel: Vec<[f64; 2]> = channel.filter(|[x, y]| usable(*x) && usable(*y)).collect();
        if channel.len() < MIN_PAIRS {
            continue;
        }
        [exposure.gain[c], exposure.bias[c]] = robust_line(&channel).map(|v| v as f32);
    }
    exposure
}

/// Gain and bias.
fn robust_line(points: &[[f64; 2]]) -> [f64; 2] {
    let middle = |axis: usize| median(points.iter().map(|p| p[axis])).unwrap_or_default();
    let [mut gain, mut bias] = [1.0, middle(1) - middle(0)];
    for _ in 0..ROUNDS {
        let norm = (1.0 + gain * gain).sqrt();
        let residual = |[x, y]: &[f64; 2]| (y - gain * x - bias) / norm;
        let deviation = robust_deviation(points.iter().map(residual)).unwrap_or_default().max(1e-6);
        let weight = |p: &[f64; 2]| (HUBER * deviation / residual(p).abs().max(1e-12)).min(1.0);
        let mut sums = [0.0; 6];
        for p in points {
            let (w, [x, y]) = (weight(p), *p);
            for (sum, term) in sums.iter_mut().zip([w, w * x, w * y, w * x * x, w * x * y, w * y * y]) {
                *sum += term;
            }
        }
        let [_, mx, my, xx, xy, yy] = sums.map(|sum| sum / sums[0]);
        let (xx, xy, yy) = (xx - mx * mx, xy - mx * my, yy - my * my);
        let correlated = xy > MIN_CORRELATION * (xx * yy).max(0.0).sqrt() && xy > 0.0;
        gain = if correlated {
            let d = yy - xx;
            (d + d.hypot(2.0 * xy)) / (2.0 * xy)
        } else {
            1.0
        };
        bias = my - gain * mx;
    }
    [gain, bias]
}

/// Bilinear colour, where all four pixels are on the mask.
fn sample(view: &PosedView, x: f64, y: f64) -> Option<[f32; 3]> {
    let (h, w) = view.camera.dim();
    if !(x >= 0.0 && y >= 0.0 && x <= (w - 1) as f64 && y <= (h - 1) as f64) {
        return None;
    }
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
    if ![(y0, x0), (y0, x1), (y1, x0), (y1, x1)].iter().all(|&p| view.mask[p]) {
        return None;
    }
    Some(bilinear(view.image.view(), x, y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};
    use mde_uncertainty::random::CounterRng;
    use proptest::prelude::*;
    use rand::RngExt;

    proptest! {
        /// A quarter of wrong pairs and noise on both sides move neither gain nor bias far.
        #[test]
        fn a_line_is_found_through_wrong_pairs(gain in 0.75..1.3_f32, bias in -0.05..0.05_f32, seed in 0..1000_u64) {
            let pairs: Vec<_> = (0..2000).map(|i| {
                let mut random = CounterRng::new(seed, "pairs", 0, i);
                let [x, wrong, a, b] = [(); 4].map(|()| random.random::<f32>());
                let (x, noise) = (0.1 + 0.6 * x, [a, b].map(|unit| 0.01 * (unit - 0.5)));
                let y = if i % 4 == 0 { wrong } else { gain * x + bias + noise[0] };
                ([x + noise[1]; 3], [y; 3])
            }).collect();
            let fit = fit_pairs(&pairs);
            for c in 0..3 {
                prop_assert!((fit.gain[c] - gain).abs() < 0.05, "{:?}", fit);
                prop_assert!((fit.apply([0.4; 3])[c] - (gain * 0.4 + bias)).abs() < 0.02, "{:?}", fit);
            }
        }
    }

    #[test]
    fn few_pairs_are_the_identity() {
        assert_eq!(fit_pairs(&[([0.2; 3], [0.4; 3]); 63]), Exposure::default());
    }

    /// Another exposure of the same plane comes back through the depth map.
    #[test]
    fn the_exposure_of_a_view_is_found_through_depth() {
        let plane = [Plane::slanted(2.0, 0.3, 0.1)];
        let (mut views, depths) = scene(&plane, (48, 64), &[[0.0; 3], [0.2, 0.0, 0.0]]);
        let taken = Exposure { gain: [0.8, 0.9, 0.7], bias: [0.02, 0.0, 0.05] };
        views[1].image = taken.apply_to(views[1].image.view()).into_shared();
        let fit = fit_exposure(&views[0], &views[1], depths[0].view()).unwrap();
        for c in 0..3 {
            assert!((fit.gain[c] * taken.gain[c] - 1.0).abs() < 0.05, "{fit:?}");
        }
        assert!((0..3).all(|c| (fit.bias[c] + fit.gain[c] * taken.bias[c]).abs() < 0.02), "{fit:?}");
    }
}
