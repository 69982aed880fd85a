//! One configuration for a whole run, with its defaults in one place: [`Preset`](crate::Preset).

mod presets;
mod sigma;

pub use presets::Preset;
pub use sigma::SigmaConfig;

use crate::{Error, Result};
use mde_fusion::FusionConfig;
use mde_nerf::NerfConfig;
use mde_prior::{AugmentationConfig, DisparityRule};
use mde_warp::{ReprojectConfig, ViewSampling, WarpConfig};
use serde::{Deserialize, Serialize};
use std::path::Path;
use toml::{Table, Value};

/// Everything that a run depends on beside its inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Config {
    /// Every random draw comes from it.
    pub seed: u64,
    /// The iterative loop around the stages.
    pub refinement: RefinementConfig,
    /// Test-time augmentation of the model (Section III.B uses a single prediction).
    pub augmentation: AugmentationConfig,
    /// Uncertainty of the augmented depth.
    pub sigma: SigmaConfig,
    /// The synthetic training views (Section III.A).
    pub views: ViewSampling,
    /// How they are warped.
    pub warp: WarpConfig,
    /// The radiance field (Section III.C).
    pub nerf: NerfConfig,
    /// The views that the fitted field renders (Section III.D).
    pub novel: NovelViews,
    /// How those come back to the original camera.
    pub reproject: ReprojectConfig,
    /// The fusion (Section III.E).
    pub fusion: FusionConfig,
    /// How disparity of unknown scale and shift becomes depth (Section III.B).
    pub disparity: DisparityRule,
}

/// The iterative loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RefinementConfig {
    /// Times round the loop; 0 for none: no field is fitted, and what the prior's stage says stands.
    pub iterations: usize,
    /// What the fusion takes as its prior from the second iteration on.
    pub prior: IterationPrior,
    /// Whether a field is fitted where the prior was augmented.
    pub field: FieldUse,
}

impl Default for RefinementConfig {
    fn default() -> Self {
        Self { iterations: 2, prior: IterationPrior::Carry, field: FieldUse::Always }
    }
}

impl RefinementConfig {
    /// Whether a field is fitted, given whether the prior was augmented.
    pub(crate) fn fits_a_field(&self, augmented: bool) -> bool {
        self.iterations > 0 && (self.field == FieldUse::Always || !augmented)
    }
}

/// Whether a field is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FieldUse {
    /// In every run.
    #[default]
    Always,
    /// Only where the prior is not augmented. Measured on photographs, a field fitted after the augmentation lowers no error and
    /// blurs edges, since its views are warps of the same photograph.
    WithoutAugmentation,
}

/// The fusion's prior from the second iteration on; the refined depth always makes the next warps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IterationPrior {
    /// The refined depth with its variance per pixel, as the paper says: "which initialize the next cycle".
    #[default]
    Carry,
    /// The original monocular depth, its variance estimated anew: no image is counted twice.
    Anchor,
}

/// The views that the fitted field renders; [`Config::views`] says how far from the original pose they are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct NovelViews {
    /// Number of fresh poses, the paper's K.
    pub count: usize,
    /// Whether the original pose is rendered too.
    pub original: bool,
}

impl Default for NovelViews {
    fn default() -> Self {
        Self { count: 5, original: false }
    }
}

impl Default for Config {
    /// The preset [`Preset::Paper`](crate::Preset::Paper).
    fn default() -> Self {
        Self {
            seed: 0,
            refinement: RefinementConfig::default(),
            augmentation: AugmentationConfig::default(),
            sigma: SigmaConfig::default(),
            views: ViewSampling::default(),
            warp: WarpConfig::default(),
            nerf: NerfConfig::default(),
            novel: NovelViews::default(),
            reproject: ReprojectConfig::default(),
            fusion: FusionConfig::default(),
            disparity: DisparityRule::default(),
        }
    }
}

impl Config {
    /// The preset with the values of a TOML text over it. `origin` names the text in errors.
    ///
    /// # Errors
    /// [`Error::Config`] for text that is no TOML, an unknown key, a value of the wrong type or out of range.
    pub fn with_overrides(preset: crate::Preset, text: &str, origin: &str) -> Result<Self> {
        let error = |reason: String| Error::Config { origin: origin.to_owned(), reason: one_line(&reason) };
        let overrides: Table = text.parse().map_err(|e: toml::de::Error| error(e.to_string()))?;
        let mut table = Table::try_from(preset.config()).map_err(|e| error(e.to_string()))?;
        merge(&mut table, overrides.clone());
        let config: Self =
            Value::Table(table).try_into().map_err(|e: toml::de::Error| error(e.to_string()))?;
        // Serde takes no notice of unknown keys where a `kind` chooses the table.
        let known = Table::try_from(&config).map_err(|e| error(e.to_string()))?;
        if let Some(key) = unknown(&overrides, &known) {
            return Err(error(format!("unknown key `{key}`; `mde config` prints all that there are")));
        }
        config.validate().map_err(|e| error(e.to_string()))?;
        Ok(config)
    }

