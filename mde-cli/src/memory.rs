//! How much memory a run will take, before it takes it.

use crate::Config;
use crate::config::{NovelViews, RefinementConfig};
use mde_nerf::{FieldConfig, RenderConfig};

/// The program, its threads' tiles and what it allocates whatever the picture.
const BASE: u64 = 64 << 20;
/// Bytes a pixel for the picture, the prior, the maps and what a stage holds for a while.
const PIXEL: u64 = 220;
/// Bytes a pixel and training view: colours, mask, depth, variance, the list of trainable pixels.
const VIEW: u64 = 25;
/// Bytes a pixel and rendered view: depth, variance and their way back.
const RENDERED: u64 = 16;
/// Floats a parameter of a field: itself, its gradient, two moments, an average, a copy.
const PARAMETER: u64 = 6 * 4;
/// Bytes a pixel of a scene that is evaluated: picture, truth, prior.
const SCENE: u64 = 60;
/// Bytes a pixel that the scores, or a baseline, hold for a while.
const SCORES: u64 = 400;
/// Bytes a pixel and method: its maps, until the scene is scored.
const ANSWER: u64 = 8;
/// Bytes a pixel of a view that a shared field rendered: colours, depth, variance, opacity.
const SHARED_VIEW: u64 = 24;

/// Bytes that [`refine`](crate::refine) takes at most for a picture of that many pixels, measured to be 1.1 to 2 times what
/// it does take; without what the prior itself needs to answer.
pub fn refine_bytes(pixels: u64, config: &Config) -> u64 {
    BASE.saturating_add(pixels.saturating_mul(pixel_bytes(config)))
        .saturating_add(field_bytes(&config.nerf.field))
}

/// Bytes a pixel of a refinement.
fn pixel_bytes(config: &Config) -> u64 {
    let views = (config.views.count as u64).saturating_add(1);
    PIXEL.saturating_add(VIEW.saturating_mul(views)).saturating_add(RENDERED.saturating_mul(rendered(config)))
}

/// Views that a field renders.
fn rendered(config: &Config) -> u64 {
    (config.novel.sampling.count as u64).saturating_add(u64::from(config.novel.original))
}

/// What evaluating takes, by the scene's size: measured to be 1.1 to 2 times what it does take, without what the prior itself
/// needs to answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SceneMemory {
    /// Bytes a pixel.
    pixel: u64,
    /// Bytes whatever the size.
    fixed: u64,
}

impl SceneMemory {
    /// Of scenes that `methods` answer one after the other: the loop with these settings (its seed among them), or nothing
    /// for a baseline. With `share_fields` the fields of a scene are kept until it is done.
    pub fn new(methods: &[Option<Config>], share_fields: bool) -> Self {
        let loops = || methods.iter().flatten();
        let most = |bytes: fn(&Config) -> u64| loops().map(bytes).max().unwrap_or(0);
        let mut pixel = SCENE
            .saturating_add(most(pixel_bytes).max(SCORES))
            .saturating_add(ANSWER.saturating_mul(methods.len() as u64));
        let mut fixed = most(|config| field_bytes(&config.nerf.field));
        if share_fields {
            let fits = distinct(loops(), fit_part);
            fixed = fits.iter().fold(fixed, |sum, fit| sum.saturating_add(parameters(&fit.nerf.field) * 4));
            for renders in distinct(loops(), render_part) {
                pixel = pixel.saturating_add(SHARED_VIEW.saturating_mul(rendered(&renders)));
            }
        }
        Self { pixel, fixed }
    }

    /// Bytes that so many scenes of that many pixels take at once, at most.
    pub fn bytes(&self, pixels: u64, scenes: u64) -> u64 {
        let scene = pixels.saturating_mul(self.pixel).saturating_add(self.fixed);
        BASE.saturating_add(scene.saturating_mul(scenes))
    }
}

fn distinct<'c>(configs: impl Iterator<Item = &'c Config>, part: fn(&Config) -> Config) -> Vec<Config> {
    let mut parts = Vec::new();
    for part in configs.map(part) {
        if !parts.contains(&part) {
            parts.push(part);
        }
    }
    parts
}

