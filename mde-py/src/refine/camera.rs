//! The camera of a photograph: given, from EXIF, or assumed.

use mde_cli::mde_warp::{PinholeCamera, Result};
use serde::Serialize;

/// Assumed horizontal field of view, degrees, as the program assumes it.
const ASSUMED_FOV: f64 = 60.0;

/// What the caller gave.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Given {
    /// fx, fy, cx, cy in pixels of the photograph.
    Intrinsics([f64; 4]),
    /// Horizontal field of view, degrees.
    FieldOfView(f64),
    Nothing,
}

/// A camera and where it comes from.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct KnownCamera {
    #[serde(flatten)]
    pub(crate) camera: PinholeCamera,
    pub(crate) source: CameraSource,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CameraSource {
    /// `intrinsics`.
    Flags,
    /// `fov`, degrees.
    FieldOfView(f64),
    /// A file of intrinsics or of a capture.
    File(String),
    /// The photograph's EXIF, 35 mm focal length in millimetres.
    Exif(f64),
    /// The depth network's own estimate.
    Network,
    /// Assumed, degrees.
    Assumed(f64),
    /// An assumed focal length, estimated with the poses of several photographs.
    Estimated,
}

impl KnownCamera {
    /// The camera of a photograph of `height` by `width` pixels.
    pub(crate) fn new(given: Given, focal_35mm: Option<f64>, height: usize, width: usize) -> Result<Self> {
        let (camera, source) = match (given, focal_35mm) {
            (Given::Intrinsics([fx, fy, cx, cy]), _) => {
                (PinholeCamera::new(fx, fy, cx, cy, width, height)?, CameraSource::Flags)
            }
            (Given::FieldOfView(fov), _) => {
                (PinholeCamera::from_fov(fov, width, height)?, CameraSource::FieldOfView(fov))
            }
            (Given::Nothing, Some(mm)) => {
                (PinholeCamera::from_focal_35mm(mm, width, height)?, CameraSource::Exif(mm))
            }
            (Given::Nothing, None) => {
                (PinholeCamera::from_fov(ASSUMED_FOV, width, height)?, CameraSource::Assumed(ASSUMED_FOV))
            }
        };
        Ok(Self { camera, source })
    }

    /// The same for the image resized to `(height, width)`.
    pub(crate) fn resized(&self, (height, width): (usize, usize)) -> Result<Self> {
        Ok(Self { camera: self.camera.resized(width, height)?, source: self.source.clone() })
    }

    /// Focal length / width, where it is not assumed.
    pub(crate) fn focal(&self) -> Option<f64> {
        (!self.is_assumed()).then(|| self.camera.fx / self.camera.width as f64)
    }

    pub(crate) fn is_assumed(&self) -> bool {
        matches!(self.source, CameraSource::Assumed(_))
    }
}
