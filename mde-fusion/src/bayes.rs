use crate::affine::{affine_ols, diagnose};
use crate::aggregate::check_shapes;
use crate::effective::{ROUNDS, affine_effective};
use crate::gaussian::to_f32;
use crate::guards::Bounds;
use crate::posterior::nerf_weight;
use crate::spread::Spread;
use crate::variance::{variance_floor, with_variance};
use crate::{
    Affine, AffineFit, Calibration, Degenerate, Fused, Fuser, Fusion, FusionConfig, FusionReport, Gaussian,
    Prior, Result, Sample, affine_wls, aggregate, posterior, residuals,
};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::{median, quantile};
use ndarray::Array2;

/// The paper's fusion (Eq. 7-17), with every choice in a [`FusionConfig`].
///
/// 1. The variances of the views are clamped, and the views aggregated.
/// 2. The aggregate is mapped affinely onto the prior, over the pixels \\(\mathcal X\\) where neither is missing.
/// 3. The residuals give the prior's variance \\(\sigma_o^2\\), unless the prior has its own.
/// 4. Each pixel becomes its posterior. Pixels without a view (\\(\tau_r = 0\\)), and those whose posterior is not a positive
///    depth, keep \\(D_o\\) and \\(\sigma_o^2\\). The report counts the latter. Pixels that the prior misses stay missing, but with
///    [`Fusion::NerfOnly`], which takes the views there.
///
/// The square of the [common error](FusionConfig::common_error) is added to the variance.
///
/// Where the calibration is [degenerate](crate::Guards), the result is \\(D_o\\) with the prior's own variance or
/// \\((\kappa \operatorname{median} D_o)^2\\), and the report gives the reason.
///
/// ```
/// use mde_fusion::{BayesFuser, Fuser, FusionConfig, GaussianDepth, Prior, ndarray::Array2};
///
/// // The prior is a smooth slope, the view a sharp step at twice the scale.
/// let prior = Prior::new(Array2::from_shape_fn((8, 8), |(_, x)| 2.0 + 0.25 * x as f32))?;
/// let step = Array2::from_shape_fn((8, 8), |(_, x)| if x < 4 { 4.75 } else { 6.75 });
/// let view = GaussianDepth::new(step, Array2::from_elem((8, 8), 1e-4))?;
///
/// let fused = BayesFuser::new(FusionConfig::paper())?.fuse(&prior, &[view])?;
/// assert!((fused.report.a - 0.5).abs() < 1e-6 && fused.report.degenerate.is_none());
/// let (left, right) = (fused.depth.mean()[(0, 3)], fused.depth.mean()[(0, 4)]);
/// assert!(right - left > 0.9, "the step is back: {left} {right}");
/// # Ok::<(), mde_fusion::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BayesFuser {
    config: FusionConfig,
}

impl BayesFuser {
    /// A fuser with these choices.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) for a value out of range.
    pub fn new(config: FusionConfig) -> Result<Self> {
        config.validate()?;
        Ok(Self { config })
    }

    /// The choices.
    pub fn config(&self) -> &FusionConfig {
        &self.config
    }

    fn aggregate(&self, views: &[GaussianDepth], (height, width): (usize, usize)) -> Result<GaussianDepth> {
        let config = &self.config;
        if views.is_empty() {
            return Ok(GaussianDepth::missing(height, width));
        }
        let floor = variance_floor(views, config.variance_floor);
        aggregate(&with_variance(views, config.variance, floor), config.aggregation, config.spread)
    }

    fn calibrate(&self, samples: &[Sample], pixels: usize) -> Calibrated {
        let refused = |reason| Calibrated {
            fit: diagnose(samples, Affine::IDENTITY),
            affine: None,
            degenerate: Some(reason),
        };
        let bounds = self.config.guards.bounds();
        if let Some(reason) = bounds.check_support(samples.len(), pixels) {
            return refused(reason);
        }
        let (fit, bounds) = match self.config.calibration {
            Calibration::None => {
                let fit = diagnose(samples, Affine::IDENTITY);
                return Calibrated { fit, affine: Some(Affine::IDENTITY), degenerate: None };
            }
            Calibration::Wls => (affine_wls(samples), bounds),
            Calibration::Ols => (affine_ols(samples), bounds),
            // The ridge determines the map even where the depth is constant.
            Calibration::Effective => {
                (affine_effective(samples, ROUNDS), Bounds { singular: -1.0, ..bounds })
            }
        };
        match bounds.check_fit(fit.as_ref()) {
            Some(reason) => refused(reason),
            None => Calibrated { fit, affine: fit.map(|fit| fit.affine), degenerate: None },
        }
    }

    /// The fused value of a pixel and the views' weight in it.
    fn combine(&self, prior: Option<Gaussian>, likelihood: Option<Gaussian>) -> Option<(Gaussian, f64)> {
        let nerf_only = self.config.fusion == Fusion::NerfOnly;
        match (prior, likelihood) {
            (Some(prior), None) => Some((prior, 0.0)),
            (Some(prior), Some(likelihood)) if !nerf_only => {
                Some((posterior(prior, likelihood), nerf_weight(prior.variance, likelihood.variance)))
            }
            (_, Some(likelihood)) => nerf_only.then_some((likelihood, 1.0)),
            (None, None) => None,
        }
    }

