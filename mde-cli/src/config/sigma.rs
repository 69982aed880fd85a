use serde::{Deserialize, Serialize};

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
