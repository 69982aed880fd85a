use std::path::{Path, PathBuf};

use ndarray::ArrayView3;

use crate::format::{self, ReadOptions};
use crate::{DepthKind, DepthPrior, Error, PriorDepth, Result};

/// A depth or disparity map from a file, of the image's size. It accepts no new images.
///
/// The file is read and checked when it is opened. See [`format`](mod@crate::format) for the formats.
#[derive(Debug, Clone)]
pub struct FilePrior {
    path: PathBuf,
    prior: PriorDepth,
}

impl FilePrior {
    /// Reads a map whose values are of `kind`.
    ///
    /// # Errors
    /// Those of [`format::read_depth`].
    pub fn open(path: impl AsRef<Path>, kind: DepthKind, options: &ReadOptions) -> Result<Self> {
        let path = path.as_ref();
        let map = format::read_raw(path, options)?;
        let prior = PriorDepth::from_values(map, kind).map_err(|e| Error::malformed(path, e.to_string()))?;
        Ok(Self { path: path.to_owned(), prior })
    }

    /// A map in memory, which errors call `name`.
    pub fn of_map(name: impl Into<PathBuf>, prior: PriorDepth) -> Self {
        Self { path: name.into(), prior }
    }

    /// The map in the file.
    #[must_use]
    pub fn prior(&self) -> &PriorDepth {
        &self.prior
    }
}

impl DepthPrior for FilePrior {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let (height, width, _) = image.dim();
        let (rows, columns) = self.prior.map.dim();
        if (rows, columns) != (height, width) {
            let reason = format!(
                "the prior is {columns}x{rows} but the image is {width}x{height} (width x height); resize the image, or make the prior \
                 at the image's size"
            );
            return Err(Error::malformed(&self.path, reason));
        }
        Ok(self.prior.clone())
    }
}
