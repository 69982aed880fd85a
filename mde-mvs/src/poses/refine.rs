use super::bundle::{Bundle, Observed, PosePrior};
use super::tracks::{self, Track};
use super::{
    FeatureImage, MIN_MATCHES, OUTLIER_PIXELS, PoseInput, RATIO, REGIONS, all_pairs, in_order, matching,
    shared_error_factor, two_view,
};
use crate::{Callback, Error, Result};
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use nalgebra::{Matrix6, Point2, Vector2};
use rand::RngExt;
use rayon::prelude::*;

/// Shares of the largest deviations of a given pose that are tried, the most trust first.
const TRUST: [f64; 4] = [1.0 / 30.0, 0.1, 0.3, 1.0];
/// Parts of the tracks, each of which is withheld once.
const FOLDS: usize = 5;
/// Standard errors by which a larger move must fit the withheld tracks better.
const BEYOND_NOISE: f64 = 2.0;
/// Depths that are tried for a track, over the longest baseline: from once to a thousand times.
const DEPTHS: usize = 48;
/// Steps that improve the best of them.
const DEPTH_STEPS: usize = 8;

/// Largest standard deviation of a given pose's rotation about each axis, degrees.
const ROTATION_SIGMA_DEGREES: f64 = 1.0;
/// Largest standard deviation of a given camera's place along each axis, as a share of the median depth.
const CENTRE_SIGMA: f64 = 0.01;

/// Given poses after refinement.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// One per photograph, in the order given. The reference's is unchanged; all are where [`accepted`](Self::accepted) is false.
    pub poses: Vec<Pose>,
    /// Whether withheld matches fit better with refined poses.
    pub accepted: bool,
    /// Median distance of withheld matches from where they should be, with the given poses and with those refined without them,
    /// in pixels of a photograph of 640 on the longer side. Nothing where there are too few matches.
    pub withheld: Option<[f64; 2]>,
    /// Covariance of each pose's left perturbation: translation, then rotation in radians.
    pub covariances: Vec<Option<Matrix6<f64>>>,
    /// Points seen by at least two photographs, with the poses that are returned.
    pub tracks: Vec<Track>,
    /// How well each photograph's matches fit the poses that are returned.
    pub agreement: Vec<Agreement>,
}

/// Matches of a photograph with the others, and how many fit the poses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Agreement {
    /// Features that were found in it.
    pub features: usize,
    /// Matches with other photographs that fit some motion.
    pub matches: usize,
    /// Of these, those that fit the poses to 3 pixels.
    pub agreeing: usize,
}

