//! Depth-map files.
//!
//! | extension | read | written |
//! | --- | --- | --- |
//! | `.png` | 16-bit grey, value / scale | 16-bit grey, value · scale, 0 = missing; unit and scale as text |
//! | `.npy` | f2, f4, f8, u1 to u4, i2 to i8, both byte orders, C and Fortran order | f4, version 1.0 |
//! | `.npz` | stored or deflated; a named array, or the only one | f4, stored, array `depth` |
//! | `.pfm` | grey (`Pf`), both byte orders | grey, little-endian |
//! | `.exr` | half, float or uint; the first suitable channel | float, channel `Z`, ZIP |
//!
//! [`read_depth`] returns depths, 0 = missing; [`read_values`] returns the values unchanged and refuses NaN. Writing is atomic.
//! Sizes in headers are checked against the file before memory is allocated.

mod depth_png;
mod exr;
mod npy;
mod npz;
mod pfm;
mod png;
mod png_text;

pub use depth_png::{DepthPng, confidence, confidence_formula};

use mde_uncertainty::OutOfRange;
use std::path::Path;

use ndarray::{Array2, ArrayView2};

use super::open::{self, FileKind};
use super::write_atomic;
use crate::{Error, Result};

/// Most pixels of a map; more is a broken header.
pub(crate) const MAX_PIXELS: usize = 1 << 27;

/// Steps per metre of a PNG that has no other scale.
pub const MILLIMETRES: f64 = 1000.0;

/// A parser's result: the map, or the reason and remedy (the caller names the file).
type Parsed<T> = std::result::Result<T, String>;

/// A map, and whether its samples are integers, which carry a scale.
type Samples = (Array2<f32>, bool);

/// A depth file format, by its extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// 16-bit greyscale PNG.
    Png,
    /// NumPy array.
    Npy,
    /// Zip archive of NumPy arrays.
    Npz,
    /// Portable float map.
    Pfm,
    /// OpenEXR.
    Exr,
}

impl Format {
    /// The format of the extension of `path`.
    ///
    /// # Errors
    /// [`Error::Malformed`] with the known ones.
    pub fn of(path: &Path) -> Result<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        match extension.to_ascii_lowercase().as_str() {
            "png" => Ok(Self::Png),
            "npy" => Ok(Self::Npy),
            "npz" => Ok(Self::Npz),
            "pfm" => Ok(Self::Pfm),
            "exr" => Ok(Self::Exr),
            _ => {
                let known = "use .png (16 bit), .npy, .npz, .pfm or .exr";
                Err(Error::malformed(path, format!("unknown depth format {extension:?}; {known}")))
            }
        }
    }
}

/// Options for reading a depth file.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadOptions {
    /// Depth = value / `png_scale` for integer samples (PNG; NPY and NPZ of integers); without it the scale in the PNG's metadata, else
    /// 1000, millimetres.
    pub png_scale: Option<f64>,
    /// Depth = value / `float_scale` for floating-point samples; 1.
    pub float_scale: f64,
    /// Whether a grey PNG of 8 bits is read too, as its 256 levels: a picture of disparity, at most.
    pub eight_bits: bool,
    /// The array of an NPZ; without it the only one, or the one named `depth`.
    pub npz_array: Option<String>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { png_scale: None, float_scale: 1.0, eight_bits: false, npz_array: None }
    }
}

impl ReadOptions {
    /// Checks the scales.
    ///
    /// # Errors
    /// [`Error::Config`] that names the field.
    pub fn validate(&self) -> Result<()> {
        check_scale("png-scale", self.png_scale.unwrap_or(MILLIMETRES))?;
        check_scale("float-scale", self.float_scale)
    }
}

