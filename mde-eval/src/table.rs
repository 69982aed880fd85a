//! Scores of many scenes as tables: one row per scene and method, and a summary per method with intervals.

mod comparison;
mod document;
mod rows;
mod summary;
pub(crate) mod verdict;
mod write;

pub use comparison::{Compared, Comparison};
pub use document::{Block, Document, Table, wrapped};
pub use rows::{SceneScores, csv, inert, original_name, read_csv};
pub use summary::{MethodSummary, Statistics, Summary};
pub use verdict::{is_control, verdict};
pub use write::document;

use crate::align::{Alignment, AlignmentRule};
use crate::score::{Scores, UncertaintyCurves};
use mde_uncertainty::normal::central_half_width;
use mde_uncertainty::pooled::{PooledIntervals, share_below};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// One method's scores for one scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Entry {
    /// The scene's identifier.
    pub scene: String,
    /// The place that the scene shows: scenes of one place are resampled together. The scene itself without it.
    #[serde(default)]
    pub place: Option<String>,
    /// The method's name.
    pub method: String,
    /// The seed of the method's random draws: its runs on a scene with other seeds are averaged before scenes are compared.
    pub seed: u64,
    /// The rule that brought the map to the truth's scale, `given` where it was another map's alignment.
    pub alignment: String,
    /// By the key of one of [`METRICS`](crate::score::METRICS), where it is defined.
    pub values: BTreeMap<String, f64>,
    /// Curves of its uncertainty, where there is one.
    pub curves: Option<UncertaintyCurves>,
}

impl Entry {
    /// The scores of one map.
    pub fn new(scene: impl Into<String>, method: impl Into<String>, scores: Scores) -> Self {
        let mut entry = Self {
            scene: scene.into(),
            place: None,
            method: method.into(),
            seed: 0,
            alignment: scores.rule.map_or("given", AlignmentRule::name).to_owned(),
            values: scores.values,
            curves: scores.curves,
        };
        if let (Some(AlignmentRule::Median | AlignmentRule::MedianRatio), Alignment::Depth { scale, .. }) =
            (scores.rule, scores.alignment)
        {
            entry.set("alignment_scale", scale);
        }
        entry
    }

    /// Sets the value of the metric of that key; nothing where it is not finite.
    pub fn set(&mut self, key: &str, value: f64) {
        match value.is_finite() {
            true => self.values.insert(key.to_owned(), value),
            false => self.values.remove(key),
        };
    }

    /// The place that the scene shows; the scene itself where it has none.
    pub fn place(&self) -> &str {
        self.place.as_deref().unwrap_or(&self.scene)
    }
}

/// Sets `factor` and the scores of every sigma times that factor (`calibrated_*`): the factor of each scene makes the 90 % interval cover 90 % of the scenes of all *other* places
/// ([`PooledIntervals`]). Methods whose scenes show one place only are left alone.
pub fn calibrate(entries: &mut [Entry]) {
    let mut by_method: BTreeMap<(String, u64), Vec<usize>> = BTreeMap::new();
    for (index, entry) in entries.iter_mut().enumerate() {
        entry.values.retain(|key, _| key != "factor" && !key.starts_with("calibrated_"));
        if entry.curves.is_some() {
            by_method.entry((entry.method.clone(), entry.seed)).or_default().push(index);
        }
    }
    for own in by_method.into_values() {
        let places: BTreeSet<&str> = own.iter().map(|&index| entries[index].place()).collect();
        let factor = |place: &str| {
            let others = own.iter().map(|&other| &entries[other]).filter(|other| other.place() != place);
            let quantiles: Vec<Vec<f64>> =
                others.filter_map(|other| Some(other.curves.as_ref()?.abs_z_quantiles.clone())).collect();
            let factor = PooledIntervals::fit(&quantiles).and_then(|table| table.factor(0.9));
            Some((place.to_owned(), factor.ok()?))
        };
        let factors: BTreeMap<String, f64> = places.into_iter().filter_map(factor).collect();
        let calibrated = |Entry { values, curves, .. }: &Entry, factor: f64| {
            // The factor leaves the errors and multiplies every sigma.
            let nll =
                values.get("nll")? + factor.ln() + 0.5 * values.get("mean_z2")? * (factor.powi(-2) - 1.0);
            let covered = share_below(&curves.as_ref()?.abs_z_quantiles, factor * central_half_width(0.9));
            let found = [("factor", factor), ("calibrated_coverage_90", covered), ("calibrated_nll", nll)];
            (factor > 0.0 && nll.is_finite()).then_some(found)
        };
        for index in own {
            let entry = &mut entries[index];
            let factor = factors.get(entry.place());
            let found = factor.and_then(|factor| calibrated(entry, *factor));
            found.into_iter().flatten().for_each(|(key, value)| entry.set(key, value));
        }
    }
}

/// An error of a scene or of one of its methods.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Failure {
    /// The scene.
    pub scene: String,
    /// The method; none if the scene itself could not be loaded.
    pub method: Option<String>,
    /// What is wrong.
    pub error: String,
}

