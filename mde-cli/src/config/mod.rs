//! The configuration of a run. The defaults are those of a [`Preset`]; `docs/settings.md` lists every key.

mod presets;

pub use presets::Preset;

use crate::error::{Error, Result, text};
use mde_fusion::FusionConfig;
use mde_nerf::NerfConfig;
use mde_prior::augment::Predictions;
use mde_prior::{AugmentationConfig, DisparityRule, FileKind, open};
use mde_warp::{ViewSampling, WarpConfig};
use serde::{Deserialize, Serialize};
use std::path::Path;
use toml::{Table, Value};

/// All settings of a run; the default is the preset [`Preset::Paper`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Config {
    /// Seed of all random draws.
    pub seed: u64,
    /// The iterative loop around the stages.
    pub refinement: RefinementConfig,
    /// Test-time augmentation of the model (Section III.B uses a single prediction).
    pub augmentation: AugmentationConfig,
    /// Uncertainty of the augmented depth.
    pub sigma: SigmaConfig,
    /// The synthetic training views (Section III.A).
    pub views: ViewSampling,
    /// The warps of the training views.
    pub warp: WarpConfig,
    /// The radiance field (Section III.C).
    pub nerf: NerfConfig,
    /// The views that the fitted field renders (Section III.D).
    pub novel: NovelViews,
    /// The fusion (Section III.E).
    pub fusion: FusionConfig,
    /// Several photographs of one scene.
    pub multi_view: MultiViewConfig,
    /// Conversion of affine disparity to depth (Section III.B).
    pub disparity: DisparityRule,
}

/// The iterative loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RefinementConfig {
    /// Number of iterations. With 0 no field is fitted and the result is the depth of the prior's stage.
    pub iterations: usize,
    /// Prior of the fusion from the second iteration on.
    pub prior: IterationPrior,
    /// What a field is fitted to and what its depth is for.
    pub order: Order,
}

impl Default for RefinementConfig {
    fn default() -> Self {
        Self { iterations: 2, prior: IterationPrior::Carry, order: Order::Paper }
    }
}

impl RefinementConfig {
    /// Whether a field is fitted to a photograph alone.
    pub(crate) fn fits_a_field(&self) -> bool {
        self.iterations > 0 && self.order == Order::Paper
    }
}

/// The order of the stages after the prior.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// As printed: a field is fitted to warps of the photograph, or to several photographs, and Eq. 7-17 fuse it with the prior.
    #[default]
    Paper,
    /// Several photographs: their plane sweeps, then a field whose depth joins the consensus of the sweeps. A photograph alone gets no field:
    /// measured, one that is fitted to its warps lowers no error and blurs edges.
    Poses,
}

/// Prior of the fusion from the second iteration on. The next training views are always warped by the refined depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IterationPrior {
    /// The refined depth with its variance per pixel, as in the paper: "which initialize the next cycle".
    #[default]
    Carry,
    /// The original monocular depth, its variance estimated again, so that no image counts twice.
    Anchor,
}

/// Uncertainty of the augmented depth: the variance per pixel, relative to its squared depth,
///
/// \\[ \frac{\sigma^2}{z^2} = G * \Bigl(k_s^2 s^2 + k_d^2 \ln^2\frac{z}{z_o}\Bigr) + \sigma_c^2, \\]
///
/// with \\(s\\) the spread of the predictions, \\(z_o\\) the model's prediction for the whole image, \\(G\\) a Gaussian blur, and
/// \\(\sigma_c\\) the error that all predictions share: \\(\sigma_c^2 = c^2 + 2.25\, m^2\\) with \\(c\\) the
/// [stated one](mde_fusion::FusionConfig::common_error), where that is not 0, and \\(m\\) the median of the root of the first term.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct SigmaConfig {
    /// \\(k_s\\), 0 to 100: factor of the spread of the predictions.
    pub spread: f64,
    /// \\(k_d\\), 0 to 100: factor of the change by the augmentation.
    pub disagreement: f64,
    /// Standard deviation of the blur, as a fraction of the image width, 0 to 0.25.
    pub blur: f64,
}

impl Default for SigmaConfig {
    fn default() -> Self {
        Self { spread: 1.2, disagreement: 0.6, blur: 0.025 }
    }
}

/// The views that the fitted field renders; [`Config::views`] has their distance from the original pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct NovelViews {
    /// Number of fresh poses, the paper's K; 0: the original pose alone.
    pub count: usize,
}

impl Default for NovelViews {
    fn default() -> Self {
        Self { count: 5 }
    }
}

