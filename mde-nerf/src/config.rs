use crate::{Error, Result};
use mde_uncertainty::termination::InBinVariance;

const MOST_STEPS: usize = 1_000_000;

/// Everything about a field: its network, how it is trained, sampled and rendered.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct NerfConfig {
    /// The network.
    pub field: FieldConfig,
    /// Where a ray is sampled.
    pub sampling: SamplingConfig,
    /// Optimisation and losses.
    pub train: TrainConfig,
    /// Rendering.
    pub render: RenderConfig,
}

/// The network behind the field.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(tag = "kind", rename_all = "kebab-case")
)]
pub enum FieldConfig {
    /// A light MLP on a frequency encoding, as the paper uses.
    Mlp(MlpFieldConfig),
    /// A multiresolution hash grid with small MLPs.
    Hash(HashFieldConfig),
}

impl Default for FieldConfig {
    fn default() -> Self {
        Self::Mlp(MlpFieldConfig::default())
    }
}

/// An MLP on a frequency encoding.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct MlpFieldConfig {
    /// Hidden layers.
    pub layers: usize,
    /// Width of each.
    pub width: usize,
    /// Octaves of the encoding an axis.
    pub frequencies: usize,
}

impl Default for MlpFieldConfig {
    fn default() -> Self {
        Self { layers: 4, width: 128, frequencies: 10 }
    }
}

/// A multiresolution hash grid with small MLPs.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct HashFieldConfig {
    /// Grids.
    pub levels: usize,
    /// Features a row: 1, 2, 4 or 8.
    pub features: usize,
    /// Logarithm (base 2) of the most rows a grid has.
    pub log2_rows: u32,
    /// Cells a side of the coarsest grid.
    pub coarsest: u32,
    /// Cells a side of the finest grid.
    pub finest: u32,
    /// Hidden layers of the density network (and of the only one, where `geometry` is 0).
    pub layers: usize,
    /// Width of the hidden layers.
    pub width: usize,
    /// Outputs of the density network that feed a colour network with one hidden layer; 0 for a single network.
    pub geometry: usize,
    /// Coarsest grids that alone say where matter is, while a network of its own sees all of them for the colour: surfaces
    /// cannot follow what only the fine grids tell apart, such as texture. 0: one network sees all and says both.
    pub density_levels: usize,
}

impl Default for HashFieldConfig {
    fn default() -> Self {
        Self {
            levels: 8,
            features: 4,
            log2_rows: 16,
            coarsest: 16,
            finest: 640,
            layers: 2,
            width: 32,
            geometry: 0,
            density_levels: 0,
        }
    }
}

/// How positions are spread along a ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Spacing {
    /// Uniform in depth.
    Depth,
    /// Uniform in disparity 1/z: equal steps of parallax.
    #[default]
    Disparity,
}

/// Where a ray is sampled.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct SamplingConfig {
    /// Samples over the whole range of a training ray, stratified.
    pub coarse: usize,
    /// Samples in a band around the ray's depth hypothesis, stratified; over the whole range for a ray without one.
    pub band: usize,
    /// Half width of that band, as a fraction of the depth.
    pub band_width: f64,
    /// Samples drawn where the first ones found weight.
    pub fine: usize,
    /// Spread over the range.
    pub spacing: Spacing,
    /// Nearest depth; from the hypotheses where not given (0.8 times their 0.5 % quantile).
    pub near: Option<f64>,
    /// Farthest depth; from the hypotheses where not given (1.25 times their 99.5 % quantile).
    pub far: Option<f64>,
}

impl Default for SamplingConfig {
    fn default() -> Self {
        Self {
            coarse: 24,
            band: 0,
            band_width: 0.25,
            fine: 24,
            spacing: Spacing::Disparity,
            near: None,
            far: None,
        }
    }
}

/// Supervision by the views' depth hypotheses.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")
)]
pub enum DepthLoss {
    /// None: the paper's field sees colours only.
    #[default]
    None,
    /// \\(\tfrac12\bigl(\ln \sigma_r^2 + (\mu_r - D)^2 / \sigma_r^2\bigr)\\), only where the field is outside the
    /// hypothesis' own uncertainty: \\(|\mu_r - D| > s\\) or \\(\sigma_r^2 > s^2\\) (Roessle et al., 2022).
    GaussianNll {
        /// Factor before the loss, lengths in units of the scene's median depth.
        weight: f64,
        /// Standard deviation of a hypothesis as a fraction of its depth, where it states none (variance 0).
        relative_sigma: f64,
        /// Fraction of the steps after which the loss is off; it decays linearly until then. 0: never.
        decay: f64,
    },
    /// \\(\sum_i w_i |r_i - r|\\) in disparity scaled to 0 at far and 1 at near: the first Wasserstein distance
    /// between the ray's termination and the hypothesis.
    Wasserstein {
        /// Factor before the loss.
        weight: f64,
        /// Fraction of the steps after which the loss is off; it decays linearly until then. 0: never.
        decay: f64,
    },
    /// \\(\int |W(r) - F(r)|\,\mathrm dr\\) in the same disparity: the first Wasserstein distance between the ray's termination, of
    /// distribution function \\(W\\), and the mixture \\(F\\) of *all* its hypotheses, each a logistic distribution of its own mean and
    /// variance. Where hypotheses disagree the termination becomes as wide as they are apart; [`Wasserstein`](Self::Wasserstein)
    /// would draw it together at their median.
    Distribution {
        /// Factor before the loss.
        weight: f64,
        /// Standard deviation of a hypothesis as a fraction of its depth, where it states none (variance 0).
        relative_sigma: f64,
        /// Fraction of the steps after which the loss is off; it decays linearly until then. 0: never.
        decay: f64,
    },
}

