use super::bundle::{Bundle, Cameras, Observed};
use super::covariance::PoseCovariance;
use super::features::Features;
use super::matching::match_features;
use super::two_view::{Pair, relative_pose};
use super::{
    FLAT_SIGMA, FOCAL_SIGMA, MIN_MATCHES, OUTLIER_PIXELS, Prepared, compared, cycles, neighbours,
    reference_first, shared_error_factor, tracks,
};
use crate::statistics::is_flat;
use crate::{Callback, Result};
use mde_uncertainty::OutOfRange;
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose};
use nalgebra::{Point2, Vector2};

/// Steps of an adjustment at most.
pub(super) const STEPS: usize = 60;

/// Adjustments after each of which outliers are dropped and the priors measured.
const ROUNDS: usize = 3;
/// Another start leads to a better solution if the misses sum to less than this share.
const WORTHWHILE: f64 = 0.99;
/// A photograph whose turn from the one that it is attached to is less certain than this, in degrees, has no pose. Of 882 of 20 captures
/// 11 have more, and are off by 2.2 on average.
const MOST_UNCERTAIN: f64 = 2.5;
/// Least median parallax of a photograph that determines depth, pixels.
const MIN_PARALLAX_PIXELS: f64 = 2.0;
/// A photograph whose matches a turn on the spot explains to less than this median has no parallax, pixels. Of 70 photographs of 13 captures
/// the least has .95, turned pictures have .1.
const MIN_TURN_PIXELS: f64 = 0.6;
/// No covariance is of matches better than this, in units of noise.
const LEAST_NOISE: f64 = 1e-3;
/// Errors of the focal length over what the matches' noise explains, as lenses have distortion: 2.2 is the rms of 26 estimates on 13 captures.
const FOCAL_ERRORS: f64 = 2.0;

/// Outcome for a photograph.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Verdict {
    /// The photograph whose frame is the world.
    #[error("the reference")]
    Reference,
    /// It has a pose.
    #[error("has a pose")]
    Posed,
    /// It has a pose, but so little parallax that its matches hardly determine depth: this median, or what a turn on the spot leaves of the
    /// matches, in pixels of a photograph of 640 on the longer side.
    #[error("no parallax: {0:.1} pixels, {MIN_PARALLAX_PIXELS:.1} are needed; take it from further aside")]
    NoParallax(f64),
    /// Too few features: blurred, dark or blank.
    #[error("{0} features, {MIN_MATCHES} are needed; take a sharper or brighter photograph")]
    TooFewFeatures(usize),
    /// Some matches agree, but not enough of them: the overlap is small or the views too different.
    #[error("{0} matches agree, {MIN_MATCHES} are needed; take it from nearer to the others")]
    TooFewMatches(usize),
    /// No more matches agree than those of unrelated photographs.
    #[error("another place: {agreeing} of {matches} matches agree, no more than by chance; refine it apart")]
    AnotherPlace {
        /// Matches of the best pair, right or wrong.
        matches: usize,
        /// Those that agree on one motion.
        agreeing: usize,
    },
    /// So many matches agree with each other, but on no pose that the prior's depth, or of many photographs a third, confirms.
    #[error("{0} matches agree, but on no pose that prior or third photograph confirms; take more beside it")]
    NoPose(usize),
    /// It has features, but hardly any of them is matched in its neighbours: so many.
    #[error(
        "{0} matches with its neighbours, {MIN_MATCHES} are needed; check that it shows the same scene and has its own pose"
    )]
    Unmatched(usize),
    /// Its matches with its neighbours do not fit the pose that was given for it.
    #[error(
        "{agreeing} of {matches} matches with its neighbours fit its pose; check that the pose belongs to the photograph"
    )]
    Contradicted {
        /// Matches with them; where there are enough, of points that a third photograph shows.
        matches: usize,
        /// Those that fit.
        agreeing: usize,
    },
    /// Too few matches, or too close together, for a pose: the standard deviation of its rotation, in degrees.
    #[error(
        "its pose is uncertain by {0:.1} degrees, {MOST_UNCERTAIN:.1} are allowed; take it from nearer to the others"
    )]
    Uncertain(f64),
}

impl Verdict {
    /// Whether the photograph has a pose.
    pub fn has_pose(&self) -> bool {
        matches!(self, Self::Reference | Self::Posed | Self::NoParallax(_))
    }
}

