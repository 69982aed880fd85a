//! The page of one refinement.

use crate::config::{Config, IterationPrior, Preset};
use crate::output::files::{EVIDENCE, THUMBNAIL};
use crate::program::report::encode::{self, WIDEST, gradients, photograph, photograph_in};
use crate::program::report::{page, read_json, read_text};
use crate::program::store::RECORD;
use crate::refiner::{NOVEL, RENDERED, picture_of};
use crate::scene::within;
use anyhow::{Context, Result, ensure};
use mde_prior::format::{ReadOptions, read_values};
use mde_prior::photo::read_image;
use mde_prior::resample::{nearest, shrink};
use ndarray::{Array2, Zip};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

const FILES: [(&str, &str); 21] = [
    ("depth.npy", "refined depth, 32-bit floats"),
    ("sigma.npy", "its standard deviation, same unit"),
    ("prior.npy", "the monocular depth, input of the run"),
    ("depth.png", "refined depth, 16 bits; its unit is in its metadata"),
    ("confidence.png", "probability of an error below 10 % of the depth, 16 bits"),
    ("depth.exr", "refined depth, its sigma and the prior: channels Y and Z, sigma, prior"),
    ("cloud.ply", "coloured points with normals and sigma"),
    ("mesh.glb", "textured mesh, y up"),
    ("colmap", "photographs, cameras and points as COLMAP has them"),
    ("transforms.json", "the photograph, its camera, depth and sigma, as nerfstudio has them"),
    ("image.png", "the photograph, upright"),
    ("photographs", "the photographs; input of mde refine --views"),
    ("views", "the photographs, small, and what the field renders"),
    ("evidence.npz", "photographs that see and that confirm each pixel, and the origin of its depth"),
    ("gt.npy", "ground truth of the scores"),
    ("preview.png", "image, prior, refined and sigma side by side"),
    (THUMBNAIL, "image, refined and sigma / depth, small"),
    ("field.safetensors", "field of the last iteration, for mde render"),
    ("config.toml", "all settings; input of --config"),
    ("run.json", "record of the run: measurements, versions, warnings"),
    ("report.html", "this page"),
];

pub(super) fn page(folder: &Path) -> Result<String> {
    let mut record: Value = read_json(&folder.join(RECORD))?;
    // The report lists them itself; the record gets the names after it.
    record.as_object_mut().and_then(|fields| fields.remove("files"));
    ensure!(
        record["iterations"].is_array(),
        "{}: is the record of mde {}, which has no report; give the folder of mde refine, demo or eval",
        folder.join(RECORD).display(),
        record["command"].as_str().unwrap_or("something else")
    );
    let settings = folder.join("config.toml");
    let toml = read_text(&settings)?;
    let config = Preset::Default.config().with_text(&toml, &settings.display().to_string())?;
    let path = folder.join("image.png");
    let image = read_image(&path).with_context(|| {
        format!("{}: the report needs the image; run the refinement again", path.display())
    })?;
    let (rows, columns, _) = image.pixels.dim();
    let size @ (height, width) = within((rows, columns), WIDEST);
    let embedded = |(map, name): (&'static str, &str)| -> Result<(&'static str, Value)> {
        let values = read_values(folder.join(name), &ReadOptions::default())?;
        ensure!(
            values.dim() == (rows, columns),
            "{}: is {}x{} but the image is {columns}x{rows}; run the refinement again",
            folder.join(name).display(),
            values.ncols(),
            values.nrows()
        );
        Ok((map, encode::map(nearest(values.view(), size).view())?))
    };
    let truth = folder.join("gt.npy").is_file().then_some(("truth", "gt.npy"));
    let mut maps = vec![("prior", "prior.npy"), ("refined", "depth.npy"), ("sigma", "sigma.npy")];
    maps.extend(truth);
    let maps: BTreeMap<_, _> = maps.into_par_iter().map(embedded).collect::<Result<_>>()?;
    let (sigma_o, common, prior_sigma) = prior_sigma(&config, &record);
    let small = shrink(image.pixels.view(), size);
    let present = |name: &str| name == super::FILE || folder.join(name).exists();
    let files: Vec<Value> = FILES
        .iter()
        .filter(|(name, _)| present(name))
        .map(|(name, what)| {
            let path = folder.join(name);
            let bytes = fs::metadata(&path).ok().filter(|m| m.is_file()).map(|m| m.len());
            // The record is longer once the report is there.
            let bytes = bytes.filter(|_| ![super::FILE, RECORD].contains(name));
            json!({ "name": name, "what": what, "bytes": bytes, "folder": path.is_dir() })
        })
        .collect();
    let input = record["input"].as_str().unwrap_or("run");
    // The name of a file without its folders, or the room.
    let name = Path::new(input).file_name().map_or_else(|| input.into(), |name| name.to_string_lossy());
    let mut data = json!({
        "kind": "run",
        "title": name,
        "record": record,
        "config": toml,
        "size": [width, height],
        "full": [columns, rows],
        "image": photograph(small.view())?,
        "maps": maps,
        "prior_sigma": prior_sigma,
        // Of the prior: the page makes the map.
        "prior_error": [sigma_o, common],
        // Of a pixel: all its predictions share it. Measured distances take it as shared by both ends too.
        "common_error": common,
        // Of the whole map: its gauge, where it is known.
        "scale_error": record["error_bar"]["scale"]["relative"].as_f64().unwrap_or_default(),
        "gradients": gradients(),
        "files": files,
    });
    if let Some(photographs) = record["capture"]["photographs"].as_array() {
        let pictures = (0..photographs.len()).map(|index| photograph_in(&folder.join(picture_of(index))));
        data["photographs"] = json!(pictures.collect::<Result<Vec<_>>>()?);
        let [image, rendered] = [NOVEL, RENDERED].map(|name| photograph_in(&folder.join(name)));
        if let (Some(image), Some(rendered)) = (image?, rendered?) {
            data["novel"] = json!({ "image": image, "rendered": rendered });
        }
        let reference = photographs.iter().position(|photograph| photograph["verdict"] == "the reference");
        data["reference"] = json!(reference.unwrap_or(0));
        let path = folder.join(EVIDENCE);
        if path.is_file() {
            let (confirmed, origin) = evidence(&path)?;
            data["maps"]["evidence"] = encode::map(nearest(confirmed.view(), size).view())?;
            data["origin"] = origin;
        }
    }
    Ok(page::page(&format!("Depth of {name}"), &data))
}

