//! Poses of photographs, found from matches and a monocular depth prior, or refined where they are given.
//!
//! [`estimate_poses`] needs no pose. SIFT features of each photograph are matched, of more than 12 photographs with those that share most
//! of the coarsest features, pairs of one epipolar geometry kept (a fundamental matrix by LO-RANSAC, for which no focal length is needed),
//! and the features of one photograph lifted by the prior's depth, so that three of them give the pose of the other (P3P in RANSAC). Of
//! more than 12 photographs a pair counts where a third confirms its rotation. The best pairs join all photographs to the reference; then
//! poses, depths, the scales of the priors and, where it was assumed, one common focal length are adjusted to all matches. With pixels
//! \\( p \\), rays \\( d \\), the prior \\( D \\) and Huber's loss \\( \rho \\):
//!
//! \\[ \min \sum_{k, v} \rho\left( \lVert \pi_v(T_v T_a^{-1} z_k d_k) - p_{kv} \rVert^2 \right)
//!   {}+ \sum_k \rho\left( \left( \frac{\log z_k - \log D_a(p_k) - m_a}{\sigma} \right)^2 \right) . \\]
//!
//! A photograph whose rotation stays uncertain has no pose ([`Verdict::Uncertain`]); one whose matches a turn on the spot explains as well,
//! with the focal length free where it is assumed, has no parallax ([`Verdict::NoParallax`]).
//!
//! The prior gives the start, the unit, and what matches leave open: over a short baseline depth and rotation trade for each
//! other, and without the prior the result may be off by degrees. Under a constant prior the adjustment starts thrice: from the pairs,
//! with near and far exchanged, and with each photograph posed anew by the points of those before it; the best fit to all matches is kept.
//!
//! [`refine_poses`] improves given poses by the same adjustment, with the poses themselves as a prior, and keeps the result only
//! where matches that had no part in it fit better.
//!
//! [`Prepared::log_ratio`] and [`common_scale`] need no poses: they bring the priors of a burst or a video to one scale.
//!
//! Poses map the reference's frame to the camera's, in the unit of the reference's prior.

mod bundle;
mod covariance;
mod cycles;
mod depth;
mod estimate;
mod features;
mod matching;
mod neighbours;
mod refine;
mod scale;
mod tracks;
mod turn;
mod two_view;

pub use covariance::PoseCovariance;
pub use depth::depth_variance;
pub use estimate::{Estimated, EstimatedPose, Verdict, estimate_poses};
pub use neighbours::nearest;
pub use refine::{Refined, refine_poses};
pub use scale::{LogFactor, LogRatio, MatchPair, ScaleMatches, common_scale};

use crate::{Callback, Result, centre, notify};
use bundle::Lens;
use features::Features;
use mde_uncertainty::OutOfRange;
use mde_warp::PinholeCamera;
use nalgebra::{Point2, Vector2};
use ndarray::{ArcArray2, ArrayView3};
use rayon::prelude::*;
use two_view::Pair;

/// Longer side of the photographs whose pixels all limits are in; they grow with a photograph.
const LONGER_SIDE: f64 = 640.0;

/// One photograph, and what is known of its camera and its depth.
#[derive(Debug, Clone, Copy)]
pub struct PoseInput<'a> {
    /// `[h, w, 3]` sRGB colours in \\( [0, 1] \\), without lens distortion.
    pub image: ArrayView3<'a, f32>,
    /// Its intrinsic parameters.
    pub camera: PinholeCamera,
    /// Whether the focal length was assumed: one factor, common to all such photographs, is then estimated.
    pub focal_assumed: bool,
    /// The prior's `[h, w]` z-depth, in any unit; 0 where there is none.
    pub prior: Option<&'a ArcArray2<f32>>,
}

/// Largest distance from the epipolar geometry, pixels of a photograph of [`LONGER_SIDE`], as all that follow.
const EPIPOLAR_PIXELS: f64 = 1.5;
/// Largest residual of a match after the adjustment, pixels.
const OUTLIER_PIXELS: f64 = 3.0;
/// Standard deviation of the logarithm of the prior's depth, until the matches measure it.
const PRIOR_SIGMA: f64 = 0.25;
/// The same of a map that is constant, which gives the unit and no shape; it is not measured, since poses bend to it where parallax is small.
const FLAT_SIGMA: f64 = 1.0;
/// Independent regions of a photograph. In each the prior has one error, and so has what a lens or a shutter does that is not the
/// model's: beyond this number matches add nothing, and sigmas grow by the root of matches over regions.
const REGIONS: f64 = 30.0;
/// Standard deviation of the logarithm of an assumed focal length. In the adjustment, where all matches count, it is divided by the
/// root of the number that share an error.
pub const FOCAL_SIGMA: f64 = 0.2;

