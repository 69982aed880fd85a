//! One scale for the network's depth of many photographs.

use crate::config::Config;
use crate::error::Result;
use crate::scene::SameScale;
use crate::scene::camera::KnownCamera;
use crate::scene::size::within;
use mde_mvs::poses::{LogFactor, LogRatio, PoseInput, Prepared, common_scale};
use mde_prior::resample::{nearest, shrink};
use mde_prior::{DepthPrior, DisparityRule};
use mde_uncertainty::random::derived_seed;
use ndarray::ArrayView3;
use std::sync::Arc;

/// Photographs before it that each is matched with.
const NEXT: usize = 3;
/// Photographs at most that are all matched with each other: up to so many need no order.
const KEYS: usize = 16;
/// Longer side at which photographs are matched.
const LONGER_SIDE: usize = 640;
/// Features of a photograph; a ratio needs fewer than a pose.
const FEATURES: usize = 1500;

/// Error of a whole photograph's factor over that by what it has in common with others: the median of two networks on 13 captures
/// (docs/guide.md).
const WHOLE: f64 = 2.2;

/// A photograph that is compared with later ones.
type Kept = (usize, Arc<Prepared>);

/// Two photographs that are to be compared.
#[derive(Debug, Clone)]
pub struct Pair([Kept; 2]);

/// The factors that bring the network's depth of many photographs to one scale.
///
/// Each photograph needs one prediction, and its features at 640 pixels on the longer side. It is compared with the 3 before it, and
/// up to 16 photographs, evenly spread over all, with each other; no more than these are kept. The factors depend on the photographs, their
/// order, and the seed alone.
#[derive(Debug)]
pub struct OneScale {
    disparity: DisparityRule,
    seed: u64,
    photographs: usize,
    /// Photographs from one that is matched with all such to the next.
    stride: usize,
    added: usize,
    /// In their order: the last, and those that are matched with all such.
    kept: Vec<Kept>,
    ratios: Vec<LogRatio>,
}

impl OneScale {
    /// That of so many photographs; of the settings, it depends on the seed and the conversion of disparity.
    pub fn new(photographs: usize, config: &Config) -> Self {
        Self {
            disparity: config.disparity.clone(),
            seed: derived_seed(config.seed, "same-scale", 0),
            photographs,
            stride: photographs.div_ceil(KEYS).max(1),
            added: 0,
            kept: Vec::new(),
            ratios: Vec::new(),
        }
    }

    /// The features of a photograph, sRGB in 0 to 1 `[height, width, 3]`, and a prediction of its depth. Photographs may be prepared side
    /// by side.
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
        let (image, depth) = (shrink(image, size), nearest(depth.view(), size));
        let photograph = PoseInput {
            image: image.view(),
            camera: camera.camera.resized(size.1, size.0)?,
            focal_assumed: camera.is_assumed(),
            prior: Some(depth.view()),
        };
        Ok(Prepared::new(&photograph, FEATURES)?)
    }

    /// Adds the next photograph, nothing where it could not be prepared. The result are the pairs to compare.
    pub fn add(&mut self, prepared: Option<Prepared>) -> Vec<Pair> {
        let index = self.added;
        self.added += 1;
        let Some(prepared) = prepared else { return Vec::new() };
        let new: Kept = (index, Arc::new(prepared));
        let is_key = |index: usize| index.is_multiple_of(self.stride);
        let last = self.kept.len().saturating_sub(NEXT);
        let others = self.kept.iter().enumerate();
        let others = others.filter(|(place, (old, _))| *place >= last || is_key(index) && is_key(*old));
        let pairs = others.map(|(_, old)| Pair([old.clone(), new.clone()])).collect();
        self.kept.push(new);
        if let Some(left) = self.kept.len().checked_sub(NEXT + 1)
            && !is_key(self.kept[left].0)
        {
            self.kept.remove(left);
        }
        pairs
    }

    /// The ratio of a pair's scales; nothing where the two share too little. Pairs may be compared side by side.
    pub fn ratio(&self, Pair([(first, a), (second, b)]): &Pair) -> Option<LogRatio> {
        let ratio = Prepared::log_ratio(a, b, self.seed);
        ratio.map(|[log, sigma]| LogRatio { first: *first, second: *second, log, sigma })
    }

    /// Adds ratios, in any order.
    pub fn extend(&mut self, ratios: impl IntoIterator<Item = LogRatio>) {
        self.ratios.extend(ratios);
    }

    /// Ratios so far.
    pub fn matches(&self) -> usize {
        self.ratios.len()
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
        Ok(common_scale(self.photographs, &self.ratios)?.into_iter().map(of_group).collect())
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
