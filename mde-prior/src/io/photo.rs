//! Photographs: reading with the EXIF orientation and focal length, writing of PNG.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ExtendedColorType, ImageDecoder as _, ImageEncoder as _, ImageReader, Limits};
use ndarray::{Array3, ArrayView3};

use super::format::{MAX_PIXELS, read_file};
use super::write_atomic;
use crate::{Error, Result};

/// A photograph, upright.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Photo {
    /// `[height, width, 3]`, sRGB values in `[0, 1]`.
    pub pixels: Array3<f32>,
    /// EXIF `FocalLengthIn35mmFilm` in millimetres, if any.
    pub focal_35mm: Option<f64>,
}

/// Reads a JPEG, PNG, TIFF, BMP or WebP of 8 or 16 bits, by its content: grey becomes three equal channels, alpha is
/// dropped, the EXIF orientation is applied, a colour profile is not.
///
/// # Errors
/// [`Error::Read`]; [`Error::Malformed`] when the file is no such image, broken, or too large.
pub fn read_image(path: impl AsRef<Path>) -> Result<Photo> {
    let path = path.as_ref();
    decode(&read_file(path)?).map_err(|reason| Error::malformed(path, reason))
}

/// As [`read_image`], from the bytes of a file.
///
/// # Errors
/// [`Error::Input`] with the reason.
pub fn decode_image(bytes: &[u8]) -> Result<Photo> {
    decode(bytes).map_err(Error::Input)
}

fn decode(bytes: &[u8]) -> Result<Photo, String> {
    let broken =
        |e: image::ImageError| format!("no readable image ({e}); give a JPEG, PNG, TIFF, BMP or WebP");
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(16 * MAX_PIXELS as u64);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(broken)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS as u64 {
        return Err(format!("{width}x{height} pixels are too many or none; resize the image"));
    }
    let orientation = decoder.orientation().map_err(broken)?;
    // The decoder fills a truncated image with grey.
    if bytes.starts_with(&[0xff, 0xd8]) && !ends(bytes) {
        return Err("no readable image (the JPEG is truncated); give a JPEG, PNG, TIFF, BMP or WebP".into());
    }
    let mut image = DynamicImage::from_decoder(decoder).map_err(broken)?;
    image.apply_orientation(orientation);
    Ok(Photo { pixels: to_array(image)?, focal_35mm: focal_35mm(bytes) })
}

/// Whether a JPEG's first scan is followed by the end-of-image marker; a thumbnail before it has its own.
fn ends(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        match rest {
            [0xff, 0xff, ..] => rest = &rest[1..],
            [0xff, 0xda, scan @ ..] => return scan.windows(2).any(|pair| pair == [0xff, 0xd9]),
            [0xff, _, high, low, ..] => {
                let length = 2 + usize::from(u16::from_be_bytes([*high, *low]));
                rest = rest.get(length..).unwrap_or_default();
            }
            _ => return false,
        }
    }
}

fn to_array(image: DynamicImage) -> Result<Array3<f32>, String> {
    let image = image.into_rgb32f();
    let shape = (image.height() as usize, image.width() as usize, 3);
    let pixels = Array3::from_shape_vec(shape, image.into_raw()).map_err(|e| e.to_string())?;
    // Only floating-point TIFF can hold NaN.
    if pixels.iter().any(|v| v.is_nan()) {
        return Err("the image holds NaN; convert it to 8 or 16 bits".to_owned());
    }
    Ok(pixels.mapv_into(|v| v.clamp(0.0, 1.0)))
}

/// A value of 0 means "unknown" (EXIF 2.3, tag 0xA405).
fn focal_35mm(bytes: &[u8]) -> Option<f64> {
    let exif = exif::Reader::new().read_from_container(&mut Cursor::new(bytes)).ok()?;
    let field = exif.get_field(exif::Tag::FocalLengthIn35mmFilm, exif::In::PRIMARY)?;
    field.value.get_uint(0).filter(|&mm| mm > 0).map(f64::from)
}

/// Writes `[height, width, 3]` sRGB bytes as a PNG.
///
/// # Errors
/// [`Error::Write`]; [`Error::Malformed`] when the shape is not `[height, width, 3]` with 1 pixel at least.
pub fn write_rgb_png(path: impl AsRef<Path>, pixels: ArrayView3<'_, u8>) -> Result<()> {
    let path = path.as_ref();
    let bytes = encode(pixels).map_err(|reason| Error::malformed(path, reason))?;
    write_atomic(path, &bytes)
}

/// The bytes of a PNG of `[height, width, 3]` sRGB bytes.
///
/// # Errors
/// [`Error::Input`] when the shape is not `[height, width, 3]` with 1 pixel at least.
pub fn encode_rgb_png(pixels: ArrayView3<'_, u8>) -> Result<Vec<u8>> {
    encode(pixels).map_err(Error::Input)
}

fn encode(pixels: ArrayView3<'_, u8>) -> Result<Vec<u8>, String> {
    let (height, width, channels) = pixels.dim();
    let side = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
    let (Some(width), Some(height), 3) = (side(width), side(height), channels) else {
        return Err(format!(
            "an image of shape {:?} cannot be written; give [height, width, 3]",
            pixels.shape()
        ));
    };
    let data: Vec<u8> = pixels.iter().copied().collect();
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(&data, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// Writes `[height, width, 3]` sRGB values in `[0, 1]`, rounded to 8 bits and clamped, as a PNG.
///
/// # Errors
/// Those of [`write_rgb_png`], and [`Error::Malformed`] for NaN.
pub fn write_image(path: impl AsRef<Path>, pixels: ArrayView3<'_, f32>) -> Result<()> {
    let path = path.as_ref();
    if let Some(((row, column, _), _)) = pixels.indexed_iter().find(|(_, v)| v.is_nan()) {
        return Err(Error::malformed(
            path,
            format!("NaN at row {row}, column {column} is not a colour; give values in 0 to 1"),
        ));
    }
    write_rgb_png(path, pixels.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).view())
}
