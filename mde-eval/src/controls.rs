//! The entries of a scene: its maps, and their controls, which show what trivial means reach.

use crate::align::Alignment;
use crate::baseline::Unsharp;
use crate::baseline::sigma::TrivialSigma;
use crate::score::{ScoreConfig, Scores, Subject, score, score_aligned, score_uncertainty};
use crate::table::Entry;
use crate::table::verdict::{SIGMA_BY, UNSHARP};
use crate::{Method as _, Result, Task};
use ndarray::ArrayView2;

/// A scene whose maps are scored.
pub struct ScoredScene<'a> {
    id: &'a str,
    /// Photograph, camera and prior.
    task: Task<'a>,
    truth: ArrayView2<'a, f32>,
    config: &'a ScoreConfig,
    /// The prior's alignment.
    shared: Alignment,
    /// Whether every map is scored under it.
    is_shared: bool,
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
        truth: ArrayView2<'a, f32>,
        config: &'a ScoreConfig,
        is_shared: bool,
    ) -> Result<Self> {
        let shared = Subject::new(task.prior, truth).fit(config)?;
        Ok(Self { id, task, truth, config, shared, is_shared })
    }

    /// The entry of a map with its standard deviation, both `[height, width]`.
    ///
    /// # Errors
    /// As [`score`].
    pub fn entry(
        &self,
        method: &str,
        depth: ArrayView2<'_, f32>,
        sigma: Option<ArrayView2<'_, f32>>,
    ) -> Result<Entry> {
        let subject = Subject { sigma, ..Subject::new(depth, self.truth) };
        let scores = match self.is_shared {
            true => score_aligned(&subject, &self.shared, self.config)?,
            false => score(&subject, self.config)?,
        };
        let mut entry = Entry::new(self.id, method, scores);
        entry.set_shared(&subject, &self.shared, self.config)?;
        Ok(entry)
    }

    /// The entry of the prior's [unsharp mask](Unsharp::matching) that is as sharp as the map of `method`.
    ///
    /// # Errors
    /// As [`score`].
    pub fn unsharp(&self, method: &str, depth: ArrayView2<'_, f32>) -> Result<Entry> {
        let unsharp = Unsharp::matching(self.task.prior, depth)?.refine(&self.task)?;
        self.entry(&format!("{UNSHARP}{method}"), unsharp.depth.view(), None)
    }

    /// The entries of the [trivial sigmas](TrivialSigma) that are defined for a map, whose own entry is `of`.
    ///
    /// # Errors
    /// As [`score_uncertainty`].
    pub fn trivial_sigmas(&self, depth: ArrayView2<'_, f32>, of: &Entry) -> Result<Vec<Entry>> {
        let alignment = match self.is_shared {
            true => self.shared,
            false => Subject::new(depth, self.truth).fit(self.config)?,
        };
        let mut entries = Vec::new();
        for trivial in TrivialSigma::ALL {
            let sigma = trivial.map(depth, self.task.image)?;
            let subject = Subject::new(depth, self.truth).with_sigma(sigma.view());
            let scores = score_uncertainty(&subject, &alignment, self.config)?;
            if scores.curves.is_some() {
                let method = format!("{}{SIGMA_BY}{}", of.method, trivial.name());
                let Scores { values, curves, .. } = scores;
                entries.push(Entry { method, values, curves, ..of.clone() });
            }
        }
        Ok(entries)
    }
}
