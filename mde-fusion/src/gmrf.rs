//! A posterior over whole maps: depths from one source, differences between neighbours from another.

use crate::{BayesFuser, Error, Fused, Fuser, FusionConfig, Prior, Result, Warning};
use faer::prelude::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, ArrayView2};
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

/// Systems that are solved together for the variances.
const TOGETHER: usize = 8;

/// How sure the two sources of [`gradient_posterior`] are.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct GradientConfig {
    /// Standard deviation of the depth where it states none (variance 0), as a fraction of the depth.
    pub depth_sigma: f64,
    /// Standard deviation of a difference between neighbours, as a fraction of their depth.
    pub step_sigma: f64,
    /// The same as a fraction of the difference itself: a high step's place is not certain to the pixel.
    pub edge_sigma: f64,
    /// Draws from the posterior that the variances are the mean squares of; 0 leaves the variances of the depth.
    pub draws: usize,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for GradientConfig {
    /// Gradients rule below some 20 pixels (the ratio of the two sigmas), depths above.
    fn default() -> Self {
        Self { depth_sigma: 0.1, step_sigma: 0.005, edge_sigma: 0.25, draws: 32, seed: 0 }
    }
}

impl GradientConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] with the field at fault and what to write instead.
    pub fn validate(&self) -> Result<()> {
        let share = |field, value: f64, least: f64| match value >= least && value < 1.0 {
            true => Ok(()),
            false => Err(Error::Config { field, value, remedy: "take a fraction from 0.0001 to below 1" }),
        };
        share("gradient.depth-sigma", self.depth_sigma, 1e-4)?;
        share("gradient.step-sigma", self.step_sigma, 1e-4)?;
        share("gradient.edge-sigma", self.edge_sigma, 0.0)?;
        match self.draws {
            0..=10_000 => Ok(()),
            many => Err(Error::Config {
                field: "gradient.draws",
                value: many as f64,
                remedy: "take 0 to 10000, such as 32",
            }),
        }
    }
}

/// The posterior of a Gaussian Markov random field: low frequencies from `depth`, steps between neighbours from `detail`.
///
/// \\[ p(x) \propto \exp -\tfrac12 \Bigl( \sum_i \frac{(x_i - d_i)^2}{\sigma_i^2}
///    {}+ \sum_{i \sim j} \frac{\bigl((x_i - x_j) - (e_i - e_j)\bigr)^2}{\tau_{ij}^2} \Bigr),\qquad
///    \tau_{ij}^2 = \bigl(\kappa\,\tfrac{e_i + e_j}{2}\bigr)^2 + \bigl(\eta\,(e_i - e_j)\bigr)^2, \\]
///
/// with \\(d, \sigma\\) the depth and its standard deviation, \\(e\\) the detail, \\(\kappa\\) the
/// [`step_sigma`](GradientConfig::step_sigma), \\(\eta\\) the [`edge_sigma`](GradientConfig::edge_sigma), over the four neighbours of each
/// pixel (a screened Poisson equation; Bhat et al., GradientShop, 2010). The mean is one solution by sparse Cholesky. The variances are
/// mean squares of exact draws from the posterior (perturb and optimise: each term's residual gets noise of its own variance), so
/// with \\(n\\) draws a standard deviation is known to \\(1/\sqrt{2n}\\) of itself.
///
/// All maps are `[height, width]`. A pixel that the depth misses is filled in by the detail's steps, one that both miss stays
/// missing; where only the detail is missing, nothing ties the pixel to its neighbours.
///
/// # Errors
/// [`Error::Config`], [`Error::Shape`], or [`Error::System`] where the system cannot be solved (out of memory).
///
/// ```
/// use mde_fusion::gmrf::{GradientConfig, gradient_posterior};
/// use mde_fusion::{GaussianDepth, ndarray::Array2};
///
/// // A depth that knows the level, and a detail that knows the step but is a metre off.
/// let level = Array2::from_elem((4, 10), 2.5);
/// let step = Array2::from_shape_fn((4, 10), |(_, x)| if x < 5 { 3.0 } else { 4.0 });
/// let depth = GaussianDepth::new(level, Array2::from_elem((4, 10), 0.3))?;
/// let detail = GaussianDepth::new(step, Array2::from_elem((4, 10), 0.0))?;
/// let config = GradientConfig { edge_sigma: 0.0, ..GradientConfig::default() };
/// let both = gradient_posterior(&depth, detail.mean(), &config)?;
/// let (left, right) = (both.mean()[(2, 0)], both.mean()[(2, 9)]);
/// assert!((right - left - 1.0).abs() < 0.02 && (0.5 * (left + right) - 2.5).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn gradient_posterior(
    depth: &GaussianDepth,
    detail: ArrayView2<'_, f32>,
    config: &GradientConfig,
) -> Result<GaussianDepth> {
    config.validate()?;
    let (height, width) = depth.dim();
    if detail.dim() != (height, width) {
        let found = [detail.nrows(), detail.ncols()];
        return Err(Error::Shape { view: 0, expected: [height, width], found });
    }
    let field = Field::new(depth, detail, config);
    if field.pixels.is_empty() {
        return Ok(GaussianDepth::missing(height, width));
    }
    let factor = field.matrix()?.sp_cholesky(Side::Lower).map_err(|e| Error::System(format!("{e:?}")))?;
    let mean = factor.solve(&field.right(|_| 0.0));
    let mut squares = vec![0.0_f64; field.pixels.len()];
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(config.seed);
    for first in (0..config.draws).step_by(TOGETHER) {
        let columns = TOGETHER.min(config.draws - first);
        let noise = field.noise(columns, &mut rng);
        let draws = factor.solve(&noise);
        for (row, square) in squares.iter_mut().enumerate() {
            *square += (0..columns).map(|column| draws[(row, column)].powi(2)).sum::<f64>();
        }
    }
    let (mut out, mut variance) =
        (Array2::zeros((height, width)), Array2::from_elem((height, width), f32::INFINITY));
    for (row, &pixel) in field.pixels.iter().enumerate() {
        let value = mean[(row, 0)] as f32;
        let stated = match config.draws {
            0 => depth.variance()[pixel],
            draws => (squares[row] / draws as f64) as f32,
        };
        // A level below zero is no depth.
        if value > 0.0 && value.is_finite() {
            out[pixel] = value;
            variance[pixel] = stated.max(f32::MIN_POSITIVE);
        }
    }
    Ok(GaussianDepth::new(out, variance)?)
}

