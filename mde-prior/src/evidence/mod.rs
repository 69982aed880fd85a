//! New evidence from the same photograph: the model is asked again about zoomed crops and mirror images.
//!
//! A network sees the whole picture at a fixed, small size. A crop is a synthetic view with a longer focal length, at which it
//! resolves what the whole picture blurred; a mirror image shows the same scene with another error. Each answer is a hypothesis
//! \\(L\\) of the depth, in a gauge of its own (a crop is nearer than it seems), so it enters by *local regression*: with
//! \\(c\\) the map so far, both in log depth (disparities as they are), and \\(\langle\cdot\rangle\\) a Gaussian window,
//!
//! \\[ a = \sqrt{\frac{\mathrm{var}\,c}{\mathrm{var}\,L}}\;\rho^{\,q},\qquad
//!    \rho = \frac{\mathrm{cov}^+(L, c)}{\sqrt{\mathrm{var}\,L\;\mathrm{var}\,c}},\qquad
//!    b = \langle c\rangle - a \langle L\rangle,\qquad c \leftarrow c + g\,\overline{(a L + b - c)}. \\]
//!
//! So the map keeps its low frequencies, which the whole picture knows best, and takes the crop's detail as far as the two
//! agree: \\(q = 1\\) is least squares (a guided filter whose guide is the crop), \\(q = 0\\) gives the crop the map's local
//! contrast. The bar is the mean over the crops of a level, each under a half-sine window; \\(g < 1\\) shrinks it, since the
//! crops share the model's error. After Miangoleh et al. (CVPR 2021), who train a network for the merge.

mod finish;
mod regression;
mod window;

pub use finish::blurred;

use crate::{DepthKind, DepthPrior, DisparityRule, Error, FlipAverage, PriorDepth, Result};
use ndarray::{Array2, ArrayView2, ArrayView3, Zip, s};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// How a model is asked again, and how its answers are put together.
///
/// ```
/// use mde_prior::evidence::EvidenceConfig;
/// use mde_prior::ndarray::{Array3, ArrayView3, s};
/// use mde_prior::{DepthKind, DepthPrior, PriorDepth, Result};
///
/// /// Takes the red channel for depth.
/// struct Red;
/// impl DepthPrior for Red {
///     fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
///         PriorDepth::from_values(image.slice(s![.., .., 0]).to_owned(), DepthKind::Metric)
///     }
/// }
///
/// let image = Array3::from_shape_fn((24, 32, 3), |(y, x, _)| 0.2 + 0.01 * (x + y) as f32);
/// let evidence = EvidenceConfig::zoomed().gather(&Red, image.view())?;
/// // Crops that say what the whole picture says change nothing but the last touch.
/// let change = (&evidence.consensus.map - &evidence.prior.map).mapv(f32::abs);
/// assert!(change.iter().all(|&c| c < 0.02));
/// # Ok::<(), mde_prior::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct EvidenceConfig {
    /// Whether every question is asked about the mirror image too.
    pub flip: bool,
    /// Crops, from wide to narrow: each level refines what the one before left.
    pub levels: Vec<ZoomLevel>,
    /// \\(q\\): how much a crop that does not agree with the map loses, 0 to 4.
    pub agreement: f64,
    /// \\(g\\): how much of a level's change is believed, 0 to 1.
    pub trust: f64,
    /// Gain of a last unsharp mask, 0 for none. It and the filter below move the map's detail no further than the crops did around
    /// there: a map in which they found nothing to add is sharp already.
    pub sharpen: f64,
    /// Its Gaussian's standard deviation, as a share of the picture's width.
    pub sharpen_width: f64,
    /// Standard deviation in place of a last joint bilateral filter, as a share of the picture's width; 0 for none.
    pub snap_width: f64,
    /// Its standard deviation in colour (0 to 1).
    pub snap_colour: f64,
}

/// Standard deviation of the Gaussian that tells detail from low frequencies, as a share of the picture's width.
const DETAIL: f64 = 1.0 / 80.0;

/// Overlapping crops of one size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct ZoomLevel {
    /// A crop's sides as a share of the picture's, above 0 and below 1.
    pub side: f64,
    /// Crops along each axis, 2 to 16.
    pub positions: usize,
    /// Standard deviation of the regression's window as a share of the crop's sides, above 0.
    pub window: f64,
}

