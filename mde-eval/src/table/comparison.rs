use super::Table;
use crate::Result;
use crate::align::AlignmentRule;
use crate::score::{ScoreConfig, Scores, Subject, score};
use serde::Serialize;
use std::collections::BTreeMap;

/// Scores of a prior and of the depth that was refined from it, by the name of the alignment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the truth.
    pub truth: String,
    /// The alignment of [`Comparison::table`].
    pub shown: &'static str,
    /// The scores under each alignment.
    pub by_alignment: BTreeMap<&'static str, Compared>,
}

/// Scores under one rule, each map under its own alignment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Compared {
    /// Of the prior.
    pub prior: Scores,
    /// Of the refined depth.
    pub refined: Scores,
}

impl Comparison {
    /// Scores two maps of one scene by three rules, of which the first is shown.
    ///
    /// # Errors
    /// As [`score`].
    pub fn new(
        truth: &str,
        prior: &Subject<'_>,
        refined: &Subject<'_>,
        rules: [AlignmentRule; 3],
    ) -> Result<Self> {
        let mut by_alignment = BTreeMap::new();
        for rule in rules {
            let config = ScoreConfig { alignment: rule, ..ScoreConfig::default() };
            let scores = Compared { prior: score(prior, &config)?, refined: score(refined, &config)? };
            by_alignment.insert(rule.name(), scores);
        }
        Ok(Self { truth: truth.to_owned(), shown: rules[0].name(), by_alignment })
    }

    /// The scores that matter most, under the shown alignment.
    pub fn table(&self) -> Table {
        let Some(Compared { prior, refined }) = self.by_alignment.get(self.shown) else {
            return Table::default();
        };
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
        Table::new(1, [&*format!("{} alignment", self.shown), "prior", "refined"], rows)
    }
}
