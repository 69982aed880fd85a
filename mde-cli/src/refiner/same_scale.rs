//! One scale for the network's depth of many photographs.

use crate::config::Config;
use crate::error::Result;
use crate::scene::{KnownCamera, SameScale, within};
use mde_mvs::poses::{LogFactor, PoseInput, Prepared, ScaleMatches};
use mde_prior::resample::{nearest, shrink};
use mde_prior::{DepthPrior, DisparityRule};
use mde_uncertainty::random::derived_seed;
use ndarray::ArrayView3;

/// Longer side at which photographs are matched.
const LONGER_SIDE: usize = 640;
/// Features of a photograph; a ratio needs fewer than a pose.
const FEATURES: usize = 1500;
/// Error of a whole photograph's factor over that of its common part: the median of two networks on 13 captures (docs/guide.md).
const WHOLE: f64 = 2.2;

/// The factors that bring the network's depth of many photographs to one scale.
///
/// Each photograph needs one prediction, and its features at 640 pixels on the longer side.
#[derive(Debug)]
pub struct OneScale {
    disparity: DisparityRule,
    /// What they have in common.
    pub matches: ScaleMatches,
}

impl OneScale {
    /// That of so many photographs; of the settings, it depends on the seed and the conversion of disparity.
    pub fn new(photographs: usize, config: &Config) -> Self {
        let seed = derived_seed(config.seed, "same-scale", 0);
        Self { disparity: config.disparity.clone(), matches: ScaleMatches::new(photographs, seed) }
    }

    /// The features of a photograph, sRGB in 0 to 1 `[height, width, 3]`, and a prediction of its depth.
    ///
    /// # Errors
    /// [`Error::Prior`](crate::error::Error::Prior) where the network fails, [`Error::Warp`](crate::error::Error::Warp) and
    /// [`Error::MultiView`](crate::error::Error::MultiView) for an image too small, or a camera of another size.
    pub fn prepare(
        &self,
        image: ArrayView3<'_, f32>,
        camera: &KnownCamera,
        prior: &dyn DepthPrior,
    ) -> Result<Prepared> {
        let depth = prior.predict(image)?.to_depth(&self.disparity)?;
        let (height, width, _) = image.dim();
        let size = within((height, width), LONGER_SIDE);
        let (image, depth) = (shrink(image, size), nearest(depth.view(), size).into_shared());
        let photograph = PoseInput {
            image: image.view(),
            camera: camera.camera.resized(size.1, size.0)?,
            focal_assumed: camera.is_assumed(),
            prior: Some(&depth),
        };
        Ok(Prepared::new(&photograph, FEATURES)?)
    }

    /// The factor of each photograph.
    ///
    /// # Errors
    /// [`Error::MultiView`](crate::error::Error::MultiView) for a ratio that is not finite.
    pub fn factors(&self) -> Result<Vec<SameScale>> {
        let of_group = |found: LogFactor| SameScale {
            factor: found.log.exp(),
            log_sigma: WHOLE * found.sigma,
            group: found.component,
            photographs: found.photographs,
        };
        Ok(self.matches.factors()?.into_iter().map(of_group).collect())
    }
}

/// A warning where the factors of photographs are of several groups; `place` has the group of each.
pub fn groups_warning(factors: &[SameScale], place: &str) -> Option<String> {
    let alone = factors.iter().filter(|factor| factor.is_alone()).count();
    let groups = factors.iter().map(|factor| factor.group + 1).max().unwrap_or(0) - alone;
    (groups > 1).then(|| {
        format!(
            "{{same-scale}}: the photographs are {groups} groups without a match between them, each on a scale of its own; {place} has the \
             group of each"
        )
    })
}
