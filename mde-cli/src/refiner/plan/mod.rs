//! Estimates of the memory that a run needs.

pub mod inference;
pub mod limit;

use crate::config::{Config, NovelViews, RefinementConfig};
use mde_mvs::consensus::sweeps_bytes;
use mde_nerf::{FieldConfig, HashFieldConfig, RenderConfig};

/// The program, its threads' tiles and what it allocates at any image size.
const BASE: u64 = 64 << 20;
/// The same for an evaluation: memory that threads keep after a scene differs by 10 MiB from run to run.
const EVALUATION: u64 = 80 << 20;
/// The same for the refinement of one photograph: on two threads 17 to 20 MiB, and for each further one a few.
const PROGRAM: u64 = 40 << 20;
/// Bytes per pixel for the image, the prior, the maps and a stage's temporary buffers.
const PIXEL: u64 = 220;
/// Bytes per pixel and training view: colours, mask, depth, variance, the list of trainable pixels.
const VIEW: u64 = 25;
/// Bytes per pixel and rendered view: depth and variance, before and after reprojection.
const RENDERED: u64 = 16;
/// Groups of rays that sum their gradients and keep their activations, and the points of one of their tiles; as in `mde-nerf`.
const GROUPS: u64 = 16;
const TILE_POINTS: u64 = 1024;
/// Copies of a network's parameters: itself, its transpose, two moments, an average, a sum of gradients, two for what vectors hold in
/// reserve; and a gradient per group.
const NETWORK_COPIES: u64 = 8 + GROUPS;
/// Bytes of a sample's position, kept with its gradients until the end of a step.
const POSITION: u64 = 12;
/// Bytes per pixel and photograph of a capture: colours and mask, which views share, and the prior.
const PHOTOGRAPH: u64 = 13 + 4;
/// Bytes per pixel of a photograph whose features are searched for: scale spaces at twice its size.
const FEATURES: u64 = 230;
/// Bytes per pixel of an evaluated scene: image, truth, prior.
const SCENE: u64 = 60;
/// Bytes per pixel of the temporary buffers of the scores or of a baseline.
const SCORES: u64 = 450;
/// Bytes per pixel and method: its maps, until the scene is scored.
const METHOD: u64 = 8;
/// Bytes per pixel of a view that a shared field rendered: colours, depth, variance, opacity.
const SHARED_VIEW: u64 = 24;

/// Upper bound of the bytes that [`refine`](crate::refinement::refine) needs for an image of that many pixels; measured, it is 1 to 1.25 times
/// the real peak for the fields of small images, and up to twice for large images. The memory of the prior's own inference is not
/// included; [`inference::PhotographMemory`] has it.
pub fn refine_bytes(pixels: u64, config: &Config) -> u64 {
    PROGRAM.saturating_add(pixels.saturating_mul(pixel_bytes(config))).saturating_add(field_bytes(config))
}

/// Estimate of the bytes that [`refine_several`](crate::several::refine_several) needs for that many photographs of that many pixels on that
/// many threads. For 3, 5 and 8 photographs of 320x240 and of 640x480 on two threads it is 1.10 to 1.17 times the measured peak, with the
/// inference of a network of 5 MB. What the fit copies takes memory that the sweeps have freed.
pub fn scene_bytes(pixels: u64, photographs: u64, threads: u64, config: &Config) -> u64 {
    let used = photographs.min(config.multi_view.max_views as u64);
    let held = PHOTOGRAPH.saturating_mul(photographs);
    let features = FEATURES.saturating_mul(threads.min(photographs));
    let sweeps = sweeps_bytes(pixels, photographs, used);
    let stage = match config.refinement.iterations {
        0 => sweeps,
        _ => sweeps.max(field_bytes(config)),
    };
    BASE.saturating_add(pixels.saturating_mul(held.saturating_add(features))).saturating_add(stage)
}

