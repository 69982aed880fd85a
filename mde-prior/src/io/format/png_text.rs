//! The text metadata of a PNG (`tEXt`): what its values are.

use super::{Parsed, PngContent};

const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Signature and the header's chunk.
const HEADER: usize = 33;
/// Length, type and checksum of a chunk.
const AROUND: usize = 12;

pub(super) const UNIT: &str = "Depth-Unit";
pub(super) const SCALE: &str = "Depth-Scale";
pub(super) const CONFIDENCE: &str = "Confidence";

/// A PNG with texts behind its header; keywords and texts are ASCII.
pub(super) fn with_texts(png: &[u8], texts: &[(&str, &str)]) -> Vec<u8> {
    let (header, rest) = png.split_at(HEADER.min(png.len()));
    let mut bytes = header.to_vec();
    for (keyword, text) in texts {
        let data = [b"tEXt", keyword.as_bytes(), &[0], text.as_bytes()].concat();
        bytes.extend(((data.len() - 4) as u32).to_be_bytes());
        bytes.extend(&data);
        bytes.extend(crc32fast::hash(&data).to_be_bytes());
    }
    bytes.extend(rest);
    bytes
}

/// What the values are, by the texts before the pixels; `None` without such texts.
pub(super) fn content(png: &[u8]) -> Parsed<Option<PngContent>> {
    let text = |keyword: &str| find(png, keyword);
    if text(CONFIDENCE).is_some() {
        return Ok(Some(PngContent::Confidence));
    }
    let (Some(unit), Some(scale)) = (text(UNIT), text(SCALE)) else { return Ok(None) };
    match scale.trim().parse::<f64>() {
        Ok(scale) if scale.is_finite() && scale > 0.0 => Ok(Some(PngContent::Depth { unit, scale })),
        _ => Err(format!("the PNG's {SCALE} is {scale:?}, not a positive number; write the file again")),
    }
}

fn find(png: &[u8], keyword: &str) -> Option<String> {
    let mut rest = png.strip_prefix(SIGNATURE)?;
    loop {
        let length = u32::from_be_bytes(*rest.first_chunk()?) as usize;
        let kind = rest.get(4..8)?;
        if kind == b"IDAT" {
            return None;
        }
        let data = rest.get(8..8_usize.checked_add(length)?)?;
        let text = data.strip_prefix(keyword.as_bytes()).and_then(|rest| rest.strip_prefix(&[0]));
        if let Some(text) = text.filter(|_| kind == b"tEXt") {
            // Latin-1.
            return Some(text.iter().copied().map(char::from).collect());
        }
        rest = rest.get(AROUND + length..)?;
    }
}
