use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Several photographs of one scene ([`refine_capture`](crate::several::refine_capture)).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct MultiViewConfig {
    /// Photographs that are used at most, the reference included; 2 or more.
    pub max_views: usize,
}

impl Default for MultiViewConfig {
    fn default() -> Self {
        Self { max_views: 8 }
    }
}

impl MultiViewConfig {
    pub(crate) fn validate(&self) -> Result<()> {
        match self.max_views {
            2..=64 => Ok(()),
            other => Err(Error::Config {
                field: "multi-view.max-views",
                value: other.to_string(),
                remedy: "give 2 to 64",
            }),
        }
    }
}
