use crate::Result;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView};
use ndarray::{Array2, Array3};
use std::ops::ControlFlow;

/// A scene model that learns from posed views and renders colour, depth and how sure it is of it.
///
/// The loop needs nothing else, so a Gaussian splat or a field on a GPU can stand in for [`Nerf`](crate::Nerf).
///
/// ```
/// use mde_nerf::{FitReport, Observer, RadianceField, RenderedView, Result};
/// use mde_uncertainty::GaussianDepth;
/// use mde_warp::{PinholeCamera, Pose, PosedView};
/// use ndarray::{Array2, Array3};
///
/// /// A grey wall at a known distance.
/// struct Wall(f32);
///
/// impl RadianceField for Wall {
///     fn fit(&mut self, _: &[PosedView], _: &mut dyn Observer) -> Result<FitReport> {
///         Ok(FitReport::default())
///     }
///     fn render(&self, camera: &PinholeCamera, _: &Pose, _: &mut dyn Observer) -> Result<RenderedView> {
///         let size = (camera.height, camera.width);
///         Ok(RenderedView {
///             image: Array3::from_elem((size.0, size.1, 3), 0.5),
///             depth: GaussianDepth::new(Array2::from_elem(size, self.0), Array2::from_elem(size, 1e-4))?,
///             opacity: Array2::ones(size),
///         })
///     }
/// }
/// let mut field: Box<dyn RadianceField> = Box::new(Wall(2.0));
/// ```
pub trait RadianceField: Send {
    /// Fits the field to `views`.
    ///
    /// `views[0]` is the original photograph: its camera and pose fix the volume that is modelled. The views' depth
    /// hypotheses say how far the scene reaches and, where the field is told so, supervise its depth. Nothing may be
    /// assumed about where the other views come from.
    ///
    /// # Errors
    /// Views without a usable pixel or range, a fit that diverges, or [`Error::Interrupted`](crate::Error::Interrupted)
    /// where the observer said stop.
    fn fit(&mut self, views: &[PosedView], observer: &mut dyn Observer) -> Result<FitReport>;

    /// Renders the fitted field from `pose` (world to camera).
    ///
    /// # Errors
    /// [`Error::NotFitted`](crate::Error::NotFitted), or [`Error::Interrupted`](crate::Error::Interrupted).
    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        observer: &mut dyn Observer,
    ) -> Result<RenderedView>;
}

/// What a field renders.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedView {
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub image: Array3<f32>,
    /// Mean and variance (Eq. 4-5) of z-depth in the rendering camera, `[height, width]`; missing where the ray hardly ends.
    pub depth: GaussianDepth,
    /// Chance that the ray ended in the volume, `[height, width]`.
    pub opacity: Array2<f32>,
}

/// How a fit went.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FitReport {
    /// Optimisation steps taken.
    pub steps: usize,
    /// Mean training loss over the last steps.
    pub loss: f64,
    /// Peak signal-to-noise ratio in dB a view, on a random sample of its trainable pixels; the original first.
    pub psnr: Vec<f64>,
    /// Samples along rays that were trained on.
    pub samples: u64,
}

/// What a long call tells its caller.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// Some optimisation steps are done.
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
    /// Some rows are rendered.
    Render {
        /// Rows done.
        row: usize,
        /// Rows in all.
        rows: usize,
    },
}

/// Hears of progress and may say stop. Closures from [`Event`] to [`ControlFlow`] are observers.
pub trait Observer {
    /// Hears of an event; [`ControlFlow::Break`] stops the call with [`Error::Interrupted`](crate::Error::Interrupted).
    fn observe(&mut self, event: &Event) -> ControlFlow<()>;
}

impl<F: FnMut(&Event) -> ControlFlow<()>> Observer for F {
    fn observe(&mut self, event: &Event) -> ControlFlow<()> {
        self(event)
    }
}

/// An observer that lets everything run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {
    fn observe(&mut self, _: &Event) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}