/// Per pixel 0: no depth, 1: seen by no other photograph, 2 + n: confirmed by n, `[height, width]`; and the shares of the depth's origins.
fn evidence(path: &Path) -> Result<(Array2<f32>, Value)> {
    let map = |name: &str| {
        read_values(path, &ReadOptions { npz_array: Some(name.to_owned()), ..ReadOptions::default() })
    };
    let (seen, confirmed, source) = (map("seen")?, map("confirmed")?, map("origin")?);
    let share = |which: f32| {
        source.iter().filter(|origin| **origin == which).count() as f64 / source.len().max(1) as f64
    };
    let origin = json!({ "prior": share(1.0), "consensus": share(2.0), "field": share(3.0) });
    let code = |&seen: &f32, &confirmed: &f32, &source: &f32| match () {
        () if source <= 0.0 => 0.0,
        () if seen <= 0.0 => 1.0,
        () => 2.0 + confirmed,
    };
    Ok((Zip::from(&seen).and(&confirmed).and(&source).map_collect(code), origin))
}

/// What the fusion states of the prior's error: sigma_o, the common error that it states of the result too, and a note.
fn prior_sigma(config: &Config, record: &Value) -> (f64, f64, String) {
    let iterations = record["iterations"].as_array().map(Vec::as_slice).unwrap_or_default();
    // Only an anchored loop meets the monocular depth itself again.
    let anchored = config.refinement.prior == IterationPrior::Anchor;
    let index = if anchored { iterations.len().saturating_sub(1) } else { 0 };
    let sigma_o = iterations.get(index).and_then(|i| i["fusion"]["sigma_o"].as_f64()).unwrap_or_default();
    let common = record["augmentation"]["common_error"].as_f64().unwrap_or(config.fusion.common_error);
    let whose = match record["error_bar"]["common_assumed"].is_null() {
        true => "",
        false => ", which has FastDepth's error, assumed here (mde calibrate measures another network's)",
    };
    let error = format!("the common error of {:.0} % of the depth", 100.0 * common);
    let note = match (iterations.is_empty(), record["augmentation"]["predictions"].as_u64()) {
        (true, _) | (_, Some(2..)) => {
            format!("The prior's ± is {error}{whose}: a single prediction gives no spread.")
        }
        _ if common > 0.0 => {
            format!("The prior's ± is σₒ of iteration {}, with {error} as in the result{whose}.", index + 1)
        }
        _ => format!("The prior's ± is σₒ of iteration {}.", index + 1),
    };
    (sigma_o, common, note)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_priors_sigma_is_that_of_the_iteration_which_met_it() {
        let record =
            json!({ "iterations": [{ "fusion": { "sigma_o": 0.3 } }, { "fusion": { "sigma_o": 0.1 } }] });
        let paper = prior_sigma(&Preset::Paper.config(), &record);
        assert_eq!((paper.0, paper.1), (0.3, 0.0));
        let mut config = Preset::Paper.config();
        config.refinement.prior = IterationPrior::Anchor;
        config.fusion.common_error = 0.1;
        let anchored = prior_sigma(&config, &record);
        assert_eq!((anchored.0, anchored.1), (0.1, 0.1));
    }
}
