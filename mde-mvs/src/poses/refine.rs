use super::bundle::{Bundle, Cameras, Given, Lens, Observed};
use super::covariance::PoseCovariance;
use super::estimate::{EstimatedPose, STEPS, Verdict};
use super::matching::match_features;
use super::two_view::{Pair, verified_matches};
use super::{
    MIN_MATCHES, OUTLIER_PIXELS, Prepared, REGIONS, centre, compared, neighbours, reference_first, tracks,
};
use crate::{Callback, Error, Result};
use mde_uncertainty::OutOfRange;
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use nalgebra::Point2;
use rand::RngExt;
use rayon::prelude::*;

/// Shares of the largest deviations of a given pose that are tried, the most trust first.
const TRUST: [f64; 4] = [1.0 / 30.0, 0.1, 0.3, 1.0];
/// The same of given poses that no refinement betters, for the covariance. With the largest deviations 90 % intervals hold 94.7 % on 13
/// captures, with this share 93.6 %.
const KEPT: f64 = 0.3;
/// Parts of the tracks, each of which is withheld once.
const FOLDS: usize = 5;
/// Standard errors by which moved poses must fit the withheld tracks better than the given ones.
const BEYOND_NOISE: f64 = 2.0;
/// Groups of neighbours of a long capture on which the trust is chosen.
const TRIALS: usize = 3;
/// Largest standard deviation of a given pose's rotation about each axis, degrees.
const ROTATION_SIGMA_DEGREES: f64 = 1.0;
/// Largest standard deviation of a given camera's place along each axis, as a share of the median depth.
const CENTRE_SIGMA: f64 = 0.01;
/// Features of a photograph in which those of the same scene find matches.
const PLENTY: usize = 200;
/// Least share of a photograph's matches that fit its pose. With the pose of a far photograph none do (0 of 22); with exact ones 30 degrees
/// apart, where most matches are a pattern's repetitions, .11 and more.
const LEAST_AGREEING: f64 = 0.1;
/// The same of matches whose keypoint a third photograph shows, as a share of what is typical of the capture. On 13 captures .79 and more
/// fit right poses, less than .35 most that are exchanged or 10 m off.
const LEAST_CONSISTENT: f64 = 0.5;
/// Distance within which a match fits poses that may be off by [`ROTATION_SIGMA_DEGREES`], before they are refined, pixels.
const GIVEN_PIXELS: f64 = 15.0;
/// A refinement that moves a given pose by more than this share of its distance from the nearest other one contradicts it.
const MOVED: f64 = 0.5;

/// Given poses after refinement.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// One per photograph, in the order given. The reference's pose is unchanged; all are where [`accepted`](Self::accepted) is false.
    pub photographs: Vec<EstimatedPose>,
    /// Covariance of their poses by the matches and the deviations that are allowed, of poses that are kept by .3 of the largest: exact for
    /// the reference and with fewer than 20 tracks. Of a long capture groups of 12 neighbours are independent.
    pub covariance: PoseCovariance,
    /// Whether withheld matches fit better with refined poses.
    pub accepted: bool,
    /// Median distance of withheld matches from where they should be, with the given poses and with those refined without them,
    /// in pixels of a photograph of 640 on the longer side. Nothing where there are too few matches.
    pub withheld: Option<[f64; 2]>,
    /// Photographs whose matches contradict the given pose: the refined one is farther from it than half the distance to its neighbour.
    pub moved: Vec<usize>,
    /// Pixels of the reference (x: column, y: row) and their depths by the matches, in the unit of the poses.
    pub depths: Vec<(Point2<f64>, f64)>,
}

