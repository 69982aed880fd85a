//! The sizes that images are read up to.

use super::format::MAX_PIXELS;

/// Longest side, pixels.
const MAX_SIDE: u32 = 1 << 16;
/// Most bytes of a PNG's compressed metadata; its decoder leaves out a colour profile with more.
pub(super) const MAX_METADATA: u64 = 1 << 26;

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
