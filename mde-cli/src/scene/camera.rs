//! The camera of a photograph: given, from its EXIF, or assumed.

use crate::error::{Error, Result, text};
use mde_mvs::capture::{Distortion, Lens, intrinsics};
use mde_mvs::poses::FOCAL_SIGMA;
use mde_prior::{FileKind, open};
use mde_warp::PinholeCamera;
use serde::Serialize;
use std::path::PathBuf;

/// Assumed field of view along the longer side, degrees: between a phone's main camera (65 to 75) and a longer lens.
const ASSUMED_FOV: f64 = 60.0;

/// The horizontal field of view of that lens, whose focal length is the same however it is held.
fn assumed_fov(width: usize, height: usize) -> f64 {
    let half = (width as f64 / height as f64 * (0.5 * ASSUMED_FOV).to_radians().tan()).atan();
    if width < height { 2.0 * half.to_degrees() } else { ASSUMED_FOV }
}

/// What is given of a camera, for the size of the photograph's file.
#[derive(Debug, Clone, PartialEq)]
pub enum GivenCamera {
    /// Nothing.
    Nothing,
    /// Focal lengths and principal point, pixels.
    Intrinsics {
        /// Horizontal focal length.
        fx: f64,
        /// Vertical focal length, by default the horizontal one.
        fy: Option<f64>,
        /// Column of the principal point, by default the middle.
        cx: Option<f64>,
        /// Row of the principal point, by default the middle.
        cy: Option<f64>,
    },
    /// Horizontal field of view, degrees.
    FieldOfView(f64),
    /// A file of intrinsics.
    File(PathBuf),
}

/// A camera and where it comes from.
#[derive(Debug, Clone, Serialize)]
pub struct KnownCamera {
    /// The camera.
    #[serde(flatten)]
    pub camera: PinholeCamera,
    /// Where it comes from.
    pub source: CameraSource,
}

/// Where a camera comes from.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraSource {
    /// Focal lengths as arguments.
    Flags,
    /// A field of view, degrees.
    FieldOfView(f64),
    /// A file of intrinsics or of a capture.
    File(String),
    /// The photograph's EXIF, 35 mm focal length in millimetres.
    Exif(f64),
    /// The depth network's own estimate.
    Network,
    /// Assumed, degrees.
    Assumed(f64),
    /// An assumed focal length, estimated with the poses of several photographs, and the standard deviation of its logarithm.
    Estimated(f64),
    /// The procedural scene's own.
    Scene,
}

impl KnownCamera {
    /// The camera of a photograph of that size, with the focal length of its EXIF in millimetres of 35 mm film.
    ///
    /// # Errors
    /// [`Error::Prior`] for a file that can't be read; [`Error::Argument`] or [`Error::Warp`] for what is no camera of the photograph.
    pub fn new(given: &GivenCamera, focal_35mm: Option<f64>, [width, height]: [usize; 2]) -> Result<Self> {
        let middle = |side: usize| 0.5 * (side as f64 - 1.0);
        let checked = |camera: PinholeCamera| {
            let lens = Lens { camera, distortion: Distortion::default() };
            lens.check().map(|()| camera).map_err(Error::Argument)
        };
        let (camera, source) = match (given, focal_35mm) {
            (GivenCamera::File(path), _) => {
                let shown = path.display();
                let read = open::read_text(path, FileKind::Settings).map_err(Error::read(path))?;
                let camera = intrinsics(&read, [width, height])
                    .map_err(|error| text(&error))
                    .and_then(|camera| checked(camera).map_err(|error| text(&error)))
                    .map_err(|error| Error::Argument(format!("{shown}: {error}")))?;
                (camera, CameraSource::File(shown.to_string()))
            }
            (GivenCamera::Intrinsics { fx, fy, cx, cy }, _) => {
                let (cx, cy) = (cx.unwrap_or(middle(width)), cy.unwrap_or(middle(height)));
                let camera = PinholeCamera::new(*fx, fy.unwrap_or(*fx), cx, cy, width, height)?;
                (checked(camera)?, CameraSource::Flags)
            }
            (GivenCamera::FieldOfView(fov), _) => {
                let camera = PinholeCamera::from_fov(*fov, width, height)
                    .map_err(|error| Error::Argument(format!("{{fov}}: {}", text(&error))))?;
                (camera, CameraSource::FieldOfView(*fov))
            }
            (GivenCamera::Nothing, Some(mm)) => {
                (PinholeCamera::from_focal_35mm(mm, width, height)?, CameraSource::Exif(mm))
            }
            (GivenCamera::Nothing, None) => {
                let fov = assumed_fov(width, height);
                (PinholeCamera::from_fov(fov, width, height)?, CameraSource::Assumed(fov))
            }
        };
        Ok(Self { camera, source })
    }