/// Improves given poses (world to camera) by matches of the photographs: the adjustment of the module's front page with inverse
/// depths from the matches alone, the given poses as a prior, and the reference's pose kept. Without a reference it is the first photograph
/// that is not left out.
///
/// Neighbours are matched: all with all up to 12 photographs, of more each with 6 that are near it and look the same way, by half as
/// many features. A photograph of whose matches less than a tenth fits its pose, by more than a standard error, or that has features but no
/// matches, is left out ([`Verdict::Contradicted`], [`Verdict::Unmatched`]), the worst first, since the others are judged again without it.
/// Where a third photograph shows the points of 20 matches, these decide, by their depths: half of the capture's usual share.
///
/// The deviations of the given poses are tried at a thirtieth, a tenth, a third and all of 1 degree and of 1 % of the median depth.
/// Each trial is judged by tracks that had no part in it: every fifth of the tracks is withheld once, and distances beyond 3 pixels
/// count as that, so that wrong matches do not decide. The trial of least error is kept, and adjusted to all tracks; the given poses
/// are where they do not fit worse by more than two standard errors. Of more than 13 photographs the trials are made on three groups
/// of 12 neighbours, each with its own matches alone. With fewer than 20 tracks the given poses are kept. The callback counts the
/// pairs of photographs as they are matched.
///
/// # Errors
/// Those of [`estimate_poses`](super::estimate_poses) but for the prior, [`Error::Config`] for another number of poses than of
/// photographs, [`Error::View`] for a pose that is not finite, and [`Error::Interrupted`].
pub fn refine_poses(
    photographs: &[Prepared],
    poses: &[Pose],
    reference: Option<usize>,
    seed: u64,
    callback: &mut Callback<'_>,
) -> Result<Refined> {
    let shots = reference_first(photographs, reference)?;
    let as_many = poses.len() == photographs.len();
    OutOfRange::check(as_many, "number of poses", &poses.len(), "give one for each photograph")?;
    let mut numbers = poses.iter().flat_map(|p| p.translation.vector.iter().chain(p.rotation.coords.iter()));
    if !numbers.all(|x| x.is_finite()) {
        return Err(Error::View(mde_warp::Error::Pose { which: "given" }));
    }
    let mut given = poses.to_vec();
    given[..=reference.unwrap_or(0)].rotate_right(1);
    let compare = |[i, j]: [usize; 2]| {
        let found = match_features(&shots[i].features, &shots[j].features);
        verified_matches([shots[i], shots[j]], [i, j], &found, seed)
    };
    let pairs = compared(&neighbours::pairs(&given), compare, callback)?;

    let mut verdicts = vec![Verdict::Posed; given.len()];
    verdicts[0] = Verdict::Reference;
    let mut capture = Capture { shots: &shots, pairs: &pairs, poses: &given, verdicts };
    while capture.leave_out(&given, GIVEN_PIXELS) {}
    let kept = capture.verdicts.iter().position(Verdict::has_pose).filter(|_| reference.is_none());
    if let Some(first @ 1..) = kept {
        return refine_poses(photographs, poses, Some(first), seed, callback);
    }
    let mut adjusted = capture.adjusted(seed);
    while capture.leave_out(&adjusted.bundle.cameras.poses, OUTLIER_PIXELS) {
        adjusted = capture.adjusted(seed);
    }
    let Adjusted { bundle, mut covariance, accepted, withheld } = adjusted;
    let fitting = capture.agreement(&bundle.cameras, OUTLIER_PIXELS);
    let depths = bundle.median_depths();
    let of_photograph = |v: usize| EstimatedPose {
        pose: capture.verdicts[v].has_pose().then_some(bundle.cameras.poses[v]),
        camera: shots[v].camera,
        verdict: capture.verdicts[v],
        matches: fitting[v][1],
        depth: depths[v],
    };
    let mut photographs: Vec<EstimatedPose> = (0..shots.len()).map(of_photograph).collect();
    photographs[..=reference.unwrap_or(0)].rotate_left(1);
    covariance.rotate_left(reference.unwrap_or(0) + 1);
    let found = photographs.iter().map(|one| one.pose.filter(|_| accepted));
    let (moved, depths) = (moved(poses, &found.collect::<Vec<_>>()), bundle.reference_depths());
    Ok(Refined { photographs, covariance, accepted, withheld, moved, depths })
}

/// The photographs whose found pose is farther from the given one than [`MOVED`] allows.
fn moved(given: &[Pose], found: &[Option<Pose>]) -> Vec<usize> {
    let is_moved = |&index: &usize| {
        let Some(at) = found[index].as_ref().map(centre) else { return false };
        let others = found.iter().enumerate().filter(|(other, _)| *other != index);
        let apart = others.filter_map(|(_, other)| Some((at - centre(other.as_ref()?)).norm()));
        (centre(&given[index]) - at).norm() > MOVED * apart.fold(f64::INFINITY, f64::min)
    };
    (0..given.len()).filter(is_moved).collect()
}

/// Matched photographs with given poses, the reference first.
pub(super) struct Capture<'g> {
    pub(super) shots: &'g [&'g Prepared],
    pub(super) pairs: &'g [Pair],
    pub(super) poses: &'g [Pose],
    pub(super) verdicts: Vec<Verdict>,
}

/// Poses and tracks as they are kept.
struct Adjusted {
    bundle: Bundle,
    covariance: PoseCovariance,
    accepted: bool,
    withheld: Option<[f64; 2]>,
}