/// What was found of one photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedPose {
    /// Reference's frame to camera; nothing where [`Verdict::has_pose`] is false.
    pub pose: Option<Pose>,
    /// The camera, with the estimated focal length where it was assumed.
    pub camera: PinholeCamera,
    /// Outcome for it.
    pub verdict: Verdict,
    /// Points that it shares with others (of given poses: matches with its neighbours) and that fit the poses to 3 pixels.
    pub matches: usize,
    /// Median depth of the points that it shows, in the unit of the poses; nothing with fewer than 20.
    pub depth: Option<f64>,
}

/// Poses of photographs, and depths by their matches.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// One per photograph, in the order given, in the unit of the reference's prior.
    pub photographs: Vec<EstimatedPose>,
    /// Covariance of their poses, of which that of the reference is exact.
    pub covariance: PoseCovariance,
    /// Pixels of the reference (x: column, y: row) and their depths, in the unit of the poses.
    pub depths: Vec<(Point2<f64>, f64)>,
    /// Factor on the assumed focal lengths; 1 where none was assumed.
    pub focal_factor: f64,
    /// Standard deviation of its logarithm; nothing where none was assumed.
    pub focal_sigma: Option<f64>,
    /// Radial distortion with which the matches fit better beyond chance, as the share of its distance from the centre by which a corner
    /// moves: the camera is none of the photographs', or the poses are wrong.
    pub distortion: Option<f64>,
}

/// Poses of photographs without any; the module's front page has the method.
///
/// Without a reference, the photograph with a prior and most agreeing matches in the largest group that is joined by motions takes its
/// place. Of more than 12 photographs a motion counts where a third photograph confirms its rotation. The result depends on the photographs,
/// the order of those after the reference, and the seed, not on the number of threads. A photograph that does not fit has no pose and a
/// [`Verdict`] with the reason; with none that fits, the reference alone has one. The callback counts the pairs of photographs as they are
/// compared.
///
/// # Errors
/// [`Config`](crate::Error::Config) for fewer than two photographs or a reference that is none of them or has no prior;
/// [`Interrupted`](crate::Error::Interrupted).
pub fn estimate_poses(
    photographs: &[Prepared],
    reference: Option<usize>,
    seed: u64,
    callback: &mut Callback<'_>,
) -> Result<Estimated> {
    let mut shots = reference_first(photographs, reference)?;
    let has_prior = shots[..reference.map_or(shots.len(), |_| 1)].iter().any(|shot| shot.prior.is_some());
    OutOfRange::check(has_prior, "prior of the reference", &"missing", "give its depth")?;
    let features: Vec<&Features> = shots.iter().map(|shot| &shot.features).collect();
    let compare = |[i, j]: [usize; 2]| {
        relative_pose([shots[i], shots[j]], [i, j], &match_features(features[i], features[j]), seed)
    };
    let mut pairs = compared(&neighbours::likely(&features), compare, callback)?;
    if shots.len() > neighbours::FEW {
        cycles::drop_unconfirmed(&mut pairs);
    }
    let chosen = reference.map_or_else(|| central(&shots, &pairs), |_| 0);
    shots[..=chosen].rotate_right(1);
    let place = |index: usize| if index > chosen { index } else { (index + 1) % (chosen + 1) };
    let pairs: Vec<Pair> = pairs.into_iter().map(|pair| pair.between(place)).collect();
    let mut found = adjusted(&shots, &pairs);
    let front = reference.unwrap_or(chosen) + 1;
    found.photographs[..front].rotate_left(1);
    found.covariance.rotate_left(front);
    Ok(found)
}

/// The photograph with a prior and most agreeing matches in the largest group that is joined by motions.
fn central(shots: &[&Prepared], pairs: &[Pair]) -> usize {
    let mut group: Vec<usize> = (0..shots.len()).collect();
    let mut matches = vec![0; shots.len()];
    for pair in pairs.iter().filter(|pair| pair.motion.is_some()) {
        let [into, from] = [group[pair.first], group[pair.second]];
        group.iter_mut().filter(|of| **of == from).for_each(|of| *of = into);
        [pair.first, pair.second].into_iter().for_each(|index| matches[index] += pair.agreeing.len());
    }
    let size = |index: usize| group.iter().filter(|of| **of == group[index]).count();
    let with_prior = (0..shots.len()).rev().filter(|&index| shots[index].prior.is_some());
    with_prior.max_by_key(|&index| (size(index), matches[index])).unwrap_or(0)
}

