use crate::affine::Line;
use crate::gaussian::to_f32;
use crate::huber::{CUT, huber_variance};
use crate::{Affine, AffineFit, Residual, Sample, residuals};
use mde_uncertainty::statistics::median;

/// Rounds of fitting the map and the prior's variance in turn.
pub(crate) const ROUNDS: usize = 10;
/// Standard deviation of the scale about 1 before the views are seen.
pub(crate) const SCALE_SIGMA: f64 = 0.05;
/// Standard deviation of the shift about 0, as a fraction of the median prior depth.
pub(crate) const SHIFT_SIGMA: f64 = 0.05;
/// Relative change of the map at which the iteration stops.
const CONVERGED: f64 = 1e-9;

/// The fit of [`Calibration::Effective`](crate::Calibration::Effective): York's effective variance, iterated, with Huber's
/// M-estimate and his proposal 2 for the scale. The field was fitted in the prior's frame, hence the ridge terms, which also keep
/// the fit determined where \\(u\\) is constant. The weights are in the physical unit, so that the ridge matters only where the
/// pixels determine little. `None` without samples.
pub(crate) fn affine_effective(samples: &[Sample], rounds: usize) -> Option<AffineFit> {
    let scale = median(samples.iter().map(|s| to_f32(s.v.abs())))?;
    let (ridge_a, ridge_b) = ridge(scale);
    // A variance below the map's own resolution; it only keeps the weights finite.
    let tiny = (scale * f64::from(f32::EPSILON)).powi(2).max(f64::from(f32::MIN_POSITIVE));
    let mut fit = None;
    let mut affine = Affine::IDENTITY;
    for _ in 0..rounds {
        let deltas = residuals(samples, affine);
        let s = huber_variance(&deltas);
        let weight = |r: &Residual| {
            let total = (s + r.variance).max(tiny);
            (CUT * total.sqrt() / r.delta.abs()).min(1.0) / total
        };
        let points = samples.iter().zip(&deltas).map(|(x, r)| (weight(r), x.u, x.v));
        let line = Line::new(points)?;
        let next = solve(&line, ridge_a, ridge_b)?;
        let change = (next.a - affine.a).abs() + (next.b - affine.b).abs() / scale.max(tiny);
        affine = next;
        fit = Some(line.describe(affine));
        if change < CONVERGED {
            break;
        }
    }
    fit
}

/// Precisions of the ridge terms for \\(a\\) and \\(b\\).
fn ridge(scale: f64) -> (f64, f64) {
    let b = (SHIFT_SIGMA * scale).powi(-2);
    (SCALE_SIGMA.powi(-2), if b.is_finite() { b } else { 0.0 })
}

/// The ridge's normal equations in \\((a, c)\\), \\(c = a \bar u + b\\): about the mean, where they do not cancel.
fn solve(line: &Line, ridge_a: f64, ridge_b: f64) -> Option<Affine> {
    let u = line.mean_u;
    let (aa, ac, cc) = (line.suu + ridge_a + ridge_b * u * u, -ridge_b * u, line.sum_p + ridge_b);
    let (ra, rc) = (line.suv + ridge_a, line.sum_p * line.mean_v);
    let det = aa * cc - ac * ac;
    let (a, c) = ((cc * ra - ac * rc) / det, (aa * rc - ac * ra) / det);
    let b = c - a * u;
    (a.is_finite() && b.is_finite()).then_some(Affine { a, b })
}
