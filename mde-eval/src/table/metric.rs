use super::Entry;
use crate::metrics::bsds::BoundaryCounts;
use crate::score::{AreaScores, EdgeScores, UncertaintyScores};

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
    pub(super) fn badness(self, value: f64) -> Option<f64> {
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
    of: fn(&Entry) -> Option<f64>,
}

impl Metric {
    /// The metric of that key.
    pub fn named(key: &str) -> Option<&'static Self> {
        METRICS.iter().find(|metric| metric.key == key)
    }

    /// Its value; nothing where it is not defined (a scene without edges, a method without sigma) or not finite.
    pub fn value(&self, entry: &Entry) -> Option<f64> {
        (self.of)(entry).filter(|value| value.is_finite())
    }
}

const fn shown(
    key: &'static str,
    label: &'static str,
    better: Better,
    group: Group,
    of: fn(&Entry) -> Option<f64>,
) -> Metric {
    Metric { key, label, better, group, shown: true, of }
}

const fn more(key: &'static str, better: Better, group: Group, of: fn(&Entry) -> Option<f64>) -> Metric {
    Metric { key, label: key, better, group, shown: false, of }
}

fn sigma(entry: &Entry) -> Option<&UncertaintyScores> {
    entry.uncertainty.as_ref()
}

fn area(entry: &Entry, of: fn(&UncertaintyScores) -> &AreaScores) -> Option<&AreaScores> {
    sigma(entry).map(of)
}

fn coverage(entry: &Entry, level: f64) -> Option<f64> {
    sigma(entry)?.coverage.iter().find(|c| c.nominal == level).map(|c| c.observed)
}

fn edge(entry: &Entry, threshold: f64, tolerance: u32) -> Option<&EdgeScores> {
    entry.depth.as_ref()?.edges_at(threshold, tolerance)
}

use Better::{Higher, Lower, Near, Neither};
use Group::{Calibration, Cost, Depth, Edges, Gradient, Ranking};

fn boundary(entry: &Entry, threshold: f64) -> Option<&BoundaryCounts> {
    let scores = &entry.depth.as_ref()?.boundaries;
    scores.iter().find(|b| b.threshold == threshold)?.counts.as_ref()
}