/// Poses of photographs, the reference first, by their pairs.
pub(super) fn adjusted(shots: &[&Prepared], pairs: &[Pair]) -> Estimated {
    // Photographs that have a motion with another, but too few tracks or an uncertain rotation.
    let mut dropped = vec![false; shots.len()];
    let mut uncertain = vec![None; shots.len()];
    loop {
        let tree = Tree::grow(shots.len(), pairs, &dropped);
        let start = build(shots, pairs, &tree);
        let solved = |mut bundle: Bundle| {
            for _ in 0..ROUNDS {
                bundle.adjust(STEPS);
                bundle.drop_outliers(OUTLIER_PIXELS);
                bundle.measure_priors();
            }
            bundle.adjust(STEPS);
            bundle.drop_outliers(OUTLIER_PIXELS);
            bundle
        };
        let mut bundle = solved(start.clone());
        if is_flat(start.tracks.iter().filter_map(|track| track.prior)) {
            let all =
                |bundle: &Bundle| Bundle { cameras: bundle.cameras.clone(), tracks: start.tracks.clone() };
            let missed = |bundle: &Bundle| all(bundle).misses().iter().sum::<f64>();
            let others: [&dyn Fn(&Bundle) -> Bundle; 2] =
                [&Bundle::reversed, &|bundle| bundle.regrown(&tree.rank, &tree.from)];
            for other in others {
                let next = solved(other(&all(&bundle)));
                if missed(&next) < WORTHWHILE * missed(&bundle) {
                    bundle = next;
                }
            }
        }
        let counts = bundle.counts();
        // The weakest goes first: without it, others may fit better.
        let weak = |&v: &usize| tree.poses[v].is_some() && counts[v] < MIN_MATCHES;
        if let Some(v) = (1..shots.len()).filter(weak).min_by_key(|&v| counts[v]) {
            dropped[v] = true;
            continue;
        }
        bundle.rescale_to_prior();
        // The matches count as if they were few, so the focal length's own deviation counts in full.
        bundle.cameras.focal_sigma = FOCAL_SIGMA;
        let (covariance, of_focal) = bundle.covariance(bundle.shared_noise());
        let placed = |v: usize| tree.poses[v].map(|pose| (v, pose));
        // Not of the turn from the reference: on a long walk the errors of turns add up.
        let degrees = |v: usize| {
            let turn = covariance.of_motions(&[placed(tree.from[v])?, placed(v)?]);
            Some((v, turn.diagonal().rows(3, 3).sum().max(0.0).sqrt().to_degrees()))
        };
        let most_uncertain = (1..shots.len()).filter_map(degrees).max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((v, degrees)) = most_uncertain.filter(|(_, degrees)| *degrees > MOST_UNCERTAIN) {
            (dropped[v], uncertain[v]) = (true, Some(degrees));
            continue;
        }
        let (focal_factor, distortion) = (bundle.cameras.log_focal.exp(), bundle.distortion());
        let depths = bundle.median_depths();
        let of_photograph = |v: usize| {
            let parallax = bundle.median_parallax(v);
            let camera = &shots[v].camera;
            let factor = if shots[v].lens.assumed { focal_factor } else { 1.0 };
            let posed = tree.poses[v].is_some();
            let verdict = if v == 0 {
                Verdict::Reference
            } else if let Some(degrees) = uncertain[v] {
                Verdict::Uncertain(degrees)
            } else if !posed {
                refusal(v, shots, pairs, &tree)
            } else if let Some(left) = bundle.turn_error(v).filter(|left| *left < MIN_TURN_PIXELS) {
                Verdict::NoParallax(left)
            } else if parallax < MIN_PARALLAX_PIXELS {
                Verdict::NoParallax(parallax)
            } else {
                Verdict::Posed
            };
            EstimatedPose {
                pose: posed.then_some(bundle.cameras.poses[v]),
                camera: PinholeCamera { fx: camera.fx * factor, fy: camera.fy * factor, ..*camera },
                verdict,
                matches: counts[v],
                depth: depths[v],
            }
        };
        let photographs = (0..shots.len()).map(of_photograph).collect();
        let (depths, focal_sigma) =
            (bundle.reference_depths(), of_focal.map(|variance| FOCAL_ERRORS * variance.sqrt()));
        return Estimated { photographs, covariance, depths, focal_factor, focal_sigma, distortion };
    }
}

