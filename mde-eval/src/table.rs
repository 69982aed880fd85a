//! Scores of many scenes as tables: one row per scene and method, and a summary per method with intervals.

mod document;
mod metric;
mod summary;
mod write;

pub use document::{Block, Cell, Column, Document, Table};
pub use metric::{Better, Group, METRICS, Metric};
pub use summary::{MethodSummary, Statistics, Summary};
pub use write::{csv, document, inert, original_name};

use crate::Result;
use crate::align::{Alignment, AlignmentRule};
use crate::metrics::depth;
use crate::raster::gather;
use crate::score::{DepthScores, ScoreConfig, Scores, Subject, UncertaintyCurves, UncertaintyScores};
use mde_uncertainty::normal::central_half_width;
use mde_uncertainty::pooled::{PooledIntervals, share_below};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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
    /// The factor that brought the map to the truth's scale, where the alignment is one of depth without a shift.
    #[serde(default)]
    pub scale: Option<f64>,
    /// Wall seconds that the method took; nothing where it is not known.
    pub seconds: Option<f64>,
    /// Scores of the depth; nothing where only another sigma of the same depth is scored.
    pub depth: Option<DepthScores>,
    /// Errors under the reference's alignment instead of its own.
    pub shared: Option<SharedErrors>,
    /// Scores of the uncertainty, where there is one.
    pub uncertainty: Option<UncertaintyScores>,
    /// Curves of its uncertainty, where there is one.
    pub curves: Option<UncertaintyCurves>,
    /// Its uncertainty after one factor that the other scenes give ([`calibrate`]).
    pub calibrated: Option<Calibrated>,
}

impl Entry {
    /// The scores of one map.
    pub fn new(scene: impl Into<String>, method: impl Into<String>, scores: Scores) -> Self {
        let (depth, uncertainty) = (Some(scores.depth), scores.uncertainty);
        let alignment = scores.rule.map_or("given", AlignmentRule::name).to_owned();
        let scale = match (scores.rule, scores.alignment) {
            (Some(AlignmentRule::Median | AlignmentRule::MedianRatio), Alignment::Depth { scale, .. }) => {
                Some(scale)
            }
            _ => None,
        };
        Self { alignment, scale, depth, uncertainty, ..Self::empty(scene.into(), method.into()) }
    }

    /// The scores of a sigma whose depth has the entry `of`.
    pub fn of_uncertainty(
        of: &Self,
        method: impl Into<String>,
        uncertainty: UncertaintyScores,
        curves: UncertaintyCurves,
    ) -> Self {
        let (uncertainty, curves) = (Some(uncertainty), Some(curves));
        let (alignment, seed) = (of.alignment.clone(), of.seed);
        let place = of.place.clone();
        Self { place, seed, alignment, uncertainty, curves, ..Self::empty(of.scene.clone(), method.into()) }
    }

    /// The place that the scene shows; the scene itself where it has none.
    pub fn place(&self) -> &str {
        self.place.as_deref().unwrap_or(&self.scene)
    }

    fn empty(scene: String, method: String) -> Self {
        Self {
            scene,
            place: None,
            method,
            seed: 0,
            alignment: String::new(),
            scale: None,
            seconds: None,
            depth: None,
            shared: None,
            uncertainty: None,
            curves: None,
            calibrated: None,
        }
    }
}

/// Errors of a map under another map's alignment: a difference of these is not the alignment's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct SharedErrors {
    /// [Mean squared error](crate::metrics::depth::mse), m².
    pub mse: f64,
    /// [Mean absolute relative error](crate::metrics::depth::abs_rel).
    pub abs_rel: f64,
}

impl SharedErrors {
    /// The errors of `subject` under `alignment`, on the pixels and within the depths of `config`.
    ///
    /// # Errors
    /// As [`score_aligned`](crate::score::score_aligned).
    pub fn of(subject: &Subject<'_>, alignment: &Alignment, config: &ScoreConfig) -> Result<Self> {
        config.validate()?;
        let pixels = subject.pixels(config)?;
        let clip = |p: f64| alignment.depth(p).max(config.min_depth).min(config.max_depth).max(1e-6);
        let p: Vec<f64> = gather(subject.prediction, pixels.view()).into_iter().map(clip).collect();
        let g = gather(subject.truth, pixels.view());
        Ok(Self { mse: depth::mse(&p, &g)?, abs_rel: depth::abs_rel(&p, &g)? })
    }
}

/// Scores of the sigmas after one factor that is fitted on other places.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Calibrated {
    /// What the sigmas are multiplied by.
    pub factor: f64,
    /// Coverage of the central 50 % interval.
    pub coverage_50: f64,
    /// Coverage of the central 90 % interval.
    pub coverage_90: f64,
    /// Negative log-likelihood, nats per pixel.
    pub nll: f64,
}

