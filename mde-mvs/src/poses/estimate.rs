use super::bundle::{Bundle, Covariance, Observed};
use super::features::Features;
use super::matching::match_features;
use super::tracks::{self, Track, TrackPixel};
use super::two_view::{Motion, Pair, relative_pose};
use super::{FLAT_SIGMA, is_flat};
use super::{
    FOCAL_SIGMA, FeatureImage, MAX_FEATURES, MIN_MATCHES, OUTLIER_PIXELS, PRIOR_SIGMA, PoseInput, RATIO,
    REGIONS, in_order, match_pairs, neighbours, shared_error_factor,
};
use crate::{Callback, Error, Result};
use mde_uncertainty::statistics::median;
use mde_warp::{PinholeCamera, Pose};
use nalgebra::{Matrix6, Point2};
use std::fmt;

/// Steps of an adjustment at most.
pub(super) const STEPS: usize = 60;

/// Adjustments after each of which outliers are dropped and the priors measured.
const ROUNDS: usize = 3;

/// A photograph whose rotation is less certain than this, in degrees, has no pose. Of 448 photographs two had more, 4.7 and 5.3, and were
/// off by 29 and 48 degrees; the others have at most 1.2.
const MOST_UNCERTAIN: f64 = 3.0;

/// Least median parallax of a photograph that determines depth, pixels.
const MIN_PARALLAX_PIXELS: f64 = 2.0;

/// No covariance is of matches better than this, in units of noise.
pub(super) const LEAST_NOISE: f64 = 1e-3;

/// Outcome for a photograph.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Verdict {
    /// The photograph whose frame is the world.
    Reference,
    /// It has a pose.
    Posed,
    /// It has a pose, but so little parallax that its matches hardly determine depth.
    NoParallax {
        /// Median parallax of its matches, in pixels of a photograph of 640 on the longer side.
        pixels: f64,
        /// What is needed.
        need: f64,
    },
    /// Too little structure: blurred, dark or blank.
    TooFewFeatures {
        /// Features found.
        found: usize,
        /// What is needed.
        need: usize,
    },
    /// Some matches agree, but not enough of them: the overlap is small or the views too different.
    TooFewMatches {
        /// Matches of the best pair that agree on one motion.
        agreeing: usize,
        /// What is needed.
        need: usize,
    },
    /// No more matches agree than those of unrelated photographs.
    AnotherPlace {
        /// Matches of the best pair, right or wrong.
        matches: usize,
        /// Those that agree on one motion.
        agreeing: usize,
    },
    /// Matches agree with each other, but on no pose with the prior's depth.
    NoPose {
        /// Matches of the best pair that obey one epipolar geometry.
        agreeing: usize,
    },
    /// It has features, but hardly any of them is matched in its neighbours.
    Unmatched {
        /// Matches with them.
        matches: usize,
        /// What is needed.
        need: usize,
    },
    /// Its matches with its neighbours do not fit the pose that was given for it.
    Contradicted {
        /// Matches with them.
        matches: usize,
        /// Those that fit.
        agreeing: usize,
    },
    /// Too few matches, or too close together, for a pose.
    Uncertain {
        /// Standard deviation of the rotation, in degrees.
        degrees: f64,
        /// What is allowed.
        most: f64,
    },
}

impl Verdict {
    /// Whether the photograph has a pose.
    pub fn has_pose(&self) -> bool {
        matches!(self, Self::Reference | Self::Posed | Self::NoParallax { .. })
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Reference => write!(f, "the reference"),
            Self::Posed => write!(f, "has a pose"),
            Self::NoParallax { pixels, need } => {
                write!(f, "no parallax: {pixels:.1} pixels, {need:.1} are needed; take it from further aside")
            }
            Self::TooFewFeatures { found, need } => {
                write!(f, "{found} features, {need} are needed; take a sharper or brighter photograph")
            }
            Self::TooFewMatches { agreeing, need } => {
                write!(f, "{agreeing} matches agree, {need} are needed; take it from nearer to the others")
            }
            Self::AnotherPlace { matches, agreeing } => {
                write!(f, "another place: {agreeing} of {matches} matches agree, no more than by chance")
            }
            Self::NoPose { agreeing } => {
                write!(
                    f,
                    "{agreeing} matches fit no pose with the prior's depth; check its intrinsic parameters"
                )
            }
            Self::Unmatched { matches, need } => {
                write!(
                    f,
                    "{matches} matches with its neighbours, {need} are needed; check that it shows the same scene and has its own pose"
                )
            }
            Self::Contradicted { matches, agreeing } => {
                write!(
                    f,
                    "{agreeing} of {matches} matches with its neighbours fit its pose; check that the pose belongs to the photograph"
                )
            }
            Self::Uncertain { degrees, most } => {
                write!(
                    f,
                    "its pose is uncertain by {degrees:.1} degrees, {most:.1} are allowed; take it from nearer to the others"
                )
            }
        }
    }
}

