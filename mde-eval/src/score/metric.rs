use super::map::DepthMap;
use super::sigma::SigmaMap;
use crate::Result;
use crate::metrics::calibration::{coverage, crps, mean_z2, nll};
use crate::metrics::depth;

/// Direction of a metric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Better {
    /// Small values.
    Lower,
    /// Large values.
    Higher,
    /// Values near this one.
    Near(f64),
    /// Neither: it describes a method without ranking it.
    Neither,
}

impl Better {
    /// A number that ranks values, small for good ones; `None` for [`Better::Neither`].
    pub(crate) fn badness(self, value: f64) -> Option<f64> {
        match self {
            Self::Lower => Some(value),
            Self::Higher => Some(-value),
            Self::Near(target) => Some((value - target).abs()),
            Self::Neither => None,
        }
    }
}

/// Which table a metric stands in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Errors of the depth.
    Depth,
    /// Edges and order, invariant to contrast.
    Edges,
    /// Raised by any added gradient: an unsharp mask, or noise.
    Gradient,
    /// Correlation of sigma with the errors.
    Ranking,
    /// Size of sigma against the errors.
    Calibration,
    /// Seconds.
    Cost,
}

impl Group {
    /// All groups, in the order of the tables.
    pub const ALL: [Self; 6] =
        [Self::Depth, Self::Edges, Self::Gradient, Self::Ranking, Self::Calibration, Self::Cost];

    /// The heading of its table.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Depth => "Depth",
            Self::Edges => "Edges, invariant to contrast",
            Self::Gradient => "Gradient: raised by any unsharp mask or noise, so no evidence of quality",
            Self::Ranking => "Uncertainty: correlation with the errors",
            Self::Calibration => "Uncertainty: calibration",
            Self::Cost => "Cost",
        }
    }
}

/// One number per scene and method, where it is defined.
#[derive(Debug, Clone, Copy)]
pub struct Metric {
    /// The column's name in files, with threshold and tolerance where there are any.
    pub key: &'static str,
    /// The column's head in tables, with its unit.
    pub label: &'static str,
    /// Its direction.
    pub better: Better,
    /// The table it stands in.
    pub group: Group,
    /// Whether the tables show it; files have every metric.
    pub shown: bool,
    pub(super) of: Of,
}

/// What a metric is computed from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Of {
    /// Aligned and true depths, as lists.
    Depths(fn(&[f64], &[f64]) -> Result<f64>),
    /// What several metrics of the aligned map share; nothing where the metric is not defined, as in a scene without edges.
    Shared(fn(&DepthMap) -> Option<f64>),
    /// Errors and their sigmas, as lists.
    Errors(fn(&[f64], &[f64]) -> Result<f64>),
    /// What several metrics of sigma share.
    Sigma(fn(&SigmaMap) -> Option<f64>),
    /// Not one map alone: [`Entry`](crate::table::Entry) is given it.
    Evaluation,
}

const fn shown(key: &'static str, label: &'static str, better: Better, group: Group, of: Of) -> Metric {
    Metric { key, label, better, group, shown: true, of }
}

/// Of files alone.
const fn more(key: &'static str, better: Better, group: Group, of: Of) -> Metric {
    Metric { key, label: key, better, group, shown: false, of }
}

use Better::{Higher, Lower, Near, Neither};
use Group::{Calibration, Cost, Depth, Edges, Gradient, Ranking};
use Of::{Depths, Errors, Evaluation, Shared, Sigma};

