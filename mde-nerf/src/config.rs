use crate::Result;
use mde_uncertainty::OutOfRange;
use mde_uncertainty::termination::InBinVariance;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

const MAX_STEPS: usize = 1_000_000;

/// Configuration of a field: network, sampling, training and rendering.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct NerfConfig {
    /// The network.
    pub field: FieldConfig,
    /// Sample positions along rays.
    pub sampling: SamplingConfig,
    /// Optimisation and losses.
    pub train: TrainConfig,
    /// Rendering.
    pub render: RenderConfig,
}

/// Architecture of the network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum FieldConfig {
    /// A light MLP on a frequency encoding, as in the paper.
    Mlp(MlpFieldConfig),
    /// A multiresolution hash grid with a small MLP.
    Hash(HashFieldConfig),
}

impl Default for FieldConfig {
    fn default() -> Self {
        Self::Mlp(MlpFieldConfig::default())
    }
}

/// An MLP on a frequency encoding.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct MlpFieldConfig {
    /// Number of hidden layers.
    pub layers: usize,
    /// Width of the hidden layers.
    pub width: usize,
    /// Octaves of the encoding per axis.
    pub frequencies: usize,
}

impl Default for MlpFieldConfig {
    fn default() -> Self {
        Self { layers: 4, width: 128, frequencies: 10 }
    }
}

/// A multiresolution hash grid with a small MLP.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct HashFieldConfig {
    /// Number of grids.
    pub levels: usize,
    /// Features per row: 1, 2, 4 or 8.
    pub features: usize,
    /// Base-2 logarithm of the largest number of rows per grid.
    pub log2_rows: u32,
    /// Cells per side of the coarsest grid.
    pub coarsest: u32,
    /// Cells per side of the finest grid.
    pub finest: u32,
    /// Hidden layers of the network.
    pub layers: usize,
    /// Width of the hidden layers.
    pub width: usize,
}

impl Default for HashFieldConfig {
    fn default() -> Self {
        Self { levels: 8, features: 4, log2_rows: 16, coarsest: 16, finest: 640, layers: 2, width: 32 }
    }
}

/// The modelled volume. What lies outside is empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum VolumeConfig {
    /// The frustum of view 0 between near and far, wide enough for the frusta of all views. Every ray is sampled between
    /// near and far of its own camera. For views close to view 0, such as warps.
    #[default]
    Hull,
    /// The frustum of view 0 between near and far with a margin on each side of 6 % of the image's width and height. Rays are clipped to
    /// it; valid pixels of the other views count only where their ray meets it and their hypothesis, if there is one, lies inside. For
    /// photographs.
    Reference,
}

/// Sample positions along rays, uniform in disparity 1/z.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct SamplingConfig {
    /// Stratified samples over the whole range of a training ray.
    pub coarse: usize,
    /// Stratified samples in a band of 12 % to either side of the ray's depth hypothesis; over the whole range for a ray without one.
    pub band: usize,
    /// Importance samples, drawn from the weights of the others.
    pub fine: usize,
    /// The modelled volume.
    pub volume: VolumeConfig,
    /// Nearest depth. Default: the 0.5 % quantile of the hypotheses of view 0 times 0.8 (`hull`) or 0.75 (`reference`). No part of a configuration file.
    #[serde(skip)]
    pub near: Option<f64>,
    /// Farthest depth. Default: the 99.5 % quantile of the hypotheses of view 0 times 1.25 (`hull`) or 1.3 (`reference`). No part of a configuration file.
    #[serde(skip)]
    pub far: Option<f64>,
}

impl Default for SamplingConfig {
    fn default() -> Self {
        Self { coarse: 24, band: 0, fine: 24, volume: VolumeConfig::Hull, near: None, far: None }
    }
}

