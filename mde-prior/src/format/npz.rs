//! NPZ: a zip archive of NPY files.

use ndarray::ArrayView2;

use super::bytes::{u16_at, u32_at};
use super::inflate::inflate;
use super::{MAX_PIXELS, Parsed, Samples, npy};

const LOCAL: u32 = 0x0403_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const END: u32 = 0x0605_4b50;
/// 1980-01-01, the earliest date that the format knows: the same array gives the same bytes.
const DATE: u16 = 0x21;

/// An array in the archive.
struct Member<'a> {
    name: &'a str,
    method: usize,
    size: usize,
    crc: usize,
    data: &'a [u8],
}

pub(super) fn parse(bytes: &[u8], wanted: Option<&str>) -> Parsed<Samples> {
    let members =
        directory(bytes).ok_or("this is no NPZ file, or it is truncated; write it with numpy.savez")?;
    let member = choose(&members, wanted)?;
    let what = |reason: String| format!("array {:?}: {reason}", member.name);
    // No sample has more than 8 bytes; 64 KiB are plenty for the header.
    if member.size > 8 * MAX_PIXELS + (1 << 16) {
        return Err(what(format!("{} bytes are no depth map; write the file again", member.size)));
    }
    let unpacked;
    let data = match member.method {
        0 => member.data,
        8 => {
            unpacked = inflate(member.data, member.size).map_err(what)?;
            &unpacked
        }
        method => {
            return Err(what(format!("compression method {method} is unknown; use numpy.savez_compressed")));
        }
    };
    if data.len() != member.size || crc32fast::hash(data) as usize != member.crc {
        return Err(what("the checksum is wrong; write the file again".to_owned()));
    }
    npy::parse(data).map_err(what)
}

fn choose<'a, 'b>(members: &'b [Member<'a>], wanted: Option<&str>) -> Parsed<&'b Member<'a>> {
    let find = |name: &str| members.iter().find(|m| m.name == name);
    let found = match (wanted, members) {
        (Some(name), _) => find(name),
        (None, [only]) => Some(only),
        (None, _) => find("depth"),
    };
    found.ok_or_else(|| {
        let names: Vec<&str> = members.iter().map(|m| m.name).collect();
        match wanted {
            Some(name) => format!("no array {name:?}; there are {names:?}"),
            None => format!("say which array holds the depth; there are {names:?}"),
        }
    })
}

fn directory(bytes: &[u8]) -> Option<Vec<Member<'_>>> {
    // The end record is 22 bytes and a comment of at most 65535.
    let first = bytes.len().saturating_sub(22 + 0xffff);
    let end =
        (first..=bytes.len().checked_sub(22)?).rev().find(|&at| u32_at(bytes, at) == Some(END as usize))?;
    let count = u16_at(bytes, end + 10)?;
    let mut at = u32_at(bytes, end + 16)?;
    let mut members = Vec::new();
    for _ in 0..count {
        if u32_at(bytes, at)? != CENTRAL as usize {
            return None;
        }
        let name_length = u16_at(bytes, at + 28)?;
        let name = std::str::from_utf8(bytes.get(at + 46..at + 46 + name_length)?).ok()?;
        let local = u32_at(bytes, at + 42)?;
        if u32_at(bytes, local)? != LOCAL as usize {
            return None;
        }
        let start = local + 30 + u16_at(bytes, local + 26)? + u16_at(bytes, local + 28)?;
        members.push(Member {
            name: name.strip_suffix(".npy").unwrap_or(name),
            method: u16_at(bytes, at + 10)?,
            crc: u32_at(bytes, at + 16)?,
            size: u32_at(bytes, at + 24)?,
            data: bytes.get(start..start.checked_add(u32_at(bytes, at + 20)?)?)?,
        });
        at += 46 + name_length + u16_at(bytes, at + 30)? + u16_at(bytes, at + 32)?;
    }
    Some(members)
}

pub(super) fn encode(arrays: &[(&str, ArrayView2<'_, f32>)]) -> Parsed<Vec<u8>> {
    let (mut bytes, mut central) = (Vec::new(), Vec::new());
    for (index, (name, map)) in arrays.iter().enumerate() {
        if name.is_empty() || arrays[..index].iter().any(|(other, _)| other == name) {
            return Err(format!("the array name {name:?} is empty or repeats; give each array its own"));
        }
        let member = npy::encode(*map);
        let too_large = |_| "the archive would exceed 4 GiB; write fewer arrays".to_owned();
        let offset = u32::try_from(bytes.len()).map_err(too_large)?;
        let size = u32::try_from(member.len()).map_err(too_large)?;
        let file = format!("{name}.npy");
        let length =
            u16::try_from(file.len()).map_err(|_| "an array's name is too long; shorten it".to_owned())?;

        // Version 2.0, UTF-8 names, stored, date, checksum, sizes, name length, no extra field.
        let mut record = Vec::new();
        record.extend([20_u16, 0x800, 0, 0, DATE].iter().flat_map(|v| v.to_le_bytes()));
        record.extend([crc32fast::hash(&member), size, size].iter().flat_map(|v| v.to_le_bytes()));
        record.extend([length, 0].iter().flat_map(|v| v.to_le_bytes()));

        bytes.extend(LOCAL.to_le_bytes());
        bytes.extend(&record);
        bytes.extend(file.as_bytes());
        bytes.extend(member);

        central.extend(CENTRAL.to_le_bytes());
        central.extend(20_u16.to_le_bytes());
        central.extend(&record);
        // No comment, disk 0, no attributes.
        central.extend([0; 10]);
        central.extend(offset.to_le_bytes());
        central.extend(file.as_bytes());
    }
    let too_large = "the archive would exceed 4 GiB or 65535 arrays; write fewer arrays";
    let offset = u32::try_from(bytes.len()).map_err(|_| too_large)?;
    let count = u16::try_from(arrays.len()).map_err(|_| too_large)?;
    let size = u32::try_from(central.len()).map_err(|_| too_large)?;
    bytes.extend(central);
    bytes.extend(END.to_le_bytes());
    bytes.extend([0, 0, count, count].iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend([size, offset].iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend(0_u16.to_le_bytes());
    Ok(bytes)
}
