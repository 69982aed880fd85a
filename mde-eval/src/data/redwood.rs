use super::files::find_scenes;
use super::pairs::{Pair, Paired, pairs_side_by_side, side_by_side};
use super::{DataSet, Fallback, Sample};
use crate::{Error, Result};
use mde_warp::PinholeCamera;
use serde::Deserialize;
use std::fs;
use std::path::{Path, PathBuf};

/// Redwood's RGB-D scans (Choi et al., 2016) and others in Open3D's layout: `color/`, `rgb/` or `image/` beside `depth/` (PNG in
/// millimetres, 0 = missing), paired by the first number in the files' names.
///
/// The camera is read from `camera_intrinsic.json`, `intrinsic.json` or `camera_primesense.json` beside those folders (Open3D's
/// `PinholeCameraIntrinsic`: pixel centres at integers from 0); without such a file it is Open3D's PrimeSense default for
/// 640 x 480, and a [`Fallback`] for other sizes. Depth is trusted up to 4 m, where a PrimeSense sensor's step is about 4 cm.
#[derive(Debug, Clone)]
pub struct Redwood {
    paired: Paired,
    fallback: Fallback,
}

/// Open3D's camera file.
#[derive(Deserialize)]
struct Intrinsic {
    width: usize,
    height: usize,
    /// Column by column.
    intrinsic_matrix: [f64; 9],
}

impl Redwood {
    const FILES: [&str; 3] = ["camera_intrinsic.json", "intrinsic.json", "camera_primesense.json"];

    /// Finds the pairs at or below a folder.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read, [`Error::Layout`] where there is no pair.
    pub fn open(root: impl AsRef<Path>) -> Result<Self> {
        let root = root.as_ref();
        let mut pairs = Vec::new();
        for folder in find_scenes(root, side_by_side)? {
            pairs.extend(pairs_side_by_side(&folder)?);
        }
        if pairs.is_empty() {
            let reason = "holds no color/ (rgb/, image/) beside depth/ with files of the same numbers".into();
            return Err(Error::Layout { path: root.to_owned(), reason });
        }
        Ok(Self { paired: Paired::new(root, pairs, |_| true), fallback: Fallback::Refuse })
    }

    /// Only every `stride`-th image: neighbours in a video show the same.
    #[must_use]
    pub fn with_stride(mut self, stride: usize) -> Self {
        self.paired.step(stride);
        self
    }

    /// With a camera for scans that have none.
    #[must_use]
    pub fn with_fallback(mut self, fallback: Fallback) -> Self {
        self.fallback = fallback;
        self
    }

    fn camera(&self, pair: &Pair, [width, height]: [usize; 2]) -> Result<(PinholeCamera, bool)> {
        let file = Self::FILES.iter().map(|name| pair.sequence.join(name)).find(|path| path.is_file());
        match file {
            Some(path) => Ok((read(&path)?.resized(width, height)?, false)),
            None if [width, height] == [640, 480] => {
                Ok((PinholeCamera::new(525.0, 525.0, 319.5, 239.5, 640, 480)?, false))
            }
            None => {
                let scene = pair.sequence.display().to_string();
                Ok((self.fallback.camera(&scene, Self::FILES[0], width, height)?, true))
            }
        }
    }
}

fn read(path: &PathBuf) -> Result<PinholeCamera> {
    let text = fs::read_to_string(path).map_err(|source| Error::Io { path: path.clone(), source })?;
    let intrinsic: Intrinsic = serde_json::from_str(&text).map_err(|fault| Error::Layout {
        path: path.clone(),
        reason: format!("is no camera of Open3D: {fault}"),
    })?;
    let Intrinsic { width, height, intrinsic_matrix: [fx, _, _, _, fy, _, cx, cy, _] } = intrinsic;
    Ok(PinholeCamera::new(fx, fy, cx, cy, width, height)?)
}

impl DataSet for Redwood {
    fn ids(&self) -> &[String] {
        &self.paired.ids
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.paired.place(index)
    }

    fn load(&self, index: usize) -> Result<Sample> {
        self.paired.load(index, 1000.0, 4.0, |pair, size| self.camera(pair, size))
    }
}
