//! A field that can be saved after the loop.

use mde_nerf::{FieldCallback, FitReport, Nerf, RadianceField, RenderedView, Result};
use mde_warp::{PinholeCamera, Pose, PosedView};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A [`Nerf`] that the loop fits and its caller keeps: clones are one field.
///
/// ```
/// use mde_cli::{SharedNerf, Stages};
/// # use mde_cli::mde_prior::DepthPrior;
///
/// # fn stages<'s>(prior: &'s dyn DepthPrior, kept: &'s mut Option<SharedNerf>) -> Stages<'s> {
/// // After the run, `kept` is the field of the last iteration.
/// Stages::new(prior).with_field(|request| Ok(Box::new(kept.insert(SharedNerf::new(request.nerf()?)).clone())))
/// # }
/// ```
#[derive(Clone)]
pub struct SharedNerf(Arc<Mutex<Nerf>>);

impl SharedNerf {
    /// Shares a field.
    pub fn new(nerf: Nerf) -> Self {
        Self(Arc::new(Mutex::new(nerf)))
    }

    /// The field, once nothing else uses it.
    pub fn lock(&self) -> MutexGuard<'_, Nerf> {
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