/// The loss of a ray's colour error \\(e = C - \hat C\\), a mean over the channels.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColourLoss {
    /// \\(e^2\\).
    #[default]
    Squared,
    /// \\(2 \delta^2 \bigl(\sqrt{1 + e^2 / \delta^2} - 1\bigr)\\) with \\(\delta = 0.1\\) (Charbonnier et al., 1997): \\(e^2\\) for
    /// small errors, \\(2 \delta |e|\\) for large ones, such as those of moving objects and of highlights. Its weight grows linearly
    /// from 1 at the first step to 6 at the last.
    Charbonnier,
}

/// Optimisation and losses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct TrainConfig {
    /// Optimisation steps.
    pub steps: usize,
    /// Pixels of view 0 that `steps` is meant for: a larger view gets proportionally more steps. 0: `steps` for any size.
    pub steps_for: usize,
    /// Rays per step.
    pub rays: usize,
    /// Share of the rays that are drawn from view 0; the rest is drawn uniformly from the other views.
    pub original_share: f64,
    /// Learning rate after the warm-up; it decays exponentially to a tenth at the last step.
    pub learning_rate: f64,
    /// Steps over which the learning rate rises linearly from 0.
    pub warm_up: usize,
    /// Colour supervision.
    pub colour_loss: ColourLoss,
    /// Weight of the supervision by the views' hypotheses; colours have weight 1, and 0 is colours alone, as in the paper. The loss is
    /// \\(\int |W(r) - F(r)|\,\mathrm dr\\) in disparity scaled to 0 at far and 1 at near: the first Wasserstein distance between the
    /// termination, of distribution function \\(W\\), and the mixture \\(F\\) of all hypotheses of the ray, each a logistic distribution
    /// with the mean and variance of the hypothesis, and a standard deviation of at least 0.5 % of its depth. The weight is full for a
    /// fifth of the steps and falls linearly to a fiftieth at four fifths: hypotheses start a field and leave it to the colours.
    pub depth_weight: f64,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            steps: 2000,
            steps_for: 0,
            rays: 1024,
            original_share: 0.3,
            learning_rate: 5e-3,
            warm_up: 100,
            colour_loss: ColourLoss::Squared,
            depth_weight: 0.0,
        }
    }
}

/// Rendering.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RenderConfig {
    /// Samples over the whole range of a ray.
    pub coarse: usize,
    /// Importance samples, placed by the weights of the others.
    pub fine: usize,
    /// Contribution of a bin's extent to the variance.
    pub in_bin: InBinVariance,
}

impl Default for RenderConfig {
    fn default() -> Self {
        Self { coarse: 32, fine: 32, in_bin: InBinVariance::Midpoint }
    }
}

