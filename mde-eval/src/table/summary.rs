use super::Entry;
use crate::score::{METRICS, Metric};
use crate::statistics::{Bootstrap, Estimate};
use crate::{Error, Result};
use mde_uncertainty::OutOfRange;
use mde_uncertainty::statistics::{average_ranks, median};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Statistics of every method and metric over scenes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Summary {
    /// The method that the others are compared with, if any.
    pub reference: Option<String>,
    /// Number of scenes.
    pub scenes: usize,
    /// Number of places that the scenes show. Intervals are over resampled places.
    pub places: usize,
    /// Settings of the intervals.
    pub bootstrap: Bootstrap,
    /// The methods, in the order of their first entry.
    pub methods: Vec<MethodSummary>,
}

/// Statistics of one method over scenes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct MethodSummary {
    /// Its name.
    pub method: String,
    /// By the metric's key; metrics that no scene has are left out.
    pub metrics: BTreeMap<String, Statistics>,
}

/// One metric of one method over scenes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Statistics {
    /// Scenes that have it.
    pub scenes: usize,
    /// Mean over them.
    pub mean: f64,
    /// Median over them: what a bad scene does not move.
    pub median: f64,
    /// Scenes that have it for the reference too.
    pub paired: usize,
    /// Places of those scenes.
    pub places: usize,
    /// Mean difference to the reference on the same scenes.
    pub difference: Option<Estimate>,
    /// Ratio of means to the reference on the same scenes, where the reference's is positive.
    pub ratio: Option<Estimate>,
    /// Scenes on which it is worse than the reference; nothing where neither is better.
    pub worse: Option<usize>,
    /// Mean over scenes of its rank among the methods that have the metric, 1 the best, ties averaged.
    pub rank: Option<f64>,
}

impl Summary {
    /// Summarises entries: at most one a scene, method and seed; seeds are averaged.
    ///
    /// # Errors
    /// [`Error::Empty`] without entries; [`Error::Config`] where a method has a scene and seed twice, where a scene has two
    /// places, or for the bootstrap's settings.
    pub fn new(entries: &[Entry], reference: Option<&str>, bootstrap: &Bootstrap) -> Result<Self> {
        bootstrap.validate()?;
        if entries.is_empty() {
            return Err(Error::Empty("a summary"));
        }
        let mut methods: Vec<MethodSummary> = Vec::new();
        let mut seen = BTreeSet::new();
        let mut places: BTreeMap<&str, &str> = BTreeMap::new();
        for entry in entries {
            if methods.iter().all(|known| known.method != entry.method) {
                methods.push(MethodSummary { method: entry.method.clone(), metrics: BTreeMap::new() });
            }
            if *places.entry(&entry.scene).or_insert(entry.place()) != entry.place() {
                let value = format!("{} for {}", entry.place(), entry.scene);
                return Err(OutOfRange::new("place", value, "give each scene one place").into());
            }
            if !seen.insert((&entry.method, &entry.scene, entry.seed)) {
                let value = format!("{} on {}, twice", entry.method, entry.scene);
                return Err(
                    OutOfRange::new("an entry", value, "give each scene, method and seed once").into()
                );
            }
        }
        for metric in METRICS {
            let values = Values::of(metric, entries, &places);
            let ranks = values.ranks(metric);
            for method in &mut methods {
                let rank = ranks.get(method.method.as_str()).copied();
                if let Some(statistics) =
                    values.statistics(metric, &method.method, reference, rank, bootstrap)?
                {
                    method.metrics.insert(metric.key.to_owned(), statistics);
                }
            }
        }
        let reference = reference.map(str::to_owned);
        let scenes = places.len();
        let places = places.values().collect::<BTreeSet<_>>().len();
        Ok(Self { reference, scenes, places, bootstrap: bootstrap.clone(), methods })
    }

    /// The statistics of a method's metric.
    pub fn get(&self, method: &str, key: &str) -> Option<&Statistics> {
        self.methods.iter().find(|summary| summary.method == method)?.metrics.get(key)
    }
}

/// One metric by method and scene.
struct Values<'e> {
    by_method: BTreeMap<&'e str, BTreeMap<&'e str, f64>>,
    /// The place of each scene.
    places: &'e BTreeMap<&'e str, &'e str>,
}

impl<'e> Values<'e> {
    fn of(metric: &Metric, entries: &'e [Entry], places: &'e BTreeMap<&'e str, &'e str>) -> Self {
        let mut sums: BTreeMap<&str, BTreeMap<&str, (f64, f64)>> = BTreeMap::new();
        for entry in entries {
            if let Some(value) = entry.values.get(metric.key) {
                let sum = sums.entry(&entry.method).or_default().entry(&entry.scene).or_default();
                *sum = (sum.0 + value, sum.1 + 1.0);
            }
        }
        let mean = |scenes: BTreeMap<&'e str, (f64, f64)>| {
            scenes.into_iter().map(|(scene, (sum, seeds))| (scene, sum / seeds)).collect()
        };
        Self { by_method: sums.into_iter().map(|(method, scenes)| (method, mean(scenes))).collect(), places }
    }

    fn ranks(&self, metric: &Metric) -> BTreeMap<&'e str, f64> {
        let scenes: BTreeSet<&str> =
            self.by_method.values().flat_map(|scenes| scenes.keys().copied()).collect();
        let mut sums: BTreeMap<&str, (f64, usize)> = BTreeMap::new();
        for scene in scenes {
            let here = self
                .by_method
                .iter()
                .filter_map(|(method, values)| Some((*method, metric.better.badness(*values.get(scene)?)?)));
            let (methods, badness): (Vec<&str>, Vec<f64>) = here.unzip();
            let Ok(ranks) = average_ranks(&badness) else { continue };
            for (method, rank) in methods.into_iter().zip(ranks) {
                let sum = sums.entry(method).or_default();
                (sum.0, sum.1) = (sum.0 + rank, sum.1 + 1);
            }
        }
        sums.into_iter().map(|(method, (sum, scenes))| (method, sum / scenes as f64)).collect()
    }

    fn statistics(
        &self,
        metric: &Metric,
        method: &str,
        reference: Option<&str>,
        rank: Option<f64>,
        bootstrap: &Bootstrap,
    ) -> Result<Option<Statistics>> {
        let Some(own) = self.by_method.get(method) else { return Ok(None) };
        let values: Vec<f64> = own.values().copied().collect();
        let of_reference = reference.filter(|name| *name != method).and_then(|name| self.by_method.get(name));
        let pairs = own.iter().filter_map(|(scene, value)| {
            Some(((*value, *of_reference?.get(scene)?), self.places.get(scene).copied()?))
        });
        let ((x, r), places): ((Vec<f64>, Vec<f64>), Vec<&str>) = pairs.unzip();
        let badness = |value: f64| metric.better.badness(value);
        let worse = x.iter().zip(&r).filter(|&(&x, &r)| badness(x) > badness(r)).count();
        let paired = !x.is_empty();
        let positive = paired && r.iter().all(|r| *r >= 0.0);
        Ok(Some(Statistics {
            scenes: values.len(),
            mean: values.iter().sum::<f64>() / values.len() as f64,
            median: median(values).unwrap_or(f64::NAN),
            paired: x.len(),
            places: places.iter().collect::<BTreeSet<_>>().len(),
            difference: paired.then(|| bootstrap.difference(&x, &r, &places)).transpose()?,
            ratio: positive.then(|| bootstrap.ratio(&x, &r, &places)).transpose()?.flatten(),
            worse: (paired && badness(0.0).is_some()).then_some(worse),
            rank,
        }))
    }
}