/// The terms of the energy over the pixels that something is known of.
struct Field {
    pixels: Vec<(usize, usize)>,
    /// Depth and precision of each; precision 0 where it is missing.
    levels: Vec<(f64, f64)>,
    /// Two rows, the step from the second to the first, its precision.
    steps: Vec<(usize, usize, f64, f64)>,
}

impl Field {
    fn new(depth: &GaussianDepth, detail: ArrayView2<'_, f32>, config: &GradientConfig) -> Self {
        let known = |pixel: (usize, usize)| detail.get(pixel).copied().filter(|e| *e > 0.0 && e.is_finite());
        let level = |pixel: (usize, usize)| depth.get(pixel.0, pixel.1).filter(|(d, _)| *d > 0.0);
        let reached = reached(depth.dim(), &level, &known);
        let mut rows = Array2::from_elem(depth.dim(), usize::MAX);
        let (mut pixels, mut levels) = (Vec::new(), Vec::new());
        for (pixel, row) in rows.indexed_iter_mut() {
            if !reached[pixel] {
                continue;
            }
            *row = pixels.len();
            pixels.push(pixel);
            levels.push(level(pixel).map_or((0.0, 0.0), |(d, variance)| {
                let (d, variance) = (f64::from(d), f64::from(variance));
                let variance = if variance > 0.0 { variance } else { (config.depth_sigma * d).powi(2) };
                (d, 1.0 / variance.max(1e-12 * d * d))
            }));
        }
        let mut steps = Vec::new();
        for (row, &(y, x)) in pixels.iter().enumerate() {
            for other in [(y + 1, x), (y, x + 1)] {
                let Some(&there) = rows.get(other).filter(|row| **row != usize::MAX) else { continue };
                if let (Some(e), Some(f)) = (known((y, x)), known(other)) {
                    let (e, f) = (f64::from(e), f64::from(f));
                    let (step, middle) = (e - f, 0.5 * (e + f));
                    let variance = (config.step_sigma * middle).powi(2) + (config.edge_sigma * step).powi(2);
                    steps.push((row, there, step, 1.0 / variance));
                }
            }
        }
        Self { pixels, levels, steps }
    }