/// What was found of one photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedPose {
    /// Reference's frame to camera, in the unit of the reference's prior; nothing where [`Verdict::has_pose`] is false.
    pub pose: Option<Pose>,
    /// The camera, with the estimated focal length where it was assumed.
    pub camera: PinholeCamera,
    /// Outcome for it.
    pub verdict: Verdict,
    /// Tracks that it is part of.
    pub tracks: usize,
    /// Median parallax of those to the others, in pixels of a photograph of 640 on the longer side.
    pub parallax: f64,
    /// Depth in the unit of the poses over the depth of this photograph's prior.
    pub prior_scale: Option<f64>,
    /// Covariance of the pose's left perturbation, translation before rotation in radians, as of 30 independent
    /// matches at most, since lens and shutter have errors that neighbours share.
    pub covariance: Option<Matrix6<f64>>,
}

/// Poses of photographs, and the points that they have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// One per photograph, in the order given.
    pub photographs: Vec<EstimatedPose>,
    /// Points seen by at least two photographs, those of the reference first.
    pub tracks: Vec<Track>,
    /// Factor on the assumed focal lengths; 1 where none was assumed.
    pub focal_factor: f64,
    /// Standard deviation of its logarithm; 0 where none was assumed. Where the photographs do not determine it, it stays near .2.
    pub focal_log_sigma: f64,
    /// Standard deviation of a match, in pixels of a photograph of 640 on the longer side.
    pub noise: f64,
}

/// Poses of photographs without any; the module's front page has the method.
///
/// The result depends on the photographs, the order of those after the reference, and the seed, not on the number of threads. A
/// photograph that does not fit has no pose and a [`Verdict`] with the reason; with none that fits, the reference alone has one. The
/// callback counts the pairs of photographs as they are compared.
///
/// # Errors
/// [`Error::Config`] for fewer than two photographs, a reference that is none of them or has no
/// prior, or a photograph with a side below 16 pixels;
/// [`Error::View`] for a camera that is not of its image's or its prior's size;
/// [`Error::Interrupted`].
pub fn estimate_poses(
    photographs: &[PoseInput],
    reference: usize,
    seed: u64,
    callback: &mut Callback<'_>,
) -> Result<Estimated> {
    let order = in_order(photographs, reference)?;
    if photographs[reference].prior.is_none() {
        return Err(Error::config("prior of the reference", "missing", "give its depth"));
    }
    let sorted: Vec<PoseInput> = order.iter().map(|&i| photographs[i]).collect();
    let shots = FeatureImage::all(&sorted, MAX_FEATURES)?;
    let found = |i: usize, j: usize| match_features(&shots[i].features, &shots[j].features, RATIO);
    let features: Vec<&Features> = shots.iter().map(|shot| &*shot.features).collect();
    let likely = neighbours::likely(&features);
    let pairs = match_pairs(&shots, &likely, found, relative_pose, seed, callback)?;
    Ok(adjusted(&sorted, &shots, &pairs, &order))
}

