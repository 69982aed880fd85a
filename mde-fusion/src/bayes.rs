use crate::aggregate::check_shapes;
use crate::gaussian::to_f32;
use crate::spread::Spread;
use crate::working::{WorkingPrior, depth_belief, depth_map, prior_depth_variance, working_views};
use crate::{
    Affine, AffineFit, Calibration, Degenerate, Fused, Fuser, Fusion, FusionConfig, FusionReport, Gaussian,
    Guards, MissingPrior, OnDegenerate, Prior, Result, Sample, Space, affine, affine_effective, affine_ols,
    affine_wls, aggregate, nerf_weight, posterior, residuals, variance_floor, with_variance,
};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::{median, quantile};
use ndarray::Array2;

/// The paper's fusion (Eq. 7-17), with every choice in a [`FusionConfig`].
///
/// 1. The views' variances are clamped, and the views aggregated.
/// 2. The aggregate is mapped affinely onto the prior, over the pixels \\(\mathcal X\\) that both know.
/// 3. The residuals give the prior's variance \\(\sigma_o^2\\), unless the prior has its own.
/// 4. Each pixel gets its posterior. Without NeRF support (\\(\tau_r = 0\\)) it keeps \\(D_o\\) and \\(\sigma_o^2\\);
///    a posterior that is not a positive depth reverts to the same, and is counted.
///
/// An error that prior and views have in common ([`FusionConfig::common_error`]) comes on top.
///
/// Where the calibration is degenerate the result is \\(D_o\\) ([`OnDegenerate`]), with the prior's own variance or
/// \\((\kappa \operatorname{median} D_o)^2\\), and the report says why.
///
/// ```
/// use mde_fusion::{BayesFuser, Fuser, FusionConfig, GaussianDepth, Prior, ndarray::Array2};
///
/// // The prior: a smooth slope. The views: a step, seen exactly, at twice the scale.
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

    fn aggregate(
        &self,
        evidence: &[GaussianDepth],
        (height, width): (usize, usize),
    ) -> Result<GaussianDepth> {
        let config = &self.config;
        if evidence.is_empty() {
            return Ok(GaussianDepth::missing(height, width));
        }
        let views = working_views(evidence, config.space);
        let floor = variance_floor(&views, config.variance_floor);
        aggregate(&with_variance(&views, config.variance, floor), config.aggregation, config.spread)
    }

    fn calibrate(&self, samples: &[Sample], pixels: usize) -> Calibrated {
        let Self { config } = self;
        let refused = |reason| Calibrated {
            fit: affine::diagnose(samples, Affine::IDENTITY),
            affine: (config.on_degenerate == OnDegenerate::Identity).then_some(Affine::IDENTITY),
            degenerate: Some(reason),
        };
        if let Some(reason) = config.guards.check_support(samples.len(), pixels) {
            return refused(reason);
        }
        let (fit, guards) = match config.calibration {
            Calibration::None => {
                let fit = affine::diagnose(samples, Affine::IDENTITY);
                return Calibrated { fit, affine: Some(Affine::IDENTITY), degenerate: None };
            }
            Calibration::Wls => (affine_wls(samples), config.guards),
            Calibration::Ols => (affine_ols(samples), config.guards),
            // The ridge determines the map even where the depth is constant.
            Calibration::Effective => {
                (affine_effective(samples, &config.effective), Guards { singular: -1.0, ..config.guards })
            }
        };
        match guards.check_fit(fit.as_ref()) {
            Some(reason) => refused(reason),
            None => Calibrated { fit, affine: fit.map(|fit| fit.affine), degenerate: None },
        }
    }

    /// What a pixel becomes, in the working space, and the NeRF's weight in it.
    fn combine(&self, prior: Option<Gaussian>, likelihood: Option<Gaussian>) -> Option<(Gaussian, f64)> {
        let nerf_only = self.config.fusion == Fusion::NerfOnly;
        match (prior, likelihood) {
            (Some(prior), None) => Some((prior, 0.0)),
            (Some(_), Some(likelihood)) if nerf_only => Some((likelihood, 1.0)),
            (Some(prior), Some(likelihood)) => {
                Some((posterior(prior, likelihood), nerf_weight(prior.variance, likelihood.variance)))
            }
            (None, Some(likelihood)) => {
                (nerf_only || self.config.missing_prior == MissingPrior::Nerf).then_some((likelihood, 1.0))
            }
            (None, None) => None,
        }
    }

    /// The posterior of every pixel as depth. Fills the report's `nerf_weight` and `reverted`.
    fn refine(
        &self,
        prior: &Prior,
        working: &WorkingPrior,
        spread: &Spread,
        likelihood: impl Iterator<Item = Option<Gaussian>>,
        report: &mut FusionReport,
    ) -> Result<GaussianDepth> {
        let space = self.config.space;
        let floor = (self.config.posterior_floor * prior_median(prior)).powi(2);
        let mut mean = Array2::zeros(prior.dim());
        let mut variance = Array2::from_elem(prior.dim(), f32::INFINITY);
        let input = prior.mean().into_iter().zip(&working.mean).zip(spread.values()).zip(likelihood);
        let mut weights = 0.0;
        for ((((&depth, &m), s), likelihood), output) in input.zip(mean.iter_mut().zip(&mut variance)) {
            let depth = f64::from(depth);
            let belief = (m > 0.0).then(|| working.belief(depth, m, s));
            let Some((fused, weight)) = self.combine(belief, likelihood) else { continue };
            let mut fused = depth_belief(fused, space);
            if belief.is_some() {
                if likelihood.is_some() && fused.is_some() {
                    weights += weight;
                } else {
                    report.reverted += usize::from(likelihood.is_some());
                    fused = Some(Gaussian::new(depth, prior_depth_variance(depth, s, space)));
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
    fn fuse(&self, prior: &Prior, evidence: &[GaussianDepth]) -> Result<Fused> {
        let Self { config } = self;
        check_shapes(evidence, prior.dim())?;
        let aggregated = self.aggregate(evidence, prior.dim())?;
        let working = WorkingPrior::new(prior, config.space);
        let (samples, inside) = overlap(&aggregated, &working);
        let Calibrated { fit, affine, degenerate } = self.calibrate(&samples, inside.len());

        let deltas = affine.map(|affine| residuals(&samples, affine));
        let spread = Spread::find(&working, deltas.as_deref(), &inside, config);
        let sigma_o = spread.rms(&inside);
        let used = affine.unwrap_or_default();
        let align = Aligner::new(used, prior, config);
        let aligned = aggregated.clone().map(|m, v| {
            let g = align.apply(m, v);
            (to_f32(g.mean), to_f32(g.variance))
        });
        let mut report = FusionReport {
            a: used.a,
            b: used.b,
            sigma_o,
            support: samples.len(),
            effective_support: fit.map_or(0.0, |fit| fit.effective_support),
            correlation: fit.map_or(0.0, |fit| fit.correlation),
            sigma_o_clamped: working.variance.is_none() && !samples.is_empty() && sigma_o == 0.0,
            degenerate,
            ..FusionReport::default()
        };
        let known = aggregated.mean().into_iter().zip(aggregated.variance());
        let likelihood = known.map(|(&m, &v)| (affine.is_some() && v.is_finite()).then(|| align.apply(m, v)));
        let depth = self.refine(prior, &working, &spread, likelihood, &mut report)?;
        let aggregated = depth_map(&aggregated, config.space);
        report.variance_quantiles = variance_quantiles(&aggregated);
        report.collect_warnings();
        Ok(Fused { depth, aligned: depth_map(&aligned, config.space), aggregated, report })
    }
}

/// The outcome of the affine fit; no map means that the result is the prior.
struct Calibrated {
    fit: Option<AffineFit>,
    affine: Option<Affine>,
    degenerate: Option<Degenerate>,
}

/// Eq. 10 in the working space, with disparities kept in front of the farthest depth.
struct Aligner {
    affine: Affine,
    floor: f64,
}

impl Aligner {
    fn new(affine: Affine, prior: &Prior, config: &FusionConfig) -> Self {
        let farthest = prior.mean().iter().copied().fold(0.0, f32::max);
        let floor = match config.space {
            Space::Disparity if farthest > 0.0 => (config.far * f64::from(farthest)).recip(),
            Space::Disparity | Space::Depth => f64::NEG_INFINITY,
        };
        Self { affine, floor }
    }

    fn apply(&self, mean: f32, variance: f32) -> Gaussian {
        let g = self.affine.apply(Gaussian::new(f64::from(mean), f64::from(variance)));
        Gaussian::new(g.mean.max(self.floor), g.variance)
    }
}

/// The pixels \\(\mathcal X\\) that both know, and which they are, in the order of the map's rows.
fn overlap(aggregated: &GaussianDepth, prior: &WorkingPrior) -> (Vec<Sample>, Vec<bool>) {
    let mut samples = Vec::new();
    let views = aggregated.mean().into_iter().zip(aggregated.variance());
    let pixels = views.zip(&prior.mean).map(|((&nerf, &variance), &prior)| {
        let inside = variance.is_finite() && prior > 0.0;
        if inside {
            samples.push(Sample { nerf: f64::from(nerf), variance: f64::from(variance), prior });
        }
        inside
    });
    let inside = pixels.collect();
    (samples, inside)
}

fn prior_median(prior: &Prior) -> f64 {
    median(prior.mean().iter().copied().filter(|&d| d > 0.0)).unwrap_or(0.0)
}

fn variance_quantiles(map: &GaussianDepth) -> [f64; 5] {
    let mut values: Vec<f32> = map.variance().iter().copied().filter(|v| v.is_finite()).collect();
    [0.05, 0.25, 0.5, 0.75, 0.95].map(|q| quantile(&mut values, q).unwrap_or(0.0))
}