impl Capture<'_> {
    /// Leaves out the photograph that fits its pose least, if it does not; `cut` is in pixels. Returns whether there was one.
    pub(super) fn leave_out(&mut self, poses: &[Pose], cut: f64) -> bool {
        let cameras = self.cameras(poses);
        let (found, consistent) = (self.agreement(&cameras, cut), self.consistency(&cameras, cut));
        let share = |[matches, agreeing]: [usize; 2]| agreeing as f64 / matches as f64;
        let posed: Vec<usize> = (0..found.len()).filter(|&v| self.verdicts[v].has_pose()).collect();
        let is_enough = |v: usize| consistent[v][0] >= MIN_MATCHES;
        let typical = median(posed.iter().filter(|v| is_enough(**v)).map(|v| share(consistent[*v])));
        let of = |v: usize| {
            let features = self.shots[v].features.keypoints.len();
            if found[v][0] < MIN_MATCHES {
                return (features >= PLENTY).then_some((0.0, Verdict::Unmatched(found[v][0])));
            }
            let least = typical.filter(|_| is_enough(v)).map_or(0.0, |typical| LEAST_CONSISTENT * typical);
            let counts @ [matches, agreeing] = if is_enough(v) { consistent[v] } else { found[v] };
            let p = share(counts);
            let of_least = (p + (p * (1.0 - p) / matches as f64).sqrt()) / LEAST_AGREEING.max(least);
            (of_least < 1.0).then_some((of_least, Verdict::Contradicted { matches, agreeing }))
        };
        let doubtful = posed.iter().filter_map(|&v| Some((v, of(v)?)));
        let Some((v, (_, verdict))) = doubtful.min_by(|a, b| a.1.0.total_cmp(&b.1.0)) else { return false };
        self.verdicts[v] = verdict;
        true
    }

    /// A match of keypoint `a` of `anchor` with keypoint `b` of another photograph, at the depth that it gives by itself.
    fn alone(&self, cameras: &Cameras, anchor: usize, a: usize, other: usize, b: usize) -> Observed {
        let (pixel, there) = (self.shots[anchor].pixel(a), self.shots[other].pixel(b));
        let views = vec![(other, there)];
        let mut track = Observed { anchor, pixel, inverse_depth: 0.0, prior: None, views };
        cameras.triangulate(&mut track);
        track
    }

    /// Matches of every photograph with those that are kept, and how many fall within `cut` pixels with a depth of their own.
    fn agreement(&self, cameras: &Cameras, cut: f64) -> Vec<[usize; 2]> {
        let kept = self.kept_pairs();
        let fitting = |pair: &&Pair| {
            let alone = |&[a, b]: &[usize; 2]| self.alone(cameras, pair.first, a, pair.second, b);
            pair.agreeing.iter().map(alone).filter(|track| cameras.lies(track, track, cut)).count()
        };
        let fitting: Vec<usize> = kept.par_iter().map(fitting).collect();
        let mut found = vec![[0; 2]; self.shots.len()];
        for (pair, fitting) in kept.iter().zip(fitting) {
            for v in [pair.first, pair.second] {
                found[v][0] += pair.agreeing.len();
                found[v][1] += fitting;
            }
        }
        found
    }

    /// The same of matches whose keypoint a third photograph shows: such a match also has the depth that half of the others give it, to
    /// `cut` pixels. A camera that is off along its baselines fits each pair by itself, at a depth of another scale.
    fn consistency(&self, cameras: &Cameras, cut: f64) -> Vec<[usize; 2]> {
        let both = |pair: &&Pair| {
            let Pair { first, second, .. } = **pair;
            let each = |&[a, b]: &[usize; 2]| [(first, a, second, b), (second, b, first, a)];
            pair.agreeing.iter().flat_map(each).collect::<Vec<_>>()
        };
        let mut seen: Vec<_> = self.kept_pairs().iter().flat_map(both).collect();
        seen.sort_unstable();
        let judged = |matches: &[(usize, usize, usize, usize)]| -> Vec<(usize, bool)> {
            let tracks: Vec<_> = matches.iter().map(|m| self.alone(cameras, m.0, m.1, m.2, m.3)).collect();
            let fitting: Vec<_> = tracks.iter().map(|track| cameras.lies(track, track, cut)).collect();
            let verdict = |i: usize| {
                let others = || (0..tracks.len()).filter(|&j| j != i && fitting[j]).map(|j| &tracks[j]);
                let same = |other: &&Observed| {
                    cameras.lies(&tracks[i], other, cut) || cameras.lies(other, &tracks[i], cut)
                };
                let agrees = 2 * others().filter(same).count() >= others().count();
                (others().count() > 0).then_some((matches[i].2, fitting[i] && agrees))
            };
            (0..tracks.len()).filter_map(verdict).collect()
        };
        let points: Vec<_> = seen.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|m| m.len() > 1).collect();
        let judged: Vec<_> = points.into_par_iter().flat_map_iter(judged).collect();
        let mut found = vec![[0; 2]; self.shots.len()];
        for (v, fits) in judged {
            found[v][0] += 1;
            found[v][1] += usize::from(fits);
        }
        found
    }

    /// The median depth of the points, or that over pairs of photographs of the median by their matches, whichever is less: a camera far
    /// away makes the first large, little parallax the second.
    fn typical_depth(&self, bundle: &Bundle) -> Option<f64> {
        let depth = |track: &Observed| track.inverse_depth.recip();
        let of_pair = |pair: &Pair| {
            let alone = |&[a, b]: &[usize; 2]| self.alone(&bundle.cameras, pair.first, a, pair.second, b);
            median(pair.agreeing.iter().map(|found| depth(&alone(found))))
        };
        let of_pairs = median(self.kept_pairs().into_iter().filter_map(of_pair))?;
        Some(median(bundle.tracks.iter().map(depth))?.min(of_pairs))
    }

    fn kept_pairs(&self) -> Vec<&Pair> {
        let kept = |v: usize| self.verdicts[v].has_pose();
        self.pairs.iter().filter(|pair| kept(pair.first) && kept(pair.second)).collect()
    }

    fn cameras(&self, poses: &[Pose]) -> Cameras {
        let lenses = self.shots.iter().map(|shot| Lens { assumed: false, ..shot.lens }).collect();
        Cameras::new(lenses, poses.to_vec(), 0)
    }

    /// The given poses, or those that fit withheld tracks better.
    fn adjusted(&self, seed: u64) -> Adjusted {
        let rank: Vec<usize> = (0..self.shots.len()).collect();
        let tracks = tracks::join(self.shots, &self.kept_pairs(), &rank);
        let mut bundle = Bundle { cameras: self.cameras(self.poses), tracks };
        bundle.triangulate();
        let still = self.poses.iter().all(|pose| centre(pose) == centre(&self.poses[0]));
        let depth = self.typical_depth(&bundle);
        let mut covariance = PoseCovariance::new(&vec![None; self.poses.len()], None);
        let Some(depth) = depth.filter(|_| !still && bundle.tracks.len() >= MIN_MATCHES) else {
            return Adjusted { bundle, covariance, accepted: false, withheld: None };
        };
        bundle.cameras.given = Some(Given {
            poses: self.poses.to_vec(),
            rotation_sigma: ROTATION_SIGMA_DEGREES.to_radians(),
            centre_sigma: CENTRE_SIGMA * depth,
        });
        let windows = neighbours::windows(self.poses);
        // Each group on trial is a capture of its own: with the others kept as given it could not move.
        let of_window = |window: &Vec<usize>| {
            let own = |v: usize| v == 0 || window.contains(&v);
            let pairs = self.kept_pairs().into_iter().filter(|pair| own(pair.first) && own(pair.second));
            tracks::join(self.shots, &pairs.collect::<Vec<_>>(), &rank)
        };
        let on_trial = windows.iter().step_by(windows.len().div_ceil(TRIALS));
        let mut judge =
            Bundle { cameras: bundle.cameras.clone(), tracks: on_trial.flat_map(of_window).collect() };
        judge.triangulate();
        let draw = |track: usize| CounterRng::new(seed, "withheld", 0, track as u64).random_range(0..FOLDS);
        let drawn: Vec<usize> = (0..judge.tracks.len()).map(draw).collect();
        // The tracks that are withheld in a fold, or the others.
        let part = |fold: usize, withheld: bool| {
            let tracks = judge.tracks.iter().zip(&drawn).filter(|(_, of)| (**of == fold) == withheld);
            let tracks = tracks.map(|(track, _)| track.clone()).collect();
            Bundle { cameras: judge.cameras.clone(), tracks }
        };
        let trusting = |share: f64, mut next: Bundle| {
            if let Some(given) = &mut next.cameras.given {
                given.rotation_sigma *= share;
                given.centre_sigma *= share;
            }
            next
        };
        let refined = |share: f64, next: Bundle| {
            let mut next = trusting(share, next);
            next.adjust(STEPS);
            next.triangulate();
            next.drop_outliers(OUTLIER_PIXELS);
            next.adjust(STEPS);
            next
        };
        // The given poses first, then every trust, each over all folds.
        let trials: Vec<(Option<f64>, usize)> = std::iter::once(None)
            .chain(TRUST.map(Some))
            .flat_map(|share| (0..FOLDS).map(move |fold| (share, fold)))
            .collect();
        let judged: Vec<Vec<f64>> = trials
            .par_iter()
            .map(|&(share, fold)| {
                let mut judged = part(fold, true);
                if let Some(share) = share {
                    judged.cameras.poses = refined(share, part(fold, false)).cameras.poses;
                }
                judged.misses()
            })
            .collect();
        let errors: Vec<Vec<f64>> = judged.chunks(FOLDS).map(<[Vec<f64>]>::concat).collect();
        let chosen = best_fitting(&errors);
        let middle = |i: usize| median(errors[i].iter().copied()).unwrap_or(0.0);
        let withheld = chosen.map(|chosen| [0, chosen].map(middle));
        let share = chosen.and_then(|chosen| chosen.checked_sub(1)).and_then(|i| TRUST.get(i));
        let bundle = match share {
            Some(share) => refined(*share, bundle),
            None => {
                bundle.drop_outliers(OUTLIER_PIXELS);
                trusting(KEPT, bundle)
            }
        };
        let noise = bundle.shared_noise();
        // Of each window with the other poses kept.
        windows.iter().for_each(|window| covariance.append(bundle.window(window).covariance(noise).0));
        Adjusted { bundle, covariance, accepted: share.is_some(), withheld }
    }
}