    /// The posterior of every pixel. Fills the report's `nerf_weight` and `reverted`.
    fn refine(
        &self,
        prior: &Prior,
        spread: &Spread,
        likelihood: impl Iterator<Item = Option<Gaussian>>,
        report: &mut FusionReport,
    ) -> Result<GaussianDepth> {
        let floor = (self.config.posterior_floor * prior_median(prior)).powi(2);
        let mut mean = Array2::zeros(prior.dim());
        let mut variance = Array2::from_elem(prior.dim(), f32::INFINITY);
        let input = prior.mean().into_iter().zip(spread.values()).zip(likelihood);
        let mut weights = 0.0;
        for (((&depth, s), likelihood), output) in input.zip(mean.iter_mut().zip(&mut variance)) {
            let own = (depth > 0.0).then(|| Gaussian::new(f64::from(depth), s));
            let Some((fused, weight)) = self.combine(own, likelihood) else { continue };
            let mut fused = (to_f32(fused.mean) > 0.0 && fused.variance.is_finite()).then_some(fused);
            if own.is_some() {
                if likelihood.is_some() && fused.is_some() {
                    weights += weight;
                } else {
                    report.reverted += usize::from(likelihood.is_some());
                    fused = own;
                }
            }
            if let Some(g) = fused {
                let common = (self.config.common_error * g.mean).powi(2);
                (*output.0, *output.1) = (to_f32(g.mean), to_f32(g.variance.max(floor) + common));
            }
        }
        report.nerf_weight = weights / report.support.max(1) as f64;
        Ok(GaussianDepth::new(mean, variance)?)
    }
}

impl Fuser for BayesFuser {
    fn fuse(&self, prior: &Prior, views: &[GaussianDepth]) -> Result<Fused> {
        check_shapes(views, prior.dim())?;
        let aggregated = self.aggregate(views, prior.dim())?;
        let (samples, inside) = overlap(&aggregated, prior);
        let Calibrated { fit, affine, degenerate } = self.calibrate(&samples, inside.len());

        let deltas = affine.map(|affine| residuals(&samples, affine));
        let spread = Spread::find(prior, deltas.as_deref(), &inside, &self.config);
        let sigma_o = spread.rms(&inside);
        let used = affine.unwrap_or_default();
        let align = |m: f32, v: f32| used.apply(Gaussian::new(f64::from(m), f64::from(v)));
        let aligned = aggregated.clone().map(|m, v| {
            let g = align(m, v);
            (to_f32(g.mean), to_f32(g.variance))
        });
        let bayes = self.config.fusion == Fusion::Bayes;
        let mut report = FusionReport {
            a: used.a,
            b: used.b,
            sigma_o,
            support: samples.len(),
            effective_support: fit.map_or(0.0, |fit| fit.effective_support),
            correlation: fit.map_or(0.0, |fit| fit.correlation),
            sigma_o_clamped: bayes && prior.variance().is_none() && !samples.is_empty() && sigma_o == 0.0,
            degenerate,
            variance_quantiles: variance_quantiles(&aggregated),
            ..FusionReport::default()
        };
        let known = aggregated.mean().into_iter().zip(aggregated.variance());
        let likelihood = known.map(|(&m, &v)| (affine.is_some() && v.is_finite()).then(|| align(m, v)));
        let depth = self.refine(prior, &spread, likelihood, &mut report)?;
        report.collect_warnings(bayes);
        Ok(Fused { depth, aligned, aggregated, report })
    }
}

/// The outcome of the affine fit; without a map the result is the prior.
struct Calibrated {
    fit: Option<AffineFit>,
    affine: Option<Affine>,
    degenerate: Option<Degenerate>,
}

/// The pixels \\(\mathcal X\\) where neither the views nor the prior are missing, and a mask of them, both row by row.
fn overlap(aggregated: &GaussianDepth, prior: &Prior) -> (Vec<Sample>, Vec<bool>) {
    let mut samples = Vec::new();
    let views = aggregated.mean().into_iter().zip(aggregated.variance());
    let prior = prior.mean();
    let pixels = views.zip(&prior).map(|((&u, &variance), &v)| {
        let inside = variance.is_finite() && v > 0.0;
        if inside {
            samples.push(Sample { u: f64::from(u), variance: f64::from(variance), v: f64::from(v) });
        }
        inside
    });
    let inside = pixels.collect();
    (samples, inside)
}

pub(crate) fn prior_median(prior: &Prior) -> f64 {
    median(prior.mean().iter().copied().filter(|&d| d > 0.0)).unwrap_or(0.0)
}

fn variance_quantiles(map: &GaussianDepth) -> [f64; 5] {
    let mut values: Vec<f32> = map.variance().iter().copied().filter(|v| v.is_finite()).collect();
    [0.05, 0.25, 0.5, 0.75, 0.95].map(|q| quantile(&mut values, q).unwrap_or(0.0))
}
