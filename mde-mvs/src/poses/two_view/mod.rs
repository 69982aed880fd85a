//! The motion between two photographs, from their matches and the prior's depth in either.

mod essential;
mod fundamental;
mod msac;
mod p3p;
mod roots;

use super::bundle::{Bundle, Cameras, Lens, Observed};
use super::{EPIPOLAR_PIXELS, MIN_MATCHES, OUTLIER_PIXELS, Prepared};
use crate::statistics::is_flat;
use fundamental::{PixelPair, filter};
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use msac::{Ransac, msac};
use nalgebra::{Matrix3, Point3, Vector3};
use p3p::p3p;

/// Steps of the adjustment of one pair.
const STEPS: usize = 30;
/// Largest distance of a point lifted by the prior from where it was seen, pixels.
const RESECTION_PIXELS: f64 = 12.0;
/// Furthest depth from the median that a match may start from, as a factor.
const FURTHEST: f64 = 30.0;

/// What two photographs have in common, `first` before `second` in the order of the photographs.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    pub(super) first: usize,
    pub(super) second: usize,
    /// Mutual matches before any geometry.
    pub(super) matches: usize,
    /// Features of both that obey one epipolar geometry, and then, where a motion was found, that motion.
    pub(super) agreeing: Vec<[usize; 2]>,
    /// The fundamental matrix of that geometry.
    matrix: Option<Matrix3<f64>>,
    pub(super) motion: Option<Motion>,
}

impl Pair {
    /// The same with the photographs at other places.
    pub(super) fn between(self, place: impl Fn(usize) -> usize) -> Self {
        let (first, second) = (place(self.first), place(self.second));
        if first < second {
            return Self { first, second, ..self };
        }
        let agreeing = self.agreeing.into_iter().map(|[a, b]| [b, a]).collect();
        let (matrix, motion) = (self.matrix.map(|f| f.transpose()), self.motion.map(Motion::reversed));
        Self { first: second, second: first, agreeing, matrix, motion, ..self }
    }
}

/// The second photograph's pose in the first one's frame, in some unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motion {
    pub(super) pose: Pose,
    /// Logarithm of that unit's depths over each photograph's prior.
    pub(super) log_scales: [f64; 2],
    /// Logarithm of the common factor of the assumed focal lengths.
    pub(super) log_focal: f64,
    /// Cost of the adjustment over its matches.
    cost: f64,
}

impl Motion {
    /// The first photograph's pose in the second one's frame.
    pub(super) fn reversed(self) -> Self {
        Self { pose: self.pose.inverse(), log_scales: [self.log_scales[1], self.log_scales[0]], ..self }
    }
}

/// Those of the matches of two photographs of these places that obey one epipolar geometry.
pub(super) fn verified_matches(
    images: [&Prepared; 2],
    [first, second]: [usize; 2],
    found: &[[usize; 2]],
    seed: u64,
) -> Pair {
    let matches = found.len();
    if let Some(agreeing) = unmoved(images, found) {
        let motion = Motion { pose: Pose::identity(), log_scales: [0.0; 2], log_focal: 0.0, cost: 0.0 };
        return Pair { first, second, matches, agreeing, matrix: None, motion: Some(motion) };
    }
    let noise = images[0].lens.noise.max(images[1].lens.noise);
    let ransac = Ransac { seed, purpose: "epipolar", stream: stream([first, second]) };
    let (matrix, kept) = filter(&pixels(images, found), EPIPOLAR_PIXELS * noise, &ransac).unzip();
    let agreeing = kept.iter().flatten().map(|&i| found[i]).collect();
    Pair { first, second, matches, agreeing, matrix, motion: None }
}

/// Pixels of pairs of features.
fn pixels([a, b]: [&Prepared; 2], pairs: &[[usize; 2]]) -> Vec<PixelPair> {
    pairs.iter().map(|&[i, j]| (a.pixel(i), b.pixel(j))).collect()
}

fn stream([first, second]: [usize; 2]) -> u64 {
    (first as u64) << 15 | second as u64
}

/// The same, and the motion from the prior's depth in the first and in the second photograph, of which the better is kept.
pub(super) fn relative_pose(
    [a, b]: [&Prepared; 2],
    places: [usize; 2],
    found: &[[usize; 2]],
    seed: u64,
) -> Pair {
    let mut pair = verified_matches([a, b], places, found, seed);
    if pair.motion.is_some() || pair.agreeing.len() < MIN_MATCHES {
        return pair;
    }
    let pixels = pixels([a, b], &pair.agreeing);
    let swapped: Vec<PixelPair> = pixels.iter().map(|(p, q)| (*q, *p)).collect();
    let ransac = |way: u64| Ransac { seed, purpose: "resection", stream: stream(places) << 1 | way };
    let forward = from_prior(a, b, &pixels, pair.matrix, &ransac(0));
    let matrix = pair.matrix.map(|f| f.transpose());
    let backward = from_prior(b, a, &swapped, matrix, &ransac(1));
    let backward = backward.map(|(motion, fits)| (motion.reversed(), fits));
    let best = forward.into_iter().chain(backward).min_by(|a, b| a.0.cost.total_cmp(&b.0.cost));
    if let Some((motion, fits)) = best {
        let mut fits = fits.into_iter();
        pair.agreeing.retain(|_| fits.next() == Some(true));
        pair.motion = Some(motion);
    }
    pair
}

