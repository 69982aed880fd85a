//! Settings that have a short form beside the configuration.

use crate::config::Config;
use crate::error::{Error, Result, text};
use mde_prior::augment::Predictions;

/// What a command line or a function's caller sets in few words; each overrides a value of the [`Config`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shorthands {
    /// [`Config::seed`].
    pub seed: Option<u64>,
    /// Whether no field is fitted: 0 iterations.
    pub no_nerf: bool,
    /// Predictions of a model at most.
    pub predictions: Option<Predictions>,
    /// Nearest and farthest depth of the scene, for disparity of unknown scale and shift, metres.
    pub depth_range: Option<[f64; 2]>,
}

impl Shorthands {
    /// Sets what is given.
    ///
    /// # Errors
    /// [`Error::Argument`] for depths that are no range.
    pub fn apply(&self, config: &mut Config) -> Result<()> {
        config.seed = self.seed.unwrap_or(config.seed);
        if self.no_nerf {
            config.refinement.iterations = 0;
        }
        if let Some(predictions) = self.predictions {
            config.augmentation.predictions = predictions;
        }
        let rule = &mut config.disparity;
        [rule.near, rule.far] = self.depth_range.unwrap_or([rule.near, rule.far]);
        rule.validate().map_err(|error| Error::Argument(format!("{{depth-range}}: {}", text(&error))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    #[test]
    fn what_is_given_replaces_a_setting_and_what_is_not_leaves_it() {
        let preset = Preset::Default.config();
        let mut config = preset.clone();
        Shorthands::default().apply(&mut config).unwrap();
        assert_eq!(config, preset);
        let given = Shorthands {
            seed: Some(7),
            no_nerf: true,
            predictions: Some(Predictions::Most(3)),
            depth_range: Some([0.5, 6.0]),
        };
        given.apply(&mut config).unwrap();
        assert_eq!((config.seed, config.refinement.iterations), (7, 0));
        assert_eq!(config.augmentation.predictions, Predictions::Most(3));
        assert_eq!((config.disparity.near, config.disparity.far), (0.5, 6.0));
        let refused = Shorthands { depth_range: Some([9.0, 2.0]), ..given };
        let refused = refused.apply(&mut config).unwrap_err().to_string();
        assert!(refused.starts_with("{depth-range}: "), "{refused}");
    }
}
