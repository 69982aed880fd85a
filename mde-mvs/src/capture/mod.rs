//! Captures: photographs with cameras and poses, from the files of other programs.
//!
//! | reader | files | poses | pixel centres |
//! | --- | --- | --- | --- |
//! | [`read_transforms`] | nerfstudio's and instant-ngp's `transforms.json` | camera to world, y up, z backwards | its `pixel_centres`, else the argument |
//! | [`read_colmap`] | a COLMAP model, text or binary | world to camera | halves |
//! | [`read_tum`] | `groundtruth.txt` and `rgb.txt` | camera to world | those of the given lens |
//!
//! For every format, a [`Frame`] has a [`Lens`] with pixel centres at integers and a pose from world to camera, and [`Frame::view`] makes a
//! [`PosedView`] of the decoded photograph with its distortion removed. The readers decode no photograph: a closure returns the width and
//! height of each, or `None` for a missing one. [`CaptureFiles`] recognises the format. [`transforms_json`], [`colmap_text`] and
//! [`colmap_map`] write these formats; [`colmap_view`] and [`colmap_workspace`] make COLMAP's files of depth maps.

mod colmap;
mod error;
mod files;
mod intrinsics;
mod known;
mod lens;
mod paths;
#[cfg(test)]
mod tests;
mod transforms;
mod tum;
mod workspace;

use std::io::{self, ErrorKind, Read as _};
use std::path::{Path, PathBuf};

use crate::centre;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion};
use ndarray::ArrayView3;

pub use colmap::{ColmapPoint, colmap_map, colmap_text, read_colmap, read_colmap_depths};
pub use error::{Error, Result};
use error::{content, fault, missing};
pub use files::{CaptureFiles, same_file};
pub use intrinsics::intrinsics;
pub use known::{KnownDepth, read_known_depths};
pub use lens::{Distortion, Lens};
pub use paths::relative_path;
pub use transforms::{PixelCentres, read_transforms, transforms_json};
pub use tum::read_tum;
pub use workspace::{COLMAP_FUSION, colmap_view, colmap_workspace};

/// From pixel centres at integers to those at halves.
const HALF: f64 = 0.5;
/// Most bytes of a file that is read.
const MAX_FILE: u64 = 1 << 30;
/// Largest coordinate of a position, in the unit of the poses. Products of positions up to it are finite.
const MAX_POSITION: f64 = 1e12;
/// Most photographs of a capture.
const MAX_FRAMES: usize = 1 << 16;
/// Largest departure of a rotation from orthogonality, as an entry of \\( R^\top R - I \\).
const ORTHOGONAL: f64 = 1e-2;

/// One photograph of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Path of the photograph.
    pub photograph: PathBuf,
    /// The camera that took it.
    pub lens: Lens,
    /// World to camera.
    pub pose: Pose,
}

impl Frame {
    /// Without distortion.
    pub fn new(camera: PinholeCamera, pose: Pose, photograph: impl Into<PathBuf>) -> Self {
        let lens = Lens { camera, distortion: Distortion::default() };
        Self { photograph: photograph.into(), lens, pose }
    }

    /// The view of a decoded photograph, sRGB in [0, 1], `[height, width, 3]`, without distortion.
    ///
    /// # Errors
    /// [`Error::Content`] for a photograph of another size than the camera, [`Error::View`] for colours that are not finite.
    pub fn view(&self, photograph: ArrayView3<'_, f32>) -> Result<PosedView> {
        let (image, mask) = self.lens.undistort(photograph)?;
        Ok(PosedView::new(image, self.lens.camera, self.pose, mask, Vec::new())?)
    }
}

/// A point of the scene from the capture's files.
#[derive(Debug, Clone, PartialEq)]
pub struct SparsePoint {
    /// Position in the world.
    pub position: Point3<f64>,
    /// Mean reprojection error, pixels.
    pub error: f64,
    /// Indices of the frames that show it.
    pub frames: Vec<usize>,
}

/// Photographs of one scene with cameras and poses.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct PosedCapture {
    /// The photographs, in the order of the file.
    pub frames: Vec<Frame>,
    /// Points of the scene; empty where the format has none.
    pub points: Vec<SparsePoint>,
    /// Photographs that the files name and that are missing or can't be read; they have no frame.
    pub unreadable: Vec<PathBuf>,
}

