//! The entries of a scene: its maps, and their controls, which show what trivial means reach.

use crate::align::Alignment;
use crate::baseline::Unsharp;
use crate::baseline::sigma::TrivialSigma;
use crate::raster::Map;
use crate::score::{ScoreConfig, Scores, Subject, TruthCache, score, score_aligned, score_uncertainty};
use crate::table::Entry;
use crate::table::verdict::{SIGMA_BY, UNSHARP};
use crate::{Method as _, Refined, Result, Task};

/// The controls that are scored beside a map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Controls {
    /// The unsharp mask of the prior that is as sharp.
    pub unsharp: bool,
    /// Trivial sigmas.
    pub sigmas: bool,
}

/// A scene whose maps are scored.
pub struct ScoredScene<'a> {
    id: &'a str,
    /// Photograph, camera and prior.
    task: Task<'a>,
    truth: Map<'a>,
    config: &'a ScoreConfig,
    /// The prior's alignment.
    shared: Alignment,
    /// Whether every map is scored under it.
    is_shared: bool,
    /// The truth's edges and superpixels.
    cache: TruthCache,
}

impl<'a> ScoredScene<'a> {
    /// The scene of that name with its photograph and prior, and its truth `[height, width]`, metres, 0 where missing. With `is_shared` every
    /// map is scored under the prior's alignment, else each under its own.
    ///
    /// # Errors
    /// As [`Subject::fit`].
    pub fn new(
        id: &'a str,
        task: Task<'a>,
        truth: Map<'a>,
        config: &'a ScoreConfig,
        is_shared: bool,
    ) -> Result<Self> {
        let shared = Subject::new(task.prior, truth).fit(config)?;
        Ok(Self { id, task, truth, config, shared, is_shared, cache: TruthCache::default() })
    }

    /// The entry of a method's map; then, as its controls, the prior's [unsharp mask](Unsharp::matching) that is as sharp, and the
    /// [trivial sigmas](TrivialSigma) that are defined for the map.
    ///
    /// # Errors
    /// As [`score`](score()).
    pub fn entries(&self, method: &str, refined: &Refined, controls: Controls) -> Result<Vec<Entry>> {
        let (depth, sigma) = (refined.depth.view(), refined.sigma.as_ref());
        let mut entries = vec![self.entry(method, depth, sigma.map(|sigma| sigma.view()))?];
        if controls.unsharp {
            let unsharp = Unsharp::matching(self.task.prior, depth)?.refine(&self.task)?;
            entries.push(self.entry(&format!("{UNSHARP}{method}"), unsharp.depth.view(), None)?);
        }
        if controls.sigmas {
            let alignment = match self.is_shared {
                true => self.shared,
                false => Subject::new(depth, self.truth).fit(self.config)?,
            };
            for trivial in TrivialSigma::ALL {
                let sigma = trivial.map(depth, self.task.image)?;
                let subject = Subject::new(depth, self.truth).with_sigma(sigma.view());
                let Scores { values, curves, .. } = score_uncertainty(&subject, &alignment, self.config)?;
                if curves.is_some() {
                    let method = format!("{method}{SIGMA_BY}{}", trivial.name());
                    entries.push(Entry { method, values, curves, ..entries[0].clone() });
                }
            }
        }
        Ok(entries)
    }

    fn entry(&self, method: &str, depth: Map<'_>, sigma: Option<Map<'_>>) -> Result<Entry> {
        let subject = Subject { sigma, cache: Some(&self.cache), ..Subject::new(depth, self.truth) };
        let scores = match self.is_shared {
            true => score_aligned(&subject, &self.shared, self.config)?,
            false => score(&subject, self.config)?,
        };
        Ok(Entry::new(self.id, method, scores))
    }
}
