//! Test-time augmentation: predictions of crops and mirror images, merged into the prediction of the whole image.
//!
//! A network takes the whole image at a small, fixed size. A crop is an image with a longer focal length, in which the network
//! resolves what it blurred before; a mirror image has another error. Each prediction \\(L\\) of a crop has a scale and shift
//! of its own and is brought to the current map \\(c\\) by a *local regression*. Both are log depths, or disparities scaled to a
//! standard deviation of 0.3. With \\(\langle\cdot\rangle\\) a Gaussian window,
//!
//! \\[ a = \min\Bigl(a_{max},\; \sqrt{\frac{v_c}{v_L}}\,\rho^{\,q}\Bigr),\qquad
//!    b = \langle c\rangle - a \langle L\rangle,\qquad
//!    \rho = \min\Bigl(1, \frac{\mathrm{cov}^+(L, c)}{\sqrt{v_L v_c}}\Bigr),\qquad
//!    v_x = \langle x^2\rangle - \langle x\rangle^2 + \varepsilon, \\]
//!
//! with \\(\mathrm{cov}^+ = \max(0, \langle L c\rangle - \langle L\rangle\langle c\rangle)\\), \\(\varepsilon = 10^{-4}\\),
//! \\(a_{max} = 3\\), and \\(a = 0\\) where \\(\rho = 0\\). \\(q = 1\\) is least squares (the guided filter of He et al., 2013, with
//! the crop as guide), which flattens where the two disagree; \\(q = 0\\) gives the crop the map's local contrast. The moments are
//! means over 28 x 28 blocks of the crop, blurred by the window; the fields \\(a\\) and \\(b\\) are blurred by it once more and
//! interpolated bilinearly to the pixels.
//!
//! A level of crops changes the map by \\(c \leftarrow c + g\,\overline{(a L + b - c)}\\), the mean over its crops under
//! half-sine windows. \\(g < 1\\) shrinks the change, since the crops share the model's error. The variance of the changes about
//! their mean is the level's contribution to the spread. So the map keeps its low frequencies and takes the crops' detail. After
//! Miangoleh et al. (CVPR 2021), who train a network for the merge.
//!
//! A post-filter (an unsharp mask, then a joint bilateral filter) follows. With \\(\delta\\) the change that it would make, \\(f\\)
//! the crops' change less its low frequencies, and \\(G\\) a Gaussian, it is limited to the detail that the crops added nearby:
//! \\(c \leftarrow c + \delta \min(1, \sqrt{G f^2 / G \delta^2})\\). A map to which the crops add nothing is not filtered.

mod flip;
mod plan;
mod post_filter;
mod regression;
mod values;
mod window;

pub use flip::flip_average;
pub use plan::{Plan, Predictions};

use crate::at_once::AtOnce;
use crate::error::same_size;
use crate::{DepthPrior, DisparityRule, Error, PriorDepth, Result};
use mde_uncertainty::OutOfRange;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis, Zip, s};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use values::Values;

/// Which crops are predicted, and how the predictions are merged. The equations are in the [module's](self) documentation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct AugmentationConfig {
    /// Number of predictions, `"auto"` or an upper bound; 1 for no augmentation. More take longer and add detail, in the order of [`Plan`].
    pub predictions: Predictions,
    /// \\(q\\), 0 to 4: exponent of the local correlation of crop and map. Larger values flatten what the two disagree on.
    pub correlation_exponent: f64,
    /// \\(g\\), 0 to 1: fraction of a level's mean change that is applied. Larger values add more detail and more noise.
    pub gain: f64,
    /// Gain of the unsharp mask, 0 to 4; 0 for none. Larger values sharpen edges and noise.
    pub sharpen: f64,
    /// Spatial standard deviation of the joint bilateral filter, as a fraction of the image width, 0 to 0.25; 0 for none. Larger
    /// values smooth within regions of one colour.
    pub bilateral_width: f64,
}