impl Default for EvidenceConfig {
    /// The model's first answer and nothing else.
    fn default() -> Self {
        Self {
            flip: false,
            levels: Vec::new(),
            agreement: 0.25,
            trust: 0.7,
            sharpen: 0.0,
            sharpen_width: 0.0125,
            snap_width: 0.0,
            snap_colour: 0.1,
        }
    }
}

/// What was asked and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// The model's first answer, about the whole picture.
    pub prior: PriorDepth,
    /// All answers together, of the same kind and with the same missing pixels.
    pub consensus: PriorDepth,
    /// Standard deviation of the hypotheses about the consensus, `[height, width]`: of the logarithm of a depth, of a disparity
    /// in its own unit.
    pub spread: Array2<f32>,
    /// How often the model was asked.
    pub questions: usize,
}

impl EvidenceConfig {
    /// Mirror images and crops of 4/5, 2/3 and 1/2 of the picture, 120 questions.
    ///
    /// The constants were chosen once, on twenty rooms and one network; see the workspace's `docs/method.md`.
    #[must_use]
    pub fn zoomed() -> Self {
        let level = |side, positions, window| ZoomLevel { side, positions, window };
        Self {
            flip: true,
            levels: vec![
                level(0.8, 3, 6.0 / 28.0),
                level(2.0 / 3.0, 5, 6.0 / 28.0),
                level(0.5, 5, 3.0 / 28.0),
            ],
            sharpen: 0.4,
            snap_width: 0.00625,
            ..Self::default()
        }
    }

    /// Whether the model is asked more than once.
    #[must_use]
    pub fn asks_again(&self) -> bool {
        self.flip || !self.levels.is_empty()
    }

    /// How often the model will be asked.
    #[must_use]
    pub fn questions(&self) -> usize {
        let crops: usize = self.levels.iter().map(|level| level.positions * level.positions).sum();
        1 + if self.flip { 2 + 2 * crops } else { crops }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] that names the first value out of range.
    pub fn validate(&self) -> Result<()> {
        let check = |ok: bool, field, value: f64, remedy: &str| {
            if ok {
                Ok(())
            } else {
                Err(Error::Config { field, reason: format!("{value} is out of range; {remedy}") })
            }
        };
        for level in &self.levels {
            check(
                level.side > 0.0 && level.side < 1.0,
                "evidence.levels.side",
                level.side,
                "give a share between 0 and 1",
            )?;
            let positions = level.positions;
            check(
                (2..=16).contains(&positions),
                "evidence.levels.positions",
                positions as f64,
                "give 2 to 16",
            )?;
            check(
                level.window > 0.0 && level.window <= 1.0,
                "evidence.levels.window",
                level.window,
                "give a share above 0 and up to 1",
            )?;
        }
        check((0.0..=4.0).contains(&self.agreement), "evidence.agreement", self.agreement, "give 0 to 4")?;
        check((0.0..=1.0).contains(&self.trust), "evidence.trust", self.trust, "give 0 to 1")?;
        check((0.0..=4.0).contains(&self.sharpen), "evidence.sharpen", self.sharpen, "give 0 to 4")?;
        let width = |w: f64| (0.0..=0.25).contains(&w);
        check(width(self.sharpen_width), "evidence.sharpen-width", self.sharpen_width, "give 0 to 0.25")?;
        check(width(self.snap_width), "evidence.snap-width", self.snap_width, "give 0 to 0.25")?;
        check(
            self.snap_colour > 0.0 && self.snap_colour.is_finite(),
            "evidence.snap-colour",
            self.snap_colour,
            "give a positive distance of colours",
        )
    }

    /// Asks `model` about `image` (`[height, width, 3]`, sRGB in 0 to 1) as often as the configuration says.
    ///
    /// # Errors
    /// [`Error::Config`], or what the model refuses.
    pub fn gather(&self, model: &dyn DepthPrior, image: ArrayView3<'_, f32>) -> Result<Evidence> {
        let never = &mut |_, _| ControlFlow::Continue(());
        match self.gather_with(model, image, never)? {
            Some(evidence) => Ok(evidence),
            None => Err(Error::Input("the evidence was broken off; ask again".to_owned())),
        }
    }