/// What the views that a field renders depend on; the rest is the default's.
fn render_part(config: &Config) -> Config {
    let Config { fusion, reproject, refinement: usual, .. } = Config::default();
    let refinement =
        RefinementConfig { iterations: usual.iterations, prior: usual.prior, ..config.refinement.clone() };
    Config { fusion, reproject, refinement, ..config.clone() }
}

/// What a field's fit depends on; the rest is the default's.
fn fit_part(config: &Config) -> Config {
    let mut config = Config { novel: NovelViews::default(), ..render_part(config) };
    config.nerf.render = RenderConfig::default();
    config
}

/// Bytes that rendering `views` views of so many pixels takes at most.
pub fn render_bytes(pixels: u64, views: u64) -> u64 {
    BASE.saturating_add(pixels.saturating_mul(64 + 24 * views))
}

fn field_bytes(field: &FieldConfig) -> u64 {
    PARAMETER * parameters(field)
}

fn parameters(field: &FieldConfig) -> u64 {
    match field {
        FieldConfig::Mlp(f) => (f.layers as u64 + 1) * (f.width as u64).pow(2),
        FieldConfig::Hash(f) => {
            let rows = 1_u64 << f.log2_rows.min(32);
            f.levels as u64 * f.features as u64 * rows + 2 * (f.layers as u64 + 2) * (f.width as u64).pow(2)
        }
    }
}

/// The most pixels for which `bytes` stays within `bound`, if any do.
pub fn most_pixels(bound: u64, bytes: impl Fn(u64) -> u64) -> Option<u64> {
    let (mut fits, mut fails) = (0, 1_u64 << 40);
    while fails - fits > 1 {
        let middle = fits + (fails - fits) / 2;
        *if bytes(middle) <= bound { &mut fits } else { &mut fails } = middle;
    }
    (fits > 0).then_some(fits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Preset;

    #[test]
    fn the_estimate_grows_with_everything_and_never_overflows() {
        let config = Preset::Default.config();
        let bytes = |pixels| refine_bytes(pixels, &config);
        assert!(bytes(640 * 480) < 1 << 30 && bytes(20_000_000) > 8 << 30);
        let mut more = config.clone();
        more.views.count = usize::MAX;
        assert_eq!(refine_bytes(u64::MAX, &more), u64::MAX);
        let most = most_pixels(8 << 30, bytes).unwrap();
        assert!(bytes(most) <= 8 << 30 && bytes(most + 1) > 8 << 30);
        assert_eq!(most_pixels(1, bytes), None);
    }

    #[test]
    fn an_evaluation_takes_more_with_methods_scenes_and_fields_that_differ() {
        let full = Preset::Paper.config();
        let mut few = full.clone();
        few.views.count = 1;
        let seed = |seed| Some(Config { seed, ..full.clone() });
        let bytes = |methods: &[Option<Config>], share| SceneMemory::new(methods, share).bytes(640 * 480, 1);
        let one = bytes(&[None, Some(full.clone())], false);
        assert!(one > refine_bytes(640 * 480, &full) && one > bytes(&[None, Some(few.clone())], false));
        assert!(bytes(&[None, Some(few), Some(full.clone())], false) > one);
        let memory = SceneMemory::new(&[None, Some(full.clone())], false);
        assert_eq!(memory.bytes(640 * 480, 3) - one, 2 * (one - BASE));
        assert_eq!(memory.bytes(u64::MAX, 2), u64::MAX);
        // A fusion's settings need no field of their own; another seed does.
        let mut fused = full.clone();
        fused.fusion.spread = !fused.fusion.spread;
        let shared = bytes(&[seed(0), Some(fused)], true);
        assert_eq!(shared, bytes(&[seed(0), seed(0)], true));
        assert!(shared < bytes(&[seed(0), seed(1)], true) && shared > bytes(&[seed(0), seed(1)], false));
    }
}
