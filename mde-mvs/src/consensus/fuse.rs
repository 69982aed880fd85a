//! A sweep and the gauged prior as one map.

use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{Array2, Zip};

use super::chance::TRUSTED;
use crate::Result;
use crate::correction::{Guide, correct};
use crate::raster::luma;
use crate::statistics::robust_deviation;
use crate::sweep::Sweep;

/// The differences of luma and of log depth at which a correction stops.
const EDGES: [f32; 2] = [0.1, 0.1];

/// The sweep of a photograph and its gauged prior as one map: the prior's smooth error is corrected by the sweep, then
/// both are fused by precision, the sweep being right with a probability only.
pub(super) struct Fused {
    pub(super) depth: GaussianDepth,
    /// Probability that the sweep is right.
    pub(super) inlier: Array2<f32>,
    /// The prior after the correction.
    pub(super) corrected: Array2<f32>,
    /// Share of the variance that the sweep's own is.
    pub(super) ambiguity: Array2<f32>,
}

pub(super) fn fuse(
    view: &PosedView,
    prior: &GaussianDepth,
    sweep: &Sweep,
    chance: &Array2<f32>,
    factor: f64,
) -> Result<Fused> {
    let shape = prior.dim();
    let log_prior = prior.mean().mapv(|z| if z > 0.0 { z.ln() } else { f32::NAN });
    let residual = Zip::from(&log_prior).and(sweep.depth.mean()).map_collect(|&p, &z| {
        let r = if z > 0.0 { z.ln() - p } else { 0.0 };
        if r.is_finite() { r } else { 0.0 }
    });
    let known =
        |y: usize, x: usize| sweep.depth.get(y, x).filter(|(z, _)| *z > 0.0 && log_prior[(y, x)].is_finite());
    let trusted = |c: f32| if c > TRUSTED { c } else { 0.0 };
    let weight = Array2::from_shape_fn(shape, |(y, x)| known(y, x).map_or(0.0, |_| trusted(chance[(y, x)])));
    let spread =
        robust_deviation(residual.iter().zip(&weight).filter(|(_, w)| **w > 0.0).map(|(r, _)| f64::from(*r)));
    let spread = spread.unwrap_or(0.2).clamp(0.02, 1.0) as f32;
    let filled = log_prior.mapv(|p| if p.is_finite() { p } else { 0.0 });
    let guide = Guide::new(luma(view.image.view()).view(), filled.view(), EDGES);
    let field = correct(&residual, &weight, &guide, spread);
    // A wrong match lies anywhere among the surfaces.
    let anywhere = 1.0 / (2.0 * factor.ln()) as f32;
    let (mut mean, mut variance) = (Array2::zeros(shape), Array2::from_elem(shape, f32::INFINITY));
    let mut inlier = Array2::zeros(shape);
    let mut corrected = Array2::zeros(shape);
    let mut ambiguity = Array2::zeros(shape);
    for (at, &p) in log_prior.indexed_iter() {
        if !p.is_finite() {
            if let Some((z, v)) = sweep.depth.get(at.0, at.1) {
                (mean[at], variance[at], inlier[at], ambiguity[at]) = (z, v, chance[at], 1.0);
            }
            continue;
        }
        let (u, s) = (field.mean[at], field.variance[at]);
        let (mut m, mut v) = (u, s);
        if let Some((z, var)) = known(at.0, at.1) {
            let (r, var) = (residual[at], var / (z * z));
            let total = s + var;
            let density = (-0.5 * (r - u).powi(2) / total).exp() / (std::f32::consts::TAU * total).sqrt();
            let good = chance[at] * density;
            let probability = good / (good + (1.0 - chance[at]) * anywhere).max(1e-20);
            let gain = s / total;
            let (m1, v1) = (u + gain * (r - u), gain * var);
            m = probability * m1 + (1.0 - probability) * u;
            v = probability * (v1 + (m1 - m).powi(2)) + (1.0 - probability) * (s + (u - m).powi(2));
            inlier[at] = probability;
            // Of the fused variance (1 - gain)^2 s + gain^2 var.
            ambiguity[at] = if v > 0.0 { (probability * gain * gain * var / v).min(1.0) } else { 0.0 };
        }
        let z = (p + m).exp();
        (mean[at], variance[at]) = (z, z * z * v);
        corrected[at] = (p + u).exp();
    }
    Ok(Fused { depth: GaussianDepth::new(mean, variance)?, inlier, corrected, ambiguity })
}
