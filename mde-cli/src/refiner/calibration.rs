//! The calibration of the program's own sigma, and what a calibration depends on.

use crate::config::{Config, MultiViewConfig, SigmaConfig};
use crate::error::{Error, Result};
use crate::prior::hash;
use mde_nerf::NerfConfig;
use mde_prior::{AugmentationConfig, FileKind, open};
use mde_uncertainty::calibration::{Calibration, Fingerprint};
use serde::Serialize;
use std::path::Path;

/// The calibration of [`Preset::Default`](crate::config::Preset::Default) with a model, estimated with FastDepth.
///
/// # Errors
/// None: the file is part of the crate, and a test reads it.
pub fn shipped() -> Result<Calibration> {
    Ok(Calibration::parse(include_str!("calibration/default.toml"), "the calibration of the program")?)
}

/// Reads a calibration's file.
///
/// # Errors
/// [`Error::Prior`] where it cannot be read, [`Error::Depth`] where it is no calibration.
pub fn read(path: &Path) -> Result<Calibration> {
    let text = open::read_text(path, FileKind::Settings).map_err(Error::read(path))?;
    Ok(Calibration::parse(&text, &path.display().to_string())?)
}

/// What sigma depends on.
#[derive(Serialize)]
struct Decisive<'c> {
    /// Changes when the rule for sigma does.
    version: u32,
    /// With test-time augmentation.
    augmentation: Option<(&'c AugmentationConfig, &'c SigmaConfig)>,
    common_error: f64,
    /// With a field: everything but the seed and the rule for disparities, which is the scene's.
    field: Option<Config>,
    /// Of several photographs: the photographs and the field.
    #[serde(skip_serializing_if = "Option::is_none")]
    several: Option<(&'c MultiViewConfig, Option<&'c NerfConfig>)>,
}

/// What sigma depends on: the settings, whether the prior accepts new images, one photograph or `several`, the model's [`hash`] if any.
///
/// # Errors
/// [`Error::External`] for a configuration that can't be serialised.
pub fn fingerprint(
    config: &Config,
    accepts_new_images: bool,
    several: bool,
    model: Option<String>,
) -> Result<Fingerprint> {
    let augmented = accepts_new_images && config.augmentation.is_active() && !several;
    let Config { refinement, augmentation, sigma, .. } = config;
    let usual = Config::default();
    let decisive = Decisive {
        version: 3,
        augmentation: augmented.then_some((augmentation, sigma)),
        common_error: config.fusion.common_error,
        field: (!several && refinement.fits_a_field()).then(|| Config {
            seed: 0,
            disparity: usual.disparity,
            augmentation: usual.augmentation,
            sigma: usual.sigma,
            ..config.clone()
        }),
        several: several.then(|| (&config.multi_view, (refinement.iterations > 0).then_some(&config.nerf))),
    };
    let text = serde_json::to_string(&decisive).map_err(Error::external)?;
    Ok(Fingerprint { settings: hash(text.as_bytes()), model })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;
    use mde_uncertainty::calibration::Mismatch;

    #[test]
    fn the_settings_that_sigma_depends_on_count() {
        let usual = Preset::Default.config();
        let own = fingerprint(&usual, true, false, None).unwrap();
        let same = |change: &dyn Fn(&mut Config), accepts_new_images| {
            let mut config = usual.clone();
            change(&mut config);
            fingerprint(&config, accepts_new_images, false, None).unwrap() == own
        };
        assert!(same(&|c| c.seed = 5, true));
        assert!(!same(&|_| (), false), "a prior that accepts no new images has another sigma");
        // Without a field, its settings have no effect.
        assert!(same(&|c| c.refinement.iterations = 0, true));
        assert!(same(&|c| c.nerf.train.steps = 7, true));
        assert!(!same(&|c| c.refinement.order = crate::config::Order::Paper, true));
        assert!(!same(&|c| c.sigma.spread = 3.0, true));
        assert!(!same(&|c| c.augmentation.gain = 0.5, true));
        assert!(!same(&|c| c.fusion.common_error = 0.1, true));
    }

    /// A changed default needs a new calibration. Half widths calibrated on test-time augmentation do not hold for stereo.
    #[test]
    fn the_shipped_calibration_is_of_one_photograph_the_default_settings_and_its_model_only() {
        let shipped = shipped().unwrap();
        let mismatch = |preset: Preset, several, model: Option<String>| {
            shipped.mismatch(&fingerprint(&preset.config(), true, several, model).unwrap())
        };
        let fastdepth = Some("029a5197".to_owned());
        let found = mismatch(Preset::Default, false, fastdepth.clone());
        assert_eq!(found, None, "calibrate again: the settings changed");
        let other = Some(hash(b"another network"));
        assert_eq!(mismatch(Preset::Default, false, other), Some(Mismatch::Model));
        assert_eq!(mismatch(Preset::Default, false, None), Some(Mismatch::Model));
        assert_eq!(mismatch(Preset::MultiView, true, fastdepth), Some(Mismatch::Settings));
    }
}