    fn matrix(&self) -> Result<SparseColMat<usize, f64>> {
        let mut diagonal: Vec<f64> = self.levels.iter().map(|(_, precision)| *precision).collect();
        let mut entries = Vec::with_capacity(self.levels.len() + self.steps.len());
        for &(row, other, _, precision) in &self.steps {
            diagonal[row] += precision;
            diagonal[other] += precision;
            entries.push(Triplet::new(row.max(other), row.min(other), -precision));
        }
        entries.extend(diagonal.iter().enumerate().map(|(row, d)| Triplet::new(row, row, *d)));
        let size = self.pixels.len();
        SparseColMat::try_new_from_triplets(size, size, &entries).map_err(|e| Error::System(format!("{e:?}")))
    }

    /// The right side whose solution is the mean, each term's value moved by a number of standard deviations.
    fn right(&self, mut moved: impl FnMut(usize) -> f64) -> Mat<f64> {
        let mut right: Vec<f64> = self
            .levels
            .iter()
            .enumerate()
            .map(|(term, (d, precision))| precision * d + precision.sqrt() * moved(term))
            .collect();
        for (term, &(row, other, step, precision)) in self.steps.iter().enumerate() {
            let pull = precision * step + precision.sqrt() * moved(self.levels.len() + term);
            right[row] += pull;
            right[other] -= pull;
        }
        Mat::from_fn(right.len(), 1, |row, _| right[row])
    }

    /// Right sides whose solutions are draws from the posterior, less its mean.
    fn noise(&self, columns: usize, rng: &mut Xoshiro256PlusPlus) -> Mat<f64> {
        let mut sides = Mat::zeros(self.pixels.len(), columns);
        for column in 0..columns {
            for (row, (_, precision)) in self.levels.iter().enumerate() {
                let draw: f64 = StandardNormal.sample(rng);
                sides[(row, column)] += precision.sqrt() * draw;
            }
            for &(row, other, _, precision) in &self.steps {
                let draw: f64 = StandardNormal.sample(rng);
                let pull = precision.sqrt() * draw;
                sides[(row, column)] += pull;
                sides[(other, column)] -= pull;
            }
        }
        sides
    }
}

/// Pixels that steps of the detail join to one with a level, and those.
fn reached(
    (height, width): (usize, usize),
    level: &dyn Fn((usize, usize)) -> Option<(f32, f32)>,
    known: &dyn Fn((usize, usize)) -> Option<f32>,
) -> Array2<bool> {
    let mut reached = Array2::from_elem((height, width), false);
    let mut front: Vec<(usize, usize)> =
        ndarray::indices((height, width)).into_iter().filter(|&pixel| level(pixel).is_some()).collect();
    front.iter().for_each(|&pixel| reached[pixel] = true);
    while let Some((y, x)) = front.pop() {
        if known((y, x)).is_none() {
            continue;
        }
        for other in [(y.wrapping_sub(1), x), (y + 1, x), (y, x.wrapping_sub(1)), (y, x + 1)] {
            if reached.get(other) == Some(&false) && known(other).is_some() {
                reached[other] = true;
                front.push(other);
            }
        }
    }
    reached
}

/// [`BayesFuser`] up to Eq. 15, then [`gradient_posterior`] in the place of Eq. 16-17: the prior's depths, the views' steps.
///
/// In its report, `nerf_weight` is the share of the prior's pixels at which the views know a depth, and so steps.
#[derive(Debug, Clone)]
pub struct GradientFuser {
    bayes: BayesFuser,
    config: GradientConfig,
    common_error: f64,
}

impl GradientFuser {
    /// A fuser that brings the views to the prior's scale as `fusion` says.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub fn new(fusion: FusionConfig, config: GradientConfig) -> Result<Self> {
        config.validate()?;
        Ok(Self { common_error: fusion.common_error, bayes: BayesFuser::new(fusion)?, config })
    }
}