/// Depth that is smooth where the picture is: \\(\lambda\, e^{-\lVert I_p - I_q \rVert / \kappa}\, |\ln \mu_p - \ln \mu_q|\\) for
/// neighbouring pixels \\(p, q\\) of a view (Godard et al., 2017, Eq. 3, of the logarithm: scales play no part).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct SmoothnessConfig {
    /// Factor before the loss, \\(\lambda\\); 0 for none. Otherwise every second ray is a neighbour of the ray before it.
    pub weight: f64,
    /// \\(\kappa\\): a difference of colours (Euclidean, sRGB in 0 to 1) at which the loss counts \\(1/e\\).
    pub contrast: f64,
}

impl Default for SmoothnessConfig {
    fn default() -> Self {
        Self { weight: 0.0, contrast: 0.1 }
    }
}

/// Optimisation and losses.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct TrainConfig {
    /// Optimisation steps.
    pub steps: usize,
    /// Pixels of the original view up to which that is enough: a larger one gets more in proportion. 0: whatever the size.
    pub steps_for: usize,
    /// Rays a step.
    pub rays: usize,
    /// Share of the rays that the original view gets; the others share the rest.
    pub original_share: f64,
    /// Adam's rate after the warm-up.
    pub learning_rate: f64,
    /// Its rate at the last step; exponential in between.
    pub final_learning_rate: f64,
    /// Steps over which the rate rises from 0.
    pub warm_up: usize,
    /// Adam's decay of the first moment.
    pub beta1: f64,
    /// Adam's decay of the second moment.
    pub beta2: f64,
    /// Adam's epsilon.
    pub epsilon: f64,
    /// Decay a step of the moving average of the parameters that the fit returns; 0 for none.
    pub average: f64,
    /// Depth supervision.
    pub depth_loss: DepthLoss,
    /// Edge-aware smoothness.
    pub smoothness: SmoothnessConfig,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            steps: 2000,
            steps_for: 0,
            rays: 1024,
            original_share: 0.3,
            learning_rate: 5e-3,
            final_learning_rate: 5e-4,
            warm_up: 100,
            beta1: 0.9,
            beta2: 0.99,
            epsilon: 1e-15,
            average: 0.95,
            depth_loss: DepthLoss::None,
            smoothness: SmoothnessConfig::default(),
        }
    }
}

/// Rendering.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct RenderConfig {
    /// Samples over the whole range of a ray.
    pub coarse: usize,
    /// Samples where those found weight.
    pub fine: usize,
    /// What a bin's extent adds to the variance.
    pub in_bin: InBinVariance,
    /// Opacity below which a ray's depth counts as missing.
    pub min_opacity: f32,
}

impl Default for RenderConfig {
    fn default() -> Self {
        Self { coarse: 32, fine: 32, in_bin: InBinVariance::Midpoint, min_opacity: 0.5 }
    }
}

impl NerfConfig {
    /// Checks every value.
    ///
    /// # Errors
    /// [`Error::Config`] with the first field that is out of range.
    pub fn validate(&self) -> Result<()> {
        self.field.validate()?;
        self.sampling.validate()?;
        self.train.validate()?;
        check(
            (2..=1024).contains(&self.render.coarse),
            "render.coarse",
            self.render.coarse,
            "give 2 to 1024 samples",
        )?;
        check(self.render.fine <= 1024, "render.fine", self.render.fine, "give at most 1024 samples")?;
        check(
            (0.0..1.0).contains(&self.render.min_opacity),
            "render.min-opacity",
            self.render.min_opacity,
            "give a number from 0 to below 1",
        )
    }
}

