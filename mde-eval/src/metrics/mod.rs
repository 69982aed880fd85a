//! The metrics, one function each, with its equation and its source.
//!
//! | module | takes | metrics |
//! | --- | --- | --- |
//! | [`depth`] | two lists of depths | MSE, RMSE, AbsRel, SqRel, log10, RMSE log, SILog, iRMSE, \\(\delta_k\\) |
//! | [`sharpness`] | maps and a mask | mean gradient, over all pixels, near true edges and away from them |
//! | [`edges`] | maps and a mask | edge F1 at a fixed threshold, F1max and average precision over all thresholds |
//! | [`boundary`] | maps and a mask | scale-invariant boundary F1 |
//! | [`ordinal`] | maps and a mask | depth-discontinuity disagreement (D3R-like), ordinal error (ORD) |
//! | [`rank`] | two lists | average ranks, Spearman's correlation |
//! | [`sparsification`] | costs and sigmas | AUSE and AURG, both published definitions; errors by uncertainty percentile |
//! | [`calibration`] | errors and sigmas | NLL, CRPS, coverage, calibration error, ENCE, mean \\(z^2\\) |
//!
//! Depths are z-depths in one unit (metres, where a threshold is in metres), already aligned
//! ([`align`](crate::align)). An error is *prediction minus truth*. Ties are averaged, never broken by index.

pub mod boundary;
pub mod calibration;
pub mod depth;
pub mod edges;
pub mod ordinal;
pub mod rank;
pub mod sharpness;
pub mod sparsification;
