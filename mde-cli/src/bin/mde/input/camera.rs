//! The camera from flags, a file, EXIF or an assumption.

use crate::args::CameraArgs;
use crate::input::opened::Opened;
use anyhow::{Context, Result, ensure};
use mde_cli::Intrinsics;
use mde_warp::PinholeCamera;
use serde::Serialize;

/// Assumed horizontal field of view, degrees: between a phone's main camera (65 to 75) and a longer lens.
const ASSUMED_FOV: f64 = 60.0;

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
    /// `--fx` and so on.
    Flags,
    /// `--fov`, degrees.
    FieldOfView(f64),
    /// `--intrinsics`.
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
    pub(crate) fn name(&self) -> &'static str {
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
    /// The camera at the working size; flags and files are for the size of the image file.
    pub(crate) fn new(args: &CameraArgs, focal_35mm: Option<f64>, opened: &Opened) -> Result<Self> {
        let (height, width) = opened.original;
        let known = Self::of_size(args, focal_35mm, [width, height])?;
        let (height, width) = opened.size;
        Ok(Self { camera: known.camera.resized(width, height)?, ..known })
    }

    /// The camera of an image that is not resized.
    pub(crate) fn of_size(
        args: &CameraArgs,
        focal_35mm: Option<f64>,
        [width, height]: [usize; 2],
    ) -> Result<Self> {
        let middle = |side: usize| 0.5 * (side as f64 - 1.0);
        let (camera, source) = if let Some(path) = &args.intrinsics {
            let text = std::fs::read_to_string(path).with_context(|| {
                format!("{}: can't read the camera's intrinsics; check the path", path.display())
            })?;
            let camera = Intrinsics::parse(&text)
                .and_then(|k| k.camera(args.intrinsics_base, [width, height]))
                .with_context(|| path.display().to_string())?;
            (camera, CameraSource::File(path.display().to_string()))
        } else if let Some(fx) = args.fx {
            let (cx, cy) = (args.cx.unwrap_or(middle(width)), args.cy.unwrap_or(middle(height)));
            (PinholeCamera::new(fx, args.fy.unwrap_or(fx), cx, cy, width, height)?, CameraSource::Flags)
        } else if let Some(fov) = args.fov {
            let camera = PinholeCamera::from_fov(fov, width, height).context("--fov")?;
            (camera, CameraSource::FieldOfView(fov))
        } else if let Some(mm) = focal_35mm {
            (PinholeCamera::from_focal_35mm(mm, width, height)?, CameraSource::Exif(mm))
        } else {
            (PinholeCamera::from_fov(ASSUMED_FOV, width, height)?, CameraSource::Assumed(ASSUMED_FOV))
        };
        // Beyond this, rays leave at right angles to the axis, or all along it.
        let stated = matches!(source, CameraSource::Flags | CameraSource::File(_));
        for (name, focal, side) in [("fx", camera.fx, width), ("fy", camera.fy, height)] {
            ensure!(
                !stated || (1e-3..=1e5).contains(&(focal / side as f64)),
                "{name} is {focal:e} pixels, which is no focal length of an image of {width}x{height}; give one about the width, or --fov"
            );
        }
        Ok(Self { camera, source })
    }

    /// Focal length / width, where it is not assumed.
    pub(crate) fn focal(&self) -> Option<f64> {
        let known = !matches!(self.source, CameraSource::Assumed(_));
        known.then(|| self.camera.fx / self.camera.width as f64)
    }

    /// A warning where the camera is assumed.
    pub(crate) fn warning(&self) -> Option<String> {
        let CameraSource::Assumed(degrees) = self.source else { return None };
        Some(format!(
            "the camera is unknown: a horizontal field of view of {degrees} degrees is assumed, which affects the point cloud \
             but not the depth, unless a field is fitted; give --fov, --fx or --intrinsics"
        ))
    }
}