/// What failed, one line for each method and reason.
pub fn failed(failures: &[Failure]) -> Vec<String> {
    let mut groups: BTreeMap<(&str, &str), Vec<&str>> = BTreeMap::new();
    for failure in failures {
        let method = failure.method.as_deref().unwrap_or("all methods");
        groups.entry((method, &failure.error)).or_default().push(&failure.scene);
    }
    let line = |((method, error), scenes): ((&str, &str), Vec<&str>)| match scenes.as_slice() {
        [scene] => format!("failed: {method} on {scene}: {error}"),
        scenes => format!("failed: {method} on {} scenes: {error}", scenes.len()),
    };
    groups.into_iter().map(line).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::score::{ScoreConfig, Subject, score};
    use crate::statistics::Bootstrap;
    use ndarray::Array2;

    /// Two methods on three scenes.
    pub(crate) fn entries() -> Vec<Entry> {
        entries_of(3, &[("prior", 0.2), ("better", 0.1)], true)
    }

    /// Methods whose depth is the truth, too far by about that share on average, with or without a sigma.
    pub(crate) fn entries_of(scenes: usize, methods: &[(&str, f32)], sigma: bool) -> Vec<Entry> {
        let (mut entries, config) = (Vec::new(), ScoreConfig::default());
        for scene in 0..scenes {
            let truth = Array2::from_shape_fn((24, 32), |(y, x)| 1.0 + 0.05 * (x + y + scene) as f32);
            for &(method, error) in methods {
                let error = error * (1.0 + 0.01 * scene as f32);
                let off = |(y, x)| 1.0 + error * ((7 * x + 13 * y) % 41) as f32 / 20.0;
                let depth = Array2::from_shape_fn(truth.dim(), |at| off(at) * truth[at]);
                let sigma = sigma.then(|| depth.mapv(|d| 0.03 * d));
                let sigma = sigma.as_ref().map(|sigma| sigma.view());
                let subject = Subject { sigma, ..Subject::new(depth.view(), truth.view()) };
                let scores = score(&subject, &config).unwrap();
                let mut entry = Entry::new(format!("scene {scene}"), method, scores);
                entry.set("seconds", 1.0);
                entries.push(entry);
            }
        }
        entries
    }

    #[test]
    fn what_is_better_on_every_scene_is_better_and_ranks_first() {
        let summary = Summary::new(&entries(), Some("prior"), &Bootstrap::default()).unwrap();
        assert_eq!((summary.scenes, summary.methods.len()), (3, 2));
        let mse = summary.get("better", "mse").unwrap();
        assert_eq!((mse.scenes, mse.paired, mse.worse, mse.rank), (3, 3, Some(0), Some(1.0)));
        let difference = mse.difference.unwrap();
        assert!(difference.value < 0.0 && difference.excludes(0.0));
        assert!(mse.ratio.unwrap().high < 1.0);
        let reference = summary.get("prior", "mse").unwrap();
        assert_eq!((reference.difference, reference.rank), (None, Some(2.0)));
    }

    #[test]
    fn one_factor_makes_the_other_scenes_cover() {
        let mut entries = entries();
        calibrate(&mut entries);
        for entry in &entries {
            let miss = |key: &str| (entry.values[key] - 0.9).abs();
            assert!(entry.values["factor"] > 0.0, "{:?}", entry.values);
            assert!(miss("calibrated_coverage_90") <= miss("coverage_90") + 0.1, "{:?}", entry.values);
        }
        let mut alone = entries[..2].to_vec();
        calibrate(&mut alone);
        assert!(alone.iter().all(|entry| !entry.values.contains_key("factor")));
        // The third scene alone stands for the first two, which are one place.
        let third = entries.iter().find(|entry| entry.scene == "scene 2").unwrap().clone();
        for entry in &mut entries {
            entry.place = Some(if entry.scene == "scene 2" { "there" } else { "here" }.to_owned());
        }
        calibrate(&mut entries);
        let quantiles = &third.curves.as_ref().unwrap().abs_z_quantiles;
        for entry in entries.iter().filter(|e| e.method == third.method && e.place() == "here") {
            let factor = entry.values["factor"];
            assert!((share_below(quantiles, factor * central_half_width(0.9)) - 0.9).abs() < 1e-6);
        }
    }

    #[test]
    fn equal_failures_take_one_line() {
        let failure = |scene: &str, method: Option<&str>, error: &str| Failure {
            scene: scene.to_owned(),
            method: method.map(str::to_owned),
            error: error.to_owned(),
        };
        let all = [failure("a", Some("zoom"), "x"), failure("b", Some("zoom"), "x"), failure("a", None, "y")];
        assert_eq!(failed(&all), ["failed: all methods on a: y", "failed: zoom on 2 scenes: x"]);
    }
    #[test]
    fn a_scene_twice_is_a_fault() {
        let mut entries = entries();
        entries.push(entries[0].clone());
        assert!(Summary::new(&entries, None, &Bootstrap::default()).is_err());
        assert!(Summary::new(&[], None, &Bootstrap::default()).is_err());
    }
}