impl PosedCapture {
    fn checked(self, path: &Path) -> Result<Self> {
        if let (0 | 1, Some(photograph)) = (self.frames.len(), self.unreadable.first()) {
            return Err(missing(path, photograph));
        }
        if self.frames.len() < 2 {
            let problem = format!("{} photograph(s) with a pose; at least 2 are needed", self.frames.len());
            return Err(fault(path, problem));
        }
        let first = centre(&self.frames[0].pose);
        let reach = self.frames.iter().map(|f| (centre(&f.pose) - first).norm()).fold(0.0, f64::max);
        if reach <= 1e-9 * (1.0 + first.norm()) {
            let problem = "all photographs were taken from one place, so that nothing has parallax; add some from other places";
            return Err(fault(path, problem));
        }
        Ok(self)
    }
}

/// The bytes of a regular file of at most 1 GiB. A named pipe or a device is not opened, which could block or never end.
fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let fail = |source| Error::Read { path: path.to_owned(), source };
    let found = std::fs::metadata(path).map_err(fail)?;
    if found.is_dir() {
        return Err(fail(io::Error::new(ErrorKind::IsADirectory, "it is a folder; give a file")));
    }
    if !found.is_file() {
        let what = "it is a named pipe, a socket or a device; give a regular file";
        return Err(fail(io::Error::new(ErrorKind::InvalidInput, what)));
    }
    let file = std::fs::File::open(path).map_err(fail)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE + 1).read_to_end(&mut bytes).map_err(fail)?;
    if bytes.len() as u64 > MAX_FILE {
        return Err(content(path, "size", "more than 1 GiB; give a capture of fewer photographs or points"));
    }
    Ok(bytes)
}

fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read_bytes(path)?).map_err(|_| content(path, "text", "not UTF-8"))
}

/// The rotation nearest to a matrix that is nearly a rotation.
fn rotation(m: &Matrix3<f64>) -> std::result::Result<UnitQuaternion<f64>, &'static str> {
    if !m.iter().all(|x| x.is_finite()) {
        return Err("its rotation is not finite");
    }
    let excess = (m.transpose() * m - Matrix3::identity()).amax();
    if excess > ORTHOGONAL {
        return Err("its rotation is singular or scaled; its columns must be orthonormal");
    }
    if m.determinant() <= 0.0 {
        return Err("its rotation is a reflection; one axis points the wrong way");
    }
    // Gram-Schmidt: no iteration, and within `ORTHOGONAL` of the matrix.
    let x = m.column(0).normalize();
    let y = m.column(1);
    let y = (y - x * x.dot(&y)).normalize();
    let z = x.cross(&y);
    let exact = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, z]));
    Ok(UnitQuaternion::from_rotation_matrix(&exact))
}

/// A rotation from a quaternion (w, x, y, z) that nearly is of unit length.
fn quaternion(q: [f64; 4]) -> std::result::Result<UnitQuaternion<f64>, &'static str> {
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !norm.is_finite() {
        return Err("its rotation is not finite");
    }
    if !((1.0 - ORTHOGONAL)..=(1.0 + ORTHOGONAL)).contains(&norm) {
        return Err("its quaternion is not of unit length");
    }
    Ok(UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(q[0], q[1], q[2], q[3])))
}

/// The pose of a photograph, or the fault of a rotation or translation that is none.
fn pose(
    path: &Path,
    photograph: &str,
    rotation: Result<UnitQuaternion<f64>, &'static str>,
    translation: [f64; 3],
) -> Result<Pose> {
    let near = translation.iter().all(|x| x.abs() <= MAX_POSITION);
    let translation = near.then(|| translation.into()).ok_or("its translation is not finite or above 1e12");
    let both = rotation.and_then(|rotation| Ok(Pose::from_parts(translation?, rotation)));
    both.map_err(|e| fault(path, format!("photograph {photograph}: {e}; its pose cannot be used")))
}

/// Checks that a photograph is of its camera's size.
fn check_photograph(path: &Path, photograph: &Path, lens: &Lens, found: [usize; 2]) -> Result<()> {
    lens.check_size(found).map_err(|problem| content(path, photograph.display(), problem))
}
