use crate::config::{Config, FieldUse, IterationPrior, RefinementConfig};
use mde_fusion::FusionConfig;
use mde_nerf::{Decay, DepthLoss, FieldConfig, HashFieldConfig, NerfConfig, RenderConfig, TrainConfig};
use mde_prior::AugmentationConfig;
use mde_prior::augment::Predictions;
use mde_uncertainty::termination::InBinVariance;
use serde::{Deserialize, Serialize};

/// A named configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// The equations as printed: ten views, 2000 steps of a light MLP on colours alone, two iterations.
    Paper,
    /// Test-time augmentation: the model also predicts crops and mirror images, and the merged map is the result. For a depth
    /// map from a file, a hash field is fitted with depth supervision, with the remedies of the fusion.
    #[default]
    Default,
    /// At most five predictions, merged, and no field. A depth map from a file gets an error bar and stays as it is.
    Fast,
    /// Several photographs of one scene: a hash field on their colours and on the consensus of their plane sweeps, rays clipped to
    /// the reference's frustum.
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
            Self::Default => Config {
                refinement: RefinementConfig {
                    iterations: 1,
                    prior: IterationPrior::Anchor,
                    field: FieldUse::WithoutAugmentation,
                },
                augmentation: AugmentationConfig::multi_crop(),
                nerf: supervised(2000, 1024),
                fusion: remedied(),
                ..Config::default()
            },
            Self::Fast => Config {
                refinement: RefinementConfig { iterations: 0, ..Self::Default.config().refinement },
                augmentation: AugmentationConfig {
                    predictions: Predictions::Most(5),
                    ..AugmentationConfig::multi_crop()
                },
                ..Self::Default.config()
            },
            Self::MultiView => {
                let mut nerf = NerfConfig::photographs(640);
                nerf.train.steps_for = 640 * 480;
                Config { nerf, ..Self::Default.config() }
            }
        }
    }
}

/// A hash field with a colour and a depth loss.
fn supervised(steps: usize, rays: usize) -> NerfConfig {
    NerfConfig {
        field: FieldConfig::Hash(HashFieldConfig::default()),
        train: TrainConfig {
            steps,
            steps_for: 640 * 480,
            rays,
            learning_rate: 1e-2,
            depth_loss: DepthLoss::Wasserstein { weight: 0.2, decay: Decay::default() },
            ..TrainConfig::default()
        },
        render: RenderConfig { in_bin: InBinVariance::Uniform, ..RenderConfig::default() },
        ..NerfConfig::default()
    }
}

/// The robust fusion with a stated common error. The views are warps of the photograph by the prior and share its error, which no
/// residual shows, so 12 % of the depth are added to the estimates. The figure was fitted: with it, the 90 % intervals hold 90 % of the
/// pixels of 18 photographs.
fn remedied() -> FusionConfig {
    FusionConfig { common_error: 0.12, ..FusionConfig::robust() }
}