impl Cameras {
    /// Whether a match lies within `cut` pixels of where the depth of another one of the same keypoint has it.
    fn lies(&self, of: &Observed, by: &Observed, cut: f64) -> bool {
        of.views.iter().all(|(v, there)| self.residual(by, *v, there).is_some_and(|r| r.norm() <= cut))
    }
}

impl Bundle {
    /// The tracks that a window's photographs are part of, with the poses of the others kept.
    fn window(&self, window: &[usize]) -> Self {
        let shows = |track: &&Observed| {
            window.contains(&track.anchor) || track.views.iter().any(|(v, _)| window.contains(v))
        };
        let tracks = self.tracks.iter().filter(shows).cloned().collect();
        let mut cameras = self.cameras.clone();
        cameras.fixed.iter_mut().enumerate().for_each(|(v, fixed)| *fixed |= !window.contains(&v));
        Self { cameras, tracks }
    }
}

/// The candidate of least error, or the first, the given poses, where these are not worse by more than two standard errors of the
/// difference on the same matches, of which those of one region share an error.
///
/// Nothing without matches.
fn best_fitting(errors: &[Vec<f64>]) -> Option<usize> {
    let sum = |i: usize| errors[i].iter().sum::<f64>();
    let found = (0..errors.len()).filter(|i| !errors[*i].is_empty());
    let best = found.min_by(|a, b| sum(*a).total_cmp(&sum(*b)))?;
    let count = errors[0].len() as f64;
    let mean = (sum(0) - sum(best)) / count;
    let apart = errors[0].iter().zip(&errors[best]).map(|(a, b)| (a - b - mean).powi(2)).sum::<f64>() / count;
    Some(if mean > BEYOND_NOISE * (apart / count.min(REGIONS)).sqrt() { best } else { 0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exchanged_poses_are_moved_and_noise_is_not() {
        let at = |x: f64| Pose::translation(-x, 0.0, 0.0);
        let given = [0.0, 2.0, 1.0, 3.1].map(at);
        assert_eq!(moved(&given, &[0.0, 1.0, 2.0, 3.0].map(|x| Some(at(x)))), [1, 2]);
        assert!(moved(&given, &[Some(at(0.0)), Some(at(2.0)), None, Some(at(3.4))]).is_empty());
    }

    #[test]
    fn poses_move_only_where_matches_fit_better() {
        let noisy = |level: f64| (0..200).map(|i| level + 0.1 * f64::from(i * 37 % 11 - 5)).collect();
        let [far, near, nearer]: [Vec<f64>; 3] = [2.0, 1.0, 0.999].map(noisy);
        // Alike within the error of the mean: the given poses.
        let mut shuffled = near.clone();
        shuffled.rotate_left(3);
        assert_eq!(best_fitting(&[shuffled.clone(), far.clone(), nearer.clone()]), Some(0));
        assert_eq!(best_fitting(&[near.clone(), near.clone(), far.clone()]), Some(0));
        assert_eq!(best_fitting(&[far.clone(), shuffled, nearer]), Some(2));
        assert_eq!(best_fitting(&[vec![], vec![]]), None);
    }
}
