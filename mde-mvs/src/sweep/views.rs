//! Selection of further photographs by parallax, overlap and sharpness against the reference.

use mde_uncertainty::statistics::quantile;
use mde_warp::{Pose, PosedView};
use ndarray::{ArrayView2, ArrayView3};

use super::baseline;
use crate::poses::nearest;
use crate::raster::luma;
use crate::{Error, Result, centre};
use mde_warp::transfer::Transfer;

/// Pixels between two samples of the overlap, along each axis.
const STRIDE: usize = 4;
/// Best ratio of baseline to depth: less triangulates badly, more is hard to match. The score of a parallax is a Gaussian of its
/// logarithm, lower by a factor \\( e^{-1/2} \\) at \\( e \\) times more or less.
const BEST_PARALLAX: f64 = 0.1;
/// Photographs that are scored for one reference at most: the nearest.
const CANDIDATES: usize = 48;
/// Least ratio of baseline to depth, two pixels at a focal length of 500: less is the same viewpoint, such as a copy or a burst.
const LEAST_PARALLAX: f64 = 0.004;
/// Least step between keyframes: a ratio of baseline to depth, or a turn in radians. Of 29 photographs of a walk of 150 AbsRel is .0447,
/// .0437, .0442 with .015, .025, .04, and .0599 without keyframes.
const LEAST_STEP: f64 = 0.025;
const LEAST_TURN: f64 = 0.15;
/// Least share of the reference's pixels that project into a view; a view with less is not used.
pub const MIN_OVERLAP: f64 = 0.2;

/// One further photograph measured against the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub struct ViewScore {
    /// Its index among the views.
    pub view: usize,
    /// Distance of the optical centres over the median depth of the pixels that both see.
    pub parallax: f64,
    /// Share of the reference's pixels of known depth that project into the view's mask, 0 to 1.
    pub overlap: f64,
    /// Mean squared gradient of its luma over that of the sharpest photograph, 0 to 1.
    pub sharpness: f64,
    /// Overlap times the square root of sharpness times the score of the parallax, 0 to 1.
    pub score: f64,
    /// Whether it is among the best `max_views` that overlap by [`MIN_OVERLAP`] at least.
    pub chosen: bool,
}

/// Which views of a capture are keyframes: of those with nearly one viewpoint the sharpest. `depths` are their median depths in the unit of
/// the poses, `energies` their [`gradient_energy`].
pub fn keyframes(poses: &[Pose], depths: &[f64], energies: &[f64]) -> Vec<bool> {
    let mut sharpest: Vec<usize> = (0..poses.len()).collect();
    let energy = |&view: &usize| energies.get(view).copied().unwrap_or(1.0);
    sharpest.sort_by(|a, b| energy(b).total_cmp(&energy(a)).then(a.cmp(b)));
    let mut is_keyframe = vec![false; poses.len()];
    for view in sharpest {
        let coincides = |other: &Pose| {
            let step = (centre(&poses[view]) - centre(other)).norm();
            let turn = poses[view].rotation.angle_to(&other.rotation);
            turn < LEAST_TURN && depths.get(view).is_some_and(|depth| step < LEAST_STEP * depth)
        };
        is_keyframe[view] = !poses.iter().zip(&is_keyframe).any(|(other, kept)| *kept && coincides(other));
    }
    is_keyframe
}

/// Scores the other views against `views[reference]` of known depth (0 where unknown, in the unit of the poses); of a long capture the
/// 48 nearest that look the same way, the [`keyframes`] before others. `energies` are the [`gradient_energy`] of all views, whose images are
/// not read. The scores come best first, equal ones in the order of the views; the first `max_views` keyframes that may be used are
/// chosen, then others.
///
/// # Errors
/// [`Error::Reference`] for an index outside the views, [`Error::View`] for a mask or a depth map of another size than its camera.
pub fn select_views(
    views: &[PosedView],
    reference: usize,
    depth: ArrayView2<'_, f32>,
    energies: &[f64],
    keyframes: &[bool],
    max_views: usize,
) -> Result<Vec<ViewScore>> {
    let from = views.get(reference).ok_or(Error::Reference { reference, views: views.len() })?;
    from.camera.check_map("depth", depth.dim())?;
    let poses: Vec<Pose> = views.iter().map(|view| view.pose).collect();
    let mut near = nearest(&poses, reference);
    let is_keyframe = |view: usize| keyframes.get(view).is_none_or(|is_keyframe| *is_keyframe);
    near.sort_by_key(|view| !is_keyframe(*view));
    near.truncate(CANDIDATES);
    let check = |view: &PosedView| view.camera.check_map("mask", view.mask.dim());
    near.iter().chain([&reference]).try_for_each(|&view| check(&views[view]))?;
    let sharpest = energies.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let mut scores: Vec<ViewScore> = near
        .into_iter()
        .map(|view| {
            let (overlap, seen_depth) = overlap(from, &views[view], depth);
            let parallax = seen_depth.map_or(0.0, |z| baseline(from, &views[view]) / z);
            let sharpness = energies.get(view).map_or(1.0, |energy| energy / sharpest);
            let score = overlap * sharpness.sqrt() * parallax_score(parallax / BEST_PARALLAX);
            ViewScore { view, parallax, overlap, sharpness, score, chosen: false }
        })
        .collect();
    scores.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.view.cmp(&b.view)));
    let usable = |s: &&mut ViewScore| s.overlap >= MIN_OVERLAP && s.score > 0.0;
    let (first, others): (Vec<_>, Vec<_>) =
        scores.iter_mut().filter(usable).partition(|s| is_keyframe(s.view));
    first.into_iter().chain(others).take(max_views).for_each(|s| s.chosen = true);
    Ok(scores)
}