/// Standard deviation of the Gaussian that separates detail from low frequencies, as a fraction of the image width.
const DETAIL_WIDTH: f64 = 1.0 / 80.0;

impl Default for AugmentationConfig {
    /// A single prediction of the whole image.
    fn default() -> Self {
        Self {
            predictions: Predictions::Most(1),
            correlation_exponent: 0.25,
            gain: 0.7,
            sharpen: 0.0,
            bilateral_width: 0.0,
        }
    }
}

/// The result of the augmentation.
#[derive(Debug, Clone, PartialEq)]
pub struct Augmented {
    /// The model's prediction of the whole image.
    pub prior: PriorDepth,
    /// All predictions merged, `[height, width]`, of the same kind as `prior`. Missing pixels are those of `prior`, or those that are
    /// missing in its mirror image too, where that was predicted.
    pub merged: PriorDepth,
    /// Standard deviation of the predictions about their mean, `[height, width]`: of log depth, or of a disparity in its own unit.
    pub spread: Array2<f32>,
    /// The images that were predicted.
    pub plan: Plan,
    /// The level after which [`Predictions::Auto`] left out further ones, where it did.
    pub stopped: Option<usize>,
}

/// Progress of the augmentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// A prediction is done.
    Predicted {
        /// Predictions so far.
        done: usize,
        /// Predictions in total.
        total: usize,
    },
    /// All predictions are done; the post-filter begins.
    Merging,
}

impl AugmentationConfig {
    /// As many predictions as are worthwhile.
    ///
    /// The constants were chosen on twenty photographs with one network; see `docs/method.md` of the workspace.
    #[must_use]
    pub fn multi_crop() -> Self {
        Self { predictions: Predictions::Auto, sharpen: 0.4, bilateral_width: 0.00625, ..Self::default() }
    }

    /// Whether there may be more than one prediction.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.predictions != Predictions::Most(1)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] for the first value out of range.
    pub fn validate(&self) -> Result<()> {
        for (field, value, most, remedy) in [
            ("augmentation.correlation-exponent", self.correlation_exponent, 4.0, "give 0 to 4"),
            ("augmentation.gain", self.gain, 1.0, "give 0 to 1"),
            ("augmentation.sharpen", self.sharpen, 4.0, "give 0 to 4"),
            ("augmentation.bilateral-width", self.bilateral_width, 0.25, "give 0 to 0.25 of the image width"),
        ] {
            OutOfRange::check((0.0..=most).contains(&value), field, &value, remedy)?;
        }
        Ok(())
    }

    /// Runs `model` on `image` (`[height, width, 3]`, sRGB in 0 to 1) and on its crops and mirror images, and merges the predictions.
    ///
    /// # Errors
    /// [`Error::Config`], the model's own errors, or [`Error::Input`] for a prediction of another size or kind.
    pub fn predict(&self, model: &dyn DepthPrior, image: ArrayView3<'_, f32>) -> Result<Augmented> {
        let never = &mut |_| ControlFlow::Continue(());
        let cancelled = || Error::Input("the augmentation was cancelled; run it again".to_owned());
        self.predict_with(model, image, None, never)?.ok_or_else(cancelled)
    }

