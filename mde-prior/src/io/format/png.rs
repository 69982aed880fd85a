//! 16-bit grey PNG.

use std::io::Cursor;

use image::{ExtendedColorType, ImageDecoder as _, ImageEncoder as _, ImageFormat, ImageReader};
use ndarray::{Array2, ArrayView2};

use super::super::photo::{check_image_size, png_size, with_limits};
use super::{Parsed, check_size};

pub(super) fn parse(bytes: &[u8], eight_bits: bool) -> Parsed<Array2<f32>> {
    let broken = |e: image::ImageError| format!("the PNG cannot be read ({e}); write the file again");
    if let Some([width, height]) = png_size(bytes) {
        check_image_size(width, height)?;
    }
    let reader = with_limits(ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png));
    let decoder = reader.into_decoder().map_err(broken)?;
    let color = decoder.original_color_type();
    let eight = eight_bits && color == ExtendedColorType::L8;
    if color != ExtendedColorType::L16 && !eight {
        return Err(format!(
            "the PNG's samples are {color:?}; write depth as 16-bit greyscale (an 8-bit or colour PNG shows depth, it does not hold it)"
        ));
    }
    let (width, height) = (decoder.dimensions().0 as usize, decoder.dimensions().1 as usize);
    let mut data = vec![0_u8; if eight { 1 } else { 2 } * check_size(width, height)?];
    decoder.read_image(&mut data).map_err(broken)?;
    let values = match eight {
        true => data.into_iter().map(f32::from).collect(),
        false => data.as_chunks().0.iter().map(|raw| f32::from(u16::from_ne_bytes(*raw))).collect(),
    };
    Array2::from_shape_vec((height, width), values).map_err(|e| e.to_string())
}

pub(super) fn encode(map: ArrayView2<'_, f32>, scale: f64) -> Parsed<Vec<u8>> {
    let raw = |value: f32| (f64::from(value) * scale).round();
    let fits = |value: f32| value >= 0.0 && raw(value) <= 65535.0;
    if let Some(((row, column), value)) = map.indexed_iter().find(|(_, value)| !fits(**value)) {
        return Err(format!(
            "{value} at row {row}, column {column} does not fit into 16 bits at {scale} steps per unit; \
             write .npy, or use a smaller scale for depths beyond {}",
            65535.0 / scale
        ));
    }
    encode_values(map, |value| if value > 0.0 { raw(value).max(1.0) as u16 } else { 0 })
}

/// Any values as 16-bit grey.
pub(super) fn encode_values(map: ArrayView2<'_, f32>, sample: impl Fn(f32) -> u16) -> Parsed<Vec<u8>> {
    let (height, width) = map.dim();
    let data: Vec<u8> = map.iter().flat_map(|value| sample(*value).to_ne_bytes()).collect();
    let side =
        |n: usize| u32::try_from(n).map_err(|_| format!("{n} pixels are too many for a PNG; write .npy"));
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(&data, side(width)?, side(height)?, ExtendedColorType::L16)
        .map_err(|e| e.to_string())?;
    Ok(bytes)
}
