//! Scores of the methods of a scene and of their controls.

use crate::program::args::{CropName, PixelArgs};
use crate::program::evaluation::method::{Method, PRIOR};
use crate::program::evaluation::store::{Kept, Store};
use anyhow::{Context, Result};
use mde_eval::align::{Alignment, AlignmentRule};
use mde_eval::baseline::Unsharp;
use mde_eval::baseline::sigma::TrivialSigma;
use mde_eval::data::Sample;
use mde_eval::score::{ScoreConfig, Scores, Subject, TruthCache, score, score_aligned, score_uncertainty};
use mde_eval::table::Entry;
use mde_eval::{Method as _, Task};
use mde_prior::DisparityRule;
use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Rows and columns of NYU's 640x480 that Eigen et al. score.
const EIGEN_CROP: [usize; 4] = [45, 471, 41, 601];

/// Changes with the definition of a score, so that kept scores are computed again.
const DEFINITIONS: u32 = 3;

/// Separates a method's name from that of a trivial sigma.
pub(crate) const SIGMA_BY: &str = ", sigma by ";
/// Begins the name of the unsharp mask of equal sharpness.
pub(crate) const UNSHARP: &str = "unsharp as sharp as ";

/// How maps are scored.
pub(crate) struct Scoring {
    /// Settings; the data set may replace the largest depth.
    pub(crate) config: ScoreConfig,
    /// Whether the command line names the largest depth.
    pub(crate) own_range: bool,
    /// Whether every method is scored under the prior's alignment.
    pub(crate) shared: bool,
    /// Whether trivial sigmas and the unsharp mask of equal sharpness are scored beside the methods.
    pub(crate) controls: bool,
}

/// Scores with everything that they depend on, stored beside the maps.
#[derive(Serialize, Deserialize)]
struct Scored {
    made_from: Value,
    entries: Vec<Entry>,
}

impl Scoring {
    pub(crate) fn new((alignment, shared): (AlignmentRule, bool), pixels: PixelArgs, controls: bool) -> Self {
        let plain = ScoreConfig::default();
        let config = ScoreConfig {
            max_depth: pixels.max_depth.unwrap_or(plain.max_depth),
            crop: pixels.crop.map(|CropName::Eigen| EIGEN_CROP),
            alignment,
            ..plain
        };
        Self { config, own_range: pixels.max_depth.is_some(), shared, controls }
    }

    /// Describes the alignment and the scored pixels, for the tables.
    pub(crate) fn alignment_note(&self) -> String {
        let ScoreConfig { alignment, min_depth, max_depth, crop, .. } = &self.config;
        let whose = if self.shared { "the prior's, for all methods" } else { "each map its own" };
        let range = if self.own_range {
            format!("{min_depth} to {max_depth} m")
        } else {
            format!("{min_depth} m to the data set's own limit ({max_depth} m where it names none)")
        };
        let crop = if crop.is_some() { ", within Eigen's crop" } else { "" };
        format!("Alignment: {alignment}, {whose}. True depths from {range}{crop}.")
    }

    /// Scores every method of a scene; its controls follow it.
    pub(crate) fn scene(
        &self,
        sample: &Sample,
        made: &[(&Method, Kept)],
        store: &Store,
    ) -> Result<Vec<Entry>> {
        let mut config = self.config.clone();
        if !self.own_range && sample.trusted_depth.is_finite() {
            config.max_depth = sample.trusted_depth;
        }
        let Some((_, prior)) = made.first() else { return Ok(Vec::new()) };
        let (id, truth) = (&sample.id, crc(sample.depth.view()));
        store.keep_picture(id, sample.image.view())?;
        let prior_depth = prior.refined.depth.view();
        let shared = Subject::new(prior_depth, sample.depth.view()).fit(&config)?;
        let cache = TruthCache::default();
        let against = Against { scoring: self, sample, prior: prior_depth, config: &config, shared, cache };
        let mut entries = Vec::new();
        for (method, kept) in made {
            let made_from = json!({
                "maps": kept.made_from, "prior": prior.made_from, "truth": truth, "config": config,
                "shared": self.shared, "controls": self.controls, "version": env!("CARGO_PKG_VERSION"), "definitions": DEFINITIONS,
            });
            if let Some(scored) = store.scores::<Scored>(id, &method.name)
                && scored.made_from == made_from
            {
                entries.extend(scored.entries);
                continue;
            }
            let own = against.method(method, kept).with_context(|| method.name.clone())?;
            let scored = Scored { made_from, entries: own };
            store.keep_scores(id, &method.name, &scored)?;
            entries.extend(scored.entries);
        }
        Ok(entries)
    }
}

/// A scene and the prior's alignment.
struct Against<'a> {
    scoring: &'a Scoring,
    sample: &'a Sample,
    prior: ArrayView2<'a, f32>,
    config: &'a ScoreConfig,
    /// The prior's alignment.
    shared: Alignment,
    /// The truth's edges and superpixels.
    cache: TruthCache,
}

impl Against<'_> {
    fn method(&self, method: &Method, kept: &Kept) -> Result<Vec<Entry>> {
        let (depth, sigma) = (kept.refined.depth.view(), kept.refined.sigma.as_ref());
        let mut own = self.entry(depth, sigma, &method.label)?;
        own.set("seconds", kept.seconds);
        let mut entries = vec![own];
        if self.scoring.controls && method.config().is_some() {
            // The unsharp mask of the prior that is as sharp.
            let rule = DisparityRule::default();
            let task = Task::new(self.sample.image.view(), &self.sample.camera, self.prior, &rule);
            let unsharp = Unsharp::matching(self.prior, depth)?.refine(&task)?;
            let name = format!("{UNSHARP}{}", method.label);
            entries.push(self.entry(unsharp.depth.view(), None, &name)?);
        }
        if self.scoring.controls && (method.name == PRIOR || sigma.is_some()) {
            entries.extend(self.trivial_sigmas(depth, &entries[0])?);
        }
        entries.iter_mut().for_each(|entry| entry.seed = method.seed);
        Ok(entries)
    }

    fn entry(&self, depth: ArrayView2<'_, f32>, sigma: Option<&Array2<f32>>, name: &str) -> Result<Entry> {
        let mut subject = Subject::new(depth, self.sample.depth.view());
        (subject.sigma, subject.cache) = (sigma.map(|sigma| sigma.view()), Some(&self.cache));
        let scores = match self.scoring.shared {
            true => score_aligned(&subject, &self.shared, self.config)?,
            false => score(&subject, self.config)?,
        };
        let mut entry = Entry::new(&self.sample.id, name, scores);
        entry.set_shared(&subject, &self.shared, self.config)?;
        Ok(entry)
    }

    /// Scores of trivial sigmas for `depth`, whose entry is `of`.
    fn trivial_sigmas(&self, depth: ArrayView2<'_, f32>, of: &Entry) -> Result<Vec<Entry>> {
        let truth = self.sample.depth.view();
        let alignment = match self.scoring.shared {
            true => self.shared,
            false => Subject::new(depth, truth).fit(self.config)?,
        };
        let mut entries = Vec::new();
        for trivial in TrivialSigma::ALL {
            let sigma = trivial.map(depth, self.sample.image.view())?;
            let subject = Subject::new(depth, truth).with_sigma(sigma.view());
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

fn crc(map: ArrayView2<'_, f32>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    map.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    hasher.finalize()
}
