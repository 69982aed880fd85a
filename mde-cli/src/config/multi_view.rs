use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Several photographs of one scene ([`refine_capture`](crate::capture::refine_capture)).
///
/// The variance per pixel, relative to its squared depth, is
///
/// \\[ \frac{\sigma^2}{z^2} = k_f^2 \frac{\sigma_f^2}{z_f^2} + k_c^2 \frac{\sigma_c^2}{z_c^2}, \\]
///
/// with \\(z_f, \sigma_f\\) the field's termination (Eq. 4-5) and \\(z_c, \sigma_c\\) the consensus of the plane sweeps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct MultiViewConfig {
    /// Photographs that are used at most, the reference included; 2 or more.
    pub max_views: usize,
    /// \\(k_f\\), 0 or more.
    pub sigma_field: f64,
    /// \\(k_c\\), 0 or more.
    pub sigma_consensus: f64,
}

impl Default for MultiViewConfig {
    fn default() -> Self {
        Self { max_views: 8, sigma_field: 2.0, sigma_consensus: 0.5 }
    }
}

impl MultiViewConfig {
    pub(crate) fn validate(&self) -> Result<()> {
        let fault = |field, value: String, remedy| Err(Error::Config { field, value, remedy });
        if !(2..=64).contains(&self.max_views) {
            return fault("multi-view.max-views", self.max_views.to_string(), "give 2 to 64");
        }
        let fields = [
            ("multi-view.sigma-field", self.sigma_field),
            ("multi-view.sigma-consensus", self.sigma_consensus),
        ];
        for (field, value) in fields {
            if !(0.0..=100.0).contains(&value) {
                return fault(field, value.to_string(), "give 0 to 100");
            }
        }
        if fields.iter().all(|(_, value)| *value == 0.0) {
            return fault("multi-view.sigma-field", "0".to_owned(), "make it or sigma-consensus positive");
        }
        Ok(())
    }
}
