use crate::Result;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView};
use ndarray::{Array2, Array3};
use serde::Serialize;
use std::ops::ControlFlow;

/// A scene model that is fitted to posed views and renders colour and depth with variance.
///
/// The refinement loop uses nothing else, so that a Gaussian splat or a field on a GPU can replace [`Nerf`](crate::Nerf).
/// `mde-nerf/examples/own_field.rs` of the workspace is another implementation.
pub trait RadianceField: Send {
    /// Fits the field to `views`.
    ///
    /// `views[0]` is the original photograph: its camera and pose define the modelled volume. The depth hypotheses of the views give the
    /// range of the scene and may supervise its depth. The other views may be warps or photographs; all images have the exposure of view 0.
    ///
    /// # Errors
    /// Views without a valid pixel or range, a fit that diverges, [`Error::Interrupted`](crate::Error::Interrupted) where the callback
    /// returns [`ControlFlow::Break`], and the implementation's own as [`Error::External`](crate::Error::External).
    fn fit(&mut self, views: &[PosedView], callback: &mut FieldCallback<'_>) -> Result<FitReport>;

    /// Renders the fitted field from `pose` (world to camera).
    ///
    /// # Errors
    /// [`Error::NotFitted`](crate::Error::NotFitted), [`Error::View`](crate::Error::View) for a camera or a pose that is not valid,
    /// [`Error::Interrupted`](crate::Error::Interrupted), or the implementation's own as [`Error::External`](crate::Error::External).
    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut FieldCallback<'_>,
    ) -> Result<RenderedView>;

    /// The content of a file of the fitted field, where the implementation has files.
    fn to_file(&self) -> Option<Vec<u8>> {
        None
    }
}

/// A rendered view.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedView {
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub image: Array3<f32>,
    /// Mean and variance (Eq. 4-5) of z-depth in the rendering camera, `[height, width]`; missing where the opacity is low.
    pub depth: GaussianDepth,
    /// Probability that the ray ends in the volume, `[height, width]`.
    pub opacity: Array2<f32>,
    /// The part of the variance from within the bins of the rays, `[height, width]`, where the field tells it apart.
    pub in_bin: Option<Array2<f32>>,
}

/// Summary of a fit.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FitReport {
    /// Optimisation steps taken.
    pub steps: usize,
    /// Mean training loss over the last steps.
    pub loss: f64,
    /// Peak signal-to-noise ratio of the fitted field on one more step's rays, dB.
    pub psnr: f64,
}

/// Progress of a fit or a rendering.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum FieldEvent {
    /// Optimisation steps are done.
    Fit {
        /// Steps done.
        step: usize,
        /// Steps in all.
        steps: usize,
        /// Mean loss since the last event.
        loss: f64,
        /// PSNR of the training rays since the last event, dB.
        psnr: f64,
    },
    /// Rows are rendered.
    Render {
        /// Rows done.
        row: usize,
        /// Rows in all.
        rows: usize,
    },
}

/// Progress callback; `Break` cancels the call with [`Error::Interrupted`](crate::Error::Interrupted).
pub type FieldCallback<'c> = dyn FnMut(&FieldEvent) -> ControlFlow<()> + 'c;

/// A callback that ignores all events.
pub fn silent(_: &FieldEvent) -> ControlFlow<()> {
    ControlFlow::Continue(())
}
