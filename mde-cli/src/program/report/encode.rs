//! Encoding of maps, images and colours for the page.

use crate::scene::byte;
use anyhow::Result;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use colorous::{Gradient, MAGMA, PURPLE_ORANGE, SPECTRAL};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use mde_prior::photo::{encode_rgb_png, read_image};
use ndarray::{ArrayView2, ArrayView3};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// The sides of an embedded map, pixels, are at most this.
pub(super) const WIDEST: usize = 640;
/// Steps of a value between the lowest and the highest; 0 is kept for "missing".
const STEPS: f64 = 65534.0;

/// A map of positive values in 16 bits, evenly spaced in the logarithm (so that one far outlier costs no digits), each
/// pixel minus its left neighbour, low bytes then high bytes, deflated.
pub(super) fn map(map: ArrayView2<'_, f32>) -> Result<Value> {
    let known = |v: f32| v.is_finite() && v > 0.0;
    let values = || map.iter().copied().filter(|&v| known(v)).map(f64::from);
    let low = values().fold(f64::INFINITY, f64::min).ln();
    let high = values().fold(0.0, f64::max).ln();
    let step = |v: f32| match (known(v), high > low) {
        (false, _) => 0,
        (true, false) => 1,
        (true, true) => 1 + ((f64::from(v).ln() - low) / (high - low) * STEPS).round() as u16,
    };
    let mut bytes = vec![0_u8; 2 * map.len()];
    let (lows, highs) = bytes.split_at_mut(map.len());
    for (row, values) in map.rows().into_iter().enumerate() {
        let mut left = 0_u16;
        for (column, &value) in values.iter().enumerate() {
            let value = step(value);
            let [low, high] = value.wrapping_sub(left).to_le_bytes();
            let place = row * values.len() + column;
            (lows[place], highs[place], left) = (low, high, value);
        }
    }
    // The usual level takes twice as long, for 4 % fewer bytes.
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(2));
    encoder.write_all(&bytes)?;
    let data = STANDARD.encode(encoder.finish()?);
    let [low, high] = [low, high].map(|v| if v.is_finite() { v } else { 0.0 });
    Ok(json!({ "low": low, "high": high, "steps": STEPS, "data": data }))
}

/// A picture as a `data:` address.
pub(super) fn picture(pixels: ArrayView3<'_, u8>) -> Result<String> {
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(encode_rgb_png(pixels)?)))
}

/// A photograph, sRGB in 0 to 1, as a `data:` address.
pub(super) fn photograph(pixels: ArrayView3<'_, f32>) -> Result<String> {
    picture(pixels.mapv(byte).view())
}

pub(super) fn photograph_in(path: &Path) -> Result<Option<String>> {
    path.is_file().then(|| photograph(read_image(path)?.pixels.view())).transpose()
}

/// An SVG as a `data:` address: as an image it can neither run a script nor clash with the page's names.
pub(super) fn svg(text: &str) -> String {
    format!("data:image/svg+xml;base64,{}", STANDARD.encode(text))
}

/// The page's colour maps: 256 RGB triples each.
pub(super) fn gradients() -> Value {
    let table = |gradient: Gradient| {
        let colours = (0..256).flat_map(|i| gradient.eval_continuous(f64::from(i) / 255.0).as_array());
        STANDARD.encode(colours.collect::<Vec<u8>>())
    };
    json!({ "depth": table(SPECTRAL), "magma": table(MAGMA), "diverging": table(PURPLE_ORANGE) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::read::ZlibDecoder;
    use ndarray::Array2;
    use std::io::Read;

    /// What the page's script does.
    fn decoded(value: &Value, columns: usize) -> Vec<f64> {
        let deflated = STANDARD.decode(value["data"].as_str().unwrap()).unwrap();
        let mut bytes = Vec::new();
        ZlibDecoder::new(deflated.as_slice()).read_to_end(&mut bytes).unwrap();
        let [low, high] = ["low", "high"].map(|key| value[key].as_f64().unwrap());
        let count = bytes.len() / 2;
        let mut left = 0_u16;
        let mut values = Vec::new();
        for place in 0..count {
            if place % columns == 0 {
                left = 0;
            }
            left = left.wrapping_add(u16::from_le_bytes([bytes[place], bytes[count + place]]));
            let share = f64::from(left.wrapping_sub(1)) / STEPS;
            values.push(if left == 0 { 0.0 } else { (low + share * (high - low)).exp() });
        }
        values
    }

    #[test]
    fn a_map_survives_to_four_digits_and_missing_stays_missing() {
        let mut depth =
            Array2::from_shape_fn((7, 13), |(y, x)| 0.3 + (y * 13 + x) as f32 * ((x % 3) as f32 + 0.1));
        depth[(2, 5)] = 0.0;
        depth[(3, 0)] = f32::INFINITY;
        depth[(6, 12)] = 1e5;
        let values = decoded(&map(depth.view()).unwrap(), 13);
        for (&value, &expected) in values.iter().zip(&depth) {
            let expected = f64::from(if expected.is_finite() { expected } else { 0.0 });
            assert!((value - expected).abs() <= 2e-4 * expected, "{value} {expected}");
        }
        let flat = decoded(&map(Array2::from_elem((2, 3), 2.5).view()).unwrap(), 3);
        assert!(flat.iter().all(|v| (v - 2.5).abs() < 1e-6), "{flat:?}");
        let nothing = decoded(&map(Array2::zeros((2, 3)).view()).unwrap(), 3);
        assert_eq!(nothing, [0.0; 6]);
    }
}
