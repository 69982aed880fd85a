use super::Entry;
use crate::score::{METRICS, Metric};
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::io::Write;

/// Writes a row per scene, method and seed: `scene,place,method,seed,alignment`, then every metric's key; empty without a value.
///
/// # Errors
/// [`Error::Method`] where the writer fails.
pub fn csv(entries: &[Entry], to: impl Write) -> Result<()> {
    let fault = |error: csv::Error| Error::Method(format!("the scores can't be written: {error}"));
    let mut writer = csv::Writer::from_writer(to);
    let heads = ["scene", "place", "method", "seed", "alignment"].into_iter();
    writer.write_record(heads.chain(METRICS.iter().map(|metric| metric.key))).map_err(fault)?;
    for entry in entries {
        let value = |metric: &Metric| entry.values.get(metric.key).map_or_else(String::new, f64::to_string);
        let values = METRICS.iter().map(value);
        let Entry { scene, method, seed, alignment, .. } = entry;
        let names = [inert(scene), inert(entry.place()), inert(method), seed.to_string(), alignment.clone()];
        writer.write_record(names.into_iter().chain(values)).map_err(fault)?;
    }
    writer.flush().map_err(|error| fault(error.into()))
}

/// A name that a spreadsheet would run as a formula, behind an apostrophe, as spreadsheets mark text.
pub fn inert(name: &str) -> String {
    if name.starts_with(['=', '+', '-', '@', '\t', '\r', '\'']) {
        format!("'{name}")
    } else {
        name.to_owned()
    }
}

/// A name as it was before [`csv()`] wrote it.
pub fn original_name(cell: &str) -> &str {
    cell.strip_prefix('\'').filter(|name| inert(name) == cell).unwrap_or(cell)
}

/// The scores of a scene, by method and metric.
pub type SceneScores = BTreeMap<String, BTreeMap<&'static str, f64>>;

/// The shown metrics of what [`csv()`] wrote: the scenes in the file's order, with means over seeds.
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
    use super::super::tests::entries;
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_file_has_every_metric_of_every_entry_and_no_name_is_a_formula() {
        let mut entries = entries();
        let names = ["=cmd|' /C calc'!A0", "+1", "-1", "@a", "'=1", "study"];
        entries.iter_mut().zip(names).for_each(|(entry, name)| entry.scene = name.to_owned());
        let mut bytes = Vec::new();
        csv(&entries, &mut bytes).unwrap();
        let mut reader = ::csv::Reader::from_reader(bytes.as_slice());
        let header = reader.headers().unwrap().clone();
        assert_eq!(header.iter().collect::<BTreeSet<_>>().len(), METRICS.len() + 5);
        let column = header.iter().position(|name| name == "mse").unwrap();
        let rows: Vec<_> = reader.records().map(|row| row.unwrap()).collect();
        assert_eq!(rows.len(), names.len());
        for (row, entry) in rows.iter().zip(&entries) {
            assert!(!row[0].starts_with(['=', '+', '-', '@']), "{}", &row[0]);
            assert_eq!((original_name(&row[0]), &row[2]), (entry.scene.as_str(), entry.method.as_str()));
            assert_eq!(row[column].parse::<f64>().unwrap(), entry.values["mse"]);
        }
    }

    #[test]
    fn seeds_are_averaged_and_empty_cells_stay_empty() {
        let text = "scene,method,seed,alignment,mse,abs_rel\nb,fast,0,median,1.0,\nb,fast,1,median,3.0,\na,prior,0,median,5,0.25\n";
        let scores = read_csv(text).unwrap();
        assert_eq!((&*scores[0].0, &*scores[1].0), ("b", "a"));
        assert_eq!(scores[0].1["fast"], BTreeMap::from([("mse", 2.0)]));
    }
}
