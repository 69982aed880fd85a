//! Whether depth from several photographs explains one that it has not used.
//!
//! [`withheld_error`] carries the colours of the withheld photograph into the reference through a depth map, once through the
//! reconstruction of the other photographs and once through the scaled prior; [`unused_error`] does so where a further photograph is left.
//! Wrong poses, a moved scene or a failed match show there: the photograph then fits the reconstruction worse than the prior.

use mde_uncertainty::statistics::median;
use mde_warp::PosedView;
use ndarray::{Array2, ArrayView2, Zip};

use crate::raster::{small_map, small_view};
use crate::sweep::consensus::{ViewDepth, reconstruct};
use crate::sweep::cost::NOISE;
use crate::sweep::edge::colour;
use crate::sweep::exposure::{carried, fit_exposure};
use crate::sweep::scale::Scale;
use crate::{Error, Result, silent};

/// Longer side of the photographs that are compared.
const SMALL: usize = 160;
/// Side of a block of pixels, which counts as one measurement: errors of neighbours are correlated.
const BLOCK: usize = 10;
/// Differences of colour are cut here: those of occluded pixels do not depend on depth.
const CUT: f32 = 0.1;
/// Factors of the prior that are tried about the common one, in units of [`STEP`] in log depth.
const SCALES: [f64; 7] = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0];
const STEP: f64 = 0.1;
/// Fewer blocks than this decide nothing.
const MIN_BLOCKS: usize = 8;

/// Colour differences of a withheld photograph, mean of the pixels that both depths carry into it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub struct WithheldError {
    /// Through the scaled prior, or the prior times the common factor times 0.74 to 1.35, whichever fits best: mean absolute difference of sRGB in \[0, 1\], cut at .1.
    pub prior: f64,
    /// Through the reconstruction of the other photographs.
    pub found: f64,
    /// Standard error of `found - prior`, over blocks of 10 x 10 pixels.
    pub deviation: f64,
}

impl WithheldError {
    /// Whether the reconstruction explains the photograph worse than the prior, by more than two standard errors and than the noise of
    /// photographs: of a plain wall any depth explains the colours to less than that.
    pub fn is_worse(&self) -> bool {
        self.found - self.prior > f64::from(NOISE).max(2.0 * self.deviation)
    }
}

/// Error of `views[withheld]` in `views[0]`, at 160 pixels on the longer side, through the depth of the other photographs and
/// through the scaled prior.
///
/// `priors` and `scale` are those of [`reconstruct`]. Nothing where fewer than two other photographs are left, or where both depths carry too
/// few pixels into the photograph.
///
/// # Errors
/// [`Error::Reference`] for an index that is 0 or outside the views, and those of [`reconstruct`].
pub fn withheld_error(
    views: &[PosedView],
    priors: &[ArrayView2<'_, f32>],
    withheld: usize,
    scale: Option<Scale>,
) -> Result<Option<WithheldError>> {
    if withheld == 0 || withheld >= views.len() {
        return Err(Error::Reference { reference: withheld, views: views.len() });
    }
    if views.len() < 3 || priors.len() != views.len() {
        return Ok(None);
    }
    let mut small = Vec::new();
    let mut maps = Vec::new();
    for (view, prior) in views.iter().zip(priors) {
        view.camera.check_map("prior", prior.dim())?;
        let view = small_view(view, SMALL)?;
        maps.push(small_map(prior, view.camera.dim()));
        small.push(view);
    }
    let (target, _) = (small.remove(withheld), maps.remove(withheld));
    let maps: Vec<ArrayView2<'_, f32>> = maps.iter().map(|map| map.view()).collect();
    let known = reconstruct(&small, &maps, scale, &mut silent)?;
    unused_error(&small[0], &target, &known.views[0], maps[0], known.scale)
}

/// The same for a `target` that had no part in what is `known` of the depth of `reference`, whose `prior` is in the unit of the poses but
/// for the factor `scale`: nothing has to be found again.
///
/// # Errors
/// [`Error::View`] for a map of another size than its camera.
pub fn unused_error(
    reference: &PosedView,
    target: &PosedView,
    known: &ViewDepth,
    prior: ArrayView2<'_, f32>,
    scale: Option<Scale>,
) -> Result<Option<WithheldError>> {
    let (from, to) = (small_view(reference, SMALL)?, small_view(target, SMALL)?);
    let of = |map: ArrayView2<'_, f32>| -> Result<Array2<f32>> {
        reference.camera.check_map("depth", map.dim())?;
        Ok(small_map(&map, from.camera.dim()))
    };
    let (found, gauged, prior) = (of(known.fused.mean())?, of(known.prior.mean())?, of(prior)?);
    let factor = scale.map_or(1.0, |scale| scale.log_scale.exp());
    let scaled = prior.mapv(|z| (f64::from(z) * factor) as f32);
    let differences = |depth: ArrayView2<'_, f32>| differences(&from, &to, depth);
    let found = differences(found.view())?;
    // The least of the gauged prior and of multiples of the scaled one: the scale may itself rest on wrong matches.
    let mut best = compare(&differences(gauged.view())?, &found);
    for step in SCALES {
        let scaled = scaled.mapv(|z| (f64::from(z) * (STEP * step).exp()) as f32);
        if let Some(next) = compare(&differences(scaled.view())?, &found) {
            best = best.filter(|best| best.found - best.prior >= next.found - next.prior).or(Some(next));
        }
    }
    Ok(best)
}

