//! Photographs: reading with the EXIF orientation and focal length, writing of PNG.

use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

use exif::{Context, Exif, In, Tag};
use image::{
    DynamicImage, ExtendedColorType, GrayImage, ImageDecoder as _, ImageEncoder as _, ImageFormat,
    ImageReader, Limits, RgbImage,
};
use ndarray::{Array3, ArrayView3};
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::format::{MAX_PIXELS, read_file};
use super::open::{self, FileKind};
use super::write_atomic;
use crate::{Error, Result};

/// Longest side, pixels.
const MAX_SIDE: u32 = 1 << 16;
/// Most bytes of a PNG's compressed metadata; its decoder leaves out a colour profile with more.
const MAX_METADATA: u64 = 1 << 26;
/// How a JPEG begins, and the second bytes of two of its markers.
const JPEG: [u8; 2] = [0xff, 0xd8];
const END_OF_IMAGE: u8 = 0xd9;
const START_OF_SCAN: u8 = 0xda;
/// A tag of a TIFF.
const SAMPLE_FORMAT: Tag = Tag(Context::Tiff, 339);

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
    decode(&read_file(path, FileKind::Photograph)?).map_err(|reason| Error::malformed(path, reason))
}

/// Width and height of an image file, upright, from its header alone; nothing where it is missing, no image, or too large to be read.
pub fn image_size(path: impl AsRef<Path>) -> Option<[usize; 2]> {
    let file = BufReader::new(open::open(path, FileKind::Photograph).ok()?);
    let reader = ImageReader::new(file).with_guessed_format().ok()?;
    let mut decoder = with_limits(reader).into_decoder().ok()?;
    let (width, height) = decoder.dimensions();
    check_image_size(width, height).ok()?;
    // From 5 on EXIF's orientations swap the sides.
    let turned = decoder.orientation().ok()?.to_exif() >= 5;
    let size = if turned { [height, width] } else { [width, height] };
    Some(size.map(|side| side as usize))
}

/// As [`read_image`], from the bytes of a file.
///
/// # Errors
/// [`Error::Input`] with the reason.
pub fn decode_image(bytes: &[u8]) -> Result<Photo> {
    decode(bytes).map_err(Error::Input)
}

fn decode(bytes: &[u8]) -> Result<Photo, String> {
    if matches!(bytes.get(4..12), Some(b"ftypheic" | b"ftypheix" | b"ftypmif1")) {
        return Err(unreadable(&"HEIC: convert it with heif-convert, or sips -s format jpeg"));
    }
    let broken = |e: image::ImageError| unreadable(&e);
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
    if let Some([width, height]) = png_size(bytes) {
        check_image_size(width, height)?;
    }
    let format = reader.format();
    let mut decoder = with_limits(reader).into_decoder().map_err(broken)?;
    let (width, height) = decoder.dimensions();
    check_image_size(width, height)?;
    let orientation = decoder.orientation().map_err(broken)?;
    if format == Some(ImageFormat::Tiff) && has_wide_integers(bytes) {
        return Err("the TIFF holds 32-bit integers; convert it to 8 or 16 bits".to_owned());
    }
    let mut image = match bytes.starts_with(&JPEG) {
        true => whole_jpeg(bytes)?,
        false => DynamicImage::from_decoder(decoder).map_err(broken)?,
    };
    image.apply_orientation(orientation);
    Ok(Photo { pixels: to_array(image)?, focal_35mm: focal_35mm(bytes) })
}

fn unreadable(reason: &dyn std::fmt::Display) -> String {
    format!("no readable image ({reason}); give a JPEG, PNG, TIFF, BMP or WebP")
}

/// A JPEG whose data reach its end. `image` decodes with the same library, but fills what is missing with grey.
fn whole_jpeg(bytes: &[u8]) -> Result<DynamicImage, String> {
    // The last rows of blocks can miss their end without an error of the decoder.
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xff, marker]);
    if last(END_OF_IMAGE) < last(START_OF_SCAN) {
        return Err(unreadable(&"the JPEG is truncated"));
    }
    let options = DecoderOptions::default().set_strict_mode(true);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let broken = |e: DecodeErrors| unreadable(&format!("the JPEG is truncated or damaged: {e}"));
    decoder.decode_headers().map_err(broken)?;
    let grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
    if grey {
        decoder.set_options(options.jpeg_set_out_colorspace(ColorSpace::Luma));
    }
    let pixels = decoder.decode().map_err(broken)?;
    let [width, height] =
        decoder.dimensions().map_or([0; 2], |(width, height)| [width as u32, height as u32]);
    let image = match grey {
        true => GrayImage::from_raw(width, height, pixels).map(DynamicImage::from),
        false => RgbImage::from_raw(width, height, pixels).map(DynamicImage::from),
    };
    image.ok_or_else(|| unreadable(&"the JPEG has neither one channel nor three"))
}

