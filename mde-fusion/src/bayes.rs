use crate::affine::{Line, accepted};
use crate::aggregate::check_shapes;
use crate::gaussian::to_f32;
use crate::posterior::nerf_weight;
use crate::{
    Affine, AffineFit, Calibration, Degenerate, Fusion, FusionConfig, FusionReport, Gaussian, Prior,
    PriorVariance, Residual, Result, Sample, VarianceRule, affine_wls, aggregate, empirical_bayes, posterior,
    residuals,
};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::{median, quantile};
use ndarray::Array2;

/// Combines a prior depth map with the depth of rendered views.
///
/// `examples/own_fuser.rs` is another implementation.
pub trait Fuser {
    /// Fuses a prior `[height, width]` with views that were reprojected into its camera, all `[height, width]`
    /// z-depth in about the prior's unit. Without views the result is the prior.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::Error::Shape) for a view of another size than the prior. An implementation returns an error of its
    /// own as [`Error::External`](crate::Error::External).
    fn fuse(&self, prior: &Prior, views: &[GaussianDepth]) -> Result<Fused>;
}

/// The result of a fusion. Every map is `[height, width]`, depth in the prior's unit, variance in that unit squared.
#[derive(Debug, Clone, PartialEq)]
pub struct Fused {
    /// Refined depth and its variance (Eq. 16-17); positive wherever it is not missing.
    pub depth: GaussianDepth,
    /// The aggregated views (Eq. 7-8), in their own scale and shift.
    pub aggregated: GaussianDepth,
    /// The same in the scale and shift of the prior (Eq. 10): \\(a\mu + b\\), \\(a^2\sigma^2\\).
    pub aligned: GaussianDepth,
    /// The estimated scalars and warnings.
    pub report: FusionReport,
}

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
/// Where the calibration is [degenerate](Degenerate), the result is \\(D_o\\) with the prior's own variance or
/// \\((\kappa \operatorname{median} D_o)^2\\), and the report gives the reason.
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

    /// The affine fit, and its map; without a map the result is the prior.
    fn calibrate(&self, samples: &[Sample]) -> (Option<AffineFit>, Result<Affine, Degenerate>) {
        let identity = || Line::new(samples).map(|line| line.describe(Affine::IDENTITY));
        if self.config.calibration == Calibration::None && samples.len() > 1 {
            return (identity(), Ok(Affine::IDENTITY));
        }
        let fit = affine_wls(samples);
        let affine = accepted(samples, fit);
        (if affine.is_ok() { fit } else { identity() }, affine)
    }

    /// \\(\sigma_o^2\\) of a prior without a variance, from the residuals over \\(\mathcal X\\), which are `None` without a calibration.
    fn estimate(&self, prior: &Prior, residuals: Option<&[Residual]>) -> f64 {
        let relative = || {
            let depths = prior.mean().into_iter().copied().filter(|depth| *depth > 0.0);
            (self.config.kappa * median(depths).unwrap_or(0.0)).powi(2)
        };
        let Some(residuals) = residuals.filter(|r| !r.is_empty()) else { return relative() };
        match self.config.prior_variance {
            PriorVariance::Moments => empirical_bayes(residuals),
            PriorVariance::FixedMedian => median(residuals.iter().map(|r| to_f32(r.variance))).unwrap_or(0.0),
            PriorVariance::FixedRelative => relative(),
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
        prior_variance: &Array2<f64>,
        likelihood: impl Iterator<Item = Option<Gaussian>>,
        report: &mut FusionReport,
    ) -> Result<GaussianDepth> {
        let (height, width) = prior.dim();
        let (mut mean, mut variance) = GaussianDepth::missing(height, width).into_parts();
        let input = prior.mean().into_iter().zip(prior_variance).zip(likelihood);
        let mut weights = 0.0;
        for (((&depth, &s), likelihood), output) in input.zip(mean.iter_mut().zip(&mut variance)) {
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
                (*output.0, *output.1) = (to_f32(g.mean), to_f32(g.variance + common));
            }
        }
        report.nerf_weight = weights / report.support.max(1) as f64;
        Ok(GaussianDepth::new(mean, variance)?)
    }
}

