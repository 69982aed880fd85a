//! The page of an evaluation or an ablation.

use crate::output::preview::{depth_picture_within, sigma_picture_within, usual_range};
use crate::program::report::encode::{gradients, photograph_in, picture, svg};
use crate::program::report::{page, read_json, read_text};
use crate::program::store::{file_name, folders_in};
use crate::scene::within;
use anyhow::{Context, Result};
use mde_eval::score::{Better, Group, METRICS, Metric};
use mde_eval::table::{SceneScores, read_csv};
use mde_prior::format::{ReadOptions, read_values};
use mde_prior::resample::nearest;
use ndarray::Array2;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// A reduced image of the scene, for the report.
pub(crate) const PICTURE: &str = "picture.png";
/// The file that marks an evaluation.
pub(super) const SUMMARY: &str = "summary.json";
/// Thumbnails fit into a square of so many pixels.
const THUMBNAIL: usize = 200;
/// Scenes that get thumbnails, the worst: the page stays small enough to be opened.
const SCENES: usize = 40;
/// The figures, in the order of the page.
pub(crate) const FIGURES: [(&str, &str); 3] = [
    (
        "error-by-percentile",
        "Mean error by percentile of sigma: a rising line means that larger sigmas go with larger errors.",
    ),
    (
        "sparsification",
        "Error of the remaining pixels when those of largest sigma are removed; lower is better.",
    ),
    (
        "reliability",
        "Share of pixels whose true depth lies within the stated interval; a calibrated sigma is on the diagonal.",
    ),
];

pub(super) fn page(folder: &Path) -> Result<String> {
    let summary: Value = read_json(&folder.join(SUMMARY))?;
    let table = folder.join("scenes.csv");
    let all = read_csv(&read_text(&table)?).with_context(|| table.display().to_string())?;
    let judged = judged(&summary);
    let worst = worst(&all, judged.as_ref());
    let scene = |(id, scores): &(String, SceneScores)| -> Result<Value> {
        let thumbnails = if worst.contains(&**id) { thumbnails(folder, id, scores)? } else { Value::Null };
        Ok(json!({ "id": id, "scores": scores, "thumbnails": thumbnails }))
    };
    let mut figures = Vec::new();
    for (name, what) in FIGURES {
        let path = folder.join(format!("{name}.svg"));
        if path.is_file() {
            figures.push(json!({ "name": name, "what": what, "image": svg(&read_text(&path)?) }));
        }
    }
    let title = summary["title"].as_str().unwrap_or("Evaluation");
    let data = json!({
        "kind": "evaluation",
        "title": title,
        "summary": summary,
        "metrics": METRICS.iter().map(metric).collect::<Vec<_>>(),
        "groups": Group::ALL.map(Group::title),
        "figures": figures,
        "gradients": gradients(),
        "scenes": all.iter().map(scene).collect::<Result<Vec<_>>>()?,
        "thumbnails_of": SCENES,
        "judged": judged.map(|(method, metric)| json!({ "method": method, "metric": metric.key })),
    });
    Ok(page::page(title, &data))
}

/// The method and the metric by which a scene is bad: the first scored depth but the prior's, if there is one; AbsRel, else its first.
fn judged(summary: &Value) -> Option<(String, &'static Metric)> {
    let methods = summary["summary"]["methods"].as_array()?;
    let has_depth = |method: &&Value| method["metrics"].get("abs_rel").is_some();
    let found = methods.iter().filter(has_depth).find(|method| method["method"] != "prior");
    let found = found.or_else(|| methods.iter().find(has_depth)).or_else(|| methods.first())?;
    let known = || METRICS.iter().filter(|metric| found["metrics"].get(metric.key).is_some());
    let metric = known().find(|metric| metric.key.starts_with("abs")).or_else(|| known().next())?;
    Some((found["method"].as_str()?.to_owned(), metric))
}

/// At most [`SCENES`] scenes, the worst ones; those without a score only where others are too few.
fn worst<'s>(all: &'s [(String, SceneScores)], judged: Option<&(String, &Metric)>) -> BTreeSet<&'s str> {
    let badness = |scores: &SceneScores| -> Option<f64> {
        let (method, metric) = judged?;
        let value = *scores.get(method)?.get(metric.key)?;
        Some(if matches!(metric.better, Better::Higher) { -value } else { value })
    };
    let badness = |scores: &SceneScores| badness(scores).unwrap_or(f64::NEG_INFINITY);
    let mut sorted: Vec<_> = all.iter().map(|(scene, scores)| (badness(scores), &**scene)).collect();
    sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
    sorted.into_iter().take(SCENES).map(|(_, scene)| scene).collect()
}

