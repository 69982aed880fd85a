//! The page of one refinement.

use crate::config::{Config, IterationPrior, Preset};
use crate::program::report::encode::{WIDEST, fitted, gradients, map, picture};
use crate::program::report::{page, photographs, read_json, read_text};
use crate::program::store::folder::RECORD;
use anyhow::{Context, Result, ensure};
use mde_prior::format::{ReadOptions, read_values};
use mde_prior::photo::read_image;
use mde_prior::resample::{nearest, shrink};
use ndarray::Array2;
use serde_json::{Map, Value, json};
use std::fs;
use std::path::Path;

/// What the files are, in the order of the page's list.
const FILES: [(&str, &str); 20] = [
    ("depth.npy", "refined depth, 32-bit floats"),
    ("sigma.npy", "its standard deviation, same unit"),
    ("prior.npy", "the monocular depth, input of the run"),
    ("depth.png", "refined depth, 16 bits; its unit is in its metadata"),
    ("confidence.png", "probability of an error below 10 % of the depth, 16 bits"),
    ("depth.exr", "refined depth, its sigma and the prior: channels Y and Z, sigma, prior"),
    ("cloud.ply", "coloured points with normals and sigma"),
    ("mesh.glb", "textured mesh, y up"),
    ("colmap", "the photograph, its camera and points as COLMAP has them"),
    ("transforms.json", "the photograph, its camera, depth and sigma, as nerfstudio has them"),
    ("image.png", "the photograph, upright"),
    ("photographs", "the photographs; input of mde refine --views"),
    ("views", "the photographs, small, and what the field renders"),
    ("evidence.npz", "photographs that see and that confirm each pixel, and the origin of its depth"),
    ("gt.npy", "ground truth of the scores"),
    ("preview.png", "image, prior, refined and sigma side by side"),
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
    let config = Config::with_overrides(Preset::Default, &toml, &settings.display().to_string())?;
    let read = |name: &str| read_values(folder.join(name), &ReadOptions::default());
    let path = folder.join("image.png");
    let maps =
        || rayon::join(|| rayon::join(|| read("depth.npy"), || read("sigma.npy")), || read("prior.npy"));
    let (image, ((refined, sigma), prior)) = rayon::join(|| read_image(&path), maps);
    let (refined, sigma, prior) = (refined?, sigma?, prior?);
    let image = image.with_context(|| {
        format!("{}: the report needs the image; run the refinement again", path.display())
    })?;
    let (rows, columns, _) = image.pixels.dim();
    for (name, size) in [("depth.npy", refined.dim()), ("sigma.npy", sigma.dim()), ("prior.npy", prior.dim())]
    {
        ensure!(
            size == (rows, columns),
            "{}: is {}x{} but the image is {columns}x{rows}; run the refinement again",
            folder.join(name).display(),
            size.1,
            size.0
        );
    }

    let size = fitted((rows, columns), WIDEST);
    let embed = |values: &Array2<f32>| map(nearest(values.view(), (size[1], size[0])).view());
    let mut maps = Map::new();
    maps.insert("prior".to_owned(), embed(&prior)?);
    maps.insert("refined".to_owned(), embed(&refined)?);
    maps.insert("sigma".to_owned(), embed(&sigma)?);
    let (sigma_o, common, prior_sigma) = prior_sigma(&config, &record);
    if folder.join("gt.npy").is_file() {
        maps.insert("truth".to_owned(), embed(&read("gt.npy")?)?);
    }
    let (several, evidence) = photographs::read(folder, &record)?;
    if let Some(evidence) = &evidence {
        maps.insert("evidence".to_owned(), embed(evidence)?);
    }
    let small = shrink(image.pixels.view(), (size[1], size[0]));
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
    let title = format!("Depth of {}", input_name(&record));
    let mut data = json!({
        "kind": "run",
        "title": input_name(&record),
        "record": record,
        "config": toml,
        "size": size,
        "full": [columns, rows],
        "image": picture(small.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).view())?,
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
    if let Some(data) = data.as_object_mut() {
        data.extend(several);
    }
    Ok(page::page(&title, &data))
}

/// The file's name without its folders, or the room.
fn input_name(record: &Value) -> String {
    let input = record["input"].as_str().unwrap_or("run");
    let name = Path::new(input).file_name().map(|name| name.to_string_lossy().into_owned());
    name.unwrap_or_else(|| input.to_owned())
}

/// What the fusion states of the prior's error: sigma_o, the common error that it states of the result too, and a note.
fn prior_sigma(config: &Config, record: &Value) -> (f64, f64, String) {
    let iterations = record["iterations"].as_array().map(Vec::as_slice).unwrap_or_default();
    // Only an anchored loop meets the monocular depth itself again.
    let index = match config.refinement.prior {
        IterationPrior::Anchor => iterations.len().saturating_sub(1),
        _ => 0,
    };
    let sigma_o = iterations.get(index).and_then(|i| i["fusion"]["sigma_o"].as_f64()).unwrap_or_default();
    let common = record["augmentation"]["common_error"].as_f64().unwrap_or(config.fusion.common_error);
    let whose = match record["error_bar"]["common_assumed"].is_null() {
        true => "",
        false => ", which has FastDepth's error, assumed here (mde calibrate measures another network's)",
    };
    let more = match common > 0.0 {
        true => {
            format!(", with the common error of {:.0} % of the depth as in the result{whose}", 100.0 * common)
        }
        false => String::new(),
    };
    let note = if record["augmentation"]["predictions"].as_u64().is_some_and(|n| n > 1)
        || iterations.is_empty()
    {
        format!(
            "The prior's ± is the common error of {:.0} % of the depth{whose}: a single prediction gives no spread.",
            100.0 * common
        )
    } else {
        format!("The prior's ± is σₒ of iteration {}{more}.", index + 1)
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
