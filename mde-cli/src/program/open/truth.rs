//! Scores against ground truth.

use crate::program::terminal::aligned;
use crate::reports::Refinement;
use anyhow::{Context, Result, ensure};
use mde_eval::align::AlignmentRule;
use mde_eval::score::{ScoreConfig, Scores, Subject, score};
use mde_eval::table::Table;
use mde_prior::DepthKind;
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::resample::nearest;
use ndarray::Array2;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// A true depth.
pub(crate) struct Truth {
    pub(crate) source: String,
    /// Metres, `[height, width]`; 0 = missing.
    pub(crate) depth: Array2<f32>,
}

impl Truth {
    /// The map that `--gt` names for an image of `(height, width)`, resized, if it is given.
    pub(crate) fn open(
        path: Option<&Path>,
        size: (usize, usize),
        to: (usize, usize),
    ) -> Result<Option<Self>> {
        let Some(path) = path else { return Ok(None) };
        let depth = read_depth(path, &ReadOptions::default())?;
        ensure!(
            depth.dim() == size,
            "{}: the truth is {}x{} but the image is {}x{} (width x height); make both the same size",
            path.display(),
            depth.ncols(),
            depth.nrows(),
            size.1,
            size.0
        );
        let depth = nearest(depth.view(), to);
        Ok(Some(Self { source: path.display().to_string(), depth }))
    }

    /// Scores of prior and refined depth, each under its own alignment, by three rules.
    pub(crate) fn compare(&self, refinement: &Refinement, kind: DepthKind) -> Result<Comparison> {
        let sigma = refinement.depth.sigma();
        let prior = Subject::new(refinement.prior.view(), self.depth.view());
        let refined = Subject::new(refinement.depth.mean(), self.depth.view()).with_sigma(sigma.view());
        let rules = rules(kind);
        let mut by_alignment = BTreeMap::new();
        for rule in rules {
            let config = ScoreConfig { alignment: rule, ..ScoreConfig::default() };
            let of = |subject| score(subject, &config).with_context(|| self.source.clone());
            by_alignment.insert(rule.name(), Pair { prior: of(&prior)?, refined: of(&refined)? });
        }
        Ok(Comparison { truth: self.source.clone(), shown: rules[0].name(), by_alignment })
    }
}

/// The first is printed.
fn rules(kind: DepthKind) -> [AlignmentRule; 3] {
    use AlignmentRule::{LeastSquaresDisparity, Median, None};
    match kind {
        DepthKind::AffineDisparity => [LeastSquaresDisparity, Median, None],
        _ => [Median, None, LeastSquaresDisparity],
    }
}

/// Scores of prior and refined depth by the name of the alignment.
#[derive(Debug, Serialize)]
pub(crate) struct Comparison {
    truth: String,
    /// The alignment that the program prints.
    shown: &'static str,
    by_alignment: BTreeMap<&'static str, Pair>,
}

#[derive(Debug, Serialize)]
struct Pair {
    prior: Scores,
    refined: Scores,
}

impl Comparison {
    /// A table of the scores that matter most.
    pub(crate) fn table(&self) -> String {
        let Some(Pair { prior, refined }) = self.by_alignment.get(self.shown) else { return String::new() };
        let rows = [
            ("AbsRel, lower", "abs_rel"),
            ("RMSE, m, lower", "rmse"),
            ("MSE, m2, lower", "mse"),
            ("within a factor 1.25, higher", "delta1"),
            ("edge F1, 0.25 m, 1 px, higher", "f1@0.25m_r1"),
            ("boundary F1, higher", "boundary_f1"),
            ("wrong order across edges, D3R, lower", "d3r"),
            ("sharpness on edges, higher", "sharpness_on"),
            ("sharpness off edges, lower", "sharpness_off"),
            ("Spearman of sigma and error, higher", "spearman"),
            ("mean z2 (above 1: sigma too small), near 1", "mean_z2"),
            ("90 % intervals hold, near 0.9", "coverage_90"),
        ];
        let cell =
            |scores: &Scores, key| scores.get(key).map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
        let rows = rows.map(|(label, key)| vec![label.to_owned(), cell(prior, key), cell(refined, key)]);
        aligned(&Table::new(1, [&*format!("{} alignment", self.shown), "prior", "refined"], rows))
    }
}