/// Improves given poses (world to camera) by matches of the photographs: the adjustment of the module's front page with inverse
/// depths from the matches alone, the given poses as a prior, and the reference's pose kept.
///
/// The deviations of the given poses are tried at a thirtieth, a tenth, a third and all of 1 degree and of 1 % of the median depth.
/// Each trial is judged by tracks that had no part in it: every fifth of the tracks is withheld once, and distances beyond 3 pixels
/// count as that, so that wrong matches do not decide. Of the trials and the given poses the one that moves least is kept, of those that fit the withheld tracks as well as the best within two standard errors; it is then
/// adjusted to all tracks. With fewer than [`MIN_MATCHES`](super::MIN_MATCHES) tracks the given poses are kept. The
/// callback counts the pairs of photographs as they are matched.
///
/// # Errors
/// Those of [`estimate_poses`](super::estimate_poses) but for the prior, [`Error::Config`] for another number of poses than of
/// photographs, [`Error::View`] for a pose that is not finite, and [`Error::Interrupted`].
pub fn refine_poses(
    photographs: &[PoseInput],
    poses: &[Pose],
    reference: usize,
    seed: u64,
    callback: &mut Callback<'_>,
) -> Result<Refined> {
    let order = in_order(photographs, reference)?;
    if poses.len() != photographs.len() {
        return Err(Error::config("number of poses", poses.len(), "give one for each photograph"));
    }
    let finite = |pose: &Pose| {
        pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite())
    };
    if !poses.iter().all(finite) {
        return Err(Error::View(mde_warp::Error::Pose { which: "given" }));
    }
    let sorted: Vec<PoseInput> = order.iter().map(|&i| photographs[i]).collect();
    let given: Vec<Pose> = order.iter().map(|&i| poses[i]).collect();
    let shots = FeatureImage::all(&sorted)?;
    let found = |i: usize, j: usize| matching::match_features(&shots[i].features, &shots[j].features, RATIO);
    let pairs = all_pairs(&shots, found, two_view::verified_matches, seed, callback)?;

    let rank: Vec<usize> = (0..shots.len()).collect();
    let groups = tracks::join(&shots, &pairs.iter().collect::<Vec<_>>(), &rank);
    let mut bundle = Bundle {
        lenses: shots.iter().map(|shot| super::bundle::Lens { assumed: false, ..shot.lens }).collect(),
        poses: given.clone(),
        log_focal: 0.0,
        focal_sigma: 1.0,
        log_scales: vec![0.0; shots.len()],
        keep_scale: false,
        prior_sigmas: vec![1.0; shots.len()],
        pose_priors: vec![None; shots.len()],
        tracks: groups.into_iter().filter_map(observed).collect(),
    };
    let longest = longest_baseline(&given);
    bundle.triangulate(longest);
    let cut = OUTLIER_PIXELS;
    let all = bundle.clone();
    let features: Vec<usize> = shots.iter().map(|shot| shot.features.keypoints.len()).collect();
    // The poses as given, until others are better.
    let mut result = Refined {
        poses: poses.to_vec(),
        accepted: false,
        withheld: None,
        covariances: vec![None; poses.len()],
        tracks: all.report_tracks(None, &order),
        agreement: vec![Agreement::default(); poses.len()],
    };
    let agreement = all.agreement(&features, cut);
    order.iter().zip(agreement).for_each(|(&place, found)| result.agreement[place] = found);

    let depths = bundle.tracks.iter().map(|track| track.inverse_depth.recip());
    let Some(depth) = median(depths).filter(|_| longest > 0.0) else {
        return Ok(result);
    };
    for (v, prior) in bundle.pose_priors.iter_mut().enumerate() {
        *prior = (v != 0).then(|| PosePrior {
            pose: given[v],
            rotation_sigma: ROTATION_SIGMA_DEGREES.to_radians(),
            centre_sigma: CENTRE_SIGMA * depth,
        });
    }
    if bundle.tracks.len() < MIN_MATCHES {
        return Ok(result);
    }
    let folds = folds(&bundle, seed);
    let refined = |share: f64, tracks: &[Observed]| {
        let mut next = Bundle { tracks: tracks.to_vec(), ..bundle.clone() };
        for prior in next.pose_priors.iter_mut().flatten() {
            prior.rotation_sigma *= share;
            prior.centre_sigma *= share;
        }
        next.adjust(super::estimate::STEPS);
        next.triangulate(longest);
        next.drop_outliers(cut);
        next.adjust(super::estimate::STEPS);
        next
    };
    // The given poses first, then every trust, each over all folds.
    let trials: Vec<(Option<f64>, &Fold)> = std::iter::once(None)
        .chain(TRUST.map(Some))
        .flat_map(|share| folds.iter().map(move |fold| (share, fold)))
        .collect();
    let judged: Vec<Vec<f64>> = trials
        .par_iter()
        .map(|(share, fold)| {
            let poses = share.map_or_else(|| given.clone(), |share| refined(share, &fold.kept).poses);
            let mut judge = Bundle { tracks: fold.withheld.clone(), poses, ..bundle.clone() };
            judge.triangulate(longest);
            judge.errors(cut)
        })
        .collect();
    let errors: Vec<Vec<f64>> = judged.chunks(FOLDS).map(<[Vec<f64>]>::concat).collect();
    let Some(chosen) = least_moved(&errors, REGIONS) else {
        return Ok(result);
    };
    result.withheld = Some([0, chosen].map(|i| median(errors[i].iter().copied()).unwrap_or(0.0)));
    let Some(share) = chosen.checked_sub(1).and_then(|i| TRUST.get(i)) else {
        return Ok(result);
    };
    let bundle = refined(*share, &bundle.tracks);
    let noise = shared_error_factor(bundle.tracks.len()) * bundle.noise().max(super::estimate::LEAST_NOISE);
    let covariance = bundle.covariance(noise);
    let mut judged = Bundle { poses: bundle.poses.clone(), ..all };
    judged.triangulate(longest);
    let agreement = judged.agreement(&features, cut);
    result.accepted = true;
    result.tracks = bundle.report_tracks(covariance.as_ref(), &order);
    for (v, &place) in order.iter().enumerate() {
        result.poses[place] = bundle.poses[v];
        result.covariances[place] = covariance.as_ref().and_then(|c| c.poses[v]);
        result.agreement[place] = agreement[v];
    }
    Ok(result)
}

/// Tracks that an adjustment has, and those that judge it.
struct Fold {
    kept: Vec<Observed>,
    withheld: Vec<Observed>,
}

/// Every track is withheld in one of the folds.
fn folds(bundle: &Bundle, seed: u64) -> Vec<Fold> {
    let draw = |track: usize| CounterRng::new(seed, "withheld", 0, track as u64).random_range(0..FOLDS);
    let drawn: Vec<usize> = (0..bundle.tracks.len()).map(draw).collect();
    let of = |keep: &dyn Fn(usize) -> bool| {
        let tracks = bundle.tracks.iter().zip(&drawn).filter(|(_, fold)| keep(**fold));
        tracks.map(|(track, _)| track.clone()).collect()
    };
    (0..FOLDS).map(|fold| Fold { kept: of(&|f| f != fold), withheld: of(&|f| f == fold) }).collect()
}