/// Bytes per pixel of a refinement.
fn pixel_bytes(config: &Config) -> u64 {
    let views = (config.views.count as u64).saturating_add(1);
    PIXEL.saturating_add(VIEW.saturating_mul(views)).saturating_add(RENDERED.saturating_mul(rendered(config)))
}

/// Views that a field renders.
fn rendered(config: &Config) -> u64 {
    (config.novel.count as u64).max(1)
}

/// Upper bound of the memory of an evaluation, by the size of the scenes; measured, it is 1.1 to 2 times the real peak. The memory
/// of the prior's own inference is not included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SceneMemory {
    /// Bytes per pixel.
    pixel: u64,
    /// Bytes at any size.
    fixed: u64,
}

impl SceneMemory {
    /// For scenes on which `methods` run one after the other: the configuration of a loop, seed included, or `None` for a baseline.
    /// With `share_fields` the fields of a scene are kept until the scene is done.
    pub fn new(methods: &[Option<Config>], share_fields: bool) -> Self {
        let loops = || methods.iter().flatten();
        let most = |bytes: fn(&Config) -> u64| loops().map(bytes).max().unwrap_or(0);
        let mut pixel = SCENE
            .saturating_add(most(pixel_bytes).max(SCORES))
            .saturating_add(METHOD.saturating_mul(methods.len() as u64));
        let mut fixed = most(field_bytes);
        if share_fields {
            let fits = distinct(loops(), fit_part);
            fixed = fits.iter().fold(fixed, |sum, fit| sum.saturating_add(parameters(&fit.nerf.field) * 4));
            for renders in distinct(loops(), render_part) {
                pixel = pixel.saturating_add(SHARED_VIEW.saturating_mul(rendered(&renders)));
            }
        }
        Self { pixel, fixed }
    }