/// Every metric of the tables and files.
pub const METRICS: &[Metric] = &[
    shown("mse", "MSE, m²", Lower, Depth, |e| Some(e.depth.as_ref()?.mse)),
    shown("rmse", "RMSE, m", Lower, Depth, |e| Some(e.depth.as_ref()?.rmse)),
    shown("abs_rel", "AbsRel", Lower, Depth, |e| Some(e.depth.as_ref()?.abs_rel)),
    shown("log10", "log10", Lower, Depth, |e| Some(e.depth.as_ref()?.log10)),
    shown("silog", "SILog, %", Lower, Depth, |e| Some(e.depth.as_ref()?.silog)),
    shown("delta1", "within 1.25", Higher, Depth, |e| Some(e.depth.as_ref()?.delta[0])),
    shown("mse_shared", "MSE under the prior's scale, m²", Lower, Depth, |e| Some(e.shared?.mse)),
    more("abs_rel_shared", Lower, Depth, |e| Some(e.shared?.abs_rel)),
    more("sq_rel", Lower, Depth, |e| Some(e.depth.as_ref()?.sq_rel)),
    more("rmse_log", Lower, Depth, |e| Some(e.depth.as_ref()?.rmse_log)),
    more("irmse", Lower, Depth, |e| Some(e.depth.as_ref()?.irmse)),
    more("delta2", Higher, Depth, |e| Some(e.depth.as_ref()?.delta[1])),
    more("delta3", Higher, Depth, |e| Some(e.depth.as_ref()?.delta[2])),
    shown("f1_max@0.25m_r1", "F1max, 0.25 m", Higher, Edges, |e| edge(e, 0.25, 1)?.f1_max),
    shown("f1_max@0.5m_r1", "F1max, 0.5 m", Higher, Edges, |e| edge(e, 0.5, 1)?.f1_max),
    more("f1_max@1m_r1", Higher, Edges, |e| edge(e, 1.0, 1)?.f1_max),
    more("average_precision@0.25m_r1", Higher, Edges, |e| edge(e, 0.25, 1)?.average_precision),
    more("average_precision@0.5m_r1", Higher, Edges, |e| edge(e, 0.5, 1)?.average_precision),
    shown("ois@0.25m", "thinned F1 (OIS), 0.25 m", Higher, Edges, |e| Some(boundary(e, 0.25)?.best)),
    more("ois@0.5m", Higher, Edges, |e| Some(boundary(e, 0.5)?.best)),
    more("boundary_ap@0.25m", Higher, Edges, |e| Some(boundary(e, 0.25)?.average_precision)),
    more("boundary_ap@0.5m", Higher, Edges, |e| Some(boundary(e, 0.5)?.average_precision)),
    shown("boundary_f1", "boundary F1", Higher, Edges, |e| Some(e.depth.as_ref()?.boundary_f1)),
    more("occlusion_f1_r1", Higher, Edges, |e| Some(e.depth.as_ref()?.occlusion_f1[0])),
    more("occlusion_f1_r2", Higher, Edges, |e| Some(e.depth.as_ref()?.occlusion_f1[1])),
    more("occlusion_f1_r3", Higher, Edges, |e| Some(e.depth.as_ref()?.occlusion_f1[2])),
    more("dbe_accuracy", Lower, Edges, |e| e.depth.as_ref()?.dbe_accuracy),
    shown("dbe_completeness", "DBE completeness, px", Lower, Edges, |e| e.depth.as_ref()?.dbe_completeness),
    more("see", Lower, Edges, |e| e.depth.as_ref()?.see),
    shown("d3r", "D3R", Lower, Edges, |e| e.depth.as_ref()?.d3r),
    more("ord", Lower, Edges, |e| e.depth.as_ref()?.ord),
    shown("d3r_like", "D3R, random pairs", Lower, Edges, |e| e.depth.as_ref()?.d3r_like),
    shown("sharpness_on", "sharp on edges", Neither, Gradient, |e| e.depth.as_ref()?.sharpness_on),
    shown("sharpness_off", "sharp off edges", Neither, Gradient, |e| e.depth.as_ref()?.sharpness_off),
    shown("sharpness", "sharpness", Neither, Gradient, |e| e.depth.as_ref()?.sharpness),
    shown("f1@0.25m_r1", "F1, 0.25 m", Neither, Gradient, |e| Some(edge(e, 0.25, 1)?.f1)),
    shown("f1@0.5m_r1", "F1, 0.5 m", Neither, Gradient, |e| Some(edge(e, 0.5, 1)?.f1)),
    more("f1@1m_r1", Neither, Gradient, |e| Some(edge(e, 1.0, 1)?.f1)),
    more("f1@0.25m_r0", Neither, Gradient, |e| Some(edge(e, 0.25, 0)?.f1)),
    more("f1@0.25m_r2", Neither, Gradient, |e| Some(edge(e, 0.25, 2)?.f1)),
    more("f1@0.5m_r0", Neither, Gradient, |e| Some(edge(e, 0.5, 0)?.f1)),
    more("f1@0.5m_r2", Neither, Gradient, |e| Some(edge(e, 0.5, 2)?.f1)),
    more("f1@1m_r0", Neither, Gradient, |e| Some(edge(e, 1.0, 0)?.f1)),
    more("f1@1m_r2", Neither, Gradient, |e| Some(edge(e, 1.0, 2)?.f1)),
    shown("spearman", "Spearman", Higher, Ranking, |e| sigma(e)?.spearman),
    shown("spearman_binned", "Spearman, 100 bins", Higher, Ranking, |e| sigma(e)?.spearman_binned),
    shown("ause_mae", "AUSE, MAE", Lower, Ranking, |e| Some(area(e, |u| &u.mae)?.ause)),
    shown("ause_rmse", "AUSE, RMSE", Lower, Ranking, |e| Some(area(e, |u| &u.rmse)?.ause)),
    shown("spearman_relative", "Spearman, σ/D and AbsRel", Higher, Ranking, |e| sigma(e)?.spearman_relative),
    shown("ause_relative", "AUSE, σ/D and AbsRel", Lower, Ranking, |e| Some(area(e, |u| &u.relative)?.ause)),
    shown("aurg_relative", "AURG, σ/D and AbsRel", Higher, Ranking, |e| {
        Some(area(e, |u| &u.relative)?.aurg)
    }),
    more("poggi_ause_abs_rel", Lower, Ranking, |e| Some(area(e, |u| &u.poggi_abs_rel)?.ause)),
    shown("poggi_aurg_abs_rel", "AURG, AbsRel", Higher, Ranking, |e| {
        Some(area(e, |u| &u.poggi_abs_rel)?.aurg)
    }),
    more("poggi_ause_rmse", Lower, Ranking, |e| Some(area(e, |u| &u.poggi_rmse)?.ause)),
    more("poggi_aurg_rmse", Higher, Ranking, |e| Some(area(e, |u| &u.poggi_rmse)?.aurg)),
    more("poggi_ause_a1", Lower, Ranking, |e| Some(area(e, |u| &u.poggi_a1)?.ause)),
    more("poggi_aurg_a1", Higher, Ranking, |e| Some(area(e, |u| &u.poggi_a1)?.aurg)),
    shown("coverage_50", "cover 50 %", Near(0.5), Calibration, |e| coverage(e, 0.5)),
    more("coverage_68", Near(0.68), Calibration, |e| coverage(e, 0.68)),
    shown("coverage_90", "cover 90 %", Near(0.9), Calibration, |e| coverage(e, 0.9)),
    more("coverage_95", Near(0.95), Calibration, |e| coverage(e, 0.95)),
    shown("nll", "NLL", Lower, Calibration, |e| Some(sigma(e)?.nll)),
    shown("crps", "CRPS, m", Lower, Calibration, |e| Some(sigma(e)?.crps)),
    shown("mean_z2", "mean z² (above 1: sigma too small)", Near(1.0), Calibration, |e| {
        Some(sigma(e)?.mean_z2)
    }),
    shown("ence", "ENCE", Lower, Calibration, |e| Some(sigma(e)?.ence)),
    more("mace", Lower, Calibration, |e| Some(sigma(e)?.mace)),
    more("rmsce", Lower, Calibration, |e| Some(sigma(e)?.rmsce)),
    more("miscalibration_area", Lower, Calibration, |e| Some(sigma(e)?.miscalibration_area)),
    more("alignment_scale", Neither, Calibration, |e| e.scale),
    more("rms_sigma", Neither, Calibration, |e| Some(sigma(e)?.rms_sigma)),
    shown("factor", "factor from other places", Near(1.0), Calibration, |e| Some(e.calibrated?.factor)),
    shown("calibrated_coverage_90", "then cover 90 %", Near(0.9), Calibration, |e| {
        Some(e.calibrated?.coverage_90)
    }),
    more("calibrated_coverage_50", Near(0.5), Calibration, |e| Some(e.calibrated?.coverage_50)),
    shown("calibrated_nll", "then NLL", Lower, Calibration, |e| Some(e.calibrated?.nll)),
    shown("seconds", "seconds", Neither, Cost, |e| e.seconds),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_is_its_own_and_is_found() {
        for metric in METRICS {
            assert_eq!(METRICS.iter().filter(|other| other.key == metric.key).count(), 1, "{}", metric.key);
            assert_eq!(Metric::named(metric.key).unwrap().label, metric.label);
        }
        assert!(Metric::named("mes").is_none());
    }
}