/// Poses and prior scales along the strongest pairs from the reference.
struct Tree {
    poses: Vec<Option<Pose>>,
    log_scales: Vec<f64>,
    /// When a photograph was attached; the reference first, those without a pose last.
    rank: Vec<usize>,
    /// The photograph that each is attached to.
    from: Vec<usize>,
}

impl Tree {
    /// The spanning tree of most agreeing matches (Prim, 1957).
    fn grow(count: usize, pairs: &[Pair], dropped: &[bool]) -> Self {
        let mut tree = Self {
            poses: vec![None; count],
            log_scales: vec![0.0; count],
            rank: vec![usize::MAX; count],
            from: vec![0; count],
        };
        tree.poses[0] = Some(Pose::identity());
        tree.rank[0] = 0;
        for rank in 1..count {
            // From a photograph of the tree to another.
            let ends = |pair: &Pair| {
                let ways = [[pair.first, pair.second], [pair.second, pair.first]];
                let is_posed = |v: usize| tree.poses[v].is_some();
                ways.into_iter().find(|&[from, to]| is_posed(from) && !is_posed(to) && !dropped[to])
            };
            let joining = pairs.iter().rev().filter_map(|pair| Some((pair, pair.motion?, ends(pair)?)));
            let strongest = joining.max_by_key(|(pair, ..)| pair.agreeing.len());
            let Some((pair, motion, [from, to])) = strongest else { break };
            let mut motion = if from == pair.first { motion } else { motion.reversed() };
            // The pair's unit over that of the tree.
            let unit = tree.log_scales[from] - motion.log_scales[0];
            motion.pose.translation.vector *= unit.exp();
            tree.poses[to] = tree.poses[from].map(|known| motion.pose * known);
            tree.log_scales[to] = motion.log_scales[1] + unit;
            (tree.rank[to], tree.from[to]) = (rank, from);
        }
        tree
    }
}

fn build(shots: &[&Prepared], pairs: &[Pair], tree: &Tree) -> Bundle {
    let posed = |v: usize| tree.poses[v].is_some();
    let joined = |pair: &&Pair| pair.motion.is_some() && posed(pair.first) && posed(pair.second);
    let used: Vec<&Pair> = pairs.iter().filter(joined).collect();
    let mut tracks = tracks::join(shots, &used, &tree.rank);
    let of_features = |shot: &&Prepared| -> Vec<f64> {
        shot.features.keypoints.iter().filter_map(|k| shot.log_prior(&k.pixel)).collect()
    };
    let known: Vec<Vec<f64>> = shots.iter().map(of_features).collect();
    let middles: Vec<f64> = known.iter().map(|logs| median(logs.iter().copied()).unwrap_or(0.0)).collect();
    for track in &mut tracks {
        track.prior = shots[track.anchor].log_prior(&track.pixel);
        let log_depth = track.prior.unwrap_or(middles[track.anchor]) + tree.log_scales[track.anchor];
        track.inverse_depth = (-log_depth).exp();
    }
    let lenses = shots.iter().map(|shot| shot.lens).collect();
    let poses = tree.poses.iter().map(|pose| pose.unwrap_or_else(Pose::identity)).collect();
    let mut cameras = Cameras::new(lenses, poses, tracks.len());
    cameras.log_scales.clone_from(&tree.log_scales);
    for (sigma, known) in cameras.prior_sigmas.iter_mut().zip(&known) {
        if is_flat(known.iter().copied()) {
            *sigma = FLAT_SIGMA * shared_error_factor(tracks.len());
        }
    }
    Bundle { cameras, tracks }
}

impl Cameras {
    /// Whether a track in front of both photographs falls within `limit` units of noise of where it was found.
    pub(super) fn fits(&self, track: &Observed, view: usize, pixel: &Point2<f64>, limit: f64) -> bool {
        track.inverse_depth > 0.0 && self.residual(track, view, pixel).is_some_and(|r| r.norm() < limit)
    }
}

impl Bundle {
    /// Leaves out observations further than `limit` from where they should be, and tracks without any left.
    pub(super) fn drop_outliers(&mut self, limit: f64) {
        for track in &mut self.tracks {
            let here = track.clone();
            track.views.retain(|(v, p)| self.cameras.fits(&here, *v, p, limit));
        }
        self.tracks.retain(|track| !track.views.is_empty());
    }

