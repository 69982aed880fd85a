//! The camera from flags, a file, EXIF or a guess.

use crate::args::CameraArgs;
use anyhow::{Context, Result, bail, ensure};
use mde_warp::PinholeCamera;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Assumed where nothing is known: between a phone's main camera (65 to 75 degrees) and a longer lens.
const ASSUMED_FOV: f64 = 60.0;

/// A camera and how it is known.
#[derive(Debug, Serialize)]
pub(crate) struct KnownCamera {
    #[serde(flatten)]
    pub(crate) camera: PinholeCamera,
    pub(crate) source: CameraSource,
}

#[derive(Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CameraSource {
    /// `--fx` and so on.
    Flags,
    /// `--fov`, degrees.
    FieldOfView(f64),
    /// `--intrinsics`.
    File(PathBuf),
    /// The photograph's EXIF, 35 mm focal length in millimetres.
    Exif(f64),
    /// Nothing was known; degrees.
    Assumed(f64),
    /// The procedural scene's own.
    Scene,
}

impl KnownCamera {
    /// The camera of a picture of `width` by `height` pixels.
    pub(crate) fn new(
        args: &CameraArgs,
        focal_35mm: Option<f64>,
        [width, height]: [usize; 2],
    ) -> Result<Self> {
        let middle = |side: usize| 0.5 * (side as f64 - 1.0);
        let (camera, source) = if let Some(path) = &args.intrinsics {
            let k = Intrinsics::read(path)?;
            k.check_size(width, height).with_context(|| path.display().to_string())?;
            let base = f64::from(args.intrinsics_base);
            let camera = PinholeCamera::new(k.fx, k.fy, k.cx - base, k.cy - base, width, height);
            (camera.with_context(|| path.display().to_string())?, CameraSource::File(path.clone()))
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
        Ok(Self { camera, source })
    }

    /// What to tell the user of a guess.
    pub(crate) fn warning(&self) -> Option<String> {
        let CameraSource::Assumed(degrees) = self.source else { return None };
        Some(format!(
            "the camera is unknown; a horizontal field of view of {degrees} degrees is assumed (give --fov, --fx or \
             --intrinsics)"
        ))
    }
}

#[derive(Debug, PartialEq, Deserialize)]
struct Intrinsics {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: Option<usize>,
    height: Option<usize>,
}

impl Intrinsics {
    fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| {
            format!("{}: can't read the camera's intrinsics; check the path", path.display())
        })?;
        Self::parse(&text).with_context(|| path.display().to_string())
    }

    fn parse(text: &str) -> Result<Self> {
        if text.trim_start().starts_with('{') {
            return serde_json::from_str(text).context("give JSON with the numbers fx, fy, cx, cy");
        }
        let parts =
            text.split(|c: char| c.is_whitespace() || ",;[]".contains(c)).filter(|part| !part.is_empty());
        let numbers: Vec<f64> = parts
            .map(str::parse)
            .collect::<Result<_, _>>()
            .context("give a 3x3 matrix of numbers, or JSON")?;
        let &[fx, skew, cx, zero, fy, cy, below, beside, one] = numbers.as_slice() else {
            bail!("{} numbers are no camera; give a 3x3 matrix, or JSON with fx, fy, cx, cy", numbers.len());
        };
        ensure!(
            [skew, zero, below, beside, one - 1.0].iter().all(|v| v.abs() < 1e-6),
            "no pinhole camera; the matrix must be [fx 0 cx; 0 fy cy; 0 0 1]"
        );
        Ok(Self { fx, fy, cx, cy, width: None, height: None })
    }

    fn check_size(&self, width: usize, height: usize) -> Result<()> {
        let (w, h) = (self.width.unwrap_or(width), self.height.unwrap_or(height));
        ensure!(
            (w, h) == (width, height),
            "the intrinsics are for {w}x{h} pixels but the image is {width}x{height}; scale them"
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_and_json_are_read() {
        let k = Intrinsics { fx: 520.5, fy: 521.0, cx: 277.9, cy: 215.0, width: None, height: None };
        for text in [
            "520.5 0 277.9\n0 521 215\n0 0 1\n",
            "520.5 0 277.9 0 521 215 0 0 1",
            "[[520.5, 0, 277.9], [0, 521, 215], [0, 0, 1]]",
            "{\"fx\": 520.5, \"fy\": 521, \"cx\": 277.9, \"cy\": 215, \"source\": \"a lab\"}",
        ] {
            assert_eq!(Intrinsics::parse(text).unwrap(), k, "{text}");
        }
        for text in ["", "1 2 3", "520 3 277 0 520 215 0 0 1", "a b c", "{\"fx\": 520}"] {
            assert!(Intrinsics::parse(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_intrinsics_know_their_size() {
        let text =
            "{\"fx\": 500, \"fy\": 500, \"cx\": 319.5, \"cy\": 239.5, \"width\": 640, \"height\": 480}";
        let k = Intrinsics::parse(text).unwrap();
        assert!(k.check_size(640, 480).is_ok() && k.check_size(320, 240).is_err());
    }
}
