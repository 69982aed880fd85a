use super::files::{layout, read_json};
use super::maps::MapPair;
use super::truth::TrueDepth;
use crate::metrics::cloud::{Cloud, CloudScore};
use crate::{Error, Result};
use mde_mvs::capture::{Frame, PixelCentres, read_transforms};
use mde_prior::photo::image_size;
use mde_uncertainty::statistics::median;
use nalgebra::Point2;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Tolerances of the cloud, as shares of the median true depth.
const TOLERANCES: [f64; 3] = [0.01, 0.02, 0.05];
/// That of a result in the world of its capture.
const UNIT: &str = "capture";

/// The folder that `mde dense` wrote, beside the true depths that the capture's `transforms.json` names.
#[derive(Debug, Clone)]
pub struct DenseResults {
    /// The depths that are to be scored, each by the name of its folder.
    pub pairs: Vec<MapPair>,
    /// Photographs without a true depth.
    pub unmatched: Vec<String>,
    truths: Vec<TrueDepth>,
    root: PathBuf,
    /// Content of `run.json`.
    record: Value,
}

impl DenseResults {
    /// Finds the true depths of the photographs of a run; those of photographs that failed count for the cloud.
    ///
    /// # Errors
    /// [`Error::Io`] and [`Error::Layout`] for files that can't be read or are no such ones, or where no photograph has a true depth.
    pub fn open(root: &Path, transforms: &Path) -> Result<Self> {
        let record: Value = read_json(&root.join("run.json"))?;
        let capture = read_transforms(transforms, PixelCentres::Halves, &|path: &Path| image_size(path))?;
        let content: Value = read_json(transforms)?;
        let (mut pairs, mut unmatched, mut truths) = (Vec::new(), Vec::new(), Vec::new());
        for row in rows(&record) {
            let name = row["photograph"].as_str().unwrap_or_default();
            let frame = capture.frames.iter().find(|frame| frame.photograph.ends_with(name));
            let truth = frame.map(|frame| TrueDepth::of_frame(transforms, &content, frame)).transpose()?;
            let Some(truth) = truth.flatten() else {
                unmatched.push(name.to_owned());
                continue;
            };
            // One with a reason was refined alone.
            if let Some(id) = row["folder"].as_str().filter(|_| row["reason"].is_null()) {
                let [prediction, sigma] = ["depth.npy", "sigma.npy"].map(|name| root.join(id).join(name));
                pairs.push(MapPair {
                    id: id.to_owned(),
                    prediction,
                    truth: truth.clone(),
                    sigma: Some(sigma),
                });
            }
            truths.push(truth);
        }
        if pairs.is_empty() {
            return Err(layout(root, format!("no photograph has a true depth in {}", transforms.display())));
        }
        Ok(Self { pairs, unmatched, truths, root: root.to_owned(), record })
    }

    /// How many photographs the others helped, how long one took, and the peak of the memory, in words.
    pub fn summary(&self) -> String {
        let seconds: Vec<f64> = rows(&self.record).filter_map(|row| row["seconds"].as_f64()).collect();
        let (used, all) = (self.pairs.len(), seconds.len());
        let (each, threads) = (seconds.iter().sum::<f64>() / all as f64, &self.record["threads"]);
        let peak = self.record["peak_memory_bytes"].as_u64();
        let peak = peak.map_or_else(String::new, |bytes| format!(", {} MiB", bytes >> 20));
        let is_scored = self.record["unit"] == UNIT;
        let cloud = if is_scored { "" } else { "; the cloud is not in the capture's unit: no score" };
        format!("{used} of {all} photographs used; {each:.1} s each on {threads} threads{peak}{cloud}")
    }

    /// The scores of `cloud.ply` against the points of all true depths within 1, 2 and 5 % of the median true depth; none where the cloud is
    /// not in the world of the capture.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn cloud(&self) -> Result<Vec<CloudScore>> {
        if self.record["unit"] != UNIT {
            return Ok(Vec::new());
        }
        let mut medians = Vec::new();
        for truth in &self.truths {
            medians.extend(median(truth.read()?.into_iter().filter(|z| *z > 0.0)));
        }
        let middle = median(medians).unwrap_or(1.0);
        let mut clouds = TOLERANCES.map(|share| [Cloud::new(share * middle), Cloud::new(share * middle)]);
        for point in positions(&self.root.join("cloud.ply"))? {
            clouds.iter_mut().for_each(|[found, _]| found.add(point));
        }
        for truth in &self.truths {
            let Some(Frame { lens, pose, .. }) = &truth.frame else { continue };
            let world = pose.inverse();
            for ((y, x), z) in truth.read()?.indexed_iter().filter(|(_, z)| **z > 0.0) {
                let pixel = Point2::new(x as f64, y as f64);
                let point = world * lens.camera.unproject(pixel, f64::from(*z));
                clouds.iter_mut().for_each(|[_, cloud]| cloud.add(point.into()));
            }
        }
        Ok(clouds.iter().map(|[found, truth]| found.score(truth)).collect())
    }
}

/// The photographs of a `run.json`.
fn rows(record: &Value) -> impl Iterator<Item = &Value> {
    record["photographs"].as_array().into_iter().flatten()
}

/// The points of a binary PLY file of floats, which its points begin with, and bytes.
fn positions(path: &Path) -> Result<Vec<[f64; 3]>> {
    const END: &[u8] = b"end_header\n";
    let bytes = fs::read(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
    let end = bytes.windows(END.len()).position(|window| window == END).unwrap_or_default();
    let header = String::from_utf8_lossy(&bytes[..end]);
    let count = |kind: &str| header.matches(&format!("property {kind} ")).count();
    let width = 4 * count("float") + count("uchar");
    if width < 12 {
        return Err(layout(path, "is no cloud of mde dense"));
    }
    let point = |bytes: &[u8]| {
        let floats = bytes.as_chunks().0;
        std::array::from_fn(|axis| f64::from(f32::from_le_bytes(floats[axis])))
    };
    Ok(bytes[end + END.len()..].chunks_exact(width).map(point).collect())
}
