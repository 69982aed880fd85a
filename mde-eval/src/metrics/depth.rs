//! Errors of aligned depths against the truth, pixel by pixel.
//!
//! Every function takes the predicted depths \\(p_i\\) and the true depths \\(g_i\\) of the pixels to score, \\(n\\) of
//! each, both positive and in the same unit. Definitions follow Eigen, Puhrsch and Fergus (NeurIPS 2014), in the form
//! that the evaluation code of ZoeDepth and PatchFusion gives them.
//!
//! # Errors
//! All of them: [`Error::Length`](crate::Error::Length) where the lists differ, [`Error::Empty`](crate::Error::Empty) without pixels,
//! [`Error::Value`](crate::Error::Value) for a depth that is not positive and finite.

use crate::Result;
use crate::error::{check_lists, positive};

/// Mean squared error, in the unit squared: \\(\frac1n \sum_i (p_i - g_i)^2\\).
pub fn mse(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    mean(prediction, truth, |p, g| (p - g).powi(2))
}

/// Root of the mean squared error, in the depths' unit: \\(\sqrt{\mathrm{MSE}}\\).
pub fn rmse(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    Ok(mse(prediction, truth)?.sqrt())
}

/// Mean absolute relative error: \\(\frac1n \sum_i |g_i - p_i| / g_i\\).
pub fn abs_rel(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    mean(prediction, truth, |p, g| (g - p).abs() / g)
}

/// Mean squared relative error, in the depths' unit: \\(\frac1n \sum_i (g_i - p_i)^2 / g_i\\).
pub fn sq_rel(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    mean(prediction, truth, |p, g| (g - p).powi(2) / g)
}

/// Root mean squared error of the natural logarithms: \\(\sqrt{\frac1n \sum_i (\ln p_i - \ln g_i)^2}\\).
pub fn rmse_log(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    Ok(mean(prediction, truth, |p, g| (p / g).ln().powi(2))?.sqrt())
}

/// Mean absolute difference of the decimal logarithms: \\(\frac1n \sum_i |\log_{10} g_i - \log_{10} p_i|\\).
pub fn log10(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    mean(prediction, truth, |p, g| (g / p).log10().abs())
}

/// Scale-invariant logarithmic error, in percent (the KITTI benchmark's `SILog`):
///
/// \\[ 100 \sqrt{\tfrac1n \sum_i e_i^2 - \Bigl(\tfrac1n \sum_i e_i\Bigr)^2}, \qquad e_i = \ln p_i - \ln g_i \\]
///
/// It is blind to a global scale of either side. Computed about the mean, so that nothing cancels.
pub fn silog(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    let centre = mean(prediction, truth, |p, g| (p / g).ln())?;
    Ok(100.0 * mean(prediction, truth, |p, g| ((p / g).ln() - centre).powi(2))?.sqrt())
}

/// Root mean squared error of the inverse depths, in one over the unit: \\(\sqrt{\frac1n \sum_i (1/p_i - 1/g_i)^2}\\).
pub fn irmse(prediction: &[f64], truth: &[f64]) -> Result<f64> {
    Ok(mean(prediction, truth, |p, g| (p.recip() - g.recip()).powi(2))?.sqrt())
}

/// Share of pixels within a factor: \\(\delta_k = \frac1n |\\{i : \max(g_i/p_i,\, p_i/g_i) < 1.25^k\\}|\\), strictly below.
pub fn delta(prediction: &[f64], truth: &[f64], k: i32) -> Result<f64> {
    let limit = 1.25_f64.powi(k);
    mean(prediction, truth, |p, g| f64::from(u8::from((g / p).max(p / g) < limit)))
}

fn mean(prediction: &[f64], truth: &[f64], term: impl Fn(f64, f64) -> f64) -> Result<f64> {
    check_lists(
        "a depth error",
        [positive("the true depth", truth), positive("the predicted depth", prediction)],
    )?;
    let sum = prediction.iter().zip(truth).fold(0.0, |sum, (&p, &g)| sum + term(p, g));
    Ok(sum / truth.len() as f64)
}
