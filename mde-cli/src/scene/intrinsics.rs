//! Camera intrinsics from a file.

use crate::error::{Error, Result};
use mde_warp::PinholeCamera;
use serde::Deserialize;

/// Focal lengths and principal point in pixels, and the image size where the file states it.
///
/// ```
/// use mde_cli::scene::intrinsics::Intrinsics;
///
/// let k = Intrinsics::parse("520.5 0 277.9\n0 521 215\n0 0 1")?;
/// let camera = k.camera([561, 427])?;
/// assert_eq!((camera.fx, camera.cy), (520.5, 215.0));
/// # Ok::<(), mde_cli::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct Intrinsics {
    /// Horizontal focal length.
    pub fx: f64,
    /// Vertical focal length.
    pub fy: f64,
    /// Column of the principal point.
    pub cx: f64,
    /// Row of the principal point.
    pub cy: f64,
    /// Width of the image, pixels.
    pub width: Option<usize>,
    /// Height of the image, pixels.
    pub height: Option<usize>,
}

impl Intrinsics {
    /// Reads a 3x3 matrix (white space, commas, semicolons and brackets separate), or JSON with `fx`, `fy`, `cx`, `cy` and
    /// optionally `width` and `height`; other keys are ignored.
    ///
    /// # Errors
    /// [`Error::Argument`] for text of another layout.
    pub fn parse(text: &str) -> Result<Self> {
        if text.trim_start().starts_with('{') {
            return serde_json::from_str(text)
                .map_err(|e| fault(format!("give JSON with the numbers fx, fy, cx, cy: {e}")));
        }
        let parts =
            text.split(|c: char| c.is_whitespace() || ",;[]".contains(c)).filter(|part| !part.is_empty());
        let numbers: Vec<f64> = parts
            .map(str::parse)
            .collect::<Result<_, _>>()
            .map_err(|e| fault(format!("give a 3x3 matrix of numbers, or JSON: {e}")))?;
        let &[fx, skew, cx, zero, fy, cy, below, beside, one] = numbers.as_slice() else {
            return Err(fault(format!(
                "{} numbers do not make a camera; give a 3x3 matrix, or JSON with fx, fy, cx, cy",
                numbers.len()
            )));
        };
        if ![skew, zero, below, beside, one - 1.0].iter().all(|v| v.abs() < 1e-6) {
            return Err(fault(
                "the matrix is not that of a pinhole camera; give [fx 0 cx; 0 fy cy; 0 0 1]".into(),
            ));
        }
        Ok(Self { fx, fy, cx, cy, width: None, height: None })
    }

    /// The camera of an image of `width` by `height` pixels, counted from 0.
    ///
    /// # Errors
    /// [`Error::Argument`] for intrinsics of another size, [`Error::Warp`] for a value out of range.
    pub fn camera(&self, [width, height]: [usize; 2]) -> Result<PinholeCamera> {
        let (w, h) = (self.width.unwrap_or(width), self.height.unwrap_or(height));
        if (w, h) != (width, height) {
            return Err(fault(format!(
                "the intrinsics are for {w}x{h} pixels but the image is {width}x{height}; scale them"
            )));
        }
        Ok(PinholeCamera::new(self.fx, self.fy, self.cx, self.cy, width, height)?)
    }
}

fn fault(reason: String) -> Error {
    Error::Argument(reason)
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
        assert_eq!(k.camera([640, 480]).unwrap().cx, 319.5);
        assert!(k.camera([320, 240]).is_err());
    }

    #[test]
    fn a_file_of_no_possible_camera_is_refused() {
        use crate::scene::camera::{GivenCamera, KnownCamera};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("k.txt");
        for (matrix, word) in [
            ("1e300 0 320 0 500 240 0 0 1", "fx is 1e300"),
            ("500 0 320 0 1e-300 240 0 0 1", "fy is 1e-300"),
            ("500 0 1e300 0 500 240 0 0 1", "cx is 1e300"),
        ] {
            std::fs::write(&path, matrix).unwrap();
            let camera = KnownCamera::new(&GivenCamera::File(path.clone()), None, [640, 480]);
            let refused = camera.unwrap_err().to_string();
            assert!(refused.contains("k.txt") && refused.contains(word), "{refused}");
        }
    }
}