    /// Tracks of each photograph.
    pub(super) fn counts(&self) -> Vec<usize> {
        let mut counts = vec![0; self.cameras.poses.len()];
        for track in &self.tracks {
            counts[track.anchor] += 1;
            track.views.iter().for_each(|(v, _)| counts[*v] += 1);
        }
        counts
    }

    /// Standard deviation of an observation over [`Lens::noise`](super::bundle::Lens::noise), by the residuals that the depths
    /// and poses leave free.
    pub(super) fn noise(&self) -> f64 {
        let observations: usize = self.tracks.iter().map(|track| track.views.len()).sum();
        let moving = 6 * (self.counts().iter().filter(|count| **count > 0).count().saturating_sub(1));
        let free = (2 * observations).saturating_sub(self.tracks.len() + moving).max(1);
        let squares: f64 = self.residuals().flatten().map(|r| r.norm_squared()).sum();
        (squares / free as f64).sqrt().max(LEAST_NOISE)
    }

    /// The same with the errors that neighbouring matches share, of as many matches as 12 photographs have.
    pub(super) fn shared_noise(&self) -> f64 {
        let photographs = self.counts().iter().filter(|count| **count > 0).count();
        let matches = self.tracks.len() * neighbours::FEW / photographs.max(neighbours::FEW);
        shared_error_factor(matches) * self.noise()
    }

    /// [`Cameras::residual`] of all observations.
    pub(super) fn residuals(&self) -> impl Iterator<Item = Option<Vector2<f64>>> {
        let seen = self.tracks.iter().flat_map(|track| track.views.iter().map(move |view| (track, view)));
        seen.map(|(track, (view, pixel))| self.cameras.residual(track, *view, pixel))
    }

    /// The pixels of the reference's tracks, and their depths.
    pub(super) fn reference_depths(&self) -> Vec<(Point2<f64>, f64)> {
        let anchored = self.tracks.iter().filter(|track| track.anchor == 0);
        anchored.map(|track| (track.pixel, track.inverse_depth.recip())).collect()
    }

    /// Median depth of the tracks that each photograph shows, where there are enough.
    pub(super) fn median_depths(&self) -> Vec<Option<f64>> {
        let mut depths = vec![Vec::new(); self.cameras.poses.len()];
        for track in &self.tracks {
            depths[track.anchor].push(track.inverse_depth.recip());
            track.views.iter().for_each(|(v, _)| depths[*v].push(self.cameras.depth(track, *v)));
        }
        let usual = |depths: Vec<f64>| Some(depths).filter(|all| all.len() >= MIN_MATCHES).and_then(median);
        depths.into_iter().map(usual).map(|depth| depth.filter(|z| *z > 0.0 && z.is_finite())).collect()
    }

    /// Median over a photograph's tracks of the parallax to another photograph, in units of the noise.
    pub(super) fn median_parallax(&self, photograph: usize) -> f64 {
        let mine = self.tracks.iter().flat_map(|track| track.views.iter().map(move |(v, _)| (track, *v)));
        let mine = mine.filter(|(track, v)| track.anchor == photograph || *v == photograph);
        median(mine.filter_map(|(track, v)| self.cameras.parallax(track, v))).unwrap_or(0.0)
    }
}

/// Why a photograph has no pose: by its best pair with one that has.
fn refusal(view: usize, shots: &[&Prepared], pairs: &[Pair], tree: &Tree) -> Verdict {
    let found = shots[view].features.keypoints.len();
    if found < MIN_MATCHES {
        return Verdict::TooFewFeatures(found);
    }
    let other = |pair: &Pair| if pair.first == view { pair.second } else { pair.first };
    let mine = pairs.iter().filter(|pair| pair.first == view || pair.second == view);
    let best = mine.filter(|pair| tree.poses[other(pair)].is_some()).max_by_key(|pair| pair.agreeing.len());
    let (matches, agreeing) = best.map_or((0, 0), |pair| (pair.matches, pair.agreeing.len()));
    if agreeing >= MIN_MATCHES {
        Verdict::NoPose(agreeing)
    } else if 3 * agreeing >= 2 * MIN_MATCHES {
        Verdict::TooFewMatches(agreeing)
    } else {
        Verdict::AnotherPlace { matches, agreeing }
    }
}
