//! The points, surface and cameras of a capture in one view, above the table of its photographs.

use crate::output::every::{CLOUD, MESHES, PhotographRow};
use crate::output::export::transforms::FILE as TRANSFORMS;
use crate::program::report::{page, read_json};
use anyhow::{Context, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// Points at most: two megabytes of the page.
const POINTS: usize = 120_000;
/// Cells of a grid along each axis of the surface; each keeps one vertex, so that the page stays small.
const CELLS: f32 = 128.0;
/// Steps of a coordinate across the cloud.
const STEPS: f32 = 65535.0;
/// Bytes of a point of [`CLOUD`] and of a vertex of [`MESHES`], and where the colour of both and the number of photographs that confirm a
/// point stand.
const POINT: usize = 32;
const VERTEX: usize = 31;
const COLOUR: usize = 24;
const CONFIRMED: usize = 31;
/// Bytes of a triangle: the number of its corners, and their indices.
const TRIANGLE: usize = 13;

/// The view of a finished folder, for its page; nothing where its cloud is gone, has no points, or was written with other properties.
pub(super) fn view(folder: &Path, rows: &[PhotographRow]) -> Result<Option<String>> {
    let read = |name: &str| {
        let path = folder.join(name);
        let bytes = path.is_file().then(|| fs::read(&path)).transpose();
        bytes.with_context(|| format!("{}: can't be read", path.display()))
    };
    let Some(cloud) = read(CLOUD)?.filter(|_| folder.join(TRANSFORMS).is_file()) else { return Ok(None) };
    let points = after(&cloud, b"property float sigma\nproperty uchar confirmed\nend_header\n");
    let every = (points.len() / POINT).div_ceil(POINTS).max(1);
    let points: Vec<&[u8]> = points.chunks_exact(POINT).step_by(every).collect();
    if points.is_empty() {
        return Ok(None);
    }
    let surface = read(MESHES[0])?.and_then(|mesh| surface(&mesh));
    let transforms: Value = read_json(&folder.join(TRANSFORMS))?;
    let cameras = transforms["frames"].as_array().into_iter().flatten().filter_map(|frame| {
        let name = frame["file_path"].as_str()?.split_once('/')?.0;
        let row = rows.iter().find(|row| row.folder.as_deref() == Some(name))?;
        let keys = ["fl_x", "fl_y", "cx", "cy", "w", "h", "transform_matrix"];
        let lens = keys.map(|key| frame[key].clone());
        Some(json!({ "name": row.photograph, "folder": name, "sigma": row.sigma, "lens": lens }))
    });
    let cameras: Vec<Value> = cameras.collect();
    let data = json!({ "points": packed(&points), "surface": surface, "cameras": cameras });
    Ok(Some(page::embedded(&data)))
}

/// What follows the end of a header; nothing where the file has another.
fn after<'a>(file: &'a [u8], end: &[u8]) -> &'a [u8] {
    file.windows(end.len()).position(|bytes| bytes == end).map_or(&[], |at| &file[at + end.len()..])
}

fn coordinate(point: &[u8], axis: usize) -> f32 {
    point[4 * axis..4 * axis + 4].try_into().map_or(0.0, f32::from_le_bytes)
}

/// The least and the greatest coordinate on each axis.
fn range(points: &[&[u8]]) -> [[f32; 2]; 3] {
    [0, 1, 2].map(|axis| {
        let values = points.iter().map(|point| coordinate(point, axis));
        values.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    })
}

/// The place of a point in its range, in steps.
fn place(point: &[u8], range: &[[f32; 2]; 3], steps: f32) -> [u16; 3] {
    [0, 1, 2].map(|axis| {
        let [low, high] = range[axis];
        ((coordinate(point, axis) - low) / (high - low).max(f32::MIN_POSITIVE) * steps).round() as u16
    })
}

/// Places, colours, and the photographs that confirm: all of a vertex.
fn packed(points: &[&[u8]]) -> Value {
    let range = range(points);
    let bytes = |point: &&[u8]| {
        let place = place(point, &range, STEPS).into_iter().flat_map(u16::to_le_bytes);
        let confirmed = point.get(CONFIRMED).copied().unwrap_or(u8::MAX);
        place.chain(point[COLOUR..COLOUR + 3].iter().copied()).chain([confirmed]).collect::<Vec<u8>>()
    };
    let data: Vec<u8> = points.iter().flat_map(bytes).collect();
    json!({ "range": range, "data": STANDARD.encode(data) })
}

/// The first vertex of each cell, and the triangles that are left.
fn surface(file: &[u8]) -> Option<Value> {
    let count = after(file, b"element vertex ").split(|byte| *byte == b'\n').next()?;
    let count: usize = std::str::from_utf8(count).ok()?.parse().ok()?;
    let (vertices, triangles) = after(file, b"end_header\n").split_at_checked(VERTEX.checked_mul(count)?)?;
    let vertices: Vec<&[u8]> = vertices.chunks_exact(VERTEX).collect();
    let (range, mut kept, mut cells) = (range(&vertices), Vec::new(), HashMap::new());
    let merged = vertices.iter().map(|vertex| {
        *cells.entry(place(vertex, &range, CELLS)).or_insert_with(|| {
            kept.push(*vertex);
            kept.len() as u32 - 1
        })
    });
    let merged: Vec<u32> = merged.collect();
    let corners = triangles.chunks_exact(TRIANGLE).filter_map(|triangle| {
        let corner = |at: usize| {
            let index = triangle[at..at + 4].try_into().map_or(0, u32::from_le_bytes);
            merged.get(index as usize).copied()
        };
        let [a, b, c] = [corner(1)?, corner(5)?, corner(9)?];
        (a != b && b != c && c != a).then_some([a, b, c])
    });
    let corners: Vec<u8> = corners.flatten().flat_map(u32::to_le_bytes).collect();
    let mut packed = packed(&kept);
    packed["triangles"] = json!(STANDARD.encode(&corners));
    (!corners.is_empty()).then_some(packed)
}
