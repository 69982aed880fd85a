use crate::batch::Pixels;
use crate::config::{NerfConfig, RenderConfig};
use crate::field::{FieldCallback, FitReport, RadianceField, RenderedView};
use crate::frustum::Frustum;
use crate::network::Network;
use crate::render::render;
use crate::store;
use crate::train::train;
use crate::{Error, Result};
use mde_warp::{PinholeCamera, Pose, PosedView};
use std::path::Path;

/// A neural radiance field: a small network on the frustum of view 0, without view direction (a view-dependent colour
/// could explain the views without geometry). The [crate's](crate) documentation has an example.
#[derive(Debug, Clone)]
pub struct Nerf {
    config: NerfConfig,
    seed: u64,
    fitted: Option<Fitted>,
}

/// A fitted network and its volume.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub(crate) network: Network<f32>,
    pub(crate) frustum: Frustum,
}

impl Nerf {
    /// An unfitted field; all random numbers of its fit derive from `seed`.
    ///
    /// # Errors
    /// [`Error::Config`] where a value is out of range.
    pub fn new(config: NerfConfig, seed: u64) -> Result<Self> {
        config.validate()?;
        Ok(Self { config, seed, fitted: None })
    }

    /// The same field, fitted or not, with other settings for rendering; they do not affect the fit.
    ///
    /// # Errors
    /// [`Error::Config`] where a value is out of range.
    pub fn with_render(mut self, render: RenderConfig) -> Result<Self> {
        self.config.render = render;
        self.config.validate()?;
        Ok(self)
    }

    /// Reads a file with the bytes of [`RadianceField::to_file`].
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Format`] for another format, another version or a wrong checksum.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let (config, seed, fitted) = store::load(path.as_ref())?;
        Ok(Self { config, seed, fitted: Some(fitted) })
    }
}

impl RadianceField for Nerf {
    fn fit(&mut self, views: &[PosedView], callback: &mut FieldCallback<'_>) -> Result<FitReport> {
        for (index, view) in views.iter().enumerate() {
            view.validate().map_err(|error| Error::View { index, reason: error.to_string() })?;
        }
        if views.iter().all(|view| !view.mask.iter().any(|&valid| valid)) {
            return Err(Error::NoPixels);
        }
        let frustum = Frustum::of_views(views, &self.config.sampling)?;
        let pixels = Pixels::new(views, &frustum, &self.config.train)?;
        let mut network = Network::new(&self.config.field, self.seed);
        let size = views.first().map_or(0, |view| view.camera.width * view.camera.height);
        let config = NerfConfig { train: self.config.train.for_pixels(size), ..self.config.clone() };
        let report = train(&mut network, &frustum, &pixels, &config, self.seed, callback)?;
        self.fitted = Some(Fitted { network, frustum });
        Ok(report)
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut FieldCallback<'_>,
    ) -> Result<RenderedView> {
        let fitted = self.fitted.as_ref().ok_or(Error::NotFitted)?;
        let refused = |reason: String| Error::View { index: 0, reason };
        camera.validate().map_err(|error| refused(error.to_string()))?;
        if !pose.to_homogeneous().iter().all(|x| x.is_finite()) {
            return Err(refused("its pose is not finite".to_owned()));
        }
        render(&fitted.network, &fitted.frustum, &self.config, camera, pose, callback)
    }

    /// A safetensors file of the fitted field, which [`Nerf::load`] reads.
    fn to_file(&self) -> Option<Vec<u8>> {
        store::encode(&self.config, self.seed, self.fitted.as_ref()?).ok()
    }
}
