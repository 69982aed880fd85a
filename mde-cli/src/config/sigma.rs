use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Uncertainty of the augmented depth: the variance per pixel, relative to its squared depth,
///
/// \\[ \frac{\sigma^2}{z^2} = G * \Bigl(k_s^2 s^2 + k_d^2 \ln^2\frac{z}{z_o}\Bigr) + \sigma_c^2, \\]
///
/// with \\(s\\) the spread of the predictions, \\(z_o\\) the model's prediction for the whole image, \\(G\\) a Gaussian blur, and
/// \\(\sigma_c\\) the error that all predictions share ([`mde_fusion::FusionConfig::common_error`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct SigmaConfig {
    /// \\(k_s\\), 0 or more.
    pub spread: f64,
    /// \\(k_d\\), 0 or more.
    pub disagreement: f64,
    /// Standard deviation of the blur, as a fraction of the image width.
    pub blur: f64,
}

impl Default for SigmaConfig {
    fn default() -> Self {
        Self { spread: 1.2, disagreement: 0.6, blur: 0.025 }
    }
}

impl SigmaConfig {
    pub(crate) fn validate(&self) -> Result<()> {
        let fields = [
            ("spread", self.spread, 100.0),
            ("disagreement", self.disagreement, 100.0),
            ("blur", self.blur, 0.25),
        ];
        for (name, value, most) in fields {
            if !(0.0..=most).contains(&value) {
                let reason = format!("sigma.{name} is {value}; give 0 to {most}");
                return Err(Error::Config { origin: "config".into(), reason });
            }
        }
        Ok(())
    }
}
