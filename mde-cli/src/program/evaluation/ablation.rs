//! The rows of `mde ablate`: the paper's Table II, controls without a NeRF, and remedies.

use crate::config::{Config, IterationPrior};
use crate::program::evaluation::PRIOR;
use mde_eval::table::{Block, Summary, Table};
use mde_fusion::{Aggregation, Calibration, Fusion, PriorVariance, VarianceRule};
use mde_uncertainty::termination::InBinVariance;

/// The unchanged configuration, the reference of the other rows.
pub(crate) const FULL: &str = "full";

/// One row: the base configuration with one change.
pub(crate) struct Row {
    pub(crate) name: &'static str,
    what: &'static str,
    /// Change of MSE in percent, sharpness over the prior's and edge F1, as the paper prints them.
    paper: Option<[f64; 3]>,
    change: fn(&mut Config),
}

impl Row {
    pub(crate) fn config(&self, base: &Config) -> Config {
        let mut config = base.clone();
        (self.change)(&mut config);
        config
    }

    /// The baseline that replaces the field.
    pub(crate) fn control(&self) -> Option<&'static str> {
        self.name.strip_suffix("-for-nerf")
    }
}

const fn row(name: &'static str, what: &'static str, change: fn(&mut Config)) -> Row {
    Row { name, what, paper: None, change }
}

const fn printed(name: &'static str, what: &'static str, paper: [f64; 3], change: fn(&mut Config)) -> Row {
    Row { name, what, paper: Some(paper), change }
}

fn fixed(config: &mut Config, kappa: f64) {
    config.fusion.prior_variance = PriorVariance::FixedRelative;
    config.fusion.kappa = kappa;
}

fn original_only(config: &mut Config) {
    config.novel.count = 0;
}

/// All rows, the full model first.
pub(crate) const ROWS: &[Row] = &[
    printed(FULL, "the whole method", [0.0, 1.08, 0.412], |_| {}),
    printed(
        "no-variance",
        "- NeRF variance: the median of all views' variances everywhere",
        [0.5, 1.03, 0.382],
        |c| c.fusion.variance = VarianceRule::ConstantMedian,
    ),
    printed("min-depth", "- precision-weighted fusion: the nearest surface", [0.7, 1.04, 0.309], |c| {
        c.fusion.aggregation = Aggregation::MinDepth
    }),
    printed("no-calibration", "- affine WLS: a = 1, b = 0", [2.8, 1.06, 0.402], |c| {
        c.fusion.calibration = Calibration::None
    }),
    printed(
        "fixed-variance",
        "- empirical Bayes: the median of the calibrated variances",
        [0.2, 1.08, 0.397],
        |c| c.fusion.prior_variance = PriorVariance::FixedMedian,
    ),
    row("kappa-0.02", "sigma_o = 2 % of the median depth", |c| fixed(c, 0.02)),
    row("kappa-0.05", "sigma_o = 5 %", |c| fixed(c, 0.05)),
    row("kappa-0.1", "sigma_o = 10 %", |c| fixed(c, 0.1)),
    row("kappa-0.2", "sigma_o = 20 %", |c| fixed(c, 0.2)),
    printed(
        "nerf-only",
        "- monocular prior: the calibrated NeRF where there is one",
        [3.2, 1.10, 0.406],
        |c| c.fusion.fusion = Fusion::NerfOnly,
    ),
    row("guided-for-nerf", "no NeRF: a guided filter of the prior in its place", original_only),
    row("noise-for-nerf", "no NeRF: the prior with 1 % noise in its place", original_only),
    row("original-pose", "rendered from the original pose alone", original_only),
    row("in-bin", "variance within the bins of a ray", |c| c.nerf.render.in_bin = InBinVariance::Uniform),
    row("spread", "variance of the mixture of views", |c| c.fusion.aggregation = Aggregation::Mixture),
    row("anchor", "the first prior in every iteration", |c| c.refinement.prior = IterationPrior::Anchor),
];

/// The prior without refinement, for comparison.
const THE_PRIOR: Row = row(PRIOR, "the monocular depth", |_| {});

/// The rows that differ from `base`; without `anchor` for a single iteration, where it has no effect.
pub(crate) fn rows(base: &Config) -> impl Iterator<Item = &'static Row> {
    let base = base.clone();
    ROWS.iter().filter(move |row| match row.name {
        FULL => true,
        "anchor" if base.refinement.iterations == 1 => false,
        _ => row.control().is_some() || row.config(&base) != base,
    })
}

/// Table II beside the paper's figures. `to_full` and `to_prior` compare the same entries with the full model and with the prior.
pub(crate) fn table(to_full: &Summary, to_prior: &Summary) -> Vec<Block> {
    let sample = if to_full.places < to_full.scenes { "places" } else { "scenes" };
    let note = format!(
        "Change of MSE against the full model and sharpness against the prior are ratios of means over scenes \
         [95 % of resampled {sample}]; F1 is at 0.25 m and 1 px."
    );
    let heads = ["row", "what", "dMSE", "dMSE, paper", "sharpness", "paper", "F1", "paper"];
    let mut rows = Vec::new();
    for row in std::iter::once(&THE_PRIOR).chain(ROWS) {
        let Some(f1) = to_full.get(row.name, "f1@0.25m_r1") else { continue };
        let mse = to_full.get(row.name, "mse").and_then(|s| s.ratio);
        let percent = |ratio: f64| 100.0 * (ratio - 1.0);
        let mse = mse.map_or_else(
            || if row.name == FULL { "0" } else { "–" }.to_owned(),
            |r| format!("{:+.1} % [{:+.1}, {:+.1}]", percent(r.value), percent(r.low), percent(r.high)),
        );
        let sharp = to_prior.get(row.name, "sharpness").and_then(|s| s.ratio);
        let sharp =
            sharp.map_or_else(String::new, |r| format!("{:.2} [{:.2}, {:.2}]", r.value, r.low, r.high));
        let paper =
            |index: usize, text: fn(f64) -> String| row.paper.map_or_else(String::new, |p| text(p[index]));
        rows.push(vec![
            row.name.to_owned(),
            row.what.to_owned(),
            mse,
            paper(0, |v| format!("{v:+.1} %")),
            sharp,
            paper(1, |v| format!("{v:.2}")),
            format!("{:.3}", f1.mean),
            paper(2, |v| format!("{v:.3}")),
        ]);
    }
    let heading = Block::Heading(2, "The paper's Table II".to_owned());
    vec![heading, Block::Text(note), Block::Table(Table::new(2, heads, rows))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Preset;

    #[test]
    fn every_row_is_another_configuration_that_is_sound() {
        let base = Preset::Paper.config();
        for (index, row) in ROWS.iter().enumerate() {
            row.config(&base).validate().unwrap();
            for other in &ROWS[..index] {
                assert_ne!(row.name, other.name);
                let same = row.config(&base) == other.config(&base) && row.control() == other.control();
                assert!(!same, "{} is {}", row.name, other.name);
            }
        }
        assert_eq!(rows(&base).count(), ROWS.len());
        let mut one = base;
        one.refinement.iterations = 1;
        assert!(rows(&one).all(|row| row.name != "anchor"));
    }
}
