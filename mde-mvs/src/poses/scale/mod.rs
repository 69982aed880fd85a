//! One scale for the priors of many photographs, from the ratios of pairs.
//!
//! A network's depth of two photographs of one place differs by a factor. Their overlap gives the logarithm of that factor; the
//! factors \\( e^{f_i} \\) of all photographs follow from the ratios \\( r_{ij} \\) of the pairs that share something, with Huber's
//! loss \\( \rho \\):
//!
//! \\[ \min_f \sum_{ij} \rho\left( \frac{f_j - f_i - r_{ij}}{\sigma_{ij}} \right), \quad \sum_{i \in C} f_i = 0
//!   \text{ for each connected component } C . \\]

mod graph;
mod matches;

pub use matches::{MatchPair, ScaleMatches};

use super::matching::match_features;
use super::two_view::{Motion, relative_pose};
use super::{Prepared, REGIONS};
use crate::Result;
use crate::statistics::robust_deviation;
use graph::Laplacian;
use mde_uncertainty::OutOfRange;
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use nalgebra::{Point2, Point3};

/// Huber's cut in standard deviations: 95 % efficient for normal errors.
const CUT: f64 = 1.345;
/// Rounds of reweighting at most.
const ROUNDS: usize = 100;
/// Change of a factor's logarithm below which the rounds end.
const SETTLED: f64 = 1e-10;
/// Standard error of a median over that of a mean, for normal errors.
const OF_MEDIAN: f64 = 1.2533;
/// No ratio is known better than this.
const LEAST_SIGMA: f64 = 0.005;
/// Pixels of a photograph that are compared, about.
const SAMPLES: f64 = 5000.0;

/// The logarithm of the factor of the second photograph over that of the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogRatio {
    /// Index of a photograph.
    pub first: usize,
    /// Index of another.
    pub second: usize,
    /// \\( r \\): the prior of the second photograph times \\( e^r \\) has the scale of the first.
    pub log: f64,
    /// Standard deviation of `log`.
    pub sigma: f64,
}

/// Scale factor of one photograph's depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogFactor {
    /// Logarithm of the factor; its mean over a component is 0.
    pub log: f64,
    /// Standard deviation of `log`, relative to the mean over the component; 0 for a photograph alone.
    pub sigma: f64,
    /// Number of the component, from 0, by the first photograph in it. Components have no scale in common.
    pub component: usize,
    /// Photographs in the component.
    pub photographs: usize,
}

impl Prepared {
    /// The logarithm of the factor of `second` over that of `first`, and its standard deviation; nothing where fewer than
    /// 20 matches agree on a motion, or a photograph has no prior. A video of any length can be compared with a few of these in memory.
    ///
    /// Matches and the priors give the motion, as in [`estimate_poses`](super::estimate_poses); a tripod or a camera turned on the
    /// spot is no exception. Pixels of each photograph are lifted by its prior and moved into the other one, where the depth is
    /// compared with the other prior. The result is the median over both directions, so what is hidden in either does not matter.
    /// Its deviation is the robust spread over the root of the number of regions in the overlap, 30 in a whole photograph, in each of
    /// which the priors share an error. It depends on the photographs and the seed alone.
    pub fn log_ratio(a: &Self, b: &Self, seed: u64) -> Option<[f64; 2]> {
        let found = match_features(&a.features, &b.features);
        let Motion { pose, log_scales, log_focal, .. } = relative_pose([a, b], [0, 1], &found, seed).motion?;
        let (mut ratios, forth) = depth_log_ratios([a, b], &pose, log_scales[0], log_focal);
        let (others, back) = depth_log_ratios([b, a], &pose.inverse(), log_scales[1], log_focal);
        ratios.extend(others.into_iter().map(|ratio| -ratio));
        let regions = (REGIONS * 0.5 * (forth + back)).max(1.0);
        let log = median(ratios.iter().copied())?;
        let spread = robust_deviation(ratios.into_iter().map(|ratio| ratio - log)).unwrap_or(0.0);
        Some([log, (OF_MEDIAN * spread / regions.sqrt()).max(LEAST_SIGMA)])
    }
}

