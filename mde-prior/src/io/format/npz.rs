//! NPZ: a zip archive of NPY files.

use std::io::{Cursor, Read, Write};

use ndarray::ArrayView2;
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::{FileKind, MAX_PIXELS, Parsed, Samples, choose, npy};

/// No sample has more than 8 bytes; 64 KiB are plenty for the header.
const MAX_MEMBER: u64 = 8 * MAX_PIXELS as u64 + (1 << 16);

pub(super) fn parse(bytes: &[u8], wanted: Option<&str>) -> Parsed<Samples> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| {
        format!("the file is not in NPZ format, or truncated ({e}); write it with numpy.savez")
    })?;
    let files: Vec<String> = archive.file_names().map(str::to_owned).collect();
    let names: Vec<&str> = files.iter().map(|file| file.strip_suffix(".npy").unwrap_or(file)).collect();
    let place = |wanted: &str| names.iter().position(|name| *name == wanted);
    let index = match wanted {
        Some(wanted) => place(wanted).ok_or_else(|| format!("no array {wanted:?}; name one of {names:?}"))?,
        None => choose("array", &names, place("depth"), "depth")?,
    };
    let what = |reason: String| format!("array {:?}: {reason}", names[index]);
    let unreadable = |e: ZipError| what(format!("{e}; write the file again with numpy.savez"));
    let member = archive.by_name(&files[index]).map_err(unreadable)?;
    let size = member.size();
    if size > MAX_MEMBER {
        return Err(what(format!("{size} bytes are too many for a depth map; write the file again")));
    }
    let mut data = Vec::new();
    // The stated size may be wrong, so the output is bounded too. The checksum is checked at the end.
    member.take(MAX_MEMBER + 1).read_to_end(&mut data).map_err(|e| unreadable(e.into()))?;
    npy::parse(&data).map_err(what)
}

pub(super) fn encode(arrays: &[(&str, ArrayView2<'_, f32>)]) -> Parsed<Vec<u8>> {
    let bytes = arrays.iter().fold(0, |sum: u64, (_, map)| sum.saturating_add(4 * map.len() as u64));
    if bytes > FileKind::DepthMap.limit() - (1 << 20) {
        return Err("the archive would be over 4 GiB; give fewer arrays".to_owned());
    }
    let unwritable = |e: ZipError| format!("the archive cannot be written ({e}); give fewer arrays");
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    // A fixed date: the same arrays give the same bytes.
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default());
    for (index, (name, map)) in arrays.iter().enumerate() {
        if name.is_empty() || arrays[..index].iter().any(|(other, _)| other == name) {
            return Err(format!("the array name {name:?} is empty or repeats; give each array its own"));
        }
        writer.start_file(format!("{name}.npy"), options).map_err(unwritable)?;
        writer.write_all(&npy::encode(*map)).map_err(|e| unwritable(e.into()))?;
    }
    Ok(writer.finish().map_err(unwritable)?.into_inner())
}
