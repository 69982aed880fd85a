use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;

/// Variance of the views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum VarianceRule {
    /// Their own.
    #[default]
    Computed,
    /// One constant: the median of the variances of all views at all pixels that are not missing.
    ConstantMedian,
    /// One constant: their mean.
    ConstantMean,
}

/// Lower bound of the views' variance: \\((\epsilon \cdot \operatorname{median} |\mu|)^2\\).
///
/// A surface inside one bin of a ray has a computed variance of 0, and would take all the weight of Eq. 7 and Eq. 11.
/// The floor is relative to the median depth of the views, so that it follows the unit. `relative` is
/// \\(\epsilon\\). Never less than the smallest normal `f32`, so that a precision stays finite.
pub(crate) fn variance_floor(views: &[GaussianDepth], relative: f64) -> f64 {
    let depths = views.iter().flat_map(known).map(|(mean, _)| mean.abs());
    let floor = (relative * median(depths).unwrap_or(0.0)).powi(2);
    floor.clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX))
}

/// The views with variances by `rule`, none of them below `floor`.
pub(crate) fn with_variance(views: &[GaussianDepth], rule: VarianceRule, floor: f64) -> Vec<GaussianDepth> {
    let variances = || views.iter().flat_map(known).map(|(_, variance)| variance);
    let constant = match rule {
        VarianceRule::Computed => None,
        VarianceRule::ConstantMedian => median(variances()),
        VarianceRule::ConstantMean => {
            let (sum, count) = variances().fold((0.0, 0.0), |(s, n), v| (s + f64::from(v), n + 1.0));
            (count > 0.0).then(|| sum / count)
        }
    };
    let floor = floor as f32;
    let constant = constant.map(|c| c as f32);
    let adjust = |view: &GaussianDepth| view.clone().map(|m, v| (m, constant.unwrap_or(v).max(floor)));
    views.iter().map(adjust).collect()
}

fn known(view: &GaussianDepth) -> impl Iterator<Item = (f32, f32)> {
    view.mean().into_iter().zip(view.variance()).filter(|(_, v)| v.is_finite()).map(|(&m, &v)| (m, v))
}
