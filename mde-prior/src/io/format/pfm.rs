//! Portable float map, grey: `Pf`, width, height, a scale whose sign is the byte order, then rows from the bottom up.

use ndarray::{Array2, ArrayView2, Axis};

use super::{Parsed, check_size};

pub(super) fn encode(map: ArrayView2<'_, f32>) -> Vec<u8> {
    let (height, width) = map.dim();
    let mut bytes = format!("Pf\n{width} {height}\n-1.0\n").into_bytes();
    bytes.extend(map.axis_iter(Axis(0)).rev().flatten().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// The magnitude of the scale has no agreed unit and is ignored, as in other readers.
pub(super) fn parse(bytes: &[u8]) -> Parsed<Array2<f32>> {
    let broken = || "the PFM header is malformed; write 'Pf', width, height and scale".to_owned();
    let mut rest = bytes;
    match token(&mut rest) {
        Some("Pf") => {}
        Some("PF") => return Err("this PFM has three channels; write a grey one ('Pf')".to_owned()),
        _ => return Err("the file is not in PFM format; write a header that starts with 'Pf'".to_owned()),
    }
    let width: usize = token(&mut rest).and_then(|t| t.parse().ok()).ok_or_else(broken)?;
    let height: usize = token(&mut rest).and_then(|t| t.parse().ok()).ok_or_else(broken)?;
    let scale: f64 = token(&mut rest).and_then(|t| t.parse().ok()).ok_or_else(broken)?;
    // With Windows line ends, the line feed is still part of the header.
    if bytes[..bytes.len() - rest.len()].ends_with(b"\r") {
        rest = rest.strip_prefix(b"\n").unwrap_or(rest);
    }
    if !scale.is_finite() || scale == 0.0 {
        return Err(broken());
    }
    let needed = 4 * check_size(width, height)?;
    let Some(data) = rest.get(..needed) else {
        return Err(format!(
            "truncated: {width}x{height} floats need {needed} bytes, there are {}; write the file again",
            rest.len()
        ));
    };
    let decode = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
    let values = data.as_chunks().0.iter().map(|raw| decode(*raw)).collect();
    let mut map = Array2::from_shape_vec((height, width), values).map_err(|e| e.to_string())?;
    map.invert_axis(Axis(0));
    Ok(map.as_standard_layout().into_owned())
}

/// The next word, and exactly one white-space byte after it (more would be data).
fn token<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
    // No number of a header is longer; other data is not searched to its end.
    let length = rest[start..].iter().take(32).position(u8::is_ascii_whitespace)?;
    let word = &rest[start..start + length];
    *rest = &rest[start + length + 1..];
    std::str::from_utf8(word).ok()
}
