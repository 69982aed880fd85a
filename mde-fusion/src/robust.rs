use crate::{Affine, Sample, affine_wls};
use mde_uncertainty::statistics::median;

/// Huber's cut in standard deviations: 95 % efficient for normal errors.
const CUT: f64 = 1.345;
/// Rounds of reweighting.
const ROUNDS: usize = 20;
/// Weight of a point that does not fit at all.
const LEAST_WEIGHT: f64 = 1e-6;
/// Standard deviation of a normal distribution over its median absolute deviation.
const NORMAL: f64 = 1.4826;

/// A point of a [`RobustLine`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinePoint {
    /// \\(u\\).
    pub u: f64,
    /// Its variance.
    pub u_variance: f64,
    /// \\(v\\).
    pub v: f64,
    /// Its variance.
    pub v_variance: f64,
}

/// A rising line \\(v = a u + b\\) through points of which some may be wrong.
///
/// Weights are \\(1/(a^2 \sigma_u^2 + \sigma_v^2)\\) times Huber's weights, which are below 1 for what does not fit. The variance is
///
/// \\[ \mathrm{Var}(a u + b) = s^2\\Bigl(\frac{1}{\sum p} + \frac{(u - \bar u)^2}{\sum p (u - \bar u)^2}\\Bigr), \\]
///
/// with \\(p\\) the weights without Huber's and \\(s^2\\) the variance of the clipped residuals over the squared share of those that are
/// not clipped (Huber, 1981). It takes the errors of the points as independent. A line through the origin has the second term alone, with
/// \\(\bar u = 0\\).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobustLine {
    /// The line.
    pub affine: Affine,
    /// Points that weigh less than half.
    pub outliers: usize,
    offset: f64,
    mean: f64,
    spread: f64,
}

impl RobustLine {
    /// The line through the points; `None` where it is not determined or falls. Unless it `needs_shift`, one within twice its own standard
    /// deviation is left out.
    pub fn fit(points: &[LinePoint], needs_shift: bool) -> Option<Self> {
        if needs_shift {
            return robust(points, true);
        }
        let with_shift = (points.len() > 2).then(|| robust(points, true)).flatten();
        // A shift within its own error: the scale alone is the better fit.
        let matters = |line: &RobustLine| line.affine.b.abs() >= 2.0 * line.variance(0.0).sqrt();
        with_shift.filter(matters).or_else(|| robust(points, false))
    }

    /// Variance of \\(a u + b\\).
    pub fn variance(&self, u: f64) -> f64 {
        self.offset + (u - self.mean).powi(2) / self.spread
    }
}

/// Least squares, reweighted by Huber's weights.
fn robust(points: &[LinePoint], has_shift: bool) -> Option<RobustLine> {
    let count = points.len() as f64;
    // As many points as unknowns leave no residual: their own variances stand.
    let spare = count - if has_shift { 2.0 } else { 1.0 };
    let mut slope = median(points.iter().map(|p| p.v / p.u)).filter(|r| r.is_finite() && *r > 0.0)?;
    let mut weights = vec![1.0; points.len()];
    let mut line = None;
    for _ in 0..ROUNDS {
        // Exact values on both sides weigh the same.
        let own = |p: &LinePoint| (slope * slope * p.u_variance + p.v_variance).max((1e-6 * p.v).powi(2));
        let weighted = points.iter().zip(&weights);
        let weighted: Vec<Sample> =
            weighted.map(|(p, weight)| Sample { u: p.u, variance: own(p) / weight, v: p.v }).collect();
        let affine = if has_shift {
            affine_wls(&weighted)?.affine
        } else {
            let sum = |term: fn(&Sample) -> f64| weighted.iter().map(term).sum::<f64>();
            Affine { a: sum(|s| s.u * s.v / s.variance) / sum(|s| s.u * s.u / s.variance), b: 0.0 }
        };
        if !(affine.a > 0.0 && affine.a.is_finite()) {
            return None;
        }
        let z = |p: &LinePoint| (affine.a * p.u + affine.b - p.v).abs() / own(p).sqrt();
        let scale =
            if spare > 0.0 { NORMAL * median(points.iter().map(z))? * (count / spare).sqrt() } else { 1.0 };
        // Where residual and scale are 0 the point fits.
        let cut = (CUT * scale).max(f64::MIN_POSITIVE);
        weights =
            points.iter().map(|p| (cut / z(p).max(f64::MIN_POSITIVE)).clamp(LEAST_WEIGHT, 1.0)).collect();
        // Huber's covariance: the clipped residuals' variance over the squared share that is not clipped.
        let clipped: f64 = points.iter().map(|p| z(p).min(cut).powi(2)).sum();
        let within = points.iter().filter(|p| z(p) <= cut).count() as f64 / count;
        let factor = if spare > 0.0 { (clipped / spare / (within * within)).max(1e-24) } else { 1.0 };
        let sum =
            |term: &dyn Fn(f64) -> f64| points.iter().map(|p| term(p.u) / (own(p) * factor)).sum::<f64>();
        // A line through the origin has no other place to turn about.
        let (offset, mean) =
            if has_shift { (1.0 / sum(&|_| 1.0), sum(&|u| u) / sum(&|_| 1.0)) } else { (0.0, 0.0) };
        let spread = sum(&|u| (u - mean).powi(2));
        let outliers = weights.iter().filter(|w| **w < 0.5).count();
        line = Some(RobustLine { affine, offset, mean, spread, outliers });
        slope = affine.a;
    }
    line
}
