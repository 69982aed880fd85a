//! Planes of the surfaces that a photograph shows: on a plain wall few pixels match, and the others lie on their plane.
//!
//! Pixels \\( q \\) that can be reached from \\( p \\) without crossing an edge of the photograph are taken for its surface, which is linear
//! in inverse depth:
//!
//! \\[ \min_{w, g} \sum_q \frac{k_{pq}}{(\sigma_q^2 / z_q^2 + \sigma_0^2)^2} \left( w + g^\top (q - p) - z_q^{-1} \right)^2 . \\]
//!
//! \\( k_{pq} \\) falls with the length of the way over the photograph as a surface in space and colour: the domain transform (Gastal and
//! Oliveira, 2011), whose recursive filter sums the moments of all pixels at a cost that does not depend on the reach. Precisions are
//! squared, since the errors of doubtful pixels have heavier tails than a normal distribution. Depth and plane are averaged by precision
//! (Eq. 7).

use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{Array2, Zip};

use super::cost::NOISE;
use super::edge::colour;
use crate::Result;
use crate::raster::recursive_filter;

/// Reach along a surface of one colour, as a share of the longer side.
const REACH: f64 = 0.2;
/// Sum of the differences of sRGB beyond noise along a way that is as long as the reach.
const COLOUR: f64 = 0.1;
/// Relative deviation that is added to each pixel's, which bounds the weight of a single one.
const LEAST: f64 = 0.01;
/// Filters, each of half the reach of the one before.
const FILTERS: i32 = 2;
/// Change of inverse depth at most, as a factor.
const MOST: f64 = 3.0;
/// Ridge of a slope, as a share of the spread of the pixels along it.
const RIDGE: f64 = 0.001;

/// Weight, then its products: `x`, `y`, `xx`, `xy`, `yy`, `w`, `wx`, `wy`, `ww`, and the relative variance.
type Moments = [f64; 11];

/// The depth of a photograph with the planes of its surfaces, `[height, width]`; what is missing stays so.
///
/// With \\( a \\) the weight of the own depth, the relative variance is \\( a \sigma_p^2 + (1 - a) (\bar\sigma^2 + r^2) \\), of the mean variance of the
/// plane's pixels and their mean squared residual \\( r^2 \\): neighbours share their errors, so an average is no surer than its parts.
///
/// # Errors
/// [`Error::View`](crate::Error::View) for a map that is not of the photograph's size.
pub fn with_planes(view: &PosedView, depth: &GaussianDepth) -> Result<GaussianDepth> {
    view.camera.check_map("depth", depth.dim())?;
    let longer = depth.dim().0.max(depth.dim().1) as f64;
    let reach = REACH * longer;
    let steps = [steps(view, reach, [0, 1]), steps(view, reach, [1, 0])];
    let known = |z: f32, v: f32| z > 0.0 && v.is_finite();
    let own = Zip::from(depth.mean())
        .and(depth.variance())
        .map_collect(|&z, &v| if known(z, v) { f64::from(v) / f64::from(z).powi(2) } else { f64::INFINITY });
    let mut inverse = depth.mean().mapv(|z| if z > 0.0 { f64::from(z).recip() } else { 0.0 });
    let mut moments = Zip::indexed(&inverse).and(&own).map_collect(|(y, x), &w, &own| {
        let weight = (own + LEAST * LEAST).powi(-2);
        let (x, y, own) = (x as f64 / longer, y as f64 / longer, if own.is_finite() { own } else { 0.0 });
        [1.0, x, y, x * x, x * y, y * y, w, w * x, w * y, w * w, own].map(|value| weight * value)
    });
    for filter in 1..=FILTERS {
        let share = 3.0_f64.sqrt() * 2.0_f64.powi(FILTERS - filter) / (4.0_f64.powi(FILTERS) - 1.0).sqrt();
        let decay = -2.0_f64.sqrt() / (reach * share);
        let feedback = steps.each_ref().map(|steps| steps.mapv(|step| (decay * step).exp()));
        recursive_filter(&mut moments, &feedback);
    }
    let mut variance = own.clone();
    Zip::indexed(&mut inverse).and(&own).and(&mut variance).and(&moments).for_each(
        |(y, x), inverse, &own, variance, moments| {
            if own.is_finite() {
                let [plane, residual] = plane(moments, [x as f64 / longer, y as f64 / longer], *inverse);
                let weight = own.max(1e-6).recip();
                let weight = weight / (weight + residual.max(1e-6).recip());
                *variance = weight * own + (1.0 - weight) * (moments[10] / moments[0] + residual);
                *inverse *= weight + (1.0 - weight) * plane.clamp(MOST.recip(), MOST);
            }
        },
    );
    let mean = Zip::from(&inverse).map_collect(|&w| if w > 0.0 { w.recip() as f32 } else { 0.0 });
    let variance = Zip::from(&variance)
        .and(&mean)
        .and(depth.variance())
        .map_collect(|&v, &z, &was| if v.is_finite() { (v * f64::from(z).powi(2)) as f32 } else { was });
    Ok(GaussianDepth::new(mean, variance)?)
}