/// Fills [`Entry::calibrated`]: the factor of each scene makes the 90 % interval cover 90 % of the scenes of all *other* places
/// ([`PooledIntervals`]). Methods whose scenes show one place only are left alone.
pub fn calibrate(entries: &mut [Entry]) {
    let mut by_method: BTreeMap<(String, u64), Vec<usize>> = BTreeMap::new();
    for (index, entry) in entries.iter_mut().enumerate() {
        entry.calibrated = None;
        if entry.curves.is_some() && entry.uncertainty.is_some() {
            by_method.entry((entry.method.clone(), entry.seed)).or_default().push(index);
        }
    }
    for own in by_method.into_values() {
        let mut factors: BTreeMap<String, Option<f64>> = BTreeMap::new();
        for &index in &own {
            let place = entries[index].place();
            if !factors.contains_key(place) {
                let others = own.iter().map(|&other| &entries[other]).filter(|other| other.place() != place);
                let quantiles: Vec<Vec<f64>> =
                    others.filter_map(|other| Some(other.curves.as_ref()?.abs_z_quantiles.clone())).collect();
                let factor = PooledIntervals::fit(&quantiles).and_then(|table| table.factor(0.9)).ok();
                factors.insert(place.to_owned(), factor);
            }
        }
        for index in own {
            let entry = &entries[index];
            let Some(factor) = factors.get(entry.place()).copied().flatten() else { continue };
            let (Some(scores), Some(curves)) = (&entry.uncertainty, &entry.curves) else { continue };
            let quantiles = &curves.abs_z_quantiles;
            let covered = |p| share_below(quantiles, factor * central_half_width(p));
            // The factor leaves the errors and multiplies every sigma.
            let nll = scores.nll + factor.ln() + 0.5 * scores.mean_z2 * (factor.powi(-2) - 1.0);
            let (coverage_50, coverage_90) = (covered(0.5), covered(0.9));
            entries[index].calibrated = (factor > 0.0 && nll.is_finite()).then_some(Calibrated {
                factor,
                coverage_50,
                coverage_90,
                nll,
            });
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::scene::{Room, room};
    use crate::score::{curves, score};
    use crate::statistics::Bootstrap;

    /// Two methods on three rooms: the truth too far by a tenth on one half, and by a fifth.
    pub(crate) fn entries() -> Vec<Entry> {
        let mut entries = Vec::new();
        let config = ScoreConfig::default();
        for kind in [Room::Study, Room::LivingRoom, Room::Bedroom] {
            let truth = room(kind, 0, 48, 36).unwrap().depth;
            for (method, off) in [("prior", 1.2), ("better", 1.1)] {
                let mut depth = truth.clone();
                depth.indexed_iter_mut().filter(|((_, x), _)| *x > 20).for_each(|(_, d)| *d *= off);
                let sigma = depth.mapv(|d| 0.03 * d);
                let subject = Subject::new(depth.view(), truth.view()).with_sigma(sigma.view());
                let scores = score(&subject, &config).unwrap();
                let curves = curves(&subject, &scores.alignment, &config).unwrap();
                let shared = SharedErrors::of(&subject, &scores.alignment, &config).unwrap();
                assert!((shared.mse - scores.depth.mse).abs() < 1e-6);
                entries.push(Entry {
                    seconds: Some(1.0),
                    shared: Some(shared),
                    curves,
                    ..Entry::new(kind.to_string(), method, scores)
                });
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
            let (before, after) = (entry.uncertainty.as_ref().unwrap(), entry.calibrated.unwrap());
            let observed = before.coverage.iter().find(|c| c.nominal == 0.9).unwrap().observed;
            let miss = |coverage: f64| (coverage - 0.9).abs();
            assert!(
                after.factor > 0.0 && miss(after.coverage_90) <= miss(observed) + 0.1,
                "{after:?} {observed}"
            );
        }
        let mut alone = entries[..2].to_vec();
        calibrate(&mut alone);
        assert!(alone.iter().all(|entry| entry.calibrated.is_none()));
        // The third room alone stands for the first two, which are one place.
        let third = entries.iter().find(|entry| entry.scene == "bedroom").unwrap().clone();
        for entry in &mut entries {
            entry.place = Some(if entry.scene == "bedroom" { "there" } else { "here" }.to_owned());
        }
        calibrate(&mut entries);
        let quantiles = &third.curves.as_ref().unwrap().abs_z_quantiles;
        for entry in entries.iter().filter(|e| e.method == third.method && e.place() == "here") {
            let factor = entry.calibrated.unwrap().factor;
            assert!((share_below(quantiles, factor * central_half_width(0.9)) - 0.9).abs() < 1e-6);
        }
    }

    #[test]
    fn a_scene_twice_is_a_fault() {
        let mut entries = entries();
        entries.push(entries[0].clone());
        assert!(Summary::new(&entries, None, &Bootstrap::default()).is_err());
        assert!(Summary::new(&[], None, &Bootstrap::default()).is_err());
    }
}