/// Every metric of the tables and files, in the order of their columns.
pub const METRICS: &[Metric] = &[
    shown("mse", "MSE, m²", Lower, Depth, Depths(depth::mse)),
    shown("rmse", "RMSE, m", Lower, Depth, Depths(depth::rmse)),
    shown("abs_rel", "AbsRel", Lower, Depth, Depths(depth::abs_rel)),
    shown("log10", "log10", Lower, Depth, Depths(depth::log10)),
    shown("silog", "SILog, %", Lower, Depth, Depths(depth::silog)),
    shown("delta1", "within 1.25", Higher, Depth, Depths(|p, g| depth::delta(p, g, 1))),
    more("sq_rel", Lower, Depth, Depths(depth::sq_rel)),
    more("rmse_log", Lower, Depth, Depths(depth::rmse_log)),
    more("irmse", Lower, Depth, Depths(depth::irmse)),
    more("delta2", Higher, Depth, Depths(|p, g| depth::delta(p, g, 2))),
    more("delta3", Higher, Depth, Depths(|p, g| depth::delta(p, g, 3))),
    shown("f1_max@0.25m_r1", "F1max, 0.25 m", Higher, Edges, Shared(|m| m.f1_max[0])),
    shown("f1_max@0.5m_r1", "F1max, 0.5 m", Higher, Edges, Shared(|m| m.f1_max[1])),
    shown("boundary_f1", "boundary F1", Higher, Edges, Shared(|m| Some(m.boundary_f1))),
    more("dbe_accuracy", Lower, Edges, Shared(|m| Some(m.dbe?.accuracy))),
    shown("dbe_completeness", "DBE completeness, px", Lower, Edges, Shared(|m| Some(m.dbe?.completeness))),
    shown("d3r", "D3R", Lower, Edges, Shared(|m| m.d3r)),
    shown("sharpness_on", "sharp on edges", Neither, Gradient, Shared(|m| m.sharpness_on_off[0])),
    shown("sharpness_off", "sharp off edges", Neither, Gradient, Shared(|m| m.sharpness_on_off[1])),
    shown("sharpness", "sharpness", Neither, Gradient, Shared(|m| m.sharpness)),
    shown("f1@0.25m_r1", "F1, 0.25 m", Neither, Gradient, Shared(|m| Some(m.f1[0]))),
    shown("f1@0.5m_r1", "F1, 0.5 m", Neither, Gradient, Shared(|m| Some(m.f1[1]))),
    shown("spearman", "Spearman", Higher, Ranking, Sigma(|s| s.spearman)),
    shown("spearman_binned", "Spearman, 100 bins", Higher, Ranking, Sigma(|s| s.spearman_binned)),
    shown("ause_mae", "AUSE, MAE", Lower, Ranking, Sigma(|s| Some(s.curves.sparsification.ause()))),
    shown("ause_rmse", "AUSE, RMSE", Lower, Ranking, Sigma(|s| Some(s.rmse.ause()))),
    shown("spearman_relative", "Spearman, σ/D and AbsRel", Higher, Ranking, Sigma(|s| s.spearman_relative)),
    shown("ause_relative", "AUSE, σ/D and AbsRel", Lower, Ranking, Sigma(|s| Some(s.relative.ause()))),
    shown("aurg_relative", "AURG, σ/D and AbsRel", Higher, Ranking, Sigma(|s| Some(s.relative.aurg()))),
    shown("coverage_50", "cover 50 %", Near(0.5), Calibration, Errors(|e, s| coverage(e, s, 0.5))),
    more("coverage_68", Near(0.68), Calibration, Errors(|e, s| coverage(e, s, 0.68))),
    shown("coverage_90", "cover 90 %", Near(0.9), Calibration, Errors(|e, s| coverage(e, s, 0.9))),
    more("coverage_95", Near(0.95), Calibration, Errors(|e, s| coverage(e, s, 0.95))),
    shown("nll", "NLL", Lower, Calibration, Errors(nll)),
    shown("crps", "CRPS, m", Lower, Calibration, Errors(crps)),
    shown("mean_z2", "mean z² (above 1: sigma too small)", Near(1.0), Calibration, Errors(mean_z2)),
    more("alignment_scale", Neither, Calibration, Evaluation),
    shown("factor", "factor from other places", Near(1.0), Calibration, Evaluation),
    shown("calibrated_coverage_90", "then cover 90 %", Near(0.9), Calibration, Evaluation),
    shown("calibrated_nll", "then NLL", Lower, Calibration, Evaluation),
    shown("seconds", "seconds", Neither, Cost, Evaluation),
];