/// The matches that have not moved, where these are three quarters: the fundamental matrix is degenerate.
fn unmoved([a, b]: [&Prepared; 2], found: &[[usize; 2]]) -> Option<Vec<[usize; 2]>> {
    let size = |image: &Prepared| image.prior.as_ref().map(|prior| prior.dim());
    let limit = EPIPOLAR_PIXELS * a.lens.noise;
    let still = |&[i, j]: &[usize; 2]| (a.pixel(i) - b.pixel(j)).norm() < limit;
    let kept: Vec<_> = found.iter().copied().filter(still).collect();
    let most = kept.len() >= MIN_MATCHES && 4 * kept.len() >= 3 * found.len();
    (most && size(a) == size(b)).then_some(kept)
}

/// A motion and which pairs fit it.
type Fitted = (Motion, Vec<bool>);

/// Pose of `b` in the frame of `a` and which pairs fit it: `a`'s pixels lifted by its prior, a pose by RANSAC over three
/// points, and the adjustment of pose and depths. The adjustment also starts from no motion, since three points of a poor prior
/// can lead it to a wrong minimum, and under a constant prior from that of the fundamental matrix; the start of lowest cost is kept.
fn from_prior(
    a: &Prepared,
    b: &Prepared,
    pixels: &[PixelPair],
    matrix: Option<Matrix3<f64>>,
    ransac: &Ransac,
) -> Option<Fitted> {
    let depths: Vec<Option<f64>> = pixels.iter().map(|(p, _)| a.log_prior(p)).collect();
    let lifted = |((p, q), depth): (&PixelPair, &Option<f64>)| {
        Some((Point3::from(a.lens.ray(p, 0.0) * (*depth)?.exp()), b.lens.ray(q, 0.0)))
    };
    let lifted: Vec<_> = pixels.iter().zip(&depths).filter_map(lifted).collect();
    let start = resect(&lifted, &b.lens, ransac)?;

    // The matches are those that obey the matrix, right or wrong: a prior that tells shapes apart is the better start.
    let flat = is_flat(depths.iter().flatten().copied());
    let epipolar = matrix.filter(|_| flat).and_then(|f| {
        let (mut pose, depth) = essential::motion(&f, pixels, [&a.lens, &b.lens])?;
        pose.translation.vector *= median(depths.iter().flatten().copied())?.exp() / depth;
        Some((pose, true))
    });
    let starts = [Some((start, false)), Some((Pose::identity(), false)), epipolar].into_iter().flatten();
    starts
        .filter_map(|(start, triangulate)| adjusted(a, b, pixels, &depths, start, triangulate))
        .min_by(|a, b| a.0.cost.total_cmp(&b.0.cost))
}

/// The adjustment of pose and depths from that pose, and from the prior's depths or those that the pose gives.
fn adjusted(
    a: &Prepared,
    b: &Prepared,
    pixels: &[PixelPair],
    depths: &[Option<f64>],
    start: Pose,
    triangulate: bool,
) -> Option<Fitted> {
    let middle = median(depths.iter().flatten().copied())?;
    let track = |((p, q), &prior): (&PixelPair, &Option<f64>)| Observed {
        anchor: 0,
        pixel: *p,
        inverse_depth: (-prior.unwrap_or(middle)).exp(),
        prior,
        views: vec![(1, *q)],
    };
    let mut bundle = Bundle {
        cameras: Cameras::new(vec![a.lens, b.lens], vec![Pose::identity(), start], pixels.len()),
        tracks: pixels.iter().zip(depths).map(track).collect(),
    };
    if triangulate {
        bundle.triangulate();
        for track in &mut bundle.tracks {
            let near = (-middle).exp();
            track.inverse_depth = track.inverse_depth.clamp(near / FURTHEST, near * FURTHEST);
        }
    }
    bundle.adjust(STEPS);

    let Bundle { cameras, tracks } = &bundle;
    let fits: Vec<bool> = tracks.iter().map(|t| cameras.fits(t, 1, &t.views[0].1, OUTLIER_PIXELS)).collect();
    if fits.iter().filter(|fit| **fit).count() < MIN_MATCHES {
        return None;
    }
    let ratio = |of: &dyn Fn(&Observed) -> Option<f64>| {
        let fitting = tracks.iter().zip(&fits).filter(|(_, fit)| **fit);
        median(fitting.filter_map(|(t, _)| of(t)))
    };
    let here = ratio(&|t| Some(-t.inverse_depth.ln() - t.prior?))?;
    let there = ratio(&|t| {
        let point = cameras.poses[1] * Point3::from(a.lens.ray(&t.pixel, 0.0) / t.inverse_depth);
        (point.z > 0.0).then(|| Some(point.z.ln() - b.log_prior(&t.views[0].1)?)).flatten()
    })
    .unwrap_or(here);
    let motion = Motion {
        pose: cameras.poses[1],
        log_scales: [here, there],
        log_focal: cameras.log_focal,
        cost: bundle.cost(),
    };
    Some((motion, fits))
}

/// The pose of which most points fall near where they were seen, counted as MSAC does.
fn resect(points: &[(Point3<f64>, Vector3<f64>)], lens: &Lens, ransac: &Ransac) -> Option<Pose> {
    if points.len() < 4 {
        return None;
    }
    // Rays have z = 1, so a squared distance between them is in squared focal lengths.
    let limit = (RESECTION_PIXELS * lens.noise / lens.focal.mean()).powi(2);
    let distance = |pose: &Pose, i: usize| {
        let (point, ray) = &points[i];
        let there = pose * point;
        if there.z <= 0.0 { f64::INFINITY } else { (there.coords.xy() / there.z - ray.xy()).norm_squared() }
    };
    let models = |chosen: [usize; 3]| p3p(chosen.map(|i| points[i].0), chosen.map(|i| points[i].1));
    msac(points.len(), limit, ransac, models, distance, |pose, score| (pose, score))
}