impl NerfConfig {
    /// Settings for several photographs of one scene with poses and depth hypotheses, such as those of a plane sweep, of
    /// `width` pixels: a hash grid of as many cells, rays clipped to the frustum of view 0, and robust colours whose weight
    /// grows while that of the hypotheses decays.
    pub fn photographs(width: usize) -> Self {
        Self {
            field: FieldConfig::Hash(HashFieldConfig {
                finest: u32::try_from(width.clamp(64, 4096)).unwrap_or(4096),
                ..HashFieldConfig::default()
            }),
            sampling: SamplingConfig {
                coarse: 8,
                band: 8,
                fine: 8,
                volume: VolumeConfig::Reference,
                ..SamplingConfig::default()
            },
            train: TrainConfig {
                steps: 500,
                rays: 1024,
                original_share: 1.0 / 3.0,
                learning_rate: 2.8e-2,
                colour_loss: ColourLoss::Charbonnier,
                depth_weight: 0.2,
                ..TrainConfig::default()
            },
            render: RenderConfig { coarse: 16, fine: 16, in_bin: InBinVariance::Uniform },
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) with the first field that is out of range.
    pub fn validate(&self) -> Result<()> {
        let Self { field, sampling, train, render } = self;
        let n = |count: usize| count as f64;
        let samples = "give 2 to 1024 samples";
        let mut ranges: Vec<(&'static str, f64, RangeInclusive<f64>, &'static str)> = match field {
            FieldConfig::Mlp(f) => vec![
                ("field.layers", n(f.layers), 1.0..=16.0, "give 1 to 16 hidden layers"),
                ("field.width", n(f.width), 1.0..=1024.0, "give a width of 1 to 1024"),
                ("field.frequencies", n(f.frequencies), 0.0..=16.0, "give at most 16 octaves"),
            ],
            FieldConfig::Hash(f) => {
                let features = if f.features.is_power_of_two() { 1.0..=8.0 } else { NONE };
                let finest = f64::from(f.coarsest)..=65536.0;
                let finer = "give at least field.coarsest and at most 65536 cells";
                vec![
                    ("field.levels", n(f.levels), 1.0..=24.0, "give 1 to 24 grids"),
                    ("field.features", n(f.features), features, "give 1, 2, 4 or 8"),
                    ("field.log2-rows", f.log2_rows.into(), 4.0..=24.0, "give 4 to 24"),
                    ("field.coarsest", f.coarsest.into(), 1.0..=65536.0, "give 1 to 65536 cells"),
                    ("field.finest", f.finest.into(), finest, finer),
                    ("field.layers", n(f.layers), 1.0..=8.0, "give 1 to 8 hidden layers"),
                    ("field.width", n(f.width), 1.0..=1024.0, "give a width of 1 to 1024"),
                ]
            }
        };
        let first = n(sampling.coarse.saturating_add(sampling.band));
        ranges.extend([
            ("sampling.coarse + sampling.band", first, 2.0..=1024.0, samples),
            ("sampling.fine", n(sampling.fine), 0.0..=1024.0, "give at most 1024 samples"),
            ("train.steps", n(train.steps), 1.0..=n(MAX_STEPS), "give 1 to 1000000 steps"),
            ("train.rays", n(train.rays), 16.0..=65536.0, "give 16 to 65536 rays"),
            ("train.original-share", train.original_share, 0.0..=1.0, "give a share from 0 to 1"),
            ("train.learning-rate", train.learning_rate, POSITIVE, "give a positive rate"),
            ("train.depth-weight", train.depth_weight, 0.0..=f64::MAX, "give 0 or more"),
            ("render.coarse", n(render.coarse), 2.0..=1024.0, samples),
            ("render.fine", n(render.fine), 0.0..=1024.0, "give at most 1024 samples"),
        ]);
        ranges.extend(sampling.near.map(|near| ("sampling.near", near, POSITIVE, "give a positive depth")));
        let beyond = sampling.near.unwrap_or(0.0).next_up()..=f64::MAX;
        let remedy = "give a depth beyond sampling.near";
        ranges.extend(sampling.far.map(|far| ("sampling.far", far, beyond, remedy)));
        for (field, value, range, remedy) in ranges {
            OutOfRange::check(range.contains(&value), field, &value, remedy)?;
        }
        Ok(())
    }
}

const POSITIVE: RangeInclusive<f64> = f64::MIN_POSITIVE..=f64::MAX;
const NONE: RangeInclusive<f64> = 1.0..=0.0;

impl TrainConfig {
    /// The configuration with the number of steps for a view 0 of `pixels` pixels.
    pub(crate) fn for_pixels(&self, pixels: usize) -> Self {
        let factor = match self.steps_for {
            0 => 1.0,
            reference => (pixels as f64 / reference as f64).max(1.0),
        };
        let steps = (self.steps as f64 * factor).round().min(MAX_STEPS as f64) as usize;
        Self { steps, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_number_of_samples_is_checked() {
        for (coarse, band) in [(usize::MAX, 3), (3, usize::MAX), (0, 1)] {
            let sampling = SamplingConfig { coarse, band, ..SamplingConfig::default() };
            let config = NerfConfig { sampling, ..NerfConfig::default() };
            assert!(config.validate().unwrap_err().to_string().contains("coarse"), "{coarse} {band}");
        }
    }

    #[test]
    fn settings_for_photographs_are_valid_for_any_width() {
        for width in [0, 1, 320, 640, 100_000] {
            NerfConfig::photographs(width).validate().unwrap();
        }
    }
}