fn parallax_score(ratio: f64) -> f64 {
    if ratio > LEAST_PARALLAX / BEST_PARALLAX { (-0.5 * ratio.ln().powi(2)).exp() } else { 0.0 }
}

/// Share of the reference's pixels that land on the view, and their median depth.
fn overlap(from: &PosedView, to: &PosedView, depth: ArrayView2<'_, f32>) -> (f64, Option<f64>) {
    let transfer = Transfer::new(from, to);
    let (mut known, mut inside) = (0_usize, Vec::new());
    for (row, line) in depth.outer_iter().enumerate().step_by(STRIDE) {
        for (column, &z) in line.iter().enumerate().step_by(STRIDE) {
            if !(z > 0.0 && z.is_finite() && from.mask[(row, column)]) {
                continue;
            }
            known += 1;
            let seen = transfer.at(column as f64, row as f64, 1.0 / f64::from(z));
            if seen.and_then(|s| transfer.nearest(&s)).is_some_and(|p| to.mask[p]) {
                inside.push(f64::from(z));
            }
        }
    }
    (inside.len() as f64 / known.max(1) as f64, quantile(&mut inside, 0.5))
}

/// Mean squared central difference of the luma of an image, sRGB in 0 to 1, `[height, width, 3]`.
pub fn gradient_energy(image: ArrayView3<'_, f32>) -> f64 {
    let energy = |square: ArrayView2<'_, f32>| {
        let gx = 0.5 * f64::from(square[(1, 2)] - square[(1, 0)]);
        let gy = 0.5 * f64::from(square[(2, 1)] - square[(0, 1)]);
        gx * gx + gy * gy
    };
    let luma = luma(image);
    let energies = luma.windows((3, 3)).into_iter().map(energy);
    let (sum, count) = energies.fold((0.0, 0_usize), |(sum, count), energy| (sum + energy, count + 1));
    sum / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};
    use ndarray::Array2;

    #[test]
    fn a_useful_baseline_is_preferred_to_none_and_to_too_much() {
        let centres = [[0.0; 3], [0.005, 0.0, 0.0], [0.2, 0.0, 0.0], [1.0, 0.0, 0.0], [30.0, 0.0, 0.0]];
        let (mut views, depths) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (48, 64), &centres);
        let energies = |views: &[PosedView]| [0, 1, 2, 3, 4].map(|i| gradient_energy(views[i].image.view()));
        let scores = select_views(&views, 0, depths[0].view(), &energies(&views), &[], 2).unwrap();
        assert_eq!(scores.iter().map(|s| s.view).collect::<Vec<_>>(), [2, 3, 1, 4]);
        assert_eq!(scores.iter().map(|s| s.chosen).collect::<Vec<_>>(), [true, true, false, false]);
        assert!((scores[0].parallax - 0.1).abs() < 1e-6 && scores[3].overlap == 0.0);
        // The same view out of focus has a lower score.
        let mean = views[2].image.mean().unwrap();
        views[2].image.mapv_inplace(|x| mean + 0.3 * (x - mean));
        let blurred = select_views(&views, 0, depths[0].view(), &energies(&views), &[], 2).unwrap();
        let of = blurred.iter().find(|s| s.view == 2).unwrap();
        assert!((of.sharpness / scores[0].sharpness - 0.09).abs() < 0.01 && of.score < scores[0].score);
    }

    #[test]
    fn of_nearly_one_viewpoint_the_sharpest_is_a_keyframe_and_chosen_first() {
        let centres = [0.0, 0.01, 0.02, 0.2].map(|x| [x, 0.0, 0.0]);
        let (mut views, depths) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (8, 8), &centres);
        let energies = [1.0, 2.0, 1.0, 1.0];
        let poses = |views: &[PosedView]| views.iter().map(|view| view.pose).collect::<Vec<_>>();
        let found = keyframes(&poses(&views), &[2.0; 4], &energies);
        assert_eq!(found, [false, true, false, true]);
        for (max_views, expected) in [(1, vec![3]), (2, vec![3, 1]), (3, vec![3, 2, 1])] {
            let scores = select_views(&views, 0, depths[0].view(), &energies, &found, max_views).unwrap();
            let chosen: Vec<usize> = scores.iter().filter(|s| s.chosen).map(|s| s.view).collect();
            assert_eq!(chosen, expected);
        }
        // One that is turned shows something else.
        views[2].pose = Pose::rotation([0.0, 0.2, 0.0].into()) * views[2].pose;
        assert_eq!(keyframes(&poses(&views), &[2.0; 4], &energies), [false, true, true, true]);
    }

    #[test]
    fn what_cannot_be_measured_is_named() {
        let (mut views, depths) =
            scene(&[Plane::slanted(2.0, 0.0, 0.0)], (8, 8), &[[0.0; 3], [0.1, 0.0, 0.0]]);
        let bad = select_views(&views, 2, depths[0].view(), &[], &[], 7);
        assert_eq!(bad, Err(Error::Reference { reference: 2, views: 2 }));
        let map = Array2::zeros((8, 9));
        assert!(matches!(select_views(&views, 0, map.view(), &[], &[], 7), Err(Error::View(_))));
        // Each stage that takes views checks them: their fields are public.
        views[1].mask = Array2::from_elem((3, 4), true).into_shared();
        let depth = depths[0].view();
        let chosen = select_views(&views, 0, depth, &[], &[], 7);
        assert!(matches!(chosen, Err(Error::View(_))));
        let fitted = crate::sweep::exposure::fit_exposure(&views[0], &views[1], depth);
        assert!(matches!(fitted, Err(Error::View(_))));
        assert!(matches!(crate::sweep::scale::point_matches(&views[1], &[], depth), Err(Error::View(_))));
    }
}
