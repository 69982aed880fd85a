//! The scores of every method of one scene, with the controls that stand beside them.

use super::method::{Method, PRIOR};
use super::runner::SceneResult;
use super::store::{Entry as Kept, Store};
use crate::args::ScoreArgs;
use anyhow::{Context, Result};
use mde_eval::align::Alignment;
use mde_eval::baseline::Unsharp;
use mde_eval::baseline::sigma::TrivialSigma;
use mde_eval::data::Sample;
use mde_eval::score::{ScoreConfig, Subject, curves, score, score_aligned, score_uncertainty};
use mde_eval::table::{Entry, SharedErrors};
use mde_eval::{Refiner, Task};
use mde_prior::DisparityRule;
use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Rows and columns of NYU's 640x480 that Eigen et al. score.
const EIGEN_CROP: [usize; 4] = [45, 471, 41, 601];

/// Between a method's name and that of a sigma that is not its own.
pub(crate) const SIGMA_BY: &str = ", sigma by ";

/// How maps are scored.
pub(crate) struct Scoring {
    /// But for the depths to trust, which the data set may know.
    pub(crate) config: ScoreConfig,
    /// Whether the command line names the largest depth.
    pub(crate) own_range: bool,
    /// Every method under the prior's alignment.
    pub(crate) shared: bool,
    /// Whether the trivial sigmas and the unsharp mask of equal sharpness stand beside the methods.
    pub(crate) controls: bool,
}

/// Scores with all that they depend on, kept beside the maps.
#[derive(Serialize, Deserialize)]
struct Scored {
    made_from: Value,
    entries: Vec<Entry>,
}

impl Scoring {
    pub(crate) fn new(args: &ScoreArgs, controls: bool) -> Self {
        let plain = ScoreConfig::default();
        let config = ScoreConfig {
            min_depth: args.min_depth.unwrap_or(plain.min_depth),
            max_depth: args.max_depth.unwrap_or(plain.max_depth),
            crop: args.eigen_crop.then_some(EIGEN_CROP),
            alignment: args.alignment.into(),
            ..plain
        };
        Self { config, own_range: args.max_depth.is_some(), shared: args.shared_alignment, controls }
    }

    /// What the tables say of the alignment and the pixels that count.
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

    fn config(&self, sample: &Sample) -> ScoreConfig {
        let mut config = self.config.clone();
        if !self.own_range && sample.trusted_depth.is_finite() {
            config.max_depth = sample.trusted_depth;
        }
        config
    }

    /// Every method of a scene, the controls after the method that they belong to.
    pub(crate) fn scene(&self, result: &SceneResult<'_>, store: &Store) -> Result<Vec<Entry>> {
        let config = self.config(result.sample);
        let Some((_, prior)) = result.entries.first() else { return Ok(Vec::new()) };
        let prior_map = prior.refined.depth.view();
        let shared = subject(prior_map, result.sample).fit(&config)?;
        let truth = crc(result.sample.depth.view());
        let mut entries = Vec::new();
        for (method, kept) in &result.entries {
            let made_from = json!({
                "maps": kept.record.made_from, "prior": prior.record.made_from, "truth": truth, "config": config,
                "shared": self.shared, "controls": self.controls, "version": env!("CARGO_PKG_VERSION"),
            });
            let id = &result.sample.id;
            if let Some(scored) = store.scores::<Scored>(id, &method.name)
                && scored.made_from == made_from
            {
                entries.extend(scored.entries);
                continue;
            }
            let own = self
                .method(result, method, kept, prior_map, &shared, &config)
                .with_context(|| method.name.clone())?;
            let scored = Scored { made_from, entries: own };
            store.keep_scores(id, &method.name, &scored)?;
            entries.extend(scored.entries);
        }
        Ok(entries)
    }

    fn method(
        &self,
        result: &SceneResult<'_>,
        method: &Method,
        kept: &Kept,
        prior: ArrayView2<'_, f32>,
        shared: &Alignment,
        config: &ScoreConfig,
    ) -> Result<Vec<Entry>> {
        let sample = result.sample;
        let depth = kept.refined.depth.view();
        let of = |depth: ArrayView2<'_, f32>, sigma: Option<&Array2<f32>>, name: &str| -> Result<Entry> {
            let mut subject = subject(depth, sample);
            subject.sigma = sigma.map(|sigma| sigma.view());
            let scores =
                if self.shared { score_aligned(&subject, shared, config)? } else { score(&subject, config)? };
            let alignment = scores.alignment;
            let mut entry = Entry::new(&sample.id, name, scores);
            entry.curves = curves(&subject, &alignment, config)?;
            entry.shared = Some(SharedErrors::of(&subject, shared, config)?);
            Ok(entry)
        };
        let mut own = of(depth, kept.refined.sigma.as_ref(), &method.label)?;
        own.seconds = Some(kept.record.seconds);
        let mut entries = vec![own];
        if !self.controls {
            entries.iter_mut().for_each(|entry| entry.seed = method.seed);
            return Ok(entries);
        }
        if method.is_loop() {
            let task = Task {
                image: sample.image.view(),
                camera: &sample.camera,
                prior,
                model: None,
                rule: &DisparityRule::default(),
                seed: method.seed,
            };
            let unsharp = Unsharp::matching(prior, depth)?.refine(&task)?;
            entries.push(of(unsharp.depth.view(), None, &format!("unsharp as sharp as {}", method.label))?);
        }
        if method.name == PRIOR || kept.refined.sigma.is_some() {
            for trivial in TrivialSigma::ALL {
                let sigma = trivial.map(depth, sample.image.view())?;
                let subject = subject(depth, sample).with_sigma(sigma.view());
                let alignment = if self.shared { *shared } else { subject.fit(config)? };
                let Some((uncertainty, curves)) = score_uncertainty(&subject, &alignment, config)? else {
                    continue;
                };
                let name = format!("{}{SIGMA_BY}{}", method.label, trivial.name());
                let entry = Entry::of_uncertainty(&entries[0], name, uncertainty, curves);
                entries.push(entry);
            }
        }
        entries.iter_mut().for_each(|entry| entry.seed = method.seed);
        Ok(entries)
    }
}

fn subject<'a>(depth: ArrayView2<'a, f32>, sample: &'a Sample) -> Subject<'a> {
    Subject::new(depth, sample.depth.view())
}

fn crc(map: ArrayView2<'_, f32>) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    map.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
    hasher.finalize()
}