/// Log ratio of `from`'s depth, moved into `to`, to `to`'s prior, per sampled pixel; and the overlap, as a share of the samples.
/// `log_scale` is that of the pose's unit over the prior of `from`.
fn depth_log_ratios(
    [from, to]: [&Prepared; 2],
    pose: &Pose,
    log_scale: f64,
    log_focal: f64,
) -> (Vec<f64>, f64) {
    let (Some(prior), Some(other)) = (&from.prior, &to.prior) else { return (Vec::new(), 0.0) };
    let step = ((prior.len() as f64 / SAMPLES).sqrt() as usize).max(1);
    let (mut ratios, mut all) = (Vec::new(), 0_usize);
    for y in (step / 2..prior.nrows()).step_by(step) {
        for x in (step / 2..prior.ncols()).step_by(step) {
            all += 1;
            let pixel = Point2::new(x as f64, y as f64);
            let Some(log_depth) = from.log_prior(&pixel) else { continue };
            let point = pose * Point3::from(from.lens.ray(&pixel, log_focal) * (log_depth + log_scale).exp());
            if point.z <= 0.0 {
                continue;
            }
            let at = Point2::from(to.lens.project(&point.coords, log_focal));
            let within = |at: f64, side: usize| at >= -0.5 && at < side as f64 - 0.5;
            if within(at.x, other.ncols()) && within(at.y, other.nrows()) {
                ratios.extend(to.log_prior(&at).map(|there| point.z.ln() - log_scale - there));
            }
        }
    }
    let share = ratios.len() as f64 / all.max(1) as f64;
    (ratios, share)
}

/// One factor per photograph from the ratios of pairs; the equation is on this module's page.
///
/// Reweighted least squares, each solved exactly by a sparse factorisation. Deviations grow where the residuals exceed those of the
/// ratios. A photograph's own error is in all of its ratios alike, and no number of them makes it smaller: of \\( n \\) photographs, no
/// factor has a variance below \\( (1 - 1/n) \sigma^2 / 2 \\), with \\( \sigma \\) the least deviation of its ratios. The result does not
/// depend on the order of the ratios.
///
/// # Errors
/// [`Config`](crate::Error::Config) for a ratio of a photograph that is none of `0..photographs` or of one with itself, or
/// that is not finite, or whose deviation is not from 1e-100 to 1e100.
pub fn common_scale(photographs: usize, ratios: &[LogRatio]) -> Result<Vec<LogFactor>> {
    let mut sorted = Vec::with_capacity(ratios.len());
    for ratio in ratios {
        // Squares of the deviations, and what is divided by them, are numbers.
        let pair = ratio.first != ratio.second && ratio.first.max(ratio.second) < photographs;
        if !(pair && ratio.log.is_finite() && (1e-100..=1e100).contains(&ratio.sigma)) {
            let remedy =
                "give the indices of two photographs, a finite ratio, and a sigma from 1e-100 to 1e100";
            let LogRatio { first, second, log, sigma } = ratio;
            let value = format!("{log} of {first} and {second}, with sigma {sigma}");
            return Err(OutOfRange::new("ratio", value, remedy).into());
        }
        sorted.push(match ratio.first < ratio.second {
            true => *ratio,
            false => LogRatio { first: ratio.second, second: ratio.first, log: -ratio.log, ..*ratio },
        });
    }
    sorted.sort_by(|a, b| {
        let pairs = (a.first, a.second).cmp(&(b.first, b.second));
        pairs.then(a.log.total_cmp(&b.log)).then(a.sigma.total_cmp(&b.sigma))
    });
    let mut weights = vec![1.0; sorted.len()];
    let mut logs = vec![0.0; photographs];
    let mut graph = factored(photographs, &sorted, &weights);
    // Ratios of each component that are left over once the factors are known.
    let mut free = vec![1_usize; graph.sizes.len()];
    sorted.iter().for_each(|ratio| free[graph.components[ratio.first]] += 1);
    free.iter_mut().zip(&graph.sizes).for_each(|(free, size)| *free = free.saturating_sub(*size));
    for _ in 0..ROUNDS {
        let next = graph.centred(graph.solve(flow(photographs, &sorted, &weights)));
        let moved = next.iter().zip(&logs).map(|(a, b): (&f64, &f64)| (a - b).abs()).fold(0.0, f64::max);
        logs = next;
        if moved < SETTLED {
            break;
        }
        let cuts = cuts(&graph, &sorted, &logs, &free);
        for (weight, ratio) in weights.iter_mut().zip(&sorted) {
            let cut = cuts[graph.components[ratio.first]];
            *weight = cut / deviation(&logs, ratio).abs().max(cut);
        }
        graph = factored(photographs, &sorted, &weights);
    }
    let cuts = cuts(&graph, &sorted, &logs, &free);
    let mut squares = vec![0.0; free.len()];
    let mut least = vec![f64::INFINITY; photographs];
    for ratio in &sorted {
        let component = graph.components[ratio.first];
        squares[component] += deviation(&logs, ratio).abs().min(cuts[component]).powi(2);
        for i in [ratio.first, ratio.second] {
            least[i] = least[i].min(ratio.sigma);
        }
    }
    let variances = graph.variances();
    let of_photograph = |i: usize| {
        let component = graph.components[i];
        let (photographs, free) = (graph.sizes[component], free[component]);
        let inflation = if free > 0 { (squares[component] / free as f64).max(1.0) } else { 1.0 };
        let others = 1.0 - 1.0 / photographs as f64;
        let own = if others > 0.0 { 0.5 * others * least[i] * least[i] } else { 0.0 };
        let sigma = (variances[i] * inflation).max(own).sqrt();
        LogFactor { log: logs[i], sigma, component, photographs }
    };
    Ok((0..photographs).map(of_photograph).collect())
}