/// The first of the candidates, the given poses and ever larger moves of them, that is not worse than the best by more than two
/// standard errors of their difference on the same matches, where matches of one region share an error.
///
/// Nothing without matches.
fn least_moved(errors: &[Vec<f64>], regions: f64) -> Option<usize> {
    let sum = |e: &[f64]| e.iter().sum::<f64>();
    let best = errors.iter().filter(|e| !e.is_empty()).min_by(|a, b| sum(a).total_cmp(&sum(b)))?;
    errors.iter().position(|e| {
        let count = e.len() as f64;
        let mean = (sum(e) - sum(best)) / count;
        let spread = e.iter().zip(best).map(|(a, b)| (a - b - mean).powi(2)).sum::<f64>() / count;
        mean <= BEYOND_NOISE * (spread / count.min(regions)).sqrt()
    })
}

fn observed(mut group: Vec<(usize, Point2<f64>)>) -> Option<Observed> {
    let (anchor, pixel) = (!group.is_empty()).then(|| group.remove(0))?;
    Some(Observed { anchor, pixel, inverse_depth: 0.0, prior: None, views: group })
}

fn longest_baseline(poses: &[Pose]) -> f64 {
    let centre = |pose: &Pose| pose.inverse().translation.vector;
    poses.iter().flat_map(|a| poses.iter().map(move |b| (centre(a) - centre(b)).norm())).fold(0.0, f64::max)
}

impl Bundle {
    /// The depth of every track that fits its matches best with the poses as they are.
    fn triangulate(&mut self, longest_baseline: f64) {
        let start = longest_baseline.max(f64::MIN_POSITIVE).ln();
        let tracks = std::mem::take(&mut self.tracks);
        self.tracks = tracks.into_iter().map(|track| self.triangulated(track, start)).collect();
    }

    fn triangulated(&self, mut track: Observed, start: f64) -> Observed {
        let cost = |track: &Observed| -> f64 {
            let squares = track.views.iter().map(|(v, p)| {
                self.residual(track, *v, p).map_or(f64::MAX.sqrt(), |r: Vector2<f64>| r.norm())
            });
            squares.sum()
        };
        let span = 1000_f64.ln();
        let mut step = span / DEPTHS as f64;
        let at = |log_depth: f64| Observed { inverse_depth: (-log_depth).exp(), ..track.clone() };
        let mut best = (0..=DEPTHS)
            .map(|i| start + step * i as f64)
            .map(|depth| (cost(&at(depth)), depth))
            .fold((f64::INFINITY, start), |a, b| if b.0 < a.0 { b } else { a });
        // Halving steps to either side: the sum of distances is smooth enough about its least.
        for _ in 0..2 * DEPTH_STEPS {
            step *= 0.5;
            for depth in [best.1 - step, best.1 + step] {
                let there = cost(&at(depth));
                if there < best.0 {
                    best = (there, depth);
                }
            }
        }
        track.inverse_depth = (-best.1).exp();
        track
    }

    /// Matches of every photograph, of the number of features given, and those within `cut` of where they should be.
    fn agreement(&self, features: &[usize], cut: f64) -> Vec<Agreement> {
        let mut found: Vec<Agreement> =
            features.iter().map(|&features| Agreement { features, ..Agreement::default() }).collect();
        for track in &self.tracks {
            for (v, p) in &track.views {
                let fits = self.residual(track, *v, p).is_some_and(|r| r.norm() <= cut);
                for view in [track.anchor, *v] {
                    found[view].matches += 1;
                    found[view].agreeing += usize::from(fits);
                }
            }
        }
        found
    }

    /// Distances of all observations from where they should be, at most `cut`.
    fn errors(&self, cut: f64) -> Vec<f64> {
        self.tracks
            .iter()
            .flat_map(|track| track.views.iter().map(move |(v, p)| self.residual(track, *v, p)))
            .map(|r| r.map_or(cut, |r| r.norm().min(cut)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_move_no_further_than_matches_ask_for() {
        let noisy =
            |level: f64| (0..200).map(|i| level + 0.1 * ((i * 37 % 11) as f64 - 5.0)).collect::<Vec<_>>();
        let (far, near, nearer) = (noisy(2.0), noisy(1.0), noisy(0.999));
        // Alike within the error of the mean: the smaller move.
        let mut shuffled = near.clone();
        shuffled.rotate_left(3);
        assert_eq!(least_moved(&[far.clone(), shuffled, nearer], 30.0), Some(1));
        assert_eq!(least_moved(&[near.clone(), near.clone(), far.clone()], 30.0), Some(0));
        assert_eq!(least_moved(&[far.clone(), far, near], 30.0), Some(2));
        assert_eq!(least_moved(&[vec![], vec![]], 30.0), None);
    }
}
