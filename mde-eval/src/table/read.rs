use super::original_name;
use crate::score::METRICS;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// The scores of a scene, by method and metric.
pub type SceneScores = BTreeMap<String, BTreeMap<&'static str, f64>>;

/// The shown metrics of what [`csv()`](super::csv()) wrote: the scenes in the file's order, with means over seeds.
///
/// # Errors
/// [`Error::Method`] for a text that is no such table.
pub fn read_csv(text: &str) -> Result<Vec<(String, SceneScores)>> {
    let fault = |error: csv::Error| Error::Method(error.to_string());
    let (mut scenes, mut places) = (Vec::<(String, SceneScores)>::new(), BTreeMap::new());
    // The values of the seeds, by scene, method and metric.
    let mut found = BTreeMap::<_, Vec<f64>>::new();
    for row in csv::Reader::from_reader(text.as_bytes()).deserialize() {
        let row: BTreeMap<String, String> = row.map_err(fault)?;
        let named = |key: &str| original_name(row.get(key).map_or("", String::as_str)).to_owned();
        let (scene, method) = (named("scene"), named("method"));
        let place = *places.entry(scene.clone()).or_insert(scenes.len());
        if place == scenes.len() {
            scenes.push((scene, SceneScores::new()));
        }
        for metric in METRICS.iter().filter(|metric| metric.shown) {
            if let Some(value) = row.get(metric.key).and_then(|text| text.parse().ok()) {
                found.entry((place, method.clone(), metric.key)).or_default().push(value);
            }
        }
    }
    for ((place, method, key), seeds) in found {
        let mean = seeds.iter().sum::<f64>() / seeds.len() as f64;
        scenes[place].1.entry(method).or_default().insert(key, mean);
    }
    Ok(scenes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_averaged_and_empty_cells_stay_empty() {
        let text = "scene,method,seed,alignment,mse,abs_rel\nb,fast,0,median,1.0,\nb,fast,1,median,3.0,\na,prior,0,median,5,0.25\n";
        let scores = read_csv(text).unwrap();
        assert_eq!((&*scores[0].0, &*scores[1].0), ("b", "a"));
        assert_eq!(scores[0].1["fast"], BTreeMap::from([("mse", 2.0)]));
    }
}
