//! Where a prior comes from.

use mde_prior::{DepthKind, ModelSpec};
use serde::Serialize;

/// The unit of metric depth.
pub const METRES: &str = "m";

/// What a prior is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PriorForm {
    /// A network in a file.
    Network,
    /// A function of the caller.
    Callable,
    /// A map, whose network is not known.
    Map,
    /// Simulated from an exact depth.
    Simulated,
    /// None: one depth for all pixels of several photographs, whose parallax alone gives the shape.
    Nothing,
}

/// Where a prior comes from, for the record.
#[derive(Debug, Clone, Serialize)]
pub struct PriorOrigin {
    /// What it is.
    #[serde(skip)]
    pub form: PriorForm,
    /// Kind of its values.
    pub kind: DepthKind,
    /// Whether a network's graph or the files of its model hub tell that kind: not the user, nor the name of the file.
    #[serde(skip)]
    pub kind_is_told: bool,
    /// The file, the name of the callable, or `simulated`.
    pub source: String,
    /// The format of a network.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelSpec>,
    /// What runs the network.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub runtime: Option<String>,
    /// Identifies the bytes of the network's files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model_hash: Option<String>,
}

impl PriorOrigin {
    /// One without a network's file.
    pub fn new(form: PriorForm, kind: DepthKind, source: impl Into<String>) -> Self {
        let source = source.into();
        Self { form, kind, kind_is_told: false, source, model: None, runtime: None, model_hash: None }
    }

    /// The message about a network whose order of near and far is exchanged, with that mean correlation with known depth.
    pub fn swapped(&self, correlation: f64) -> String {
        let disparity = self.kind == DepthKind::AffineDisparity;
        let remedy = if disparity { "metric or depth" } else { "disparity" };
        format!(
            "{}: near and far are exchanged in rooms of known depth (mean correlation {correlation:.2}), as where a disparity is taken for a depth \
             or the reverse; give {{prior-kind}} {remedy}, or check the profile",
            self.source
        )
    }

    /// The origin of predictions at that focal length / width: a network whose metres depend on it has some only where it is known.
    #[must_use]
    pub fn at_focal(&self, focal: Option<f64>) -> Self {
        let metric = self.model.as_ref().filter(|spec| spec.canonical_focal.is_some() && focal.is_some());
        Self { kind: metric.map_or(self.kind, |spec| spec.output), ..self.clone() }
    }

    /// Whether it predicts the depth of new images.
    pub fn predicts(&self) -> bool {
        matches!(self.form, PriorForm::Network | PriorForm::Callable)
    }
}
