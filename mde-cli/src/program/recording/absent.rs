//! Recordings in a program without the feature `rerun`: never opened.

use anyhow::{Result, bail};
use crate::output::record::TrainingCurve;
use crate::output::export::Exported;
use crate::several::Capture;
use crate::reports::capture::CaptureReport;
use crate::reports::iteration::IterationReport;
use mde_nerf::RadianceField;
use mde_uncertainty::GaussianDepth;
use std::path::Path;

/// There is none.
#[derive(Clone)]
pub(crate) enum Recording {}

impl Recording {
    pub(crate) fn new(path: &Path, _: bool) -> Result<Self> {
        bail!(
            "--rerun {}: this program was built without recordings; build it with --features rerun",
            path.display()
        )
    }

    pub(crate) fn inputs(&self, _: &str, _: &Exported<'_>, _: &str) {
        match *self {}
    }

    pub(crate) fn depth(&self, _: usize, _: &Exported<'_>) {
        match *self {}
    }

    pub(crate) fn sigma(&self, _: usize, _: &GaussianDepth) {
        match *self {}
    }

    pub(crate) fn watch(&self, _: usize, _: bool, _: Box<dyn RadianceField>) -> Box<dyn RadianceField> {
        match *self {}
    }

    pub(crate) fn photographs(&self, _: &Capture, _: &CaptureReport) {
        match *self {}
    }

    pub(crate) fn fitted(&self, _: usize) {
        match *self {}
    }

    pub(crate) fn reports(&self, _: &[IterationReport], _: &[TrainingCurve]) {
        match *self {}
    }

    pub(crate) fn save(&self) -> Result<()> {
        match *self {}
    }
}
