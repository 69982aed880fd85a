use crate::{Error, Result};
use mde_uncertainty::termination::InBinVariance;

const MAX_STEPS: usize = 1_000_000;

/// Configuration of a field: network, sampling, training and rendering.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct NerfConfig {
    /// The network.
    pub field: FieldConfig,
    /// Sample positions along rays.
    pub sampling: SamplingConfig,
    /// Optimisation and losses.
    pub train: TrainConfig,
    /// Rendering.
    pub render: RenderConfig,
}

/// Architecture of the network.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(tag = "kind", rename_all = "kebab-case")
)]
pub enum FieldConfig {
    /// A light MLP on a frequency encoding, as in the paper.
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
    /// Number of hidden layers.
    pub layers: usize,
    /// Width of the hidden layers.
    pub width: usize,
    /// Octaves of the encoding per axis.
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
    /// Number of grids.
    pub levels: usize,
    /// Features per row: 1, 2, 4 or 8.
    pub features: usize,
    /// Base-2 logarithm of the largest number of rows per grid.
    pub log2_rows: u32,
    /// Cells per side of the coarsest grid.
    pub coarsest: u32,
    /// Cells per side of the finest grid.
    pub finest: u32,
    /// Hidden layers of the density network (of the only network where `geometry` is 0).
    pub layers: usize,
    /// Width of the hidden layers.
    pub width: usize,
    /// Outputs of the density network that feed a colour network with one hidden layer; 0 for a single network.
    pub geometry: usize,
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
        }
    }
}

/// The modelled volume. What lies outside is empty.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")
)]
pub enum VolumeConfig {
    /// The frustum of view 0 between near and far, wide enough for the frusta of all views. Every ray is sampled between
    /// near and far of its own camera. For views close to view 0, such as warps.
    #[default]
    Hull,
    /// The frustum of view 0 between near and far with a margin. Rays are clipped to it; valid pixels of the other views
    /// count only where their ray meets it and their hypothesis, if there is one, lies inside. For photographs.
    Reference {
        /// Margin on each side, as a fraction of the image's width and height; 0.06, not part of a file.
        #[cfg_attr(feature = "serde", serde(skip, default = "margin"))]
        margin: f64,
    },
}

/// Sample positions along rays, uniform in disparity 1/z.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct SamplingConfig {
    /// Stratified samples over the whole range of a training ray.
    pub coarse: usize,
    /// Stratified samples in a band around the ray's depth hypothesis; over the whole range for a ray without one.
    pub band: usize,
    /// Half width of that band, as a fraction of the depth.
    pub band_width: f64,
    /// Importance samples, drawn from the weights of the others.
    pub fine: usize,
    /// The modelled volume.
    pub volume: VolumeConfig,
    /// Nearest depth. Default: the 0.5 % quantile of the hypotheses of view 0 times 0.8 (`hull`) or 0.75 (`reference`). Not part of a file.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub near: Option<f64>,
    /// Farthest depth. Default: the 99.5 % quantile of the hypotheses of view 0 times 1.25 (`hull`) or 1.3 (`reference`). Not part of a file.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub far: Option<f64>,
}

impl Default for SamplingConfig {
    fn default() -> Self {
        Self {
            coarse: 24,
            band: 0,
            band_width: 0.25,
            fine: 24,
            volume: VolumeConfig::Hull,
            near: None,
            far: None,
        }
    }
}

#[cfg(feature = "serde")]
fn margin() -> f64 {
    0.06
}

#[cfg(feature = "serde")]
fn delta() -> f64 {
    0.1
}

#[cfg(feature = "serde")]
fn relative_sigma() -> f64 {
    0.005
}

/// Linear decay of a weight: 1 up to `start`, `floor` from `end` on. The default is a constant 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default, rename_all = "kebab-case")
)]
pub struct Decay {
    /// Fraction of the steps at which the decay begins.
    pub start: f64,
    /// Fraction of the steps at which it ends.
    pub end: f64,
    /// Factor of the weight at the end.
    pub floor: f64,
}

impl Default for Decay {
    fn default() -> Self {
        Self { start: 1.0, end: 1.0, floor: 1.0 }
    }
}

impl Decay {
    /// Full until 20 % of the steps, a fiftieth from 80 % on: hypotheses that start a field and then leave it to the colours.
    pub fn fading() -> Self {
        Self { start: 0.2, end: 0.8, floor: 0.02 }
    }

    /// The factor of the weight at `progress`, 0 at the first step and 1 at the last.
    pub(crate) fn factor(self, progress: f64) -> f64 {
        let Self { start, end, floor } = self;
        if progress <= start {
            1.0
        } else if progress >= end {
            floor
        } else {
            1.0 + (floor - 1.0) * (progress - start) / (end - start)
        }
    }

