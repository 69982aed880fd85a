//! The camera of a photograph: given, from its EXIF, or assumed.

use crate::error::{Error, Result, text};
use mde_mvs::capture::{Distortion, Lens};
use mde_prior::{FileKind, open};
use mde_warp::PinholeCamera;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Assumed horizontal field of view, degrees: between a phone's main camera (65 to 75) and a longer lens.
const ASSUMED_FOV: f64 = 60.0;

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
    /// An assumed focal length, estimated with the poses of several photographs.
    Estimated,
    /// The procedural scene's own.
    Scene,
}

impl CameraSource {
    /// A word for a table.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Flags => "flags",
            Self::FieldOfView(_) => "field-of-view",
            Self::File(_) => "file",
            Self::Exif(_) => "exif",
            Self::Network => "network",
            Self::Assumed(_) => "assumed",
            Self::Estimated => "estimated",
            Self::Scene => "scene",
        }
    }
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
                    .and_then(checked)
                    .map_err(|error| Error::Argument(format!("{shown}: {}", text(&error))))?;
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
                (PinholeCamera::from_fov(ASSUMED_FOV, width, height)?, CameraSource::Assumed(ASSUMED_FOV))
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
            CameraSource::Flags | CameraSource::FieldOfView(_) => "given",
            CameraSource::File(_) => "from its file",
            CameraSource::Exif(_) => "from the photograph's EXIF",
            CameraSource::Network => "the network's estimate; give {fov} if known",
            CameraSource::Assumed(_) => "assumed; give {fov} if known",
            CameraSource::Estimated => "estimated with the poses; give {fov} if known",
            CameraSource::Scene => "the scene's own",
        };
        let degrees = 2.0 * (0.5 * width as f64 / fx).atan().to_degrees();
        format!("focal length {fx:.0} px ({degrees:.1} degrees), {source}")
    }

    /// A warning where the camera is assumed.
    pub fn warning(&self) -> Option<String> {
        let CameraSource::Assumed(degrees) = self.source else { return None };
        Some(format!(
            "the camera is unknown: a horizontal field of view of {degrees} degrees is assumed, which affects the point cloud \
             but not the depth, unless a field is fitted; give {{fov}} or {{intrinsics}}"
        ))
    }
}

/// Focal lengths and principal point in pixels, and the image size where the file states it.
#[derive(Deserialize)]
struct Intrinsics {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: Option<usize>,
    height: Option<usize>,
}

/// The camera of an image of `width` by `height` pixels, counted from 0, by a 3x3 matrix (white space, commas, semicolons and brackets
/// separate), or by JSON with `fx`, `fy`, `cx`, `cy` and optionally `width` and `height`; other keys are ignored.
///
/// ```
/// let camera = mde_cli::scene::camera::intrinsics("520.5 0 277.9\n0 521 215\n0 0 1", [561, 427])?;
/// assert_eq!((camera.fx, camera.cy), (520.5, 215.0));
/// # Ok::<(), mde_cli::Error>(())
/// ```
///
/// # Errors
/// [`Error::Argument`] for text of another layout, or intrinsics of another size; [`Error::Warp`] for a value out of range.
pub fn intrinsics(text: &str, [width, height]: [usize; 2]) -> Result<PinholeCamera> {
    let Intrinsics { fx, fy, cx, cy, width: w, height: h } = match text.trim_start().starts_with('{') {
        true => serde_json::from_str(text)
            .map_err(|e| Error::Argument(format!("give JSON with the numbers fx, fy, cx, cy: {e}")))?,
        false => matrix(text)?,
    };
    let (w, h) = (w.unwrap_or(width), h.unwrap_or(height));
    if (w, h) != (width, height) {
        return Err(Error::Argument(format!(
            "the intrinsics are for {w}x{h} pixels but the image is {width}x{height}; scale them"
        )));
    }
    Ok(PinholeCamera::new(fx, fy, cx, cy, width, height)?)
}

fn matrix(text: &str) -> Result<Intrinsics> {
    let parts = text.split(|c: char| c.is_whitespace() || ",;[]".contains(c)).filter(|part| !part.is_empty());
    let numbers: Vec<f64> = parts
        .map(str::parse)
        .collect::<Result<_, _>>()
        .map_err(|e| Error::Argument(format!("give a 3x3 matrix of numbers, or JSON: {e}")))?;
    let &[fx, skew, cx, zero, fy, cy, below, beside, one] = numbers.as_slice() else {
        return Err(Error::Argument(format!(
            "{} numbers do not make a camera; give a 3x3 matrix, or JSON with fx, fy, cx, cy",
            numbers.len()
        )));
    };
    if ![skew, zero, below, beside, one - 1.0].iter().all(|v| v.abs() < 1e-6) {
        return Err(Error::Argument(
            "the matrix is not that of a pinhole camera; give [fx 0 cx; 0 fy cy; 0 0 1]".into(),
        ));
    }
    Ok(Intrinsics { fx, fy, cx, cy, width: None, height: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_and_json_are_read_and_know_their_size() {
        let camera = PinholeCamera::new(520.5, 521.0, 277.9, 215.0, 561, 427).unwrap();
        for text in [
            "520.5 0 277.9\n0 521 215\n0 0 1\n",
            "520.5 0 277.9 0 521 215 0 0 1",
            "[[520.5, 0, 277.9], [0, 521, 215], [0, 0, 1]]",
            "{\"fx\": 520.5, \"fy\": 521, \"cx\": 277.9, \"cy\": 215, \"source\": \"a lab\"}",
        ] {
            assert_eq!(intrinsics(text, [561, 427]).unwrap(), camera, "{text}");
        }
        let text =
            "{\"fx\": 500, \"fy\": 500, \"cx\": 319.5, \"cy\": 239.5, \"width\": 640, \"height\": 480}";
        assert_eq!(intrinsics(text, [640, 480]).unwrap().cx, 319.5);
        assert!(intrinsics(text, [320, 240]).is_err());
    }
}
