//! A photograph at the size at which it is refined.

use crate::refiner::size::{SMALLEST, shrink, within, working};
use crate::refiner::camera::KnownCamera;
use crate::refiner::prior::origin::PriorOrigin;
use crate::refiner::plan::limit::MemoryLimit;
use crate::refiner::plan::inference::PhotographMemory;
use crate::config::{Config, Preset};
use crate::error::{Error, Result};
use crate::naming::Naming;
use mde_prior::DepthPrior;
use ndarray::Array3;

/// The sizes of results and of refinements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sizes {
    /// Longer side of the results, pixels.
    pub longest: Option<usize>,
    /// Most million pixels of a refinement.
    pub megapixels: f64,
}

impl Sizes {
    /// `(height, width)` of the results for a photograph of that size.
    pub fn of_results(&self, size: (usize, usize)) -> (usize, usize) {
        within(size, self.longest)
    }

    /// `(height, width)` of the refinement for results of that size.
    pub fn of_refinement(&self, size: (usize, usize)) -> (usize, usize) {
        working(size, self.megapixels)
    }
}

/// A photograph at the size of the results, where it is refined at a smaller one.
#[derive(Debug, Clone)]
pub struct Full {
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub image: Array3<f32>,
    /// The camera at this size.
    pub camera: KnownCamera,
}

/// A photograph at the size at which it is refined, with its camera.
#[derive(Debug, Clone)]
pub struct Opened {
    /// sRGB in 0 to 1, `[height, width, 3]`.
    pub image: Array3<f32>,
    /// The camera at this size.
    pub camera: KnownCamera,
    /// `(height, width)` as given.
    pub original: (usize, usize),
    /// At the size of the results, where that is larger.
    pub full: Option<Full>,
}

impl Opened {
    /// A photograph of that camera, as it is.
    pub fn new(image: Array3<f32>, camera: KnownCamera) -> Self {
        let (height, width, _) = image.dim();
        Self { image, camera, original: (height, width), full: None }
    }

    /// Brings a photograph to its size; `several`: its results stay at the size of the refinement. `name` is for errors; warnings
    /// of other sizes go to `warn`.
    ///
    /// # Errors
    /// [`Error::Argument`] for a size that is too small, [`Error::Warp`] for a camera that can't be resized.
    pub fn resized(
        self,
        name: &str,
        sizes: &Sizes,
        several: bool,
        naming: Naming,
        warn: &mut dyn FnMut(String),
    ) -> Result<Self> {
        let Self { mut image, camera, original, .. } = self;
        let size = sizes.of_results(original);
        let at = sizes.of_refinement(size);
        let (height, width) = size;
        if size != original {
            image = shrink(&image, size);
            let argument = naming.of("max-size");
            warn(format!(
                "resized from {}x{} to {width}x{height} pixels; {argument} sets this",
                original.1, original.0
            ));
        }
        if width.min(height) < SMALLEST {
            return Err(Error::Argument(format!(
                "{name}: the image is {width}x{height}; give one of {SMALLEST}x{SMALLEST} pixels or more"
            )));
        }
        let mut full = None;
        if at != size {
            let argument = naming.of("work-size");
            warn(format!("{width}x{height} pixels: refined at {}x{}; {argument} sets this", at.1, at.0));
            let small = shrink(&image, at);
            let large = std::mem::replace(&mut image, small);
            if !several {
                full = Some(Full { image: large, camera: camera.resized(size)? });
            }
        }
        Ok(Self { image, camera: camera.resized(at)?, original, full })
    }

    /// `(height, width)` of the refinement.
    pub fn size(&self) -> (usize, usize) {
        let (height, width, _) = self.image.dim();
        (height, width)
    }

    /// `(height, width)` of the results.
    pub fn of_results(&self) -> (usize, usize) {
        let (height, width, _) = self.full.as_ref().map_or(&self.image, |full| &full.image).dim();
        (height, width)
    }

    /// The prior's predictions at once that the memory limit allows; `name` is for the refusal.
    ///
    /// # Errors
    /// Those of [`PhotographMemory::predictions_at_once`].
    pub fn predictions_at_once(
        &self,
        name: &str,
        config: &Config,
        prior: &dyn DepthPrior,
        limit: &MemoryLimit,
    ) -> Result<usize> {
        let (full, at) = (self.of_results(), self.size());
        let memory = PhotographMemory::new(config, prior, full, at, rayon::current_num_threads());
        memory.predictions_at_once(limit, name, at)
    }

    /// The same where it is one of so many photographs of a scene, which are predicted side by side. One that is refined alone in the end is
    /// so with the usual preset.
    ///
    /// # Errors
    /// As [`predictions_at_once`](Self::predictions_at_once).
    pub fn predictions_at_once_of(
        &self,
        photographs: usize,
        prior: &dyn DepthPrior,
        limit: &MemoryLimit,
    ) -> Result<usize> {
        let (config, threads) = (Preset::Default.config(), rayon::current_num_threads());
        let memory = PhotographMemory::of_several(&config, prior, self.size(), photographs, threads);
        memory.predictions_at_once(limit, &format!("{photographs} photographs"), self.size())
    }

    /// Takes a network's own camera in the place of an assumed one. It takes a prediction, so memory is checked before.
    ///
    /// # Errors
    /// Those of [`KnownCamera::by_network`].
    pub fn take_camera_of(&mut self, prior: &dyn DepthPrior, origin: &PriorOrigin) -> Result<()> {
        let Some(own) = self.camera.by_network(prior, origin, self.image.view())? else { return Ok(()) };
        let size = self.of_results();
        if let Some(full) = &mut self.full {
            full.camera = own.resized(size)?;
        }
        self.camera = own;
        Ok(())
    }
}