    /// The same for the photograph resized to `(height, width)`.
    ///
    /// # Errors
    /// [`Error::Warp`] for a size of 0.
    pub fn resized(&self, (height, width): (usize, usize)) -> Result<Self> {
        Ok(Self { camera: self.camera.resized(width, height)?, source: self.source.clone() })
    }

    /// Whether it is assumed.
    pub fn is_assumed(&self) -> bool {
        matches!(self.source, CameraSource::Assumed(_))
    }

    /// Focal length / width, where it is not assumed.
    pub fn focal(&self) -> Option<f64> {
        (!self.is_assumed()).then(|| self.camera.fx / self.camera.width as f64)
    }

    /// Focal length, field of view and source, for the user.
    pub fn title(&self) -> String {
        let PinholeCamera { fx, width, .. } = self.camera;
        let source = match &self.source {
            CameraSource::Flags | CameraSource::FieldOfView(_) => "given, taken as exact",
            CameraSource::File(_) => "from its file, taken as exact",
            CameraSource::Exif(_) => "from the photograph's EXIF, in whole millimetres of 35 mm film",
            CameraSource::Network => "the network's estimate, whose error is unknown; give {fov} if known",
            CameraSource::Assumed(_) => "assumed; give {fov} if known",
            CameraSource::Estimated(_) => "estimated with the poses; give {fov} if known",
            CameraSource::Scene => "the scene's own",
        };
        let degrees = 2.0 * (0.5 * width as f64 / fx).atan().to_degrees();
        let sigma = match self.source {
            CameraSource::Estimated(sigma) => Some(sigma),
            CameraSource::Assumed(_) => Some(FOCAL_SIGMA),
            CameraSource::Exif(mm) => Some((mm * 12.0_f64.sqrt()).recip()),
            _ => None,
        };
        let sigma = sigma.map_or_else(String::new, |sigma| format!(" +- {:.0} %", 100.0 * sigma));
        format!("focal length {fx:.0} px{sigma} ({degrees:.1} degrees), {source}")
    }

    /// With the focal length that was estimated with the poses, where one was.
    pub(crate) fn or_estimated(self, found: Option<PinholeCamera>, sigma: Option<f64>) -> Self {
        match found.filter(|found| *found != self.camera).zip(sigma) {
            Some((camera, sigma)) => Self { camera, source: CameraSource::Estimated(sigma) },
            None => self,
        }
    }

    /// A warning where the camera is assumed.
    pub fn warning(&self) -> Option<String> {
        let CameraSource::Assumed(degrees) = self.source else { return None };
        Some(format!(
            "the camera is unknown: a horizontal field of view of {degrees:.0} degrees is assumed, which affects the point cloud \
             but not the depth, unless a field is fitted; give {{fov}} or {{intrinsics}}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_that_is_turned_keeps_its_focal_length() {
        let focal = |size| KnownCamera::new(&GivenCamera::Nothing, None, size).unwrap().camera.fx;
        assert!((focal([480, 640]) / focal([640, 480]) - 1.0).abs() < 1e-12);
    }
}