    /// The preset with the values of a TOML file over it.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read, else as [`Config::with_overrides`].
    pub fn from_file(preset: crate::Preset, path: &Path) -> Result<Self> {
        let text =
            std::fs::read_to_string(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
        Self::with_overrides(preset, &text, &path.display().to_string())
    }

    /// The whole configuration as TOML.
    ///
    /// # Errors
    /// [`Error::Config`] where a value has no place in TOML (a seed above 2^63).
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string_pretty(self)
            .map_err(|e| Error::Config { origin: "config".into(), reason: one_line(&e.to_string()) })
    }

    /// The poses of the novel views. Poses that only rotate carry no depth, so there are none.
    pub(crate) fn novel_views(&self) -> ViewSampling {
        ViewSampling { count: self.novel.count, rotation_only: 0.0, ..self.views.clone() }
    }

    /// Checks every value of every stage.
    ///
    /// # Errors
    /// The stage's error that names the value, or [`Error::Config`].
    pub fn validate(&self) -> Result<()> {
        let iterations = self.refinement.iterations;
        if iterations > 100 {
            let reason = format!("refinement.iterations is {iterations}; give 0 (no field) to 100");
            return Err(Error::Config { origin: "config".into(), reason });
        }
        if self.novel.count == 0 && !self.novel.original {
            let reason = "novel.count is 0 and novel.original is false; render at least one view".into();
            return Err(Error::Config { origin: "config".into(), reason });
        }
        self.augmentation.validate()?;
        self.sigma.validate()?;
        self.views.validate()?;
        self.novel_views().validate()?;
        self.warp.validate()?;
        self.reproject.validate()?;
        self.nerf.validate()?;
        self.fusion.validate()?;
        self.disparity.validate()?;
        Ok(())
    }
}

/// Puts `from`'s values over `into`'s, table by table. A table of another `kind` replaces the old one whole: the kinds'
/// keys differ.
fn merge(into: &mut Table, from: Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => {
                if new.get("kind").is_some_and(|kind| old.get("kind") != Some(kind)) {
                    *old = new;
                } else {
                    merge(old, new);
                }
            }
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

/// The first key of `table` that `known` does not have.
fn unknown(table: &Table, known: &Table) -> Option<String> {
    table.iter().find_map(|(key, value)| match (value, known.get(key)) {
        (_, None) => Some(key.clone()),
        (Value::Table(inner), Some(Value::Table(known))) => {
            unknown(inner, known).map(|rest| format!("{key}.{rest}"))
        }
        _ => None,
    })
}

/// Parser messages span lines to show the place; an error is one.
fn one_line(message: &str) -> String {
    message.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_nerf::FieldConfig;

    #[test]
    fn every_preset_is_valid_and_survives_toml() {
        for preset in Preset::ALL {
            let config = preset.config();
            config.validate().unwrap();
            assert_eq!(Config::with_overrides(preset, &config.to_toml().unwrap(), "test").unwrap(), config);
        }
        assert_eq!(Preset::Paper.config(), Config::default());
    }

    #[test]
    fn overrides_change_what_they_name_and_nothing_else() {
        let text = "seed = 9\n[nerf.train]\nsteps = 7\n";
        let config = Config::with_overrides(Preset::Paper, text, "test").unwrap();
        let mut expected = Preset::Paper.config();
        expected.seed = 9;
        expected.nerf.train.steps = 7;
        assert_eq!(config, expected);
    }

    #[test]
    fn another_kind_of_field_starts_from_its_own_defaults() {
        let text = "[nerf.field]\nkind = \"hash\"\nlevels = 6\n";
        let config = Config::with_overrides(Preset::Paper, text, "test").unwrap();
        let FieldConfig::Hash(hash) = config.nerf.field else { panic!("{:?}", config.nerf.field) };
        assert_eq!((hash.levels, hash.features), (6, 4));
    }

    #[test]
    fn a_wrong_key_or_value_is_named_in_one_line() {
        for (text, named) in [
            ("[nerf.train]\nstep = 7\n", "step"),
            ("[nerf.train]\nsteps = \"many\"\n", "many"),
            ("[nerf.train]\nsteps = 0\n", "train.steps is 0"),
            ("[fusion]\ncalibration = \"magic\"\n", "magic"),
            ("[nerf.train.depth-loss]\nweights = 1.0\n", "`nerf.train.depth-loss.weights`"),
            ("[nerf.train.depth-loss]\nkind = \"none\"\nweight = 1.0\n", "`nerf.train.depth-loss.weight`"),
            ("[refinement]\niterations = 101\n", "refinement.iterations is 101"),
            ("[sigma]\nspread = -1.0\n", "sigma.spread is -1"),
            ("[augmentation]\ngain = 2.0\n", "augmentation.gain"),
            ("seed = = 3", "seed"),
        ] {
            let message = Config::with_overrides(Preset::Fast, text, "my.toml").unwrap_err().to_string();
            assert!(message.starts_with("my.toml: ") && message.contains(named), "{message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }
}
