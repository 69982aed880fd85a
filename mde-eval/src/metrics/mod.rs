//! The metrics, one function each, with its equation and its source.
//!
//! | module | takes | metrics |
//! | --- | --- | --- |
//! | [`depth`] | two lists of depths | MSE, RMSE, AbsRel, SqRel, log10, RMSE log, SILog, iRMSE, \\(\delta_k\\) |
//! | [`sharpness`] | maps and a mask | mean gradient, over all pixels, near true edges and away from them |
//! | [`edges`] | maps and a mask | edge F1 at a fixed threshold, F1max over all thresholds |
//! | [`boundary`] | maps and a mask | scale-invariant boundary F1 (Depth Pro) |
//! | [`dbe`] | edge maps | depth boundary errors: accuracy and completeness (iBims-1) |
//! | [`superpixel`] | maps and a mask | order of neighbouring superpixels: D3R |
//! | [`sparsification`] | costs and sigmas | AUSE and AURG, both published definitions; errors by uncertainty percentile |
//! | [`calibration`] | errors and sigmas | NLL, CRPS, coverage, calibration error, ENCE, mean \\(z^2\\) |
//!
//! Depths are z-depths in one unit (metres, where a threshold is in metres), already aligned
//! ([`align`](crate::align)). An error is *prediction minus truth*. Ties are averaged, never broken by index.

pub mod boundary;
pub mod calibration;
pub mod dbe;
pub mod depth;
pub mod edges;
pub mod sharpness;
pub mod sparsification;
pub mod superpixel;

use crate::raster::{Map, Mask};

/// Smallest and largest value within the mask, finite ones alone; nothing where there is none.
fn depth_range(map: Map<'_>, mask: Mask<'_>) -> Option<(f32, f32)> {
    let values = map.into_iter().zip(mask).filter(|(v, keep)| **keep && v.is_finite()).map(|(v, _)| *v);
    values.fold(None, |range, v| match range {
        None => Some((v, v)),
        Some((low, high)) => Some((v.min(low), v.max(high))),
    })
}