impl Fuser for GradientFuser {
    fn fuse(&self, prior: &Prior, evidence: &[GaussianDepth]) -> Result<Fused> {
        let mut fused = self.bayes.fuse(prior, evidence)?;
        let depth = GaussianDepth::new(
            prior.mean().to_owned(),
            match prior.variance() {
                Some(variance) => variance.to_owned(),
                None => prior.mean().mapv(|d| if d > 0.0 { 0.0 } else { f32::INFINITY }),
            },
        )?;
        let known = prior.mean().iter().filter(|d| **d > 0.0).count().max(1) as f64;
        let stepped =
            fused.aligned.support().iter().zip(prior.mean()).filter(|(s, d)| **s && **d > 0.0).count();
        fused.report.nerf_weight = stepped as f64 / known;
        fused.report.sigma_o_clamped = false;
        // What Eq. 16 would do with them does not happen.
        let pixelwise = |w: &Warning| matches!(w, Warning::PriorTakenAsExact | Warning::NotPositive { .. });
        fused.report.warnings.retain(|warning| !pixelwise(warning));
        let share = self.common_error as f32;
        let posterior = gradient_posterior(&depth, fused.aligned.mean(), &self.config)?;
        fused.depth = posterior.map(|mean, variance| (mean, variance + (share * mean).powi(2)));
        Ok(fused)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::proptest::prelude::*;

    fn sure(map: Array2<f32>, relative: f32) -> GaussianDepth {
        let variance = map.mapv(|d| if d > 0.0 { (relative * d).powi(2) } else { f32::INFINITY });
        GaussianDepth::new(map, variance).unwrap()
    }

    fn ramp(height: usize, width: usize) -> Array2<f32> {
        Array2::from_shape_fn((height, width), |(y, x)| 2.0 + 0.1 * x as f32 + 0.05 * y as f32)
    }

    #[test]
    fn what_agrees_stays_and_gets_surer() {
        let depth = sure(ramp(8, 9), 0.1);
        let config = GradientConfig { draws: 400, ..GradientConfig::default() };
        let both = gradient_posterior(&depth, depth.mean(), &config).unwrap();
        for (pixel, before) in depth.mean().indexed_iter() {
            assert!((both.mean()[pixel] - before).abs() < 1e-5);
            assert!(both.variance()[pixel] < 0.5 * depth.variance()[pixel]);
        }
    }

    /// One row of two pixels has its posterior in closed form.
    #[test]
    fn two_pixels_by_hand() {
        let depth = GaussianDepth::new(ndarray::array![[2.0, 3.0]], ndarray::array![[0.04, 0.09]]).unwrap();
        let detail = ndarray::array![[2.0_f32, 2.2]];
        let config = GradientConfig { draws: 10_000, ..GradientConfig::default() };
        let both = gradient_posterior(&depth, detail.view(), &config).unwrap();
        let step = 1.0 / ((0.005_f64 * 2.1).powi(2) + (0.25_f64 * 0.2).powi(2));
        let (p, q) = (1.0 / 0.04 + step, 1.0 / 0.09 + step);
        let (b, c) = (2.0 / 0.04 - 0.2 * step, 3.0 / 0.09 + 0.2 * step);
        let determinant = p * q - step * step;
        let expected = [(q * b + step * c) / determinant, (p * c + step * b) / determinant];
        let variances = [q / determinant, p / determinant];
        for x in 0..2 {
            let (mean, variance) = both.get(0, x).unwrap();
            assert!((f64::from(mean) - expected[x]).abs() < 1e-5, "{mean} {}", expected[x]);
            assert!((f64::from(variance) / variances[x] - 1.0).abs() < 0.06, "{variance} {}", variances[x]);
        }
    }

    #[test]
    fn steps_fill_what_the_depth_misses_and_nothing_else() {
        let exact = ramp(6, 12);
        let (mut level, mut detail) = (exact.clone(), exact.mapv(|d| d + 0.7));
        level.slice_mut(ndarray::s![.., 4..]).fill(0.0);
        detail.slice_mut(ndarray::s![.., 9..]).fill(0.0);
        let config = GradientConfig::default();
        let both = gradient_posterior(&sure(level, 0.05), detail.view(), &config).unwrap();
        for (pixel, exact) in exact.indexed_iter() {
            if pixel.1 < 9 {
                assert!((both.mean()[pixel] - exact).abs() < 0.02, "{pixel:?}");
            } else {
                assert!(both.is_missing(pixel.0, pixel.1));
            }
        }
        assert!(both.variance()[(3, 8)] > both.variance()[(3, 1)]);
        let nothing =
            gradient_posterior(&GaussianDepth::missing(3, 4), Array2::zeros((3, 4)).view(), &config);
        assert!(nothing.unwrap().support().iter().all(|known| !known));
    }

    #[test]
    fn bad_input_is_named() {
        let depth = sure(ramp(3, 4), 0.1);
        let config = GradientConfig::default();
        let other = Array2::ones((4, 3));
        assert!(matches!(gradient_posterior(&depth, other.view(), &config), Err(Error::Shape { .. })));
        for bad in [
            GradientConfig { step_sigma: 0.0, ..config.clone() },
            GradientConfig { depth_sigma: f64::NAN, ..config.clone() },
            GradientConfig { edge_sigma: -1.0, ..config.clone() },
            GradientConfig { draws: 1_000_000, ..config },
        ] {
            assert!(matches!(gradient_posterior(&depth, depth.mean(), &bad), Err(Error::Config { .. })));
        }
    }

    /// Views that know the edge and a prior that knows the rest.
    #[test]
    fn the_fuser_takes_the_views_steps_and_the_prior_s_depths() {
        let exact = Array2::from_shape_fn((12, 30), |(_, x)| if x < 15 { 2.0 } else { 3.0 });
        let soft = Array2::from_shape_fn((12, 30), |(_, x)| 2.5 + 0.5 * ((x as f32 - 14.5) / 4.0).tanh());
        let config = FusionConfig { common_error: 0.05, ..FusionConfig::robust() };
        let fuser = GradientFuser::new(config, GradientConfig::default()).unwrap();
        let views = [sure(exact.mapv(|d| 1.3 * d), 0.02)];
        let fused = fuser.fuse(&Prior::new(soft.clone()).unwrap(), &views).unwrap();
        let error = |map: ArrayView2<'_, f32>| (&map - &exact).mapv(|e| e * e).sum();
        assert!(error(fused.depth.mean()) < 0.3 * error(soft.view()));
        assert_eq!(fused.report.nerf_weight, 1.0);
        assert!(fused.depth.sigma().iter().zip(&fused.depth.mean()).all(|(s, d)| *s >= 0.0499 * d));
        let alone = fuser.fuse(&Prior::new(soft.clone()).unwrap(), &[]).unwrap();
        assert!(alone.depth.mean().iter().zip(&soft).all(|(a, b)| (a - b).abs() < 1e-5));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// A constant added to the detail changes nothing; a scale of everything scales the result.
        #[test]
        fn the_detail_s_level_does_not_matter(shift in 0.0..3.0_f32, scale in 0.1..10.0_f32, seed in 0..1000_u64) {
            let wave = |x: usize, y: usize| ((seed as f32 + 1.3 * x as f32) * 0.7 + y as f32).sin();
            let depth = sure(ramp(6, 7), 0.1);
            let detail = Array2::from_shape_fn((6, 7), |(y, x)| 2.0 + 0.3 * wave(x, y));
            let config = GradientConfig { draws: 0, step_sigma: 0.02, ..GradientConfig::default() };
            let of = |depth: &GaussianDepth, detail: &Array2<f32>| gradient_posterior(depth, detail.view(), &config).unwrap();
            let first = of(&depth, &detail);
            let scaled = of(&depth.clone().map(|d, v| (scale * d, scale * scale * v)), &detail.mapv(|e| scale * e));
            for (a, b) in first.mean().iter().zip(&scaled.mean()) {
                prop_assert!((scale * a - b).abs() < 1e-3 * scale, "{a} {b}");
            }
            // The steps' sigma follows the detail's depth, so only equal sigmas show it.
            let flat = GradientConfig { step_sigma: 1e-4, edge_sigma: 0.0, ..config.clone() };
            let base = gradient_posterior(&depth, detail.view(), &flat).unwrap();
            let moved = gradient_posterior(&depth, detail.mapv(|e| e + shift).view(), &flat).unwrap();
            for (a, b) in base.mean().iter().zip(&moved.mean()) {
                prop_assert!((a - b).abs() < 0.02, "{a} {b}");
            }
        }

        #[test]
        fn the_result_is_positive_finite_and_sure(gap in 0..5_usize, level in 0.01..100.0_f32) {
            let mut depth = ramp(5, 6).mapv(|d| level * d);
            depth.slice_mut(ndarray::s![.., ..gap]).fill(0.0);
            let detail = ramp(5, 6).mapv(|d| level * (4.5 - d).max(0.1));
            let both = gradient_posterior(&sure(depth, 0.2), detail.view(), &GradientConfig::default()).unwrap();
            for (mean, variance) in both.mean().iter().zip(&both.variance()) {
                prop_assert!(*variance > 0.0 && mean.is_finite());
                prop_assert!(variance.is_infinite() || *mean > 0.0);
            }
        }
    }
}
