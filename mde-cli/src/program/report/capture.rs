//! The points and cameras of a capture in one view, above the table of its photographs.

use crate::output::every::{CLOUD, PhotographRow};
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::program::report::{page, read_json};
use anyhow::{Context, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Points at most: the page stays below two megabytes.
const POINTS: usize = 120_000;
/// Steps of a coordinate across the cloud.
const STEPS: f32 = 65535.0;
/// The last property of a point and the end of the header.
const END: &[u8] = b"property float sigma\nproperty uchar confirmed\nend_header\n";
/// Bytes of a point of [`CLOUD`], and where its colour and the number of photographs that confirm it stand.
const STRIDE: usize = 32;
const COLOUR: usize = 24;
const CONFIRMED: usize = 31;

/// The view of a finished folder, for its page; nothing where its cloud is gone, has no points, or was written with other properties.
pub(super) fn view(folder: &Path, rows: &[PhotographRow]) -> Result<Option<String>> {
    let path = folder.join(CLOUD);
    if !(path.is_file() && folder.join(TRANSFORMS).is_file()) {
        return Ok(None);
    }
    let cloud = fs::read(&path).with_context(|| format!("{}: can't be read", path.display()))?;
    let start =
        cloud.windows(END.len()).position(|bytes| bytes == END).map_or(cloud.len(), |at| at + END.len());
    let every = ((cloud.len() - start) / STRIDE).div_ceil(POINTS).max(1);
    let points: Vec<&[u8]> = cloud[start..].chunks_exact(STRIDE).step_by(every).collect();
    if points.is_empty() {
        return Ok(None);
    }
    let number =
        |bytes: &[u8], axis: usize| bytes[4 * axis..4 * axis + 4].try_into().map_or(0.0, f32::from_le_bytes);
    let range = [0, 1, 2].map(|axis| {
        let values = points.iter().map(|bytes| number(bytes, axis));
        values.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    });
    let mut data = Vec::new();
    for bytes in &points {
        for (axis, [low, high]) in range.into_iter().enumerate() {
            let share = (number(bytes, axis) - low) / (high - low).max(f32::MIN_POSITIVE);
            data.extend(((share * STEPS).round() as u16).to_le_bytes());
        }
        data.extend(&bytes[COLOUR..COLOUR + 3]);
        data.push(bytes[CONFIRMED]);
    }
    let transforms: Value = read_json(&folder.join(TRANSFORMS))?;
    let cameras = transforms["frames"].as_array().into_iter().flatten().filter_map(|frame| {
        let name = frame["file_path"].as_str()?.split_once('/')?.0;
        let row = rows.iter().find(|row| row.folder.as_deref() == Some(name))?;
        let keys = ["fl_x", "fl_y", "cx", "cy", "w", "h", "transform_matrix"];
        let lens = keys.map(|key| frame[key].clone());
        Some(json!({ "name": row.photograph, "folder": name, "sigma": row.sigma, "lens": lens }))
    });
    let cameras: Vec<Value> = cameras.collect();
    let data = json!({ "points": { "range": range, "data": STANDARD.encode(data) }, "cameras": cameras });
    Ok(Some(page::embedded(&data)))
}