    /// [`predict`](Self::predict) with at most `at_once` predictions at once, 1 or more, and a progress callback. `Break` cancels, and the
    /// result is `None`. The results do not depend on `at_once`.
    ///
    /// # Errors
    /// As [`predict`](Self::predict).
    pub fn predict_with(
        &self,
        model: &dyn DepthPrior,
        image: ArrayView3<'_, f32>,
        at_once: Option<usize>,
        progress: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Option<Augmented>> {
        self.validate()?;
        let (height, width, _) = image.dim();
        let at_once = AtOnce::new(model.concurrency(), at_once);
        let input = model.resolution(height, width);
        let mut plan = Plan::new(self.predictions, (height, width), input);
        let mut whole = Vec::with_capacity(2);
        let mut done = 0;
        let mut predicted = |plan: &Plan| {
            done += 1;
            progress(Progress::Predicted { done, total: plan.predictions() })
        };
        let mirrors: &[bool] = if plan.mirror { &[false, true] } else { &[false] };
        let predict = |&mirrored: &bool| match mirrored {
            true => model.predict(copied(image, true).view()),
            false => model.predict(image.view()),
        };
        let take = |prediction| {
            whole.push(prediction);
            predicted(&plan)
        };
        if at_once.in_order(mirrors, predict, take)?.is_break() {
            return Ok(None);
        }
        let mut whole = whole.into_iter();
        let Some(prior) = whole.next() else { return Ok(None) };
        let (rows, columns) = prior.map.dim();
        if (rows, columns) != (height, width) || prior.valid.dim() != (height, width) {
            return Err(Error::Input(format!(
                "for an image of {width}x{height} the model returned {columns}x{rows}; the augmentation needs the image's size"
            )));
        }
        let start = match whole.next() {
            Some(mirrored) => flip_average(prior.clone(), &mirrored)?,
            None => prior.clone(),
        };
        if plan.predictions() == 1 {
            let spread = Array2::zeros(prior.map.dim());
            return Ok(Some(Augmented { merged: prior.clone(), prior, spread, plan, stopped: None }));
        }
        let mut stopped = None;
        let values = Values::of(&start);
        let mut current = values.of_prior(&start);
        // Half of the difference between an image and its mirror image.
        let mut variance = (&current - &values.of_prior(&prior)).mapv_into(|d| d * d);
        for (index, level) in plan.levels.clone().into_iter().enumerate() {
            let window = regression::window(level, input.map(|(height, width)| height.min(width)));
            let mut changes = window::Changes::new(current.dim());
            let places = window::crops(current.dim(), level);
            let crops: Vec<_> = places.flat_map(|crop| mirrors.iter().map(move |m| (crop, *m))).collect();
            let change = |&((y, x, height, width), mirrored): &((usize, usize, usize, usize), bool)| {
                let crop = image.slice(s![y..y + height, x..x + width, ..]);
                let target = current.slice(s![y..y + height, x..x + width]);
                let prediction = match predict_crop(model, crop, mirrored, values) {
                    Err(Error::Empty(_)) => return Ok(None),
                    prediction => prediction?,
                };
                let change = regression::change(prediction.view(), target, window, self.correlation_exponent);
                Ok(Some(((y, x), change)))
            };
            let take = |change: Option<((usize, usize), Array2<f32>)>| {
                if let Some((place, change)) = change {
                    changes.add(place, change.view());
                }
                predicted(&plan)
            };
            if at_once.in_order(&crops, change, take)?.is_break() {
                return Ok(None);
            }
            let (mean, spread, apart) = changes.mean_and_variance();
            current.zip_mut_with(&mean, |c, m| *c += self.gain as f32 * m);
            variance += &spread;
            let moved: f64 = mean.iter().map(|m| f64::from(m * m)).sum();
            if self.predictions == Predictions::Auto && moved < apart {
                stopped = Some(level).filter(|_| plan.levels.len() > index + 1);
                plan.levels.truncate(index + 1);
                break;
            }
        }
        if progress(Progress::Merging).is_break() {
            return Ok(None);
        }
        let detail = DETAIL_WIDTH * current.ncols() as f64;
        let mut filtered = current.clone();
        if self.sharpen > 0.0 {
            filtered = post_filter::sharpened(filtered, detail, self.sharpen);
        }
        if self.bilateral_width > 0.0 {
            let sigma = self.bilateral_width * current.ncols() as f64;
            filtered = post_filter::bilateral(filtered.view(), image, sigma)?;
        }
        let added = &current - &values.of_prior(&start);
        post_filter::limit(&mut current, &filtered, added.view(), detail);
        let mut merged = start;
        Zip::from(&mut merged.map).and(&merged.valid).and(&current).for_each(|value, &valid, &c| {
            if valid {
                *value = values.to_prior(c);
            }
        });
        let spread = variance.mapv(|v| values.spread(v.max(0.0).sqrt()));
        Ok(Some(Augmented { prior, merged, spread, plan, stopped }))
    }
}

impl Augmented {
    /// The spread as a fraction of the depth \\(z\\), `[height, width]`, where `depth` is the merged map as depth: the spread
    /// of \\(\ln z\\) itself, or \\(z \alpha\\) times that of disparities with \\(1/z = \alpha d + \beta\\).
    ///
    /// # Errors
    /// [`Error::Input`] where the sizes differ.
    pub fn relative_spread(&self, depth: ArrayView2<'_, f32>) -> Result<Array2<f32>> {
        same_size(("the depth", depth.dim()), ("the spread", self.spread.dim()))?;
        if self.merged.kind.is_depth() {
            return Ok(self.spread.clone());
        }
        let pairs = || {
            let known = depth.iter().zip(&self.merged.map).filter(|(z, _)| **z > 0.0);
            known.map(|(z, d)| (f64::from(*d), 1.0 / f64::from(*z)))
        };
        let count = pairs().count().max(1) as f64;
        let (md, mz) = pairs().fold((0.0, 0.0), |(a, b), (d, z)| (a + d / count, b + z / count));
        let (dd, dz) =
            pairs().fold((0.0, 0.0), |(a, b), (d, z)| (a + (d - md).powi(2), b + (d - md) * (z - mz)));
        let alpha = if dd > 0.0 { (dz / dd).max(0.0) } else { 0.0 };
        Ok(Zip::from(&self.spread)
            .and(depth)
            .map_collect(|&s, &z| (alpha * f64::from(s) * f64::from(z)) as f32))
    }