    fn validate(self) -> Result<()> {
        let share = |x: f64| (0.0..=1.0).contains(&x);
        check(share(self.start), "train.depth-loss.decay.start", self.start, "give a fraction from 0 to 1")?;
        check(
            share(self.end) && self.end >= self.start,
            "train.depth-loss.decay.end",
            self.end,
            "give a fraction from decay.start to 1",
        )?;
        check(share(self.floor), "train.depth-loss.decay.floor", self.floor, "give a factor from 0 to 1")
    }
}

/// The loss of a ray's colour error \\(e = C - \hat C\\), a mean over the channels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")
)]
pub enum ColourLoss {
    /// \\(e^2\\).
    #[default]
    Squared,
    /// \\(2 \delta^2 \bigl(\sqrt{1 + e^2 / \delta^2} - 1\bigr)\\) (Charbonnier et al., 1997): \\(e^2\\) for small errors,
    /// \\(2 \delta |e|\\) for large ones, such as those of moving objects and of highlights.
    Charbonnier {
        /// \\(\delta\\), the error at which the loss becomes linear, colours in 0 to 1; 0.1, not part of a file.
        #[cfg_attr(feature = "serde", serde(skip, default = "delta"))]
        delta: f64,
        /// Weight of the loss at the last step; it grows linearly from 1.
        final_weight: f64,
    },
}

/// Depth supervision by the views' hypotheses.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")
)]
pub enum DepthLoss {
    /// None, as in the paper: colours only.
    #[default]
    None,
    /// \\(\sum_i w_i |r_i - r|\\) in disparity scaled to 0 at far and 1 at near: the first Wasserstein distance
    /// between the ray's termination distribution and the hypothesis, averaged over the hypotheses.
    Wasserstein {
        /// Weight of the loss; colours have weight 1.
        weight: f64,
        /// Decay of the weight over the steps; none, not part of a file.
        #[cfg_attr(feature = "serde", serde(skip))]
        decay: Decay,
    },
    /// \\(\int |W(r) - F(r)|\,\mathrm dr\\) in the same disparity: the first Wasserstein distance between the termination, of
    /// distribution function \\(W\\), and the mixture \\(F\\) of *all* hypotheses of the ray, each a logistic distribution with
    /// the mean and variance of the hypothesis. Where hypotheses disagree, the termination becomes as wide as the mixture;
    /// [`Wasserstein`](Self::Wasserstein) would contract it at their median.
    Distribution {
        /// Weight of the loss; colours have weight 1.
        weight: f64,
        /// Lower bound of the standard deviation of a hypothesis, as a fraction of its depth. Hypotheses of variance 0 are exact, and
        /// the termination cannot be.
        #[cfg_attr(feature = "serde", serde(skip, default = "relative_sigma"))]
        relative_sigma: f64,
        /// Decay of the weight over the steps; [`Decay::fading`], not part of a file.
        #[cfg_attr(feature = "serde", serde(skip, default = "Decay::fading"))]
        decay: Decay,
    },
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
    /// Pixels of view 0 that `steps` is meant for: a larger view gets proportionally more steps. 0: `steps` for any size.
    pub steps_for: usize,
    /// Rays per step.
    pub rays: usize,
    /// Share of the rays that are drawn from view 0; the rest is drawn uniformly from the other views.
    pub original_share: f64,
    /// Adam's learning rate after the warm-up; it decays exponentially to a tenth at the last step.
    pub learning_rate: f64,
    /// Steps over which the learning rate rises linearly from 0.
    pub warm_up: usize,
    /// Colour supervision.
    pub colour_loss: ColourLoss,
    /// Depth supervision.
    pub depth_loss: DepthLoss,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            steps: 2000,
            steps_for: 0,
            rays: 1024,
            original_share: 0.3,
            learning_rate: 5e-3,
            warm_up: 100,
            colour_loss: ColourLoss::Squared,
            depth_loss: DepthLoss::None,
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
    /// Importance samples, placed by the weights of the others.
    pub fine: usize,
    /// Contribution of a bin's extent to the variance.
    pub in_bin: InBinVariance,
    /// Opacity below which the depth is missing.
    pub min_opacity: f32,
}

impl Default for RenderConfig {
    fn default() -> Self {
        Self { coarse: 32, fine: 32, in_bin: InBinVariance::Midpoint, min_opacity: 0.5 }
    }
}

