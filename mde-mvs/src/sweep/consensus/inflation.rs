//! By how much the stated variances are too small.

use mde_uncertainty::statistics::quantile;
use mde_warp::PosedView;
use ndarray::Array2;
use rayon::prelude::*;

use super::Agreement;
use super::chance::TRUSTED;
use super::fuse::Fused;
use mde_warp::transfer::PlaneTransfer;

/// Factor on the variances, at least 1, that makes them consistent with the differences between photographs.
///
/// Matches of neighbours share their errors, so that variances which take them as independent are too small. Where two
/// verified maps meet, 90 % of the differences should lie within 1.645 standard deviations.
pub(super) fn inflation(views: &[&PosedView], maps: &[(Fused, Agreement, f32)]) -> f32 {
    let pairs: Vec<(usize, usize)> = (0..views.len())
        .flat_map(|i| (0..views.len()).map(move |j| (i, j)))
        .filter(|(i, j)| i != j)
        .collect();
    let mut scores: Vec<f64> = pairs
        .par_iter()
        .flat_map_iter(|&(i, j)| {
            let carried = splat(views[j], &maps[j].0, &maps[j].1, views[i]);
            let (own, agreement) = (&maps[i].0.depth, &maps[i].1.agree);
            let score = |((y, x), &(log, v)): ((usize, usize), &(f32, f32))| {
                let (z, variance) = own.get(y, x).filter(|(z, _)| *z > 0.0)?;
                let seen = v.is_finite() && agreement[(y, x)] > 0;
                let total = v + variance / (z * z);
                (seen && total > 0.0).then(|| f64::from((log - z.ln()).powi(2) / total))
            };
            carried.indexed_iter().step_by(7).filter_map(score).collect::<Vec<_>>()
        })
        .collect();
    let high = quantile(&mut scores, 0.9).unwrap_or(1.0);
    (high / 1.645_f64.powi(2)).clamp(1.0, 1e4) as f32
}

/// Log depth and its variance of one view's verified pixels seen from another, the nearest where several land.
fn splat(from: &PosedView, map: &Fused, agreement: &Agreement, to: &PosedView) -> Array2<(f32, f32)> {
    let transfer = PlaneTransfer::new(from, to);
    let mut out = Array2::from_elem(to.camera.dim(), (f32::INFINITY, f32::INFINITY));
    for ((y, x), &z) in map.depth.mean().indexed_iter() {
        let v = map.depth.variance()[(y, x)];
        let verified = agreement.agree[(y, x)] > 0 && map.inlier[(y, x)] > TRUSTED;
        if !(verified && z > 0.0 && v.is_finite()) {
            continue;
        }
        let Some(seen) = transfer.at(x as f64, y as f64, 1.0 / f64::from(z)) else { continue };
        let Some(at) = transfer.nearest(&seen) else { continue };
        let there = (f64::from(z) * seen.ratio).ln() as f32;
        if there < out[at].0 {
            out[at] = (there, v / (z * z));
        }
    }
    out
}
