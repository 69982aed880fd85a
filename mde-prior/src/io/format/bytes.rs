/// `N` bytes at `offset`, if they are there.
pub(super) fn array_at<const N: usize>(bytes: &[u8], offset: usize) -> Option<[u8; N]> {
    bytes.get(offset..offset.checked_add(N)?)?.try_into().ok()
}

/// Little-endian u16 at `offset`.
pub(super) fn u16_at(bytes: &[u8], offset: usize) -> Option<usize> {
    array_at(bytes, offset).map(|b| usize::from(u16::from_le_bytes(b)))
}

/// Little-endian u32 at `offset`.
pub(super) fn u32_at(bytes: &[u8], offset: usize) -> Option<usize> {
    array_at(bytes, offset).and_then(|b| usize::try_from(u32::from_le_bytes(b)).ok())
}