/// Reads depths, `[height, width]`: positive and finite, 0 = missing (whatever was not finite or not positive).
///
/// # Errors
/// [`Error::Read`], [`Error::Malformed`] (also when no pixel has a depth), [`Error::Config`].
pub fn read_depth(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Array2<f32>> {
    let path = path.as_ref();
    let mut map = read_raw(path, options)?;
    map.mapv_inplace(|v| if v.is_finite() && v > 0.0 { v } else { 0.0 });
    if map.iter().all(|&v| v == 0.0) {
        let reason = "no pixel has a positive depth; check that this is the depth file";
        return Err(Error::malformed(path, reason));
    }
    Ok(map)
}

/// Reads the values of a file, `[height, width]`, infinities included.
///
/// # Errors
/// Those of [`read_depth`], and [`Error::Malformed`] that names the first NaN.
pub fn read_values(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Array2<f32>> {
    let path = path.as_ref();
    let map = read_raw(path, options)?;
    if let Some((row, column)) = first_nan(map.view()) {
        let reason = format!("NaN at row {row}, column {column}; write 0 where a value is missing");
        return Err(Error::malformed(path, reason));
    }
    Ok(map)
}

/// Values after scaling, NaN and all.
pub(crate) fn read_raw(path: &Path, options: &ReadOptions) -> Result<Array2<f32>> {
    options.validate()?;
    let format = Format::of(path)?;
    let bytes = read_file(path, FileKind::DepthMap)?;
    parse(format, &bytes, options).map_err(|reason| Error::malformed(path, reason))
}

/// The whole file, unless it is empty.
pub(crate) fn read_file(path: &Path, kind: FileKind) -> Result<Vec<u8>> {
    let bytes = open::read(path, kind).map_err(|e| Error::read(path, e))?;
    if bytes.is_empty() {
        return Err(Error::malformed(path, "the file is empty; write it again"));
    }
    Ok(bytes)
}

fn parse(format: Format, bytes: &[u8], options: &ReadOptions) -> Parsed<Array2<f32>> {
    let stated = match png_text::content(bytes)? {
        Some(PngContent::Depth { scale, .. }) => Some(scale),
        Some(PngContent::Confidence) => {
            return Err("the PNG holds a confidence, not a depth; give the depth map beside it".to_owned());
        }
        None => None,
    };
    let (mut map, integer) = match format {
        Format::Png => (png::parse(bytes, options.eight_bits)?, true),
        Format::Npy => npy::parse(bytes)?,
        Format::Npz => npz::parse(bytes, options.npz_array.as_deref())?,
        Format::Pfm => (pfm::parse(bytes)?, false),
        Format::Exr => (exr::parse(bytes)?, false),
    };
    let scale = match integer {
        true => options.png_scale.or(stated).unwrap_or(MILLIMETRES),
        false => options.float_scale,
    };
    if scale != 1.0 {
        map.mapv_inplace(|v| (f64::from(v) / scale) as f32);
    }
    Ok(map)
}

/// Parses the bytes of a file of the given format, as [`read_values`] would, NaN included as 0.
///
/// # Errors
/// [`Error::Input`] with the reason.
pub fn decode(format: Format, bytes: &[u8], options: &ReadOptions) -> Result<Array2<f32>> {
    options.validate()?;
    let map = parse(format, bytes, options).map_err(Error::Input)?;
    Ok(map.mapv_into(|v| if v.is_nan() { 0.0 } else { v }))
}

/// Writes a map in the format of the file's extension; `f32` values bit-exact, but in a PNG, which has thousandths.
///
/// # Errors
/// [`Error::Write`]; [`Error::Malformed`] for another extension, or when the map is empty, holds NaN, or does not fit into 16 bits.
pub fn write_depth(path: impl AsRef<Path>, map: ArrayView2<'_, f32>) -> Result<()> {
    let path = path.as_ref();
    match Format::of(path)? {
        Format::Png => write_png16(path, map, MILLIMETRES),
        Format::Npy => write_npy(path, map),
        Format::Npz => write_npz(path, &[("depth", map)]),
        Format::Pfm => check_map(path, map).and_then(|()| write(path, Ok(pfm::encode(map)))),
        Format::Exr => write_exr(path, &[("Z", map)]),
    }
}

fn write(path: &Path, bytes: Parsed<Vec<u8>>) -> Result<()> {
    write_atomic(path, &bytes.map_err(|reason| Error::malformed(path, reason))?)
}

/// Writes `f32` values as NPY 1.0, bit-exact.
///
/// # Errors
/// See [`write_depth`].
pub fn write_npy(path: impl AsRef<Path>, map: ArrayView2<'_, f32>) -> Result<()> {
    let path = path.as_ref();
    check_map(path, map)?;
    write(path, Ok(npy::encode(map)))
}

/// Writes named `f32` arrays as an uncompressed NPZ, bit-exact.
///
/// # Errors
/// See [`write_depth`]; also [`Error::Malformed`] for an archive over 4 GiB or names that are empty or repeat.
pub fn write_npz(path: impl AsRef<Path>, arrays: &[(&str, ArrayView2<'_, f32>)]) -> Result<()> {
    let path = path.as_ref();
    arrays.iter().try_for_each(|(_, map)| check_map(path, *map))?;
    write(path, npz::encode(arrays))
}

/// Writes named `f32` maps of one size as the channels of an OpenEXR file, bit-exact.
///
/// # Errors
/// See [`write_depth`].
pub fn write_exr(path: impl AsRef<Path>, channels: &[(&str, ArrayView2<'_, f32>)]) -> Result<()> {
    let path = path.as_ref();
    channels.iter().try_for_each(|(_, map)| check_map(path, *map))?;
    write(path, exr::encode(channels))
}

/// Writes depths as a 16-bit grey PNG, round(depth · scale), 0 = missing; the error is at most 1 / (2 scale). A positive
/// depth below half a step becomes 1, so that it does not turn into a missing pixel.
///
/// # Errors
/// See [`write_depth`]; [`Error::Config`] for a scale that is none. [`Error::Malformed`] names the first value that is negative or too
/// large.
pub fn write_png16(path: impl AsRef<Path>, map: ArrayView2<'_, f32>, scale: f64) -> Result<()> {
    let path = path.as_ref();
    check_scale("png-scale", scale)?;
    check_map(path, map)?;
    write(path, png::encode(map, scale))
}

/// What the values of a PNG are, by its metadata.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum PngContent {
    /// Depth in `unit` = value / `scale`; 0 = missing.
    Depth {
        /// Name of the unit: `m` for metres.
        unit: String,
        /// Steps per unit.
        scale: f64,
    },
    /// A confidence, from 0 to 1 = the largest value.
    Confidence,
}

/// Reads what [`write_depth_png`] or [`write_confidence_png`] wrote into a file's metadata; nothing for other files.
///
/// # Errors
/// [`Error::Read`]; [`Error::Malformed`] where the scale is no number.
pub fn png_content(path: impl AsRef<Path>) -> Result<Option<PngContent>> {
    let path = path.as_ref();
    png_text::content(&read_file(path, FileKind::DepthMap)?).map_err(|reason| Error::malformed(path, reason))
}

/// As [`write_png16`], with `unit` and scale in the metadata (`tEXt`: `Depth-Unit`, `Depth-Scale`, `Description`), by which
/// [`read_depth`] finds the scale. Depths that do not fit into 16 bits are written as missing, as depth cameras write what is out of
/// their range; the result is their number.
///
/// # Errors
/// See [`write_depth`]; [`Error::Input`] where the unit is not printable ASCII.
pub fn write_depth_png(
    path: impl AsRef<Path>,
    map: ArrayView2<'_, f32>,
    unit: &str,
    scale: f64,
) -> Result<usize> {
    let path = path.as_ref();
    check_scale("png-scale", scale)?;
    check_map(path, map)?;
    check_text(unit)?;
    let fits = |depth: f32| (f64::from(depth) * scale).round() <= f64::from(u16::MAX);
    let near = map.mapv(|depth| if fits(depth) { depth } else { 0.0 });
    let beyond = map.iter().filter(|depth| depth.is_finite() && !fits(**depth)).count();
    let description = format!("depth along the optical axis in {unit} = value / {scale}; 0: missing");
    let scale_text = scale.to_string();
    let texts = [("Description", &*description), (png_text::UNIT, unit), (png_text::SCALE, &scale_text)];
    write(path, png::encode(near.view(), scale).map(|png| png_text::with_texts(&png, &texts)))?;
    Ok(beyond)
}

/// Writes values of 0 to 1 as a 16-bit grey PNG, round(value · 65535), with `formula` in the metadata. It is refused where a depth is read.
///
/// # Errors
/// See [`write_depth`]; [`Error::Malformed`] names the first value outside of 0 to 1, [`Error::Input`] a formula that is not printable
/// ASCII.
pub fn write_confidence_png(path: impl AsRef<Path>, map: ArrayView2<'_, f32>, formula: &str) -> Result<()> {
    let path = path.as_ref();
    check_map(path, map)?;
    check_text(formula)?;
    if let Some(((row, column), value)) = map.indexed_iter().find(|(_, v)| !(0.0..=1.0).contains(*v)) {
        let reason = format!("{value} at row {row}, column {column} is no confidence; give 0 to 1");
        return Err(Error::malformed(path, reason));
    }
    let png = png::encode_values(map, |value| (f64::from(value) * f64::from(u16::MAX)).round() as u16);
    let description = format!("confidence = {formula} = value / 65535; 0: no depth, 1: surest");
    let texts = [("Description", &*description), (png_text::CONFIDENCE, formula)];
    write(path, png.map(|png| png_text::with_texts(&png, &texts)))
}

fn check_text(text: &str) -> Result<()> {
    match text.bytes().all(|byte| (0x20..0x7f).contains(&byte)) {
        true => Ok(()),
        false => Err(Error::Input(format!("{text:?} can't stand in a PNG's metadata; give printable ASCII"))),
    }
}

/// Row and column of the first NaN.
fn first_nan(map: ArrayView2<'_, f32>) -> Option<(usize, usize)> {
    // Without an early end a row's test is a few instructions for 16 values.
    let row = map.outer_iter().position(|row| row.fold(false, |any, v| any | v.is_nan()))?;
    map.row(row).iter().position(|v| v.is_nan()).map(|column| (row, column))
}

fn check_map(path: &Path, map: ArrayView2<'_, f32>) -> Result<()> {
    let reason = if map.is_empty() || map.len() > MAX_PIXELS {
        format!("a map of shape {:?} cannot be written; give 1 to {MAX_PIXELS} pixels", map.dim())
    } else if let Some((row, column)) = first_nan(map) {
        format!("NaN at row {row}, column {column} is not written; use 0 where a value is missing")
    } else {
        return Ok(());
    };
    Err(Error::malformed(path, reason))
}

fn check_scale(field: &'static str, scale: f64) -> Result<()> {
    let positive = scale.is_finite() && scale > 0.0;
    Ok(OutOfRange::check(positive, field, &scale, "give a positive number of steps per unit")?)
}

/// Checks a size from a header before memory is allocated for it.
fn check_size(width: usize, height: usize) -> Parsed<usize> {
    match width.checked_mul(height) {
        Some(pixels) if (1..=MAX_PIXELS).contains(&pixels) => Ok(pixels),
        _ => Err(format!(
            "the header has {width}x{height} pixels, which is not supported; write the file again"
        )),
    }
}

/// Index of the only array or channel, else of the `usual` one, which would have the name `depth`.
fn choose(what: &str, names: &[&str], usual: Option<usize>, depth: &str) -> Parsed<usize> {
    usual.or((names.len() == 1).then_some(0)).ok_or_else(|| {
        format!("several {what}s, {names:?}; save the one with the depth under the name {depth:?}")
    })
}
