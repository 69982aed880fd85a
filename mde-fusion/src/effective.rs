use crate::affine::Line;
use crate::gaussian::to_f32;
use crate::{Affine, AffineFit, Error, Residual, Result, Sample, huber_variance, residuals};
use mde_uncertainty::statistics::median;

/// Relative change of the map at which the iteration stops.
const CONVERGED: f64 = 1e-9;

/// Settings of [`affine_effective`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct EffectiveConfig {
    /// Rounds of fitting the map and the prior's variance in turn.
    pub iterations: usize,
    /// Standard deviation of the scale about 1 before the views are seen.
    pub scale_sigma: f64,
    /// Standard deviation of the shift about 0, as a fraction of the median prior depth.
    pub shift_sigma: f64,
    /// Residual, in its standard deviations, from which a pixel pulls no harder (Huber).
    pub huber: f64,
}

impl Default for EffectiveConfig {
    fn default() -> Self {
        Self { iterations: 10, scale_sigma: 0.05, shift_sigma: 0.05, huber: 1.345 }
    }
}

impl EffectiveConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] with the field at fault.
    pub fn validate(&self) -> Result<()> {
        let positive = |field, value: f64| match value.is_finite() && value > 0.0 {
            true => Ok(()),
            false => Err(Error::Config { field, value, remedy: "take a positive number" }),
        };
        positive("effective.iterations", self.iterations as f64)?;
        positive("effective.scale-sigma", self.scale_sigma)?;
        positive("effective.shift-sigma", self.shift_sigma)?;
        positive("effective.huber", self.huber)
    }
}

/// Affine fit with effective variances, a prior on the map, and Huber's weights.
///
/// Eq. 11 weighs by the NeRF's variance alone, although Eq. 14 says that a residual has variance \\(t(x) = \sigma_o^2
/// + a^2 (\sigma_r^2)^{\mathrm{agg}}(x)\\): a few pixels of tiny variance then decide the map. Here
///
/// \\[ \min_{a,b} \sum_{x\in\mathcal X} \frac{h(x)}{t(x)} \bigl(a u(x) + b - v(x)\bigr)^2 +
/// \frac{(a-1)^2}{\sigma_a^2} + \frac{b^2}{\sigma_b^2},\qquad
/// h = \min\left(1, \frac{k \sqrt t}{|\delta|}\right), \\]
///
/// with \\(t\\) and \\(h\\) from the previous map, in turn with [`huber_variance`] for \\(\sigma_o^2\\), from the
/// identity on (York's effective variance, iterated; Huber's M-estimate with his proposal 2 for the scale). The field
/// was fitted in the prior's frame, hence the ridge terms, which also keep the fit determined where \\(u\\) is
/// constant.
///
/// This mends leverage, not attenuation: noise in \\(u\\) pulls the scale towards 0 here as in Eq. 11, and only the
/// ridge holds against it. The weights are in the physical unit, so the ridge matters only while the pixels say
/// little. `None` without samples.
pub fn affine_effective(samples: &[Sample], config: &EffectiveConfig) -> Option<AffineFit> {
    let scale = median(samples.iter().map(|s| to_f32(s.prior.abs())))?;
    let (ridge_a, ridge_b) = ridge(config, scale);
    // A variance below the map's own resolution; it only keeps the weights finite.
    let tiny = (scale * f64::from(f32::EPSILON)).powi(2).max(f64::from(f32::MIN_POSITIVE));
    let mut fit = None;
    let mut affine = Affine::IDENTITY;
    for _ in 0..config.iterations.max(1) {
        let deltas = residuals(samples, affine);
        let s = huber_variance(&deltas, config.huber);
        let weight = |r: &Residual| {
            let total = (s + r.variance).max(tiny);
            (config.huber * total.sqrt() / r.delta.abs()).min(1.0) / total
        };
        let points = samples.iter().zip(&deltas).map(|(x, r)| (weight(r), x.nerf, x.prior));
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

fn ridge(config: &EffectiveConfig, scale: f64) -> (f64, f64) {
    let b = (config.shift_sigma * scale).powi(-2);
    (config.scale_sigma.powi(-2), if b.is_finite() { b } else { 0.0 })
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
