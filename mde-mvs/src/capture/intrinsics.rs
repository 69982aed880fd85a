//! The camera in a file of intrinsics.

use super::{Error, Result};
use mde_warp::PinholeCamera;
use serde::Deserialize;

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
/// let camera = mde_mvs::capture::intrinsics("520.5 0 277.9\n0 521 215\n0 0 1", [561, 427])?;
/// assert_eq!((camera.fx, camera.cy), (520.5, 215.0));
/// # Ok::<(), mde_mvs::capture::Error>(())
/// ```
///
/// # Errors
/// [`Error::Content`] for text of another layout, or intrinsics of another size; [`Error::View`] for a value out of range.
pub fn intrinsics(text: &str, [width, height]: [usize; 2]) -> Result<PinholeCamera> {
    let Intrinsics { fx, fy, cx, cy, width: w, height: h } = match text.trim_start().starts_with('{') {
        true => serde_json::from_str(text)
            .map_err(|e| Error::Content(format!("give JSON with the numbers fx, fy, cx, cy: {e}")))?,
        false => matrix(text)?,
    };
    let (w, h) = (w.unwrap_or(width), h.unwrap_or(height));
    if (w, h) != (width, height) {
        return Err(Error::Content(format!(
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
        .map_err(|e| Error::Content(format!("give a 3x3 matrix of numbers, or JSON: {e}")))?;
    let &[fx, skew, cx, zero, fy, cy, below, beside, one] = numbers.as_slice() else {
        return Err(Error::Content(format!(
            "{} numbers do not make a camera; give a 3x3 matrix, or JSON with fx, fy, cx, cy",
            numbers.len()
        )));
    };
    if ![skew, zero, below, beside, one - 1.0].iter().all(|v| v.abs() < 1e-6) {
        return Err(Error::Content(
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