/// Several photographs of one scene ([`PreparedScene`](crate::several::prepared::PreparedScene)).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct MultiViewConfig {
    /// Photographs that are used at most, the reference included; 2 to 64.
    pub max_views: usize,
}

impl Default for MultiViewConfig {
    fn default() -> Self {
        Self { max_views: 8 }
    }
}

impl Config {
    /// The same configuration with the values of a TOML text over it. `origin` names the text in errors.
    ///
    /// # Errors
    /// [`Error::Argument`] for text that is not TOML, an unknown key, or a value of the wrong type or out of range.
    pub fn with_text(&self, text: &str, origin: &str) -> Result<Self> {
        let error = |reason: String| Error::Argument(format!("{origin}: {}", one_line(&reason)));
        let overrides: Table = text.parse().map_err(|e: toml::de::Error| error(e.to_string()))?;
        let mut table = Table::try_from(self).map_err(|e| error(e.to_string()))?;
        merge(&mut table, overrides.clone());
        let config: Self =
            Value::Table(table).try_into().map_err(|e: toml::de::Error| error(e.to_string()))?;
        // Serde ignores unknown keys in tables with a `kind`.
        let known = Table::try_from(&config).map_err(|e| error(e.to_string()))?;
        if let Some(key) = unknown(&overrides, &known) {
            return Err(error(format!("unknown key `{key}`; `mde config` prints all keys")));
        }
        config.validate().map_err(|e| error(e.to_string()))?;
        Ok(config)
    }

    /// The same configuration with the values of a TOML file over it.
    ///
    /// # Errors
    /// [`Error::Prior`] where it cannot be read, else as [`Config::with_text`].
    pub fn with_file(&self, path: &Path) -> Result<Self> {
        let text = open::read_text(path, FileKind::Settings).map_err(Error::read(path))?;
        self.with_text(&text, &path.display().to_string())
    }

    /// The same configuration with what a caller sets in few words: the seed, whether no field is fitted, the most predictions of a model, and
    /// the nearest and farthest depth of the scene for disparity of unknown scale and shift, metres.
    ///
    /// # Errors
    /// [`Error::Argument`] for depths that are no range.
    pub fn with(
        mut self,
        seed: Option<u64>,
        no_nerf: bool,
        predictions: Option<Predictions>,
        depth_range: Option<[f64; 2]>,
    ) -> Result<Self> {
        self.seed = seed.unwrap_or(self.seed);
        if no_nerf {
            self.refinement.iterations = 0;
        }
        self.augmentation.predictions = predictions.unwrap_or(self.augmentation.predictions);
        let rule = &mut self.disparity;
        [rule.near, rule.far] = depth_range.unwrap_or([rule.near, rule.far]);
        let fault = |error| Error::Argument(format!("{{depth-range}}: {}", text(&error)));
        rule.validate().map_err(fault)?;
        Ok(self)
    }

    /// The whole configuration as TOML.
    ///
    /// # Errors
    /// [`Error::Argument`] for a value that TOML can't hold (a seed above 2^63).
    pub fn to_toml(&self) -> Result<String> {
        let error = |e: toml::ser::Error| Error::Argument(format!("config: {}", one_line(&e.to_string())));
        toml::to_string_pretty(self).map_err(error)
    }

    /// The poses of the novel views. Poses that only rotate carry no depth, so there are none.
    pub(crate) fn novel_views(&self) -> ViewSampling {
        ViewSampling { count: self.novel.count, rotation_only: 0.0, ..self.views.clone() }
    }

    /// Checks every value of every stage.
    ///
    /// # Errors
    /// [`Error::Argument`], or that of the stage, with the first value out of range.
    pub fn validate(&self) -> Result<()> {
        let Self { refinement, sigma, multi_view, .. } = self;
        let ranges = [
            ("refinement.iterations", refinement.iterations as f64, 0.0..=100.0, "give 0 (no field) to 100"),
            ("sigma.spread", sigma.spread, 0.0..=100.0, "give 0 to 100"),
            ("sigma.disagreement", sigma.disagreement, 0.0..=100.0, "give 0 to 100"),
            ("sigma.blur", sigma.blur, 0.0..=0.25, "give 0 to 0.25 (of the image width)"),
            ("multi-view.max-views", multi_view.max_views as f64, 2.0..=64.0, "give 2 to 64"),
        ];
        if let Some((field, value, _, remedy)) = ranges.into_iter().find(|r| !r.2.contains(&r.1)) {
            return Err(Error::Argument(format!("{field} is {value}; {remedy}")));
        }
        self.augmentation.validate()?;
        self.views.validate()?;
        self.novel_views().validate()?;
        self.warp.validate()?;
        self.nerf.validate()?;
        self.fusion.validate()?;
        self.disparity.validate()?;
        Ok(())
    }
}