impl Fuser for BayesFuser {
    fn fuse(&self, prior: &Prior, views: &[GaussianDepth]) -> Result<Fused> {
        check_shapes(views, prior.dim())?;
        let aggregated = match views {
            [] => GaussianDepth::missing(prior.dim().0, prior.dim().1),
            _ => aggregate(&with_variance(views, &self.config), self.config.aggregation)?,
        };
        let (samples, inside) = overlap(&aggregated, prior);
        let (fit, affine) = self.calibrate(&samples);

        let deltas = affine.ok().map(|affine| residuals(&samples, affine));
        let prior_variance = match prior.variance() {
            Some(own) => own.mapv(f64::from),
            None => Array2::from_elem(prior.dim(), self.estimate(prior, deltas.as_deref())),
        };
        let sigma_o = rms(&prior_variance, &inside);
        let used = affine.unwrap_or(Affine::IDENTITY);
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
            degenerate: affine.err(),
            variance_quantiles: variance_quantiles(&aggregated),
            ..FusionReport::default()
        };
        let known = aggregated.mean().into_iter().zip(aggregated.variance());
        let likelihood = known.map(|(&m, &v)| (affine.is_ok() && v.is_finite()).then(|| align(m, v)));
        let depth = self.refine(prior, &prior_variance, likelihood, &mut report)?;
        report.collect_warnings(bayes);
        Ok(Fused { depth, aligned, aggregated, report })
    }
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

/// Square root of the mean over \\(\mathcal X\\), or over all finite values where it is empty.
fn rms(variance: &Array2<f64>, inside: &[bool]) -> f64 {
    let all = !inside.contains(&true);
    let chosen = variance.iter().zip(inside).filter(|(v, inside)| v.is_finite() && (all || **inside));
    let (sum, count) = chosen.fold((0.0, 0.0), |(sum, count), (v, _)| (sum + v, count + 1.0));
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}

fn variance_quantiles(map: &GaussianDepth) -> [f64; 5] {
    let mut values: Vec<f32> = map.variance().iter().copied().filter(|v| v.is_finite()).collect();
    [0.05, 0.25, 0.5, 0.75, 0.95].map(|q| quantile(&mut values, q).unwrap_or(0.0))
}

/// The views with variances by the configuration's rule, at least \\((\epsilon \cdot \operatorname{median} |\mu|)^2\\).
///
/// A surface inside one bin of a ray has a computed variance of 0, and would take all the weight of Eq. 7 and Eq. 11.
/// The floor is relative to the median depth of the views, so that it follows the unit; \\(\epsilon\\) is the configuration's
/// `variance_floor`. Never less than the smallest normal `f32`, so that a precision stays finite.
fn with_variance(views: &[GaussianDepth], config: &FusionConfig) -> Vec<GaussianDepth> {
    let median_of = |value: fn((f32, f32)) -> f32| median(views.iter().flat_map(known).map(value));
    let floor = (config.variance_floor * median_of(|(mean, _)| mean.abs()).unwrap_or(0.0)).powi(2);
    let floor = (floor as f32).clamp(f32::MIN_POSITIVE, f32::MAX);
    let constant = match config.variance {
        VarianceRule::Computed => None,
        VarianceRule::ConstantMedian => median_of(|(_, variance)| variance).map(|c| c as f32),
    };
    let adjust = |view: &GaussianDepth| view.clone().map(|m, v| (m, constant.unwrap_or(v).max(floor)));
    views.iter().map(adjust).collect()
}

fn known(view: &GaussianDepth) -> impl Iterator<Item = (f32, f32)> {
    view.mean().into_iter().zip(view.variance()).filter(|(_, v)| v.is_finite()).map(|(&m, &v)| (m, v))
}