/// Length of the way to each pixel from the one before it, `[dy, dx]` away. Differences count beyond the noise of both pixels: along a plain
/// surface it would add up.
fn steps(view: &PosedView, reach: f64, [dy, dx]: [usize; 2]) -> Array2<f64> {
    Array2::from_shape_fn(view.camera.dim(), |(y, x)| {
        let (here, from) = (colour(view, y, x), colour(view, y.saturating_sub(dy), x.saturating_sub(dx)));
        let beyond_noise =
            |(here, from): (&f32, f32)| ((here - from).abs() - std::f32::consts::SQRT_2 * NOISE).max(0.0);
        let differences = here.iter().zip(from).map(beyond_noise);
        1.0 + reach / COLOUR * f64::from(differences.sum::<f32>())
    })
}

/// The plane at a pixel over its own inverse depth, and the mean squared residual of its pixels.
fn plane(moments: &Moments, [x, y]: [f64; 2], own: f64) -> [f64; 2] {
    let [sx, sy, sxx, sxy, syy, w, wx, wy, ww] = std::array::from_fn(|i| moments[i + 1] / moments[0]);
    let (cxx, cxy, cyy) = (sxx - sx * sx, sxy - sx * sy, syy - sy * sy);
    let (cwx, cwy) = (wx - w * sx, wy - w * sy);
    let [cxx, cyy] = [cxx, cyy].map(|spread| spread * (1.0 + RIDGE) + 1e-12);
    let determinant = cxx * cyy - cxy * cxy;
    let (gx, gy) = ((cyy * cwx - cxy * cwy) / determinant, (cxx * cwy - cxy * cwx) / determinant);
    let residual = (ww - w * w - gx * cwx - gy * cwy).max(0.0);
    [(w + gx * (x - sx) + gy * (y - sy)) / own, residual / (own * own)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;
    use crate::synthetic::{Plane, scene};
    use proptest::prelude::*;

    const SIZE: (usize, usize) = (60, 80);

    fn wall(colour: impl Fn(usize) -> f32) -> PosedView {
        let mut view = scene(&[Plane::slanted(2.0, 0.0, 0.0)], SIZE, &[[0.0; 3]]).0.swap_remove(0);
        view.image.indexed_iter_mut().for_each(|((_, x, _), value)| *value = colour(x));
        view
    }

    fn map(depth: impl Fn(usize, usize) -> f32, sigma: impl Fn(usize, usize) -> f32) -> GaussianDepth {
        let mean = Array2::from_shape_fn(SIZE, |(y, x)| depth(y, x));
        let variance = Array2::from_shape_fn(SIZE, |(y, x)| (sigma(y, x) * mean[(y, x)]).powi(2));
        GaussianDepth::new(mean, variance).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        /// What lies on a plane stays, whatever its sigma and the photograph, and is not surer than the surest pixel.
        #[test]
        fn planes_are_fixed_points(slope in [-0.004f32..0.004, -0.004f32..0.004], sigmas in [0.005f32..0.4, 0.005f32..0.4]) {
            let view = wall(|x| 0.3 + 0.02 * (x % 7) as f32);
            let plane = |y: usize, x: usize| (0.6 + slope[0] * x as f32 + slope[1] * y as f32).recip();
            let sigma = |y: usize, x: usize| sigmas[(x / 9 + y / 7) % 2];
            let found = with_planes(&view, &map(plane, sigma)).unwrap();
            let least = sigmas[0].min(sigmas[1]);
            for (y, x) in (0..SIZE.0).flat_map(|y| (0..SIZE.1).map(move |x| (y, x))) {
                let (z, v) = found.get(y, x).unwrap();
                prop_assert!((z / plane(y, x) - 1.0).abs() < 1e-3, "{} {}", z, plane(y, x));
                prop_assert!(v.sqrt() / z > 0.99 * least);
            }
        }
    }

    /// A spot of a slanted wall with a wrong depth and a large sigma comes back to the wall; its sigma shrinks, and noise changes nothing.
    #[test]
    fn a_doubtful_spot_returns_to_its_plane() {
        let plane = |y: usize, x: usize| (0.5 + 0.002 * x as f32 + 0.001 * y as f32).recip();
        let spot = |y: usize, x: usize| y.abs_diff(30).pow(2) + x.abs_diff(40).pow(2) < 36;
        let depth = |y, x| plane(y, x) * if spot(y, x) { 1.4 } else { 1.0 };
        let known = map(depth, |y, x| if spot(y, x) { 0.3 } else { 0.01 });
        let found = with_planes(&wall(|_| 0.5), &known).unwrap();
        assert_eq!(with_planes(&wall(|x| 0.5 + 0.01 * (x % 2) as f32), &known).unwrap(), found);
        let (z, v) = found.get(30, 40).unwrap();
        assert!((z / plane(30, 40) - 1.0).abs() < 0.06, "{z} {}", plane(30, 40));
        assert!(v.sqrt() / z < 0.15, "{}", v.sqrt() / z);
    }

    /// Two surfaces of different colour keep their depths up to the edge; of one colour, they do not.
    #[test]
    fn planes_end_at_edges_of_the_photograph() {
        let depth = |_: usize, x: usize| if x < 40 { 1.0 } else { 2.0 };
        let doubtful = |_: usize, x: usize| if x.abs_diff(40) < 6 { 0.2 } else { 0.01 };
        let off = |colour: f32| {
            let view = wall(|x| if x < 40 { 0.5 } else { colour });
            let found = with_planes(&view, &map(depth, doubtful)).unwrap();
            (found.mean()[(30, 39)] - 1.0).abs().max((found.mean()[(30, 40)] / 2.0 - 1.0).abs())
        };
        assert!(off(0.8) < 0.01 && off(0.5) > 0.02, "{} {}", off(0.8), off(0.5));
    }

    #[test]
    fn what_is_missing_stays_missing() {
        let mut known = map(|_, _| 2.0, |_, _| 0.1).into_parts();
        (known.0[(7, 9)], known.1[(7, 9)]) = (0.0, f32::INFINITY);
        let known = GaussianDepth::new(known.0, known.1).unwrap();
        let found = with_planes(&wall(|_| 0.5), &known).unwrap();
        assert_eq!(found.get(7, 9), known.get(7, 9));
        assert_eq!(found.mean()[(7, 9)], 0.0);
        let small = GaussianDepth::new(Array2::ones((3, 4)), Array2::ones((3, 4))).unwrap();
        assert!(matches!(with_planes(&wall(|_| 0.5), &small), Err(Error::View(_))));
    }
}