/// Overrides `into`'s values by `from`'s, table by table. A table of another `kind` replaces the old one, since its keys differ.
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

/// The first key of `table` that is not in `known`.
fn unknown(table: &Table, known: &Table) -> Option<String> {
    table.iter().find_map(|(key, value)| match (value, known.get(key)) {
        (_, None) => Some(key.clone()),
        (Value::Table(inner), Some(Value::Table(known))) => {
            unknown(inner, known).map(|rest| format!("{key}.{rest}"))
        }
        _ => None,
    })
}

/// Most characters of a line that an error quotes.
const LONGEST_LINE: usize = 120;

/// Parser messages span several lines, with the line at fault as `5 | key = value`; an error is one line.
fn one_line(message: &str) -> String {
    let lines = message.lines().map(str::trim).filter(|line| !line.is_empty());
    let short = |line: &str| match line.contains('|') {
        true => line.chars().take(LONGEST_LINE).collect(),
        false => line.to_owned(),
    };
    lines.map(short).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_nerf::{FieldConfig, HashFieldConfig};
    use std::collections::BTreeSet;

    #[test]
    fn overrides_change_what_they_name_and_another_kind_starts_from_its_own_defaults() {
        let text = "seed = 9\n[nerf.train]\nsteps = 7\n[nerf.field]\nkind = \"hash\"\nlevels = 6\n";
        let config = Preset::Paper.config().with_text(text, "test").unwrap();
        let mut expected = Preset::Paper.config();
        (expected.seed, expected.nerf.train.steps) = (9, 7);
        expected.nerf.field = FieldConfig::Hash(HashFieldConfig { levels: 6, ..HashFieldConfig::default() });
        assert_eq!(config, expected);
    }

    #[test]
    fn what_is_given_in_few_words_replaces_a_setting() {
        let usual = Preset::Default.config();
        assert_eq!(usual.clone().with(None, false, None, None).unwrap(), usual);
        let few = Some(Predictions::Most(3));
        let config = usual.clone().with(Some(7), true, few, Some([0.5, 6.0])).unwrap();
        assert_eq!((config.seed, config.refinement.iterations), (7, 0));
        assert_eq!(config.augmentation.predictions, Predictions::Most(3));
        assert_eq!((config.disparity.near, config.disparity.far), (0.5, 6.0));
        let refused = usual.with(None, false, None, Some([9.0, 2.0])).unwrap_err().to_string();
        assert!(refused.starts_with("{depth-range}: "), "{refused}");
    }

    /// The keys of a table, with their sections; of a list of tables, those of its elements.
    fn keys(table: &Table, section: &str, found: &mut BTreeSet<String>) {
        for (key, value) in table {
            let name = format!("{section}{key}");
            match value {
                Value::Table(inner) => keys(inner, &format!("{name}."), found),
                Value::Array(list) if list.iter().any(Value::is_table) => {
                    for inner in list.iter().filter_map(Value::as_table) {
                        keys(inner, &format!("{name}."), found);
                    }
                }
                // No level is the default; its keys are those of the preset that has some.
                Value::Array(list) if list.is_empty() => (),
                _ => drop(found.insert(name)),
            }
        }
    }

    #[test]
    fn every_key_is_documented_and_there_are_at_most_52() {
        let mut settings = BTreeSet::new();
        for preset in Preset::ALL {
            keys(&Table::try_from(preset.config()).unwrap(), "", &mut settings);
        }
        assert!(settings.len() <= 52, "{} keys", settings.len());
        let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/settings.md");
        // The package alone has no documents.
        let Ok(page) = std::fs::read_to_string(page) else { return };
        let documented: BTreeSet<String> = page
            .lines()
            .filter_map(|line| line.strip_prefix("| `")?.split_once('`').map(|(key, _)| key.to_owned()))
            .collect();
        assert_eq!(documented, settings);
    }

    #[test]
    fn the_paper_preset_has_the_numbers_of_the_paper() {
        let paper = Preset::Paper.config();
        assert_eq!((paper.nerf.train.steps, paper.nerf.train.steps_for), (2000, 0));
        assert_eq!(paper.refinement.iterations, 2);
        assert_eq!((paper.views.count, paper.novel.count), (10, 5));
        assert!(!paper.augmentation.is_active());
    }
}