/// Poses of photographs, the reference first, by their pairs; `order` has their places in the order given.
pub(super) fn adjusted(
    sorted: &[PoseInput],
    shots: &[FeatureImage],
    pairs: &[Pair],
    order: &[usize],
) -> Estimated {
    let mut dropped = vec![None; shots.len()];
    loop {
        let tree = Tree::grow(shots.len(), pairs, &dropped);
        let mut bundle = build(shots, pairs, &tree);
        for _ in 0..ROUNDS {
            bundle.adjust(STEPS);
            bundle.drop_outliers(OUTLIER_PIXELS);
            bundle.measure_priors(REGIONS);
        }
        bundle.adjust(STEPS);
        bundle.drop_outliers(OUTLIER_PIXELS);
        let counts = bundle.counts();
        // The weakest goes first: without it, others may fit better.
        let weakest = (1..shots.len())
            .filter(|&v| tree.poses[v].is_some() && counts[v] < MIN_MATCHES)
            .min_by_key(|&v| counts[v]);
        if let Some(v) = weakest {
            dropped[v] = Some(Dropped::TooFewTracks);
            continue;
        }
        bundle.rescale_to_prior();
        let noise = bundle.noise();
        // The matches count as if they were few, so the focal length's own deviation counts in full.
        bundle.focal_sigma = FOCAL_SIGMA;
        let covariance = bundle.covariance(shared_error_factor(bundle.tracks.len()) * noise.max(LEAST_NOISE));
        let most_uncertain = covariance.as_ref().and_then(Covariance::most_uncertain_rotation);
        match most_uncertain.filter(|(_, degrees)| *degrees > MOST_UNCERTAIN) {
            Some((v, degrees)) => dropped[v] = Some(Dropped::Uncertain { degrees }),
            None => {
                let found = Found { tree, dropped, bundle, noise, covariance };
                return found.report(sorted, shots, pairs, order);
            }
        }
    }
}

/// Why a photograph has no pose although it has a motion with another.
#[derive(Debug, Clone, Copy)]
enum Dropped {
    TooFewTracks,
    Uncertain { degrees: f64 },
}

/// The adjusted photographs.
struct Found {
    tree: Tree,
    dropped: Vec<Option<Dropped>>,
    bundle: Bundle,
    noise: f64,
    covariance: Option<Covariance>,
}

/// Poses and prior scales along the strongest pairs from the reference.
struct Tree {
    poses: Vec<Option<Pose>>,
    log_scales: Vec<f64>,
    /// When a photograph was attached; the reference first, those without a pose last.
    rank: Vec<usize>,
}

impl Tree {
    /// The spanning tree of most agreeing matches (Prim, 1957).
    fn grow(count: usize, pairs: &[Pair], dropped: &[Option<Dropped>]) -> Self {
        let mut tree =
            Self { poses: vec![None; count], log_scales: vec![0.0; count], rank: vec![usize::MAX; count] };
        tree.poses[0] = Some(Pose::identity());
        tree.rank[0] = 0;
        for rank in 1..count {
            let mut best: Option<(&Pair, &Motion, Pose)> = None;
            for pair in pairs {
                let Some(motion) = &pair.motion else { continue };
                let open = [pair.first, pair.second].map(|v| tree.poses[v].is_none() && dropped[v].is_none());
                let Some(known) = tree.poses[pair.first].or(tree.poses[pair.second]) else { continue };
                let better = best.is_none_or(|(top, ..)| pair.agreeing.len() > top.agreeing.len());
                if (open[0] || open[1]) && better {
                    best = Some((pair, motion, known));
                }
            }
            let Some((pair, motion, known)) = best else { break };
            let forward = tree.poses[pair.first].is_some();
            let (from, to) = if forward { (0, 1) } else { (1, 0) };
            let ends = [pair.first, pair.second];
            // The pair's unit over that of the tree.
            let unit = tree.log_scales[ends[from]] - motion.log_scales[from];
            let mut step = if forward { motion.pose } else { motion.pose.inverse() };
            step.translation.vector *= unit.exp();
            tree.poses[ends[to]] = Some(step * known);
            tree.log_scales[ends[to]] = motion.log_scales[to] + unit;
            tree.rank[ends[to]] = rank;
        }
        tree
    }
}