impl FieldConfig {
    fn validate(&self) -> Result<()> {
        match self {
            Self::Mlp(f) => {
                check((1..=16).contains(&f.layers), "field.layers", f.layers, "give 1 to 16 hidden layers")?;
                check((1..=1024).contains(&f.width), "field.width", f.width, "give a width of 1 to 1024")?;
                check(f.frequencies <= 16, "field.frequencies", f.frequencies, "give at most 16 octaves")
            }
            Self::Hash(f) => {
                check((1..=24).contains(&f.levels), "field.levels", f.levels, "give 1 to 24 grids")?;
                check([1, 2, 4, 8].contains(&f.features), "field.features", f.features, "give 1, 2, 4 or 8")?;
                check((4..=24).contains(&f.log2_rows), "field.log2-rows", f.log2_rows, "give 4 to 24")?;
                check(
                    (1..=1 << 16).contains(&f.coarsest),
                    "field.coarsest",
                    f.coarsest,
                    "give 1 to 65536 cells",
                )?;
                check(
                    (f.coarsest..=1 << 16).contains(&f.finest),
                    "field.finest",
                    f.finest,
                    "give at least field.coarsest and at most 65536 cells",
                )?;
                check((1..=8).contains(&f.layers), "field.layers", f.layers, "give 1 to 8 hidden layers")?;
                check((1..=1024).contains(&f.width), "field.width", f.width, "give a width of 1 to 1024")?;
                check(f.geometry <= 256, "field.geometry", f.geometry, "give at most 256 outputs")?;
                check(
                    f.density_levels <= f.levels && (f.density_levels == 0 || f.geometry == 0),
                    "field.density-levels",
                    f.density_levels,
                    "give at most field.levels, and 0 where field.geometry is not 0",
                )
            }
        }
    }
}

impl SamplingConfig {
    fn validate(&self) -> Result<()> {
        let first = self.coarse + self.band;
        check(
            (2..=1024).contains(&first),
            "sampling.coarse + sampling.band",
            first,
            "give 2 to 1024 samples",
        )?;
        check(self.fine <= 1024, "sampling.fine", self.fine, "give at most 1024 samples")?;
        check(
            self.band_width > 0.0 && self.band_width < 1.0,
            "sampling.band-width",
            self.band_width,
            "give a fraction between 0 and 1",
        )?;
        if let Some(near) = self.near {
            check(near > 0.0 && near.is_finite(), "sampling.near", near, "give a positive depth")?;
        }
        if let Some(far) = self.far {
            let near = self.near.unwrap_or(0.0);
            check(far > near && far.is_finite(), "sampling.far", far, "give a depth beyond sampling.near")?;
        }
        Ok(())
    }
}

impl TrainConfig {
    /// The same for an original view of so many pixels.
    pub(crate) fn for_picture(&self, pixels: usize) -> Self {
        let more = match self.steps_for {
            0 => 1.0,
            enough => (pixels as f64 / enough as f64).max(1.0),
        };
        let steps = (self.steps as f64 * more).round().min(MOST_STEPS as f64) as usize;
        Self { steps, ..self.clone() }
    }

    fn validate(&self) -> Result<()> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let share = |x: f64| (0.0..=1.0).contains(&x);
        let decay = |x: f64| (0.0..1.0).contains(&x);
        check((1..=MOST_STEPS).contains(&self.steps), "train.steps", self.steps, "give 1 to 1000000 steps")?;
        check((16..=1 << 16).contains(&self.rays), "train.rays", self.rays, "give 16 to 65536 rays")?;
        check(
            share(self.original_share),
            "train.original-share",
            self.original_share,
            "give a share from 0 to 1",
        )?;
        check(
            positive(self.learning_rate),
            "train.learning-rate",
            self.learning_rate,
            "give a positive rate",
        )?;
        check(
            positive(self.final_learning_rate),
            "train.final-learning-rate",
            self.final_learning_rate,
            "give a positive rate",
        )?;
        check(decay(self.beta1), "train.beta1", self.beta1, "give a number from 0 to below 1")?;
        check(decay(self.beta2), "train.beta2", self.beta2, "give a number from 0 to below 1")?;
        check(positive(self.epsilon), "train.epsilon", self.epsilon, "give a small positive number")?;
        check(decay(self.average), "train.average", self.average, "give a number from 0 to below 1")?;
        check(
            self.smoothness.weight >= 0.0 && self.smoothness.weight.is_finite(),
            "train.smoothness.weight",
            self.smoothness.weight,
            "give 0 or more",
        )?;
        check(
            positive(self.smoothness.contrast),
            "train.smoothness.contrast",
            self.smoothness.contrast,
            "give a positive difference of colours",
        )?;
        match self.depth_loss {
            DepthLoss::None => Ok(()),
            DepthLoss::GaussianNll { weight, relative_sigma, decay }
            | DepthLoss::Distribution { weight, relative_sigma, decay } => {
                check(
                    weight >= 0.0 && weight.is_finite(),
                    "train.depth-loss.weight",
                    weight,
                    "give 0 or more",
                )?;
                check(
                    positive(relative_sigma),
                    "train.depth-loss.relative-sigma",
                    relative_sigma,
                    "give a positive fraction",
                )?;
                check(share(decay), "train.depth-loss.decay", decay, "give a fraction from 0 to 1")
            }
            DepthLoss::Wasserstein { weight, decay } => {
                check(
                    weight >= 0.0 && weight.is_finite(),
                    "train.depth-loss.weight",
                    weight,
                    "give 0 or more",
                )?;
                check(share(decay), "train.depth-loss.decay", decay, "give a fraction from 0 to 1")
            }
        }
    }
}

fn check(ok: bool, field: &'static str, value: impl ToString, remedy: &'static str) -> Result<()> {
    if ok { Ok(()) } else { Err(Error::Config { field, value: value.to_string(), remedy }) }
}