fn metric(metric: &Metric) -> Value {
    let (better, target) = match metric.better {
        Better::Lower => ("lower", None),
        Better::Higher => ("higher", None),
        Better::Near(target) => ("near", Some(target)),
        Better::Neither => ("neither", None),
    };
    json!({ "key": metric.key, "label": metric.label, "better": better, "target": target,
            "group": metric.group.title(), "shown": metric.shown })
}

/// The scene's picture and the maps of its methods that are in the tables, on one scale.
fn thumbnails(folder: &Path, id: &str, scores: &SceneScores) -> Result<Value> {
    let scene = folder.join("scenes").join(file_name(id));
    let mut maps = Vec::new();
    let mut seen = BTreeSet::new();
    for place in folders_in(&scene) {
        // The maps' name in the tables is written in their scores.
        let Ok(scored) = read_json::<Value>(&place.join("scores.json")) else { continue };
        let label = scored["entries"][0]["method"].as_str().unwrap_or_default().to_owned();
        if !scores.contains_key(&label) || !seen.insert(label.clone()) {
            continue;
        }
        let map = |name: &str| -> Result<Option<Array2<f32>>> {
            let path = place.join(name);
            let map = path.is_file().then(|| read_values(&path, &ReadOptions::default())).transpose()?;
            Ok(map.map(|map| nearest(map.view(), within(map.dim(), THUMBNAIL))))
        };
        if let Some(depth) = map("depth.npy")? {
            maps.push((label, depth, map("sigma.npy")?));
        }
    }
    // The prior first: its colour range is used for all.
    maps.sort_by_key(|(label, ..)| (label != "prior", label.clone()));
    let Some((_, first, _)) = maps.first() else { return Ok(Value::Null) };
    let depths = usual_range(first.iter());
    let sigmas = usual_range(maps.iter().filter_map(|(_, _, sigma)| sigma.as_ref()).flatten());
    let mut shown = Vec::new();
    for (label, depth, sigma) in &maps {
        let depth = picture(depth_picture_within(depth.view(), depths).view())?;
        let sigma = sigma.as_ref().map(|sigma| picture(sigma_picture_within(sigma.view(), sigmas).view()));
        shown.push(json!({ "method": label, "depth": depth, "sigma": sigma.transpose()? }));
    }
    let image = photograph_in(&scene.join(PICTURE))?;
    Ok(json!({ "image": image, "maps": shown, "depths": depths, "sigmas": sigmas }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_scenes_get_the_thumbnails() {
        let rows = |i: usize| format!("s{i},fast,0,median,{i}\ns{i},prior,0,median,{}\n", 100 - i);
        let text: String = (0..SCENES + 5).map(rows).collect();
        let text = format!("scene,method,seed,alignment,abs_rel\n{text}none,prior,0,median,1\n");
        let scores = read_csv(&text).unwrap();
        // A trivial sigma of the prior has no depth of its own; a control comes after the methods.
        let method = |name: &str, key: &str| json!({ "method": name, "metrics": { key: {} } });
        let summary = |methods: &[Value]| json!({ "summary": { "methods": methods } });
        let [prior, constant] = [method("prior", "abs_rel"), method("prior, sigma by constant", "ause_mae")];
        let judged_of =
            |methods: &[Value]| judged(&summary(methods)).map(|(name, metric)| (name, metric.key));
        let fast = method("fast", "abs_rel");
        let judged_by = |name: &str| Some((name.to_owned(), "abs_rel"));
        assert_eq!(judged_of(&[prior.clone(), constant.clone()]), judged_by("prior"));
        assert_eq!(judged_of(&[prior.clone(), constant.clone(), fast.clone()]), judged_by("fast"));
        assert_eq!(judged_of(std::slice::from_ref(&constant)).unwrap().1, "ause_mae");
        let judged = judged(&summary(&[prior, constant, fast])).unwrap();
        let worst = worst(&scores, Some(&judged));
        assert_eq!(worst.len(), SCENES);
        assert!(worst.contains("s5") && worst.contains("s44") && !worst.contains("s4"), "{worst:?}");
    }
}
