//! Scores against ground truth.

use crate::reports::Refinement;
use anyhow::{Context, Result, ensure};
use mde_eval::align::AlignmentRule;
use mde_eval::score::Subject;
use mde_eval::table::Comparison;
use mde_prior::DepthKind;
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::resample::nearest;
use ndarray::Array2;
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
        Comparison::new(&self.source, &prior, &refined, rules(kind)).with_context(|| self.source.clone())
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
