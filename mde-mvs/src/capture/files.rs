//! The files of a capture, recognised by their names.

use crate::poses::nearest;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use super::tum::{lines, stamped};
use super::{
    Lens, PixelCentres, PosedCapture, Result, content, fault, missing, read_colmap, read_text,
    read_transforms, read_tum,
};

/// The files of a capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CaptureFiles {
    /// A `transforms.json`.
    Transforms(PathBuf),
    /// A COLMAP model and the folder of its photographs.
    Colmap {
        /// The folder of the model.
        model: PathBuf,
        /// The folder of the photographs.
        photographs: PathBuf,
    },
    /// The folder of a TUM sequence.
    Tum(PathBuf),
}

impl CaptureFiles {
    /// Those of a JSON file, or in a folder: `transforms.json`, `sparse/0` or a COLMAP model itself, beside `images`, or `groundtruth.txt` with
    /// `rgb.txt`. `None` where there are none.
    #[must_use]
    pub fn find(path: &Path) -> Option<Self> {
        let within = |name: &str| path.join(name).is_file();
        if path.is_file() && path.extension() == Some(OsStr::new("json")) {
            return Some(Self::Transforms(path.to_owned()));
        }
        if within("transforms.json") {
            return Some(Self::Transforms(path.join("transforms.json")));
        }
        if let Some((model, photographs)) = colmap(path) {
            return Some(Self::Colmap { model, photographs });
        }
        (within("groundtruth.txt") && within("rgb.txt")).then(|| Self::Tum(path.to_owned()))
    }

    /// The first photograph of files without intrinsics.
    ///
    /// # Errors
    /// One line that names the list and the line: it cannot be read, has no photograph, or a time that is no number.
    pub fn first_photograph(&self) -> Result<Option<PathBuf>> {
        let Self::Tum(folder) = self else { return Ok(None) };
        let list = folder.join("rgb.txt");
        let text = read_text(&list)?;
        let none = || fault(&list, "no photograph; at least 2 with poses are needed");
        let (_, name) = stamped(&list, lines(&text).next().ok_or_else(none)?)?;
        Ok(Some(folder.join(name)))
    }

    /// The capture. `lens` is that of files without intrinsics; `size` is as for the readers. Pixel centres of a `transforms.json` are at
    /// halves, as nerfstudio and instant-ngp have them, unless its `pixel_centres` is `integers`.
    ///
    /// # Errors
    /// Those of [`read_transforms`], [`read_colmap`] and [`read_tum`], and [`Error::Content`](super::Error::Content) where the lens is missing.
    pub fn read(
        &self,
        lens: Option<&Lens>,
        size: &dyn Fn(&Path) -> Option<[usize; 2]>,
    ) -> Result<PosedCapture> {
        match (self, lens) {
            (Self::Transforms(path), _) => read_transforms(path, PixelCentres::Halves, size),
            (Self::Colmap { model, photographs }, _) => read_colmap(model, photographs, size),
            (Self::Tum(folder), Some(lens)) => read_tum(folder, lens, size),
            (Self::Tum(folder), None) => {
                Err(content(folder, "intrinsics", "a TUM sequence has none; give them"))
            }
        }
    }
}

impl PosedCapture {
    /// Index of the frame of a photograph.
    ///
    /// # Errors
    /// [`Error::Content`](super::Error::Content) where the capture does not have it, or it can't be read.
    pub fn position(&self, photograph: &Path) -> Result<usize> {
        if let Some(found) = self.unreadable.iter().find(|unreadable| same_file(unreadable, photograph)) {
            return Err(missing(photograph, found));
        }
        let found = self.frames.iter().position(|frame| same_file(&frame.photograph, photograph));
        found.ok_or_else(|| {
            let some = self.frames.iter().take(3).map(|frame| frame.photograph.display().to_string());
            let (some, frames) = (some.collect::<Vec<_>>().join(", "), self.frames.len());
            let remedy = format!("give one of its {frames}, such as {some}");
            fault(photograph, format!("not a photograph of this capture; {remedy}"))
        })
    }

    /// Indices of the reference, then of the frames that [`nearest`] finds, in the order of the capture; at most `most`, and at least two.
    #[must_use]
    pub fn nearest(&self, reference: usize, most: usize) -> Vec<usize> {
        if reference >= self.frames.len() {
            return Vec::new();
        }
        let poses: Vec<_> = self.frames.iter().map(|frame| frame.pose).collect();
        let mut order = nearest(&poses, reference);
        order.truncate(most.max(2) - 1);
        order.sort_unstable();
        order.insert(0, reference);
        order
    }
}

/// Whether two paths lead to one file.
#[must_use]
pub fn same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}

/// Folder of a COLMAP model and of its photographs: `DIR` or `DIR/sparse/0`, beside `DIR/images`.
fn colmap(path: &Path) -> Option<(PathBuf, PathBuf)> {
    let is_model =
        |folder: &Path| ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file());
    let images = |root: &Path| {
        let folder = root.join("images");
        if folder.is_dir() { folder } else { root.to_owned() }
    };
    let nested = path.join("sparse").join("0");
    if is_model(&nested) {
        return Some((nested, images(path)));
    }
    let root = match path.ends_with("sparse/0") {
        true => path.parent().and_then(Path::parent).unwrap_or(path),
        false => path,
    };
    is_model(path).then(|| (path.to_owned(), images(root)))
}
