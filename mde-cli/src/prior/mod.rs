//! The monocular depth that a refinement begins with.

pub mod files;
pub mod origin;

pub use files::read_options;
pub use origin::{METRES, PriorForm, PriorOrigin};

use crate::error::{Error, Result};
use mde_prior::{DepthKind, DepthPrior, FileKind, FilePrior, PriorDepth, open};
use ndarray::{Array2, Array3, ArrayView3};
use std::path::Path;
use std::sync::OnceLock;

/// A prior that is open: a network, a map, or a caller's own.
pub struct OpenPrior<'p> {
    prior: Box<dyn DepthPrior + Send + 'p>,
    origin: PriorOrigin,
    /// `(height, width)` of a map.
    pub(crate) size: Option<(usize, usize)>,
    /// A warning about the file.
    pub(crate) note: Option<String>,
    /// The warning about near and far, once the network was tried on rooms.
    order: OnceLock<Option<String>>,
}

impl<'p> OpenPrior<'p> {
    /// A caller's own prior.
    pub fn given(prior: Box<dyn DepthPrior + Send + 'p>, origin: PriorOrigin) -> Self {
        Self { prior, origin, size: None, note: None, order: OnceLock::new() }
    }

    /// No prior: several photographs alone, in the unit of their poses, or in one of its own.
    pub fn nothing() -> Self {
        Self::given(Box::new(Uniform), PriorOrigin::new(PriorForm::Nothing, DepthKind::RelativeDepth, "none"))
    }

    /// A map.
    pub fn map(prior: FilePrior, origin: PriorOrigin) -> Self {
        let size = Some(prior.prior().map.dim());
        Self { size, ..Self::given(Box::new(prior), origin) }
    }

    /// The prior.
    pub fn prior(&self) -> &(dyn DepthPrior + 'p) {
        &*self.prior
    }

    /// Identifies the values of a map.
    pub(crate) fn content(&self) -> Option<String> {
        let (height, width) = self.size?;
        let map = self.prior.predict(Array3::zeros((height, width, 3)).view()).ok()?.map;
        let values: Vec<u8> = map.iter().flat_map(|value| value.to_le_bytes()).collect();
        Some(hash(&values))
    }

    /// A warning where a network's near and far come out swapped in rooms of known depth. Only one whose output kind was guessed from a
    /// flag or the file name is tested, once. Without procedural rooms there is nothing to test with.
    pub(crate) fn swapped(&self) -> Option<&str> {
        #[cfg(feature = "program")]
        {
            let is_guessed = self.origin.form == PriorForm::Network && !self.origin.kind_is_told;
            if is_guessed && self.order.get().is_none() {
                // Not within `get_or_init`: a thread of rayon's pool could meanwhile take up work that waits for it.
                // What can't be predicted fails in the run too, with its own error.
                let trial = mde_eval::order_check::OrderCheck::swapped(self.prior()).ok().flatten();
                // Another thread finds the same.
                let _ = self.order.set(trial.map(|trial| self.origin.swapped(trial.mean())));
            }
        }
        self.order.get()?.as_deref()
    }

    /// Where it comes from.
    pub fn origin(&self) -> &PriorOrigin {
        &self.origin
    }
}

/// The same depth everywhere.
#[derive(Debug)]
pub(crate) struct Uniform;

impl DepthPrior for Uniform {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        let (height, width, _) = image.dim();
        PriorDepth::from_values(Array2::ones((height, width)), DepthKind::RelativeDepth)
    }

    fn accepts_new_images(&self) -> bool {
        true
    }

    fn concurrency(&self) -> usize {
        usize::MAX
    }
}

/// Identifies the bytes of a model's file: their CRC-32 in hexadecimal digits.
pub fn hash(bytes: &[u8]) -> String {
    format!("{:08x}", crc32fast::hash(bytes))
}

/// Identifies the bytes of files, in their order.
///
/// # Errors
/// [`Error::Prior`] where one cannot be read.
pub fn hash_files<'p>(paths: impl IntoIterator<Item = &'p Path>) -> Result<String> {
    let mut hasher = crc32fast::Hasher::new();
    for path in paths {
        hasher.update(&open::read(path, FileKind::Weights).map_err(Error::read(path))?);
    }
    Ok(format!("{:08x}", hasher.finalize()))
}