/// Matches that a photograph needs.
const MIN_MATCHES: usize = 20;
/// Features of a photograph whose pose is estimated, at most.
const MAX_FEATURES: usize = 3000;
/// The same in a long capture, whose given poses need fewer: matching takes the square of them.
const MAX_FEATURES_OF_MANY: usize = 1500;

/// Features that each of so many photographs needs at most, by whether their poses are given.
pub fn max_features(photographs: usize, has_poses: bool) -> usize {
    if has_poses && photographs > neighbours::FEW { MAX_FEATURES_OF_MANY } else { MAX_FEATURES }
}

/// Root of the number of matches that share an error.
fn shared_error_factor(matches: usize) -> f64 {
    (matches as f64 / REGIONS).max(1.0).sqrt()
}

/// A photograph of which no more is kept than its matches with others need: features, camera, and the prior's depth.
#[derive(Debug)]
pub struct Prepared {
    features: Features,
    camera: PinholeCamera,
    lens: Lens,
    prior: Option<ArcArray2<f32>>,
}

impl Prepared {
    /// Finds at most so many features.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) for an image too small for features; [`View`](crate::Error::View) for a camera that is not of the
    /// image's or the prior's size.
    pub fn new(photograph: &PoseInput, max_features: usize) -> Result<Self> {
        let features = Features::detect(photograph.image, max_features)?;
        let camera = photograph.camera;
        camera.validate()?;
        let (height, width, _) = photograph.image.dim();
        camera.check_map("photograph", (height, width))?;
        if let Some(prior) = &photograph.prior {
            camera.check_map("prior depth", prior.dim())?;
        }
        let lens = Lens {
            focal: Vector2::new(camera.fx, camera.fy),
            centre: Vector2::new(camera.cx, camera.cy),
            assumed: photograph.focal_assumed,
            noise: width.max(height) as f64 / LONGER_SIDE,
        };
        Ok(Self { features, camera, lens, prior: photograph.prior.cloned() })
    }

    fn pixel(&self, feature: usize) -> Point2<f64> {
        self.features.keypoints[feature].pixel
    }

    /// Logarithm of the prior's depth at the nearest pixel.
    fn log_prior(&self, pixel: &Point2<f64>) -> Option<f64> {
        let prior = self.prior.as_ref()?;
        let nearest = |at: f64, size: usize| (at.round().max(0.0) as usize).min(size - 1);
        let depth = prior[(nearest(pixel.y, prior.nrows()), nearest(pixel.x, prior.ncols()))];
        (depth > 0.0 && depth.is_finite()).then(|| f64::from(depth).ln())
    }
}

/// The reference, or without one the first, then the others in the order given.
fn reference_first(photographs: &[Prepared], reference: Option<usize>) -> Result<Vec<&Prepared>> {
    let (count, reference) = (photographs.len(), reference.unwrap_or(0));
    OutOfRange::check(count >= 2, "number of photographs", &count, "give at least 2")?;
    let remedy = "give the index of one of the photographs";
    OutOfRange::check(reference < count, "reference", &reference, remedy)?;
    let mut sorted: Vec<_> = photographs.iter().collect();
    sorted[..=reference].rotate_right(1);
    Ok(sorted)
}

/// What those pairs of photographs have in common, some at once; the callback counts them.
fn compared(
    pairs: &[[usize; 2]],
    compare: impl Fn([usize; 2]) -> Pair + Sync,
    callback: &mut Callback<'_>,
) -> Result<Vec<Pair>> {
    let mut found = Vec::with_capacity(pairs.len());
    // Enough for each thread that the last ones seldom wait.
    for part in pairs.chunks(8 * rayon::current_num_threads()) {
        found.par_extend(part.par_iter().map(|pair| compare(*pair)));
        notify(callback, found.len(), pairs.len())?;
    }
    Ok(found)
}

#[cfg(test)]
mod tests;
