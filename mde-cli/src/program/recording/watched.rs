//! A field whose training views are recorded.

use crate::program::recording::Recording;
use mde_nerf::{FieldCallback, FitReport, RadianceField, RenderedView, Result};
use mde_warp::{PinholeCamera, Pose, PosedView};

pub(super) struct Watched {
    pub(super) field: Box<dyn RadianceField>,
    pub(super) iteration: usize,
    /// Whether the views are recorded: those of several photographs are in the unit of the poses.
    pub(super) views: bool,
    pub(super) recording: Recording,
}

impl RadianceField for Watched {
    fn fit(&mut self, views: &[PosedView], callback: &mut dyn FieldCallback) -> Result<FitReport> {
        if self.views {
            self.recording.views(self.iteration, views);
        }
        let report = self.field.fit(views, callback)?;
        self.recording.fitted(report.steps);
        Ok(report)
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut dyn FieldCallback,
    ) -> Result<RenderedView> {
        self.field.render(camera, pose, callback)
    }
}