impl NerfConfig {
    /// Settings for several photographs of one scene with poses and depth hypotheses, such as those of a plane sweep, of
    /// `width` pixels: a hash grid of as many cells, rays clipped to the frustum of view 0, and robust colours whose weight
    /// grows while that of the hypotheses decays.
    pub fn photographs(width: usize) -> Self {
        Self {
            field: FieldConfig::Hash(HashFieldConfig {
                finest: u32::try_from(width.clamp(64, 4096)).unwrap_or(4096),
                ..HashFieldConfig::default()
            }),
            sampling: SamplingConfig {
                coarse: 8,
                band: 8,
                band_width: 0.12,
                fine: 8,
                volume: VolumeConfig::Reference { margin: 0.06 },
                ..SamplingConfig::default()
            },
            train: TrainConfig {
                steps: 700,
                rays: 1024,
                original_share: 1.0 / 3.0,
                learning_rate: 1e-2,
                colour_loss: ColourLoss::Charbonnier { delta: 0.1, final_weight: 6.0 },
                depth_loss: DepthLoss::Distribution {
                    weight: 0.2,
                    relative_sigma: 0.005,
                    decay: Decay::fading(),
                },
                ..TrainConfig::default()
            },
            render: RenderConfig { in_bin: InBinVariance::Uniform, ..RenderConfig::default() },
        }
    }

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
                check(f.geometry <= 256, "field.geometry", f.geometry, "give at most 256 outputs")
            }
        }
    }
}

impl SamplingConfig {
    fn validate(&self) -> Result<()> {
        let first = self.coarse.saturating_add(self.band);
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
        if let VolumeConfig::Reference { margin } = self.volume {
            check(
                (0.0..=1.0).contains(&margin),
                "sampling.volume.margin",
                margin,
                "give a fraction from 0 to 1",
            )?;
        }
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
    /// The configuration with the number of steps for a view 0 of `pixels` pixels.
    pub(crate) fn for_pixels(&self, pixels: usize) -> Self {
        let factor = match self.steps_for {
            0 => 1.0,
            reference => (pixels as f64 / reference as f64).max(1.0),
        };
        let steps = (self.steps as f64 * factor).round().min(MAX_STEPS as f64) as usize;
        Self { steps, ..self.clone() }
    }

    fn validate(&self) -> Result<()> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let share = |x: f64| (0.0..=1.0).contains(&x);
        check((1..=MAX_STEPS).contains(&self.steps), "train.steps", self.steps, "give 1 to 1000000 steps")?;
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
        if let ColourLoss::Charbonnier { delta, final_weight } = self.colour_loss {
            check(
                positive(delta),
                "train.colour-loss.delta",
                delta,
                "give a positive difference of colours",
            )?;
            check(
                final_weight >= 0.0 && final_weight.is_finite(),
                "train.colour-loss.final-weight",
                final_weight,
                "give 0 or more",
            )?;
        }
        let (DepthLoss::Wasserstein { weight, decay } | DepthLoss::Distribution { weight, decay, .. }) =
            self.depth_loss
        else {
            return Ok(());
        };
        check(weight >= 0.0 && weight.is_finite(), "train.depth-loss.weight", weight, "give 0 or more")?;
        if let DepthLoss::Distribution { relative_sigma, .. } = self.depth_loss {
            check(
                positive(relative_sigma),
                "train.depth-loss.relative-sigma",
                relative_sigma,
                "give a positive fraction",
            )?;
        }
        decay.validate()
    }
}

fn check(ok: bool, field: &'static str, value: impl ToString, remedy: &'static str) -> Result<()> {
    if ok { Ok(()) } else { Err(Error::Config { field, value: value.to_string(), remedy }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The factor is 1 before the decay, the floor after it, monotone and Lipschitz in between.
        #[test]
        fn the_decay_is_linear_between_its_ends(a in 0.0..=1.0_f64, b in 0.0..=1.0_f64, floor in 0.0..=1.0_f64, p in 0.0..=1.0_f64) {
            let decay = Decay { start: a.min(b), end: a.max(b), floor };
            prop_assume!(decay.end - decay.start > 1e-3);
            decay.validate().unwrap();
            prop_assert_eq!(decay.factor(decay.start), 1.0);
            prop_assert_eq!(decay.factor(decay.end), floor);
            let factor = decay.factor(p);
            let expected = (1.0 - (p - decay.start) / (decay.end - decay.start)).clamp(0.0, 1.0) * (1.0 - floor) + floor;
            prop_assert!((factor - expected).abs() < 1e-9, "{} {}", factor, expected);
        }
    }

    #[test]
    fn the_default_decay_is_constant() {
        assert!([0.0, 0.3, 1.0].iter().all(|&p| Decay::default().factor(p) == 1.0));
    }

    #[test]
    fn any_number_of_samples_is_checked() {
        for (coarse, band) in [(usize::MAX, 3), (3, usize::MAX), (0, 1)] {
            let sampling = SamplingConfig { coarse, band, ..SamplingConfig::default() };
            assert!(sampling.validate().unwrap_err().to_string().contains("coarse"), "{coarse} {band}");
        }
    }

    #[test]
    fn settings_for_photographs_are_valid_for_any_width() {
        for width in [0, 1, 320, 640, 100_000] {
            NerfConfig::photographs(width).validate().unwrap();
        }
    }
}