    /// The merged map as positive depth, `[height, width]`, 0 = missing. Disparities become depth with the quantiles of
    /// [`prior`](Self::prior): a few sharper pixels would move quantiles of their own, and with them the whole map.
    ///
    /// # Errors
    /// Those of [`PriorDepth::to_depth`].
    pub fn depth(&self, rule: &DisparityRule) -> Result<Array2<f32>> {
        if self.merged.kind.is_depth() {
            return self.merged.to_depth(rule);
        }
        let ends = rule.ends(self.prior.map.view(), self.prior.valid.view())?;
        rule.depth_between(self.merged.map.view(), self.merged.valid.view(), ends)
    }
}

/// The image `[height, width, 3]`, or its mirror image, with contiguous rows, which a model may need.
fn copied(image: ArrayView3<'_, f32>, mirrored: bool) -> Array3<f32> {
    let step = if mirrored { -1 } else { 1 };
    image.slice(s![.., ..;step, ..]).as_standard_layout().into_owned()
}

/// The prediction of a crop, or of its mirror image turned back, as values for the regression.
fn predict_crop(
    model: &dyn DepthPrior,
    crop: ArrayView3<'_, f32>,
    mirrored: bool,
    values: Values,
) -> Result<Array2<f32>> {
    let prediction = model.predict(copied(crop, mirrored).view())?;
    let (height, width, _) = crop.dim();
    let (wanted, found, (rows, columns)) = (values.kind, prediction.kind, prediction.map.dim());
    if (rows, columns) != (height, width) || found != wanted {
        return Err(Error::Input(format!(
            "for a crop of {width}x{height} the model returned {found} of {columns}x{rows}; the augmentation needs {wanted} of the crop's size"
        )));
    }
    let mut prediction = values.of_prior(&prediction);
    if mirrored {
        prediction.invert_axis(Axis(1));
    }
    Ok(prediction)
}

#[cfg(test)]
mod tests;
