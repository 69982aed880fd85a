//! Scores of the methods of a scene and of their controls.

use crate::program::evaluation::{Kept, Method, PRIOR, Store};
use crate::program::{CropName, PixelArgs};
use anyhow::{Context, Result};
use mde_eval::align::AlignmentRule;
use mde_eval::data::Sample;
use mde_eval::score::ScoreConfig;
use mde_eval::table::Entry;
use mde_eval::{Controls, ScoredScene, Task};
use mde_prior::DisparityRule;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Rows and columns of NYU's 640x480 that Eigen et al. score.
const EIGEN_CROP: [usize; 4] = [45, 471, 41, 601];
/// Changes with the definition of a score, so that kept scores are computed again.
const DEFINITIONS: u32 = 4;

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
        let depths: Vec<u8> = sample.depth.iter().flat_map(|z| z.to_le_bytes()).collect();
        let (id, truth) = (&sample.id, crc32fast::hash(&depths));
        store.keep_picture(id, sample.image.view())?;
        let rule = DisparityRule::default();
        let task = Task::new(sample.image.view(), &sample.camera, prior.refined.depth.view(), &rule);
        let scene = ScoredScene::new(id, task, sample.depth.view(), &config, self.shared)?;
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
            let sigmas = self.controls && (method.name == PRIOR || kept.refined.sigma.is_some());
            let controls = Controls { unsharp: self.controls && method.config().is_some(), sigmas };
            let own = scene.entries(&method.label, &kept.refined, controls);
            let mut own = own.with_context(|| method.name.clone())?;
            own[0].set("seconds", kept.seconds);
            own.iter_mut().for_each(|entry| entry.seed = method.seed);
            let scored = Scored { made_from, entries: own };
            store.keep_scores(id, &method.name, &scored)?;
            entries.extend(scored.entries);
        }
        Ok(entries)
    }
}