/// Absolute difference of colour per pixel of the reference, NaN where the photograph does not show it.
fn differences(reference: &PosedView, target: &PosedView, depth: ArrayView2<'_, f32>) -> Result<Array2<f32>> {
    let exposure = fit_exposure(reference, target, depth)?;
    let there = carried(reference, target, depth);
    let difference = |(y, x), there: &Option<[f32; 3]>| {
        there.map_or(f32::NAN, |there| {
            let (there, here) = (exposure.apply(there), colour(reference, y, x));
            let channel = |c: usize| (there[c] - here[c]).abs().min(CUT);
            (channel(0) + channel(1) + channel(2)) / 3.0
        })
    };
    Ok(Zip::indexed(&there).map_collect(difference))
}

fn compare(prior: &Array2<f32>, found: &Array2<f32>) -> Option<WithheldError> {
    let mut blocks: Vec<[f64; 3]> = Vec::new();
    let [prior, found] = [prior, found].map(|map| map.exact_chunks((BLOCK, BLOCK)));
    for (prior, found) in prior.into_iter().zip(found) {
        let mut sums = [0.0; 3];
        for (p, f) in prior.iter().zip(found).filter(|(p, f)| p.is_finite() && f.is_finite()) {
            for (sum, value) in sums.iter_mut().zip([f64::from(*p), f64::from(*f), 1.0]) {
                *sum += value;
            }
        }
        if 2.0 * sums[2] >= (BLOCK * BLOCK) as f64 {
            blocks.push([sums[0] / sums[2], sums[1] / sums[2], (sums[1] - sums[0]) / sums[2]]);
        }
    }
    if blocks.len() < MIN_BLOCKS {
        return None;
    }
    let count = blocks.len() as f64;
    let mean = |i: usize| blocks.iter().map(|b| b[i]).sum::<f64>() / count;
    let difference = mean(2);
    let variance = blocks.iter().map(|b| (b[2] - difference).powi(2)).sum::<f64>() / (count - 1.0);
    Some(WithheldError { prior: mean(0), found: mean(1), deviation: (variance / count).sqrt() })
}

/// The view to withhold among `parallax`: the one of median parallax, so neither the easiest nor the hardest.
pub fn typical(parallax: &[f64]) -> Option<usize> {
    let middle = median(parallax.iter().copied())?;
    (0..parallax.len()).min_by(|&i, &j| (parallax[i] - middle).abs().total_cmp(&(parallax[j] - middle).abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::room;
    use mde_warp::Pose;

    fn error(views: &[PosedView], priors: &[Array2<f32>], withheld: usize) -> WithheldError {
        let maps: Vec<_> = priors.iter().map(|p| p.view()).collect();
        withheld_error(views, &maps, withheld, None).unwrap().unwrap()
    }

    /// Exact priors, and poses of the last two photographs that do not belong to them.
    fn with_wrong_poses() -> (Vec<PosedView>, Vec<Array2<f32>>) {
        let (mut views, depths, _) = room(1.0);
        for (view, sign) in views[2..].iter_mut().zip([1.0, -1.0]) {
            view.pose = Pose::translation(0.04 * sign, -0.05, 0.02) * view.pose;
        }
        (views, depths)
    }

    #[test]
    fn true_poses_explain_the_withheld_photograph_better_than_the_prior_and_wrong_ones_do_not() {
        let (views, _, priors) = room(1.0);
        for withheld in 1..4 {
            let error = error(&views, &priors, withheld);
            assert!(!error.is_worse() && error.found < 0.7 * error.prior, "{error:?}");
        }
        let (views, depths) = with_wrong_poses();
        let error = error(&views, &depths, 1);
        assert!(error.is_worse() && error.found > 1.5 * error.prior, "{error:?}");
    }

    /// The photograph that is withheld, and the same one left over, tell true poses from wrong ones alike.
    #[test]
    fn an_unused_photograph_is_as_good_as_a_withheld_one() {
        let (views, _, priors) = room(1.0);
        for (moved, (mut views, priors)) in [(false, (views, priors)), (true, with_wrong_poses())] {
            let target = views.remove(1);
            let maps: Vec<_> = [0, 2, 3].map(|i| priors[i].view()).to_vec();
            let known = reconstruct(&views, &maps, None, &mut silent).unwrap();
            let error =
                unused_error(&views[0], &target, &known.views[0], maps[0], known.scale).unwrap().unwrap();
            assert_eq!(error.is_worse(), moved, "{error:?}");
        }
    }

    #[test]
    fn two_photographs_withhold_none() {
        let (views, _, priors) = room(1.0);
        let maps: Vec<_> = priors[..2].iter().map(|p| p.view()).collect();
        assert_eq!(withheld_error(&views[..2], &maps, 1, None), Ok(None));
        let outside = Err(Error::Reference { reference: 0, views: 2 });
        assert_eq!(withheld_error(&views[..2], &maps, 0, None), outside);
    }

    #[test]
    fn the_typical_photograph_has_the_median_parallax() {
        assert_eq!(typical(&[0.1, 0.5, 0.2]), Some(2));
        assert_eq!(typical(&[]), None);
    }
}