    /// Upper bound of the bytes for `scenes` scenes of that many pixels at once.
    pub fn bytes(&self, pixels: u64, scenes: u64) -> u64 {
        let scene = pixels.saturating_mul(self.pixel).saturating_add(self.fixed);
        EVALUATION.saturating_add(scene.saturating_mul(scenes))
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

/// The settings on which the views that a field renders depend; the others at their defaults.
fn render_part(config: &Config) -> Config {
    let Config { fusion, refinement: usual, .. } = Config::default();
    let refinement =
        RefinementConfig { iterations: usual.iterations, prior: usual.prior, ..config.refinement.clone() };
    Config { fusion, refinement, ..config.clone() }
}

/// The settings on which a field's fit depends; the others at their defaults.
fn fit_part(config: &Config) -> Config {
    let mut config = Config { novel: NovelViews::default(), ..render_part(config) };
    config.nerf.render = RenderConfig::default();
    config
}

/// Upper bound of the bytes for rendering `views` views of that many pixels.
pub fn render_bytes(pixels: u64, views: u64) -> u64 {
    BASE.saturating_add(pixels.saturating_mul(64 + 24 * views))
}

/// Bytes of a field and its fit, which depend on the rays of a step and not on the image.
fn field_bytes(config: &Config) -> u64 {
    let (nerf, field) = (&config.nerf, &config.nerf.field);
    let per_ray =
        [nerf.sampling.coarse, nerf.sampling.band, nerf.sampling.fine].iter().map(|n| *n as u64).sum::<u64>();
    let rays = nerf.train.rays as u64;
    let (mlp, activations) = match field {
        FieldConfig::Mlp(f) => {
            (parameters(field), 2 * (3 + 6 * f.frequencies as u64) + (f.layers as u64 + 2) * f.width as u64)
        }
        FieldConfig::Hash(f) => {
            let features = (f.levels * f.features) as u64;
            (parameters(field) - table(f), 2 * features + (f.layers as u64 + 2) * f.width as u64)
        }
    };
    // A tile is at least one ray.
    let points = TILE_POINTS.max(per_ray).min(rays.div_ceil(GROUPS).saturating_mul(per_ray));
    let network = NETWORK_COPIES.saturating_mul(4 * mlp);
    let active = GROUPS.saturating_mul(points).saturating_mul(4 * activations);
    let grid = match field {
        FieldConfig::Mlp(_) => 0,
        FieldConfig::Hash(f) => {
            let (features, table) = (f.features as u64, table(f));
            // The grid, its average, the first moment, and the second, one number a row.
            let kept = (3 * table).saturating_add(table / features.max(1));
            let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
            let scratch = largest_level(f).saturating_mul(threads.min(f.levels as u64));
            let samples = rays.saturating_mul(per_ray);
            let of_samples = samples.saturating_mul(POSITION + 4 * features * f.levels as u64);
            kept.saturating_add(scratch).saturating_mul(4).saturating_add(of_samples)
        }
    };
    network.saturating_add(active).saturating_add(grid)
}

/// Numbers of a field.
fn parameters(field: &FieldConfig) -> u64 {
    let network = |input: u64, layers: usize, width: usize| {
        let (layers, width) = (layers as u64, width as u64);
        input * width + layers.saturating_sub(1) * width.pow(2) + 4 * width
    };
    match field {
        FieldConfig::Mlp(f) => network(3 + 6 * f.frequencies as u64, f.layers, f.width),
        FieldConfig::Hash(f) => network((f.levels * f.features) as u64, f.layers, f.width) + table(f),
    }
}

/// Rows of the levels of a hash grid: its corners, or as many columns as `log2-rows` allows.
fn rows(field: &HashFieldConfig) -> impl Iterator<Item = u64> {
    let (coarsest, finest) = (f64::from(field.coarsest), f64::from(field.finest));
    let growth = (finest / coarsest).powf(1.0 / (field.levels.max(2) - 1) as f64);
    let most = 1_u64 << field.log2_rows.min(32);
    (0..field.levels).map(move |level| {
        let cells = (coarsest * growth.powi(level as i32)) as u64;
        cells.saturating_add(1).saturating_pow(3).min(most + cells)
    })
}

fn table(field: &HashFieldConfig) -> u64 {
    rows(field).sum::<u64>().saturating_mul(field.features as u64)
}

fn largest_level(field: &HashFieldConfig) -> u64 {
    rows(field).max().unwrap_or(0).saturating_mul(field.features as u64)
}

/// The largest number of pixels for which `bytes` stays within `bound`; `None` where one pixel is too many.
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
    use crate::config::Preset;

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
    fn photographs_threads_and_pixels_take_more() {
        let config = Preset::MultiView.config();
        let bytes = |pixels, photographs, threads| scene_bytes(pixels, photographs, threads, &config);
        let pixels = 640 * 480;
        assert!(bytes(pixels, 5, 2) < 1 << 30 && bytes(pixels, 3, 2) < bytes(pixels, 5, 2));
        assert!(bytes(pixels, 5, 1) < bytes(pixels, 5, 2) && bytes(pixels, 5, 9) == bytes(pixels, 5, 5));
        // Of a long capture, those whose sweeps are not kept are held only, with their small ones.
        let more = |n| bytes(pixels, n + 1, 2) - bytes(pixels, n, 2);
        assert!(more(8) < more(7) && more(24) < more(8));
        assert_eq!(more(80), PHOTOGRAPH * pixels + 17 * 160 * 160);
        assert_eq!(bytes(u64::MAX, 5, 2), u64::MAX);
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
        assert_eq!(memory.bytes(640 * 480, 3) - one, 2 * (one - EVALUATION));
        assert_eq!(memory.bytes(u64::MAX, 2), u64::MAX);
        // A fusion's settings need no field of their own; another seed does.
        let mut fused = full.clone();
        fused.fusion.kappa *= 2.0;
        let shared = bytes(&[seed(0), Some(fused)], true);
        assert_eq!(shared, bytes(&[seed(0), seed(0)], true));
        assert!(shared < bytes(&[seed(0), seed(1)], true) && shared > bytes(&[seed(0), seed(1)], false));
    }
}
