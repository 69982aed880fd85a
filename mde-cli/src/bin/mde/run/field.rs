//! A field that can be saved after the loop.

use mde_nerf::{FieldCallback, FitReport, Nerf, RadianceField, RenderedView, Result};
use mde_warp::{PinholeCamera, Pose, PosedView};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A [`Nerf`] shared by the loop and the job that saves it.
#[derive(Clone)]
pub(crate) struct SharedNerf(Arc<Mutex<Nerf>>);

impl SharedNerf {
    pub(crate) fn new(nerf: Nerf) -> Self {
        Self(Arc::new(Mutex::new(nerf)))
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, Nerf> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RadianceField for SharedNerf {
    fn fit(&mut self, views: &[PosedView], callback: &mut dyn FieldCallback) -> Result<FitReport> {
        self.lock().fit(views, callback)
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut dyn FieldCallback,
    ) -> Result<RenderedView> {
        self.lock().render(camera, pose, callback)
    }
}