fn build(shots: &[FeatureImage], pairs: &[Pair], tree: &Tree) -> Bundle {
    let used: Vec<&Pair> = pairs
        .iter()
        .filter(|p| p.motion.is_some() && tree.poses[p.first].is_some() && tree.poses[p.second].is_some())
        .collect();
    let tracks = tracks::join(shots, &used, &tree.rank);
    let of_features = |shot: &FeatureImage| -> Vec<f64> {
        shot.features.keypoints.iter().filter_map(|k| shot.log_prior(&k.pixel)).collect()
    };
    let known: Vec<Vec<f64>> = shots.iter().map(of_features).collect();
    let middles: Vec<f64> =
        known.iter().map(|depths| median(depths.iter().copied()).unwrap_or(0.0)).collect();
    let tracks = tracks
        .into_iter()
        .filter_map(|mut group| {
            let (anchor, pixel) = (!group.is_empty()).then(|| group.remove(0))?;
            let prior = shots[anchor].log_prior(&pixel);
            let log_depth = prior.unwrap_or(middles[anchor]) + tree.log_scales[anchor];
            Some(Observed { anchor, pixel, inverse_depth: (-log_depth).exp(), prior, views: group })
        })
        .collect::<Vec<_>>();
    let count = tracks.len();
    let sigma = |depths: &Vec<f64>| if is_flat(depths.iter().copied()) { FLAT_SIGMA } else { PRIOR_SIGMA };
    Bundle {
        lenses: shots.iter().map(|shot| shot.lens).collect(),
        poses: tree.poses.iter().map(|pose| pose.unwrap_or_else(Pose::identity)).collect(),
        fixed: (0..shots.len()).map(|v| v == 0).collect(),
        log_focal: 0.0,
        focal_sigma: FOCAL_SIGMA / shared_error_factor(count),
        log_scales: tree.log_scales.clone(),
        keep_scale: true,
        prior_sigmas: known.iter().map(|depths| sigma(depths) * shared_error_factor(count)).collect(),
        pose_priors: vec![None; shots.len()],
        tracks,
    }
}

impl Bundle {
    /// Whether a track in front of both photographs falls within `limit` units of noise of where it was found.
    pub(super) fn fits(&self, track: &Observed, view: usize, pixel: &Point2<f64>, limit: f64) -> bool {
        track.inverse_depth > 0.0 && self.residual(track, view, pixel).is_some_and(|r| r.norm() < limit)
    }

    /// Leaves out observations further than `limit` from where they should be, and tracks without any left.
    pub(super) fn drop_outliers(&mut self, limit: f64) {
        let mut tracks = std::mem::take(&mut self.tracks);
        for track in &mut tracks {
            let here = track.clone();
            track.views.retain(|(v, p)| self.fits(&here, *v, p, limit));
        }
        tracks.retain(|track| !track.views.is_empty());
        self.tracks = tracks;
    }

    /// Tracks of each photograph.
    pub(super) fn counts(&self) -> Vec<usize> {
        let mut counts = vec![0; self.poses.len()];
        for track in &self.tracks {
            counts[track.anchor] += 1;
            track.views.iter().for_each(|(v, _)| counts[*v] += 1);
        }
        counts
    }

    /// Brings all to the unit in which the reference's prior is right on the whole.
    fn rescale_to_prior(&mut self) {
        let anchored = self.tracks.iter().filter(|track| track.anchor == 0);
        let ratios = anchored.filter_map(|track| Some(-track.inverse_depth.ln() - track.prior?));
        if let Some(shift) = median(ratios) {
            self.rescale(-shift);
        }
    }

    /// Standard deviation of an observation over [`Lens::noise`](super::bundle::Lens::noise), by the residuals that the depths
    /// and poses leave free.
    pub(super) fn noise(&self) -> f64 {
        let observations: usize = self.tracks.iter().map(|track| track.views.len()).sum();
        let moving = 6 * (self.counts().iter().filter(|count| **count > 0).count().saturating_sub(1));
        let free = (2 * observations).saturating_sub(self.tracks.len() + moving).max(1);
        let squares: f64 = self
            .tracks
            .iter()
            .flat_map(|track| track.views.iter().filter_map(move |(v, p)| self.residual(track, *v, p)))
            .map(|r| r.norm_squared())
            .sum();
        (squares / free as f64).sqrt()
    }

    /// The tracks with depths, deviations and residuals; `order` gives each view's index for the caller.
    pub(super) fn report_tracks(&self, covariance: Option<&Covariance>, order: &[usize]) -> Vec<Track> {
        self.tracks
            .iter()
            .enumerate()
            .map(|(i, track)| {
                let place = |view: usize, pixel: Point2<f64>, residual: f64| TrackPixel {
                    photograph: order[view],
                    pixel,
                    residual,
                };
                let there = track.views.iter().map(|(v, p)| {
                    place(*v, *p, self.residual(track, *v, p).map_or(f64::INFINITY, |r| r.norm()))
                });
                let moved = track
                    .views
                    .iter()
                    .filter_map(|(v, _)| Some(self.parallax(track, *v)? / self.lenses[*v].noise));
                Track {
                    pixels: std::iter::once(place(track.anchor, track.pixel, 0.0)).chain(there).collect(),
                    depth: track.inverse_depth.recip(),
                    log_depth_sigma: covariance.map_or(f64::INFINITY, |c| c.log_depths[i].max(0.0).sqrt()),
                    parallax: moved.fold(0.0, f64::max),
                }
            })
            .collect()
    }