fn factored(photographs: usize, ratios: &[LogRatio], weights: &[f64]) -> Laplacian {
    let edge = |(r, weight): (&LogRatio, &f64)| ([r.first, r.second], weight / (r.sigma * r.sigma));
    Laplacian::new(photographs, ratios.iter().zip(weights).map(edge))
}

/// Residual of a ratio over its deviation.
fn deviation(logs: &[f64], ratio: &LogRatio) -> f64 {
    (logs[ratio.second] - logs[ratio.first] - ratio.log) / ratio.sigma
}

/// Right side of the normal equations.
fn flow(photographs: usize, ratios: &[LogRatio], weights: &[f64]) -> Vec<f64> {
    let mut right = vec![0.0; photographs];
    for (ratio, weight) in ratios.iter().zip(weights) {
        let push = weight * ratio.log / (ratio.sigma * ratio.sigma);
        right[ratio.second] += push;
        right[ratio.first] -= push;
    }
    right
}

/// Where Huber's loss becomes linear in each component: [`CUT`], times the spread of the residuals where that is larger than
/// the ratios' own deviations.
fn cuts(graph: &Laplacian, ratios: &[LogRatio], logs: &[f64], free: &[usize]) -> Vec<f64> {
    let mut residuals: Vec<Vec<f64>> = vec![Vec::new(); free.len()];
    for ratio in ratios {
        residuals[graph.components[ratio.first]].push(deviation(logs, ratio));
    }
    let cut = |(residuals, &free): (Vec<f64>, &usize)| {
        let lost = (residuals.len() as f64 / free.max(1) as f64).sqrt();
        let spread = robust_deviation(residuals.into_iter()).filter(|_| free > 0);
        CUT * spread.map_or(1.0, |spread| lost * spread).max(1.0)
    };
    residuals.into_iter().zip(free).map(cut).collect()
}

#[cfg(test)]
mod tests;
