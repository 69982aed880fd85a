use crate::config::{Config, IterationPrior, Order, RefinementConfig};
use mde_fusion::FusionConfig;
use mde_nerf::NerfConfig;
use mde_prior::AugmentationConfig;
use mde_prior::augment::Predictions;

/// A named configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "program", derive(clap::ValueEnum))]
pub enum Preset {
    /// The equations as printed: an MLP trained on colours alone, two iterations.
    Paper,
    /// Predictions of crops and mirror images too, merged; a depth map gets an error bar and stays as it is.
    #[default]
    Default,
    /// As default, with at most five predictions.
    Fast,
    /// Several photographs: stereo between them, then a radiance field.
    MultiView,
}

impl Preset {
    /// All presets.
    pub const ALL: [Self; 4] = [Self::Paper, Self::Default, Self::Fast, Self::MultiView];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Default => "default",
            Self::Fast => "fast",
            Self::MultiView => "multi-view",
        }
    }

    /// The configuration.
    pub fn config(self) -> Config {
        match self {
            Self::Paper => Config::default(),
            Self::Default | Self::MultiView => {
                let mut nerf = NerfConfig::photographs(640);
                nerf.train.steps_for = 640 * 480;
                Config {
                    refinement: RefinementConfig {
                        iterations: 1,
                        prior: IterationPrior::Anchor,
                        order: Order::Poses,
                    },
                    augmentation: AugmentationConfig::multi_crop(),
                    nerf,
                    fusion: FusionConfig { common_error: COMMON_ERROR, ..FusionConfig::paper() },
                    ..Config::default()
                }
            }
            Self::Fast => {
                let mut config = Self::Default.config();
                config.refinement.iterations = 0;
                config.augmentation.predictions = Predictions::Most(5);
                config
            }
        }
    }
}

/// All predictions of a photograph share an error, which no residual shows, as a fraction of the depth. The figure was fitted: with
/// it, the 90 % intervals hold 90 % of the pixels of 18 photographs.
const COMMON_ERROR: f64 = 0.12;
