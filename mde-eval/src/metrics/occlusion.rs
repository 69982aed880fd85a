//! Occlusion boundaries between pixels a few apart.

use super::edges::harmonic;
use crate::raster::same_shape;
use crate::{Error, Result};
use ndarray::ArrayView2;

/// Radii of the published evaluation, pixels.
pub const RADII: [u32; 3] = [1, 2, 3];

/// How many ratios are tried: \\(t_k\\), \\(k = 1 \dots 10\\), from 0.05 to 0.25.
const RATIOS: usize = 10;

/// Boundary F1 of MoGe (Wang et al., CVPR 2025; `boundary_f1`) for each of [`RADII`].
///
/// A pixel \\(i\\) and another within the radius \\(\rho\\) make an occlusion boundary where \\(d_j / d_i > 1 + t\\). With \\(P_k, R_k\\) the
/// shares of predicted (true) boundaries that the other side has too,
///
/// \\[ F = \sum_k w_k \frac{2 P_k R_k}{P_k + R_k},\qquad w_k = \frac{t_k}{\sum_l t_l},\qquad t_k = 0.05 + 0.2\\,\tfrac{k-1}{9} \\]
///
/// Pairs need both pixels in the mask and the first at least \\(\rho\\) off the image's border. Blind to a scale of either side; maps
/// are `[height, width]`.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ, [`Error::Empty`] for an empty mask.
pub fn occlusion_f1(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
) -> Result<[f64; 3]> {
    same_shape("the prediction", prediction.dim(), truth.dim())?;
    same_shape("the mask", mask.dim(), truth.dim())?;
    if !mask.iter().any(|&keep| keep) {
        return Err(Error::Empty { what: "the occlusion F1" });
    }
    let limits: [f32; RATIOS] = std::array::from_fn(|k| 1.05 + 0.2 * k as f32 / (RATIOS - 1) as f32);
    let reach = i64::from(RADII[2]);
    let mut counts = [Counts::default(); 3];
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let ring = RADII.iter().position(|&r| dy * dy + dx * dx <= i64::from(r * r));
            if let Some(ring) = ring.filter(|_| (dy, dx) != (0, 0)) {
                count(
                    prediction,
                    truth,
                    mask,
                    [dy as isize, dx as isize],
                    &limits,
                    &mut counts[ring..],
                    &RADII[ring..],
                );
            }
        }
    }
    let weights: [f64; RATIOS] = std::array::from_fn(|k| 0.05 + 0.2 * k as f64 / (RATIOS - 1) as f64);
    let total: f64 = weights.iter().sum();
    Ok(counts.map(|counts| {
        let share = |of: u64, k: usize| if of == 0 { 0.0 } else { counts.both[k] as f64 / of as f64 };
        let score = |k: usize| harmonic(share(counts.prediction[k], k), share(counts.truth[k], k));
        weights.iter().enumerate().map(|(k, w)| w / total * score(k)).sum()
    }))
}

/// Boundaries above each ratio.
#[derive(Clone, Copy, Default)]
struct Counts {
    prediction: [u64; RATIOS],
    truth: [u64; RATIOS],
    both: [u64; RATIOS],
}

/// Adds all pixels with their neighbour at `offset` to the counts of the radii that reach it.
fn count(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
    offset: [isize; 2],
    limits: &[f32; RATIOS],
    counts: &mut [Counts],
    radii: &[u32],
) {
    let (height, width) = mask.dim();
    let margin = radii[0] as usize;
    let shift = |at: usize, by: isize| at.wrapping_add_signed(by);
    for y in margin..height.saturating_sub(margin) {
        let there = shift(y, offset[0]);
        let (p, g, m) = (prediction.row(y), truth.row(y), mask.row(y));
        let (q, h, n) = (prediction.row(there), truth.row(there), mask.row(there));
        for x in margin..width.saturating_sub(margin) {
            let u = shift(x, offset[1]);
            // Nearly every pair ends here: no boundary on either side.
            let (front, behind) = (limits[0] * p[x], limits[0] * g[x]);
            if !(q[u] > front || h[u] > behind) || !m[x] || !n[u] {
                continue;
            }
            let level = |near: f32, far: f32| limits.iter().take_while(|limit| far > **limit * near).count();
            let (predicted, real) = (level(p[x], q[u]), level(g[x], h[u]));
            for (counts, &radius) in counts.iter_mut().zip(radii) {
                let r = radius as usize;
                if y >= r && y + r < height && x >= r && x + r < width {
                    counts.prediction[..predicted].iter_mut().for_each(|c| *c += 1);
                    counts.truth[..real].iter_mut().for_each(|c| *c += 1);
                    counts.both[..predicted.min(real)].iter_mut().for_each(|c| *c += 1);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use proptest::prelude::*;

    fn map() -> impl Strategy<Value = Array2<f32>> {
        proptest::collection::vec(1..6_u8, 9 * 11).prop_map(|v| {
            Array2::from_shape_vec((9, 11), v.into_iter().map(|d| f32::from(d) * 0.5).collect()).unwrap()
        })
    }

    proptest! {
        #[test]
        fn it_is_symmetric_and_blind_to_scale(p in map(), g in map(), gain in -3..4_i32) {
            let mask = Array2::from_shape_fn((9, 11), |(y, x)| (y * 11 + x) % 7 != 0);
            let f1 = |p: &Array2<f32>, g: &Array2<f32>| occlusion_f1(p.view(), g.view(), mask.view()).unwrap();
            let (forth, back) = (f1(&p, &g), f1(&g, &p));
            prop_assert!(forth.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-12));
            prop_assert_eq!(f1(&p.mapv(|d| d * 2_f32.powi(gain)), &g), forth);
        }
    }

    #[test]
    fn a_perfect_map_is_perfect_and_a_flat_one_has_nothing() {
        let truth = Array2::from_shape_fn((12, 14), |(_, x)| if x < 7 { 1.0 } else { 2.0 });
        let mask = Array2::from_elem((12, 14), true);
        let perfect = occlusion_f1(truth.view(), truth.view(), mask.view()).unwrap();
        assert!(perfect.iter().all(|f| (f - 1.0).abs() < 1e-12), "{perfect:?}");
        let flat = Array2::from_elem((12, 14), 1.5);
        assert_eq!(occlusion_f1(flat.view(), truth.view(), mask.view()).unwrap(), [0.0; 3]);
        let none = Array2::from_elem((12, 14), false);
        assert!(occlusion_f1(flat.view(), truth.view(), none.view()).is_err());
        let one = Array2::from_elem((1, 1), 1.0);
        assert_eq!(
            occlusion_f1(one.view(), one.view(), Array2::from_elem((1, 1), true).view()).unwrap(),
            [0.0; 3]
        );
    }
}
