//! What the page of a run has of several photographs.

use crate::output::files::EVIDENCE;
use crate::program::report::encode::picture;
use crate::refiner::finish::{NOVEL, RENDERED, picture_of};
use anyhow::Result;
use mde_prior::format::{ReadOptions, read_values};
use mde_prior::photo::read_image;
use ndarray::{Array2, Zip};
use serde_json::{Map, Value, json};
use std::path::Path;

/// For each pixel how many photographs confirm its depth; nothing for one photograph.
type Confirmed = Option<Array2<f32>>;

/// What is added to the data of the page, without the parts whose file is missing, and per pixel 0: no depth, 1: seen by no other
/// photograph, 2: confirmed by none, 2 + n: confirmed by n, `[height, width]`. Nothing for a run with one photograph.
pub(super) fn read(folder: &Path, record: &Value) -> Result<(Map<String, Value>, Confirmed)> {
    let Some(photographs) = record["capture"]["photographs"].as_array() else {
        return Ok((Map::new(), None));
    };
    let image = |path: &Path| -> Result<Option<String>> {
        if !path.is_file() {
            return Ok(None);
        }
        let pixels = read_image(path)?.pixels;
        Ok(Some(picture(pixels.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).view())?))
    };
    let pictures = (0..photographs.len()).map(|index| image(&folder.join(picture_of(index))));
    let pictures: Vec<Option<String>> = pictures.collect::<Result<_>>()?;
    let novel = match (image(&folder.join(NOVEL))?, image(&folder.join(RENDERED))?) {
        (Some(photograph), Some(rendered)) => Some(json!({ "image": photograph, "rendered": rendered })),
        _ => None,
    };
    let path = folder.join(EVIDENCE);
    let (mut evidence, mut origin) = (None, Value::Null);
    if path.is_file() {
        let map = |name: &str| {
            let options = ReadOptions { npz_array: Some(name.to_owned()), ..ReadOptions::default() };
            read_values(&path, &options)
        };
        let (seen, confirmed, source) = (map("seen")?, map("confirmed")?, map("origin")?);
        let code = |&seen: &f32, &confirmed: &f32, &source: &f32| match () {
            () if source <= 0.0 => 0.0,
            () if seen <= 0.0 => 1.0,
            () => 2.0 + confirmed,
        };
        let share = |which: f32| {
            source.iter().filter(|origin| **origin == which).count() as f64 / source.len().max(1) as f64
        };
        origin = json!({ "prior": share(1.0), "consensus": share(2.0), "field": share(3.0) });
        evidence = Some(Zip::from(&seen).and(&confirmed).and(&source).map_collect(code));
    }
    let reference = photographs.iter().position(|photograph| photograph["verdict"] == "the reference");
    let mut data = Map::new();
    for (name, value) in [
        ("photographs", json!(pictures)),
        ("origin", origin),
        ("novel", json!(novel)),
        ("reference", json!(reference.unwrap_or(0))),
    ] {
        data.insert(name.to_owned(), value);
    }
    Ok((data, evidence))
}
