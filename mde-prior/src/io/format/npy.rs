//! NumPy's NPY format, versions 1 to 3.
//!
//! By hand, since no crate does as much: `ndarray-npy` reads no `float16`, needs the element's type before the header is read, and
//! allocates by the header; `npyz` brings a parser of Python literals (`py_literal`, `pest`). The tests compare with `ndarray-npy`.

use ndarray::{Array2, ArrayView2, ShapeBuilder as _};

use super::{Parsed, Samples, check_size};

const MAGIC: &[u8] = b"\x93NUMPY";

/// Header and data of `[height, width]` little-endian `f32`.
pub(super) fn encode(map: ArrayView2<'_, f32>) -> Vec<u8> {
    let (height, width) = map.dim();
    let dictionary = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    // Magic, version and length are 10 bytes; the data starts at a multiple of 64.
    let start = (dictionary.len() + 11).next_multiple_of(64);
    let header = format!("{dictionary:<0$}\n", start - 11);
    // Two numbers of at most 20 digits: far below 2^16.
    let length = (header.len() as u16).to_le_bytes();
    let mut bytes = [MAGIC, &[1, 0], &length, header.as_bytes()].concat();
    bytes.resize(start + 4 * map.len(), 0);
    let samples = bytes[start..].as_chunks_mut::<4>().0;
    samples.iter_mut().zip(map).for_each(|(sample, value)| *sample = value.to_le_bytes());
    bytes
}

pub(super) fn parse(bytes: &[u8]) -> Parsed<Samples> {
    if !bytes.starts_with(MAGIC) {
        return Err("the file is not in NPY format; write it with numpy.save".to_owned());
    }
    let (header, data) = split(bytes).ok_or("the NPY header is truncated; write the file again")?;
    let descr = text_value(header, "descr").ok_or_else(|| no_key("descr"))?;
    let sample = Sample::named(descr)?;
    let fortran = value(header, "fortran_order").ok_or_else(|| no_key("fortran_order"))?.starts_with("True");
    let (height, width) = plane(&shape(header)?)?;
    let pixels = check_size(width, height)?;
    let needed = pixels * sample.size;
    let Some(data) = data.get(..needed) else {
        return Err(format!(
            "truncated: {width}x{height} {descr} need {needed} bytes, there are {}; write the file again",
            data.len()
        ));
    };
    let values: Vec<f32> = match sample {
        // The usual case, which the compiler turns into a copy.
        Sample { big_endian: false, kind: b'f', size: 4 } => {
            data.as_chunks::<4>().0.iter().map(|raw| f32::from_le_bytes(*raw)).collect()
        }
        _ => data.chunks_exact(sample.size).map(|raw| sample.decode(raw)).collect(),
    };
    let map = Array2::from_shape_vec((height, width).set_f(fortran), values).map_err(|e| e.to_string())?;
    Ok((map, sample.kind != b'f'))
}

fn no_key(key: &str) -> String {
    format!("the NPY header has no '{key}'; write the file with numpy.save")
}

fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (start, length) = match bytes.get(6)? {
        1 => (10_usize, usize::from(u16::from_le_bytes(*bytes.get(8..)?.first_chunk()?))),
        2 | 3 => (12, usize::try_from(u32::from_le_bytes(*bytes.get(8..)?.first_chunk()?)).ok()?),
        _ => return None,
    };
    let end = start.checked_add(length)?;
    Some((std::str::from_utf8(bytes.get(start..end)?).ok()?, bytes.get(end..)?))
}

/// The text after `'key':`.
fn value<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let after = ['\'', '"'].iter().find_map(|quote| header.split_once(&format!("{quote}{key}{quote}")))?.1;
    Some(after.trim_start().strip_prefix(':')?.trim_start())
}

fn text_value<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let text = value(header, key)?;
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text.get(1..)?.split(quote).next()
}

fn shape(header: &str) -> Parsed<Vec<usize>> {
    let text = value(header, "shape").ok_or_else(|| no_key("shape"))?;
    let inner = text.strip_prefix('(').and_then(|t| t.split_once(')')).map(|(inner, _)| inner);
    inner
        .and_then(|list| {
            list.split(',').map(str::trim).filter(|n| !n.is_empty()).map(|n| n.parse().ok()).collect()
        })
        .ok_or_else(|| "the NPY header's shape is malformed; write the file with numpy.save".to_owned())
}

/// `[height, width]` of a shape with any number of ones about it.
fn plane(shape: &[usize]) -> Parsed<(usize, usize)> {
    let mut sides = shape;
    while let [1, rest @ ..] | [rest @ .., 1] = sides
        && rest.len() >= 2
    {
        sides = rest;
    }
    match *sides {
        [height, width] => Ok((height, width)),
        _ => Err(format!("the array's shape is {shape:?}; a depth map is [height, width]")),
    }
}

/// A sample type of the header's `descr`.
struct Sample {
    big_endian: bool,
    kind: u8,
    size: usize,
}

impl Sample {
    fn named(descr: &str) -> Parsed<Self> {
        let wrong = || format!("samples are {descr:?}; save float16, float32, float64 or integers");
        let [order, kind, size] = *descr.as_bytes() else { return Err(wrong()) };
        let big_endian = match order {
            b'<' | b'|' | b'=' => false,
            b'>' => true,
            _ => return Err(wrong()),
        };
        let size = match (kind, size) {
            (b'f' | b'i', b'2') | (b'u', b'2') => 2,
            (b'f' | b'i' | b'u', b'4') => 4,
            (b'f' | b'i', b'8') => 8,
            (b'u', b'1') => 1,
            _ => return Err(wrong()),
        };
        Ok(Self { big_endian, kind, size })
    }

    fn decode(&self, raw: &[u8]) -> f32 {
        let mut bytes = [0_u8; 8];
        bytes[..self.size].copy_from_slice(raw);
        if self.big_endian {
            bytes[..self.size].reverse();
        }
        let bits = u64::from_le_bytes(bytes);
        match (self.kind, self.size) {
            (b'f', 2) => half::f16::from_bits(bits as u16).to_f32(),
            (b'f', 4) => f32::from_bits(bits as u32),
            (b'f', _) => f64::from_bits(bits) as f32,
            (b'i', 2) => f32::from(bits as u16 as i16),
            (b'i', 4) => bits as u32 as i32 as f32,
            (b'i', _) => bits as i64 as f32,
            _ => bits as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_number_of_ones_about_a_map_is_left_out() {
        let mut shape = vec![1; 1_000_000];
        shape[500_000] = 3;
        shape[500_001] = 4;
        assert_eq!(plane(&shape), Ok((3, 4)));
        assert_eq!(plane(&[1, 1, 1, 4]), Ok((1, 4)));
        assert_eq!(plane(&[5, 1]), Ok((5, 1)));
        assert!(plane(&[2, 3, 4]).is_err() && plane(&[3]).is_err() && plane(&[]).is_err());
    }
}