/// Whether an image of that size is decoded, or the reason and remedy.
pub(super) fn check_image_size(width: u32, height: u32) -> Result<(), String> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS as u64 || width.max(height) > MAX_SIDE {
        return Err(format!("{width}x{height} pixels are too many or none; resize the image"));
    }
    Ok(())
}

/// Width and height in the header of a PNG.
pub(super) fn png_size(bytes: &[u8]) -> Option<[u32; 2]> {
    let header = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n")?.get(8..16)?.as_chunks::<4>().0;
    Some([u32::from_be_bytes(*header.first()?), u32::from_be_bytes(*header.get(1)?)])
}

/// The reader with the memory that its decoder may take.
pub(super) fn with_limits<R: BufRead + Seek>(mut reader: ImageReader<R>) -> ImageReader<R> {
    let mut limits = Limits::default();
    // A PNG is decoded row by row: the limit is for what is compressed beside the pixels.
    let png = reader.format() == Some(ImageFormat::Png);
    limits.max_alloc = Some(if png { MAX_METADATA } else { 16 * MAX_PIXELS as u64 });
    reader.limits(limits);
    reader
}

/// Whether a TIFF's samples are integers of 32 bits or more without a stated format, whose bits the decoder takes for those of
/// floating-point numbers.
fn has_wide_integers(bytes: &[u8]) -> bool {
    tags(bytes).is_some_and(|tags| {
        let bits = tags.get_field(Tag::BitsPerSample, In::PRIMARY).and_then(|field| field.value.get_uint(0));
        bits.is_some_and(|bits| bits >= 32) && tags.get_field(SAMPLE_FORMAT, In::PRIMARY).is_none()
    })
}

/// The EXIF of a photograph, which of a TIFF has its own tags too.
fn tags(bytes: &[u8]) -> Option<Exif> {
    exif::Reader::new().read_from_container(&mut Cursor::new(bytes)).ok()
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
    let millimetres = tags(bytes)?.get_field(Tag::FocalLengthIn35mmFilm, In::PRIMARY)?.value.get_uint(0);
    millimetres.filter(|&mm| mm > 0).map(f64::from)
}

/// Writes `[height, width, 3]` sRGB bytes as a PNG.
///
/// # Errors
/// [`Error::Write`]; [`Error::Malformed`] when the shape is not `[height, width, 3]` with 1 pixel at least.
pub fn write_rgb_png(path: impl AsRef<Path>, pixels: ArrayView3<'_, u8>) -> Result<()> {
    let path = path.as_ref();
    let bytes = encode_rgb_png(pixels).map_err(|error| Error::malformed(path, error.to_string()))?;
    write_atomic(path, &bytes)
}

/// The bytes of a PNG of `[height, width, 3]` sRGB bytes.
///
/// # Errors
/// [`Error::Input`] when the shape is not `[height, width, 3]` with 1 pixel at least.
pub fn encode_rgb_png(pixels: ArrayView3<'_, u8>) -> Result<Vec<u8>> {
    let (height, width, channels) = pixels.dim();
    let side = |n: usize| u32::try_from(n).ok().filter(|&n| n > 0);
    let (Some(width), Some(height), 3) = (side(width), side(height), channels) else {
        return Err(Error::Input(format!(
            "an image of shape {:?} cannot be written; give [height, width, 3]",
            pixels.shape()
        )));
    };
    let data: Vec<u8> = pixels.iter().copied().collect();
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(&data, width, height, ExtendedColorType::Rgb8)
        .map_err(|e| Error::Input(e.to_string()))?;
    Ok(bytes)
}

/// Writes `[height, width, 3]` sRGB values in `[0, 1]`, rounded to 8 bits and clamped, as a PNG.
///
/// # Errors
/// Those of [`write_rgb_png`], and [`Error::Malformed`] for NaN.
pub fn write_image(path: impl AsRef<Path>, pixels: ArrayView3<'_, f32>) -> Result<()> {
    let path = path.as_ref();
    if let Some(((row, column, _), _)) = pixels.indexed_iter().find(|(_, v)| v.is_nan()) {
        let reason = format!("NaN at row {row}, column {column} is not a colour; give values in 0 to 1");
        return Err(Error::malformed(path, reason));
    }
    write_rgb_png(path, pixels.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).view())
}