    /// The same; `observe` hears of the questions asked so far and of all, and may say stop: then there is no answer.
    ///
    /// # Errors
    /// As [`EvidenceConfig::gather`].
    pub fn gather_with(
        &self,
        model: &dyn DepthPrior,
        image: ArrayView3<'_, f32>,
        observe: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<Option<Evidence>> {
        self.validate()?;
        let prior = model.predict(image.view())?;
        if !self.asks_again() {
            let spread = Array2::zeros(prior.map.dim());
            return Ok(Some(Evidence { consensus: prior.clone(), prior, spread, questions: 1 }));
        }
        let (all, mut asked) = (self.questions(), 1);
        let start = if self.flip { FlipAverage(model).predict(image.view())? } else { prior.clone() };
        asked += if self.flip { 2 } else { 0 };
        let space = Space::of(&start);
        let mut current = space.values(&start);
        let mut variance = Array2::<f32>::zeros(current.dim());
        for level in &self.levels {
            let mut votes = window::Votes::new(current.dim());
            for (y, x, height, width) in window::crops(current.dim(), level) {
                let crop = image.slice(s![y..y + height, x..x + width, ..]);
                let target = current.slice(s![y..y + height, x..x + width]);
                let mirrors: &[bool] = if self.flip { &[false, true] } else { &[false] };
                for &mirror in mirrors {
                    let answer = ask(model, crop, mirror, space)?;
                    let change = regression::change(answer.view(), target, level.window, self.agreement);
                    votes.add((y, x), change.view());
                    asked += 1;
                    if observe(asked, all).is_break() {
                        return Ok(None);
                    }
                }
            }
            let (mean, spread) = votes.count();
            current.zip_mut_with(&mean, |c, m| *c += self.trust as f32 * m);
            variance += &spread;
        }
        let width = current.ncols() as f64;
        let mut touched = current.clone();
        if self.sharpen > 0.0 {
            touched = finish::sharpened(touched, self.sharpen_width * width, self.sharpen);
        }
        if self.snap_width > 0.0 {
            touched = finish::snapped(touched.view(), image, self.snap_width * width, self.snap_colour);
        }
        let found = &current - &space.values(&start);
        finish::allow(&mut current, &touched, found.view(), DETAIL * width);
        let mut consensus = start;
        Zip::from(&mut consensus.map).and(&consensus.valid).and(&current).for_each(|value, &valid, &c| {
            if valid {
                *value = space.back(c);
            }
        });
        let spread = variance.mapv(|v| space.unscaled(v.max(0.0).sqrt()));
        Ok(Some(Evidence { prior, consensus, spread, questions: asked }))
    }
}

/// What `answer` says, brought to the gauge of `reference`: the local regression above, once, with the whole picture as its crop.
/// Both are positive depths `[height, width]`, 0 where missing; the result is missing where the answer is.
///
/// The reference gives the low frequencies, the answer the detail, as far as they agree (`agreement` is \\(q\\)); `window` is the
/// window's standard deviation as a share of the sides. Where the reference is missing, the answer stands, scaled as a whole.
///
/// # Errors
/// [`Error::Input`] for maps of two sizes, or where they have no pixel in common.
pub fn regressed(
    answer: ArrayView2<'_, f32>,
    reference: ArrayView2<'_, f32>,
    window: f64,
    agreement: f64,
) -> Result<Array2<f32>> {
    if answer.dim() != reference.dim() {
        let reason = format!(
            "the answer is {:?} but the reference {:?}; give one size",
            answer.dim(),
            reference.dim()
        );
        return Err(Error::Input(reason));
    }
    let known = answer.iter().zip(&reference).filter(|(a, r)| **a > 0.0 && **r > 0.0);
    let mut ratios: Vec<f32> = known.map(|(a, r)| (r / a).ln()).collect();
    ratios.sort_unstable_by(f32::total_cmp);
    let Some(&scale) = ratios.get(ratios.len() / 2) else {
        return Err(Error::Input(
            "answer and reference have no pixel in common; give maps that overlap".into(),
        ));
    };
    let logs = answer.mapv(|a| if a > 0.0 { a.ln() + scale } else { 0.0 });
    let target = Zip::from(&logs).and(reference).map_collect(|&l, &r| if r > 0.0 { r.ln() } else { l });
    let change = regression::change(logs.view(), target.view(), window, agreement);
    Ok(Zip::from(answer).and(&target).and(&change).map_collect(
        |&a, &t, &c| {
            if a > 0.0 { (t + c).exp() } else { 0.0 }
        },
    ))
}

impl Evidence {
    /// The spread as a fraction of the depth \\(z\\), `[height, width]`, where `depth` is the consensus as depth: the spread
    /// of \\(\ln z\\) itself, or \\(z \alpha\\) times that of disparities with \\(1/z = \alpha d + \beta\\).
    ///
    /// # Errors
    /// [`Error::Input`] where the sizes differ.
    pub fn relative_spread(&self, depth: ArrayView2<'_, f32>) -> Result<Array2<f32>> {
        if depth.dim() != self.spread.dim() {
            let reason = format!(
                "the depth is {:?} but the spread {:?}; give one size",
                depth.dim(),
                self.spread.dim()
            );
            return Err(Error::Input(reason));
        }
        if self.consensus.kind.is_depth() {
            return Ok(self.spread.clone());
        }
        let pairs = || {
            let known = depth.iter().zip(&self.consensus.map).filter(|(z, _)| **z > 0.0);
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

    /// The consensus as positive depth, `[height, width]`, in the gauge that the rule gives to the first answer: ends of its
    /// own would stretch all of it for the sake of a few sharper pixels. 0 where missing.
    ///
    /// # Errors
    /// Those of [`PriorDepth::to_depth_as`].
    pub fn depth(&self, rule: &DisparityRule) -> Result<Array2<f32>> {
        self.consensus.to_depth_as(&self.prior, rule)
    }
}

/// The model's answer about a crop or its mirror image, turned back, as values to regress on.
fn ask(model: &dyn DepthPrior, crop: ArrayView3<'_, f32>, mirror: bool, space: Space) -> Result<Array2<f32>> {
    let answer = if mirror {
        model.predict(crop.slice(s![.., ..;-1, ..]).to_owned().view())?
    } else {
        // A model may want contiguous rows.
        model.predict(crop.to_owned().view())?
    };
    let (height, width, _) = crop.dim();
    if answer.map.dim() != (height, width) || answer.kind != space.kind {
        return Err(Error::Input(format!(
            "asked about a crop of {width}x{height}, the model gave {} of {}x{}; it can't be asked again",
            answer.kind,
            answer.map.ncols(),
            answer.map.nrows()
        )));
    }
    let values = space.values(&answer);
    Ok(if mirror { values.slice(s![.., ..;-1]).to_owned() } else { values })
}

/// Where answers are compared: the logarithm of depth, or disparity with the spread that log depth has in a room.
#[derive(Clone, Copy)]
struct Space {
    kind: DepthKind,
    scale: f32,
}

/// Standard deviation of log depth in a room: what disparities are scaled to.
const ROOM: f64 = 0.3;

impl Space {
    fn of(prior: &PriorDepth) -> Self {
        if prior.kind.is_depth() {
            return Self { kind: prior.kind, scale: 1.0 };
        }
        let known = || prior.map.iter().zip(&prior.valid).filter(|(_, v)| **v).map(|(d, _)| f64::from(*d));
        let count = known().count().max(1) as f64;
        let mean = known().sum::<f64>() / count;
        let deviation = (known().map(|d| (d - mean).powi(2)).sum::<f64>() / count).sqrt();
        Self { kind: prior.kind, scale: if deviation > 0.0 { (ROOM / deviation) as f32 } else { 1.0 } }
    }

    /// What is missing takes part as the mean.
    fn values(self, answer: &PriorDepth) -> Array2<f32> {
        let value = |d: f32| if self.kind.is_depth() { d.ln() } else { self.scale * d };
        let pairs = || answer.map.iter().zip(&answer.valid).filter(|(_, v)| **v);
        let mean = pairs().map(|(d, _)| f64::from(value(*d))).sum::<f64>() / pairs().count().max(1) as f64;
        Zip::from(&answer.map).and(&answer.valid).map_collect(|&d, &v| if v { value(d) } else { mean as f32 })
    }

    fn back(self, value: f32) -> f32 {
        if self.kind.is_depth() { value.exp().clamp(f32::MIN_POSITIVE, f32::MAX) } else { value / self.scale }
    }

    fn unscaled(self, spread: f32) -> f32 {
        if self.kind.is_depth() { spread } else { spread / self.scale }
    }
}

#[cfg(test)]
mod tests;