    /// Median over a photograph's tracks of the parallax to another photograph, in units of the noise.
    pub(super) fn median_parallax(&self, photograph: usize) -> f64 {
        let mine = self.tracks.iter().flat_map(|track| track.views.iter().map(move |(v, _)| (track, *v)));
        let mine = mine.filter(|(track, v)| track.anchor == photograph || *v == photograph);
        let all = mine.filter_map(|(track, v)| Some(self.parallax(track, v)? / self.lenses[v].noise));
        median(all).unwrap_or(0.0)
    }
}

impl Found {
    fn report(
        self,
        photographs: &[PoseInput],
        shots: &[FeatureImage],
        pairs: &[Pair],
        order: &[usize],
    ) -> Estimated {
        let Self { tree, dropped, bundle, noise, covariance } = self;
        let counts = bundle.counts();
        let focal_factor = bundle.log_focal.exp();
        let mut found: Vec<(usize, EstimatedPose)> = (0..shots.len())
            .map(|v| {
                let parallax = bundle.median_parallax(v);
                let camera = &photographs[v].camera;
                let factor = if photographs[v].focal_assumed { focal_factor } else { 1.0 };
                let posed = tree.poses[v].is_some();
                let verdict = if v == 0 {
                    Verdict::Reference
                } else if let Some(Dropped::Uncertain { degrees }) = dropped[v] {
                    Verdict::Uncertain { degrees, most: MOST_UNCERTAIN }
                } else if !posed {
                    refusal(v, shots, pairs, &tree)
                } else if parallax < MIN_PARALLAX_PIXELS {
                    Verdict::NoParallax { pixels: parallax, need: MIN_PARALLAX_PIXELS }
                } else {
                    Verdict::Posed
                };
                let of_photograph = EstimatedPose {
                    pose: posed.then_some(bundle.poses[v]),
                    camera: PinholeCamera { fx: camera.fx * factor, fy: camera.fy * factor, ..*camera },
                    verdict,
                    tracks: counts[v],
                    parallax,
                    prior_scale: (posed && shots[v].prior.is_some()).then(|| bundle.log_scales[v].exp()),
                    covariance: covariance.as_ref().filter(|_| posed).and_then(|c| c.poses[v]),
                };
                (order[v], of_photograph)
            })
            .collect();
        found.sort_by_key(|(place, _)| *place);
        let mut tracks = bundle.report_tracks(covariance.as_ref(), order);
        tracks.sort_by_key(|track| track.pixels[0].photograph != order[0]);
        let photographs = found.into_iter().map(|(_, found)| found).collect();
        let focal_log_sigma = covariance.and_then(|c| c.log_focal).map_or(0.0, f64::sqrt);
        Estimated { photographs, tracks, focal_factor, focal_log_sigma, noise }
    }
}

/// Why a photograph has no pose: by its best pair with one that has.
fn refusal(view: usize, shots: &[FeatureImage], pairs: &[Pair], tree: &Tree) -> Verdict {
    let need = MIN_MATCHES;
    let found = shots[view].features.keypoints.len();
    if found < need {
        return Verdict::TooFewFeatures { found, need };
    }
    let other = |pair: &Pair| if pair.first == view { pair.second } else { pair.first };
    let mine = pairs.iter().filter(|pair| pair.first == view || pair.second == view);
    let best = mine.filter(|pair| tree.poses[other(pair)].is_some()).max_by_key(|pair| pair.agreeing.len());
    let (matches, agreeing) = best.map_or((0, 0), |pair| (pair.matches, pair.agreeing.len()));
    if agreeing >= need {
        Verdict::NoPose { agreeing }
    } else if 3 * agreeing >= 2 * need {
        Verdict::TooFewMatches { agreeing, need }
    } else {
        Verdict::AnotherPlace { matches, agreeing }
    }
}
