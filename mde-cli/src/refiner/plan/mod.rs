//! Estimates of the memory that a run needs.

pub mod inference;
pub mod limit;

use crate::config::{Config, NovelViews, RefinementConfig};
use mde_mvs::consensus::sweeps_bytes;
use mde_nerf::RenderConfig;
use mde_prior::pixels::RECENT;

const MIB: f64 = (1 << 20) as f64;
/// The program, its threads' tiles and what it allocates at any image size.
const BASE: f64 = 40.0 * MIB;
/// The same for an evaluation: memory that threads keep after a scene differs by 10 MiB from run to run.
const EVALUATION: f64 = 80.0 * MIB;
/// The same for the refinement of one photograph: on two threads 17 to 20 MiB, and for each further one a few.
const PROGRAM: f64 = 40.0 * MIB;
/// Bytes per pixel for the image, the prior, the maps and a stage's temporary buffers.
const PIXEL: f64 = 220.0;
/// Bytes per pixel and training view: colours, mask, depth, variance, the list of trainable pixels.
const VIEW: f64 = 25.0;
/// Bytes per pixel and rendered view: depth and variance, before and after reprojection.
const RENDERED: f64 = 16.0;
/// Bytes per pixel and photograph of a capture whose colours are in memory.
const PHOTOGRAPH: f64 = 12.0;
/// Bytes per pixel of a photograph's prior.
const PRIOR: f64 = 4.0;
/// Bytes per pixel that the files of all are made of: depth and sigma, the points, and what confirmed them.
const GATHERED: f64 = 27.0;
/// Pixels that the files of all are made of at most: their points can still be looked at.
pub(crate) const MOST_GATHERED: f64 = 4e7;
/// Bytes of the voxels and triangles of one surface, at any size.
const SURFACE: f64 = 170.0 * MIB;
/// Bytes per pixel of a photograph whose features are searched for: scale spaces at twice its size.
const FEATURES: f64 = 150.0;
/// Bytes per pixel of an evaluated scene: image, truth, prior.
const SCENE: f64 = 60.0;
/// Bytes per pixel of the temporary buffers of the scores or of a baseline.
const SCORES: f64 = 450.0;
/// Bytes per pixel and method: its maps, until the scene is scored.
const METHOD: f64 = 8.0;
/// Bytes per pixel of a view that a shared field rendered: colours, depth, variance, opacity.
const SHARED_VIEW: f64 = 24.0;

/// Upper bound of the bytes that [`refine`](crate::refinement::refine) needs for that many pixels: 1 to 1.25 times the measured peak for
/// small images, up to twice for large ones. The prior's own inference is not included; [`inference::PhotographMemory`] has it.
pub fn refine_bytes(pixels: u64, config: &Config) -> u64 {
    (PROGRAM + pixels as f64 * pixel_bytes(config) + config.nerf.fit_bytes()) as u64
}

/// Estimate of the bytes that [`PreparedScene`](crate::several::prepared::PreparedScene) needs for one result of that many photographs of that many pixels, with so
/// many different priors, on that many threads, beside a network: .86 to 1.21 times the measured peak on two threads. Sweeps take the
/// memory that the features have freed, and the fit that of the sweeps.
pub fn scene_bytes(pixels: u64, photographs: u64, priors: u64, threads: u64, config: &Config) -> u64 {
    let used = photographs.min(config.multi_view.max_views as u64);
    let sweeps = sweeps_bytes(pixels, photographs, used) as f64;
    let fit = if config.refinement.iterations > 0 { config.nerf.fit_bytes() } else { 0.0 };
    let features = FEATURES * threads.min(photographs) as f64 * pixels as f64;
    (BASE + pixels as f64 * held(photographs, priors) + sweeps.max(fit).max(features)) as u64
}

/// Estimate of the bytes that the files of a whole capture need beside a network once all is refined, with one surface or without.
pub fn gathered_bytes(pixels: u64, photographs: u64, surface: bool) -> u64 {
    let [all, further] =
        [photographs, photographs.saturating_sub(RECENT as u64)].map(|n| n as f64 * pixels as f64);
    // Beside the colours in memory those of the others, or smaller ones of all.
    let colours = if all > MOST_GATHERED { MOST_GATHERED } else { further };
    let maps = GATHERED * all.min(MOST_GATHERED) + PHOTOGRAPH * colours;
    (BASE + held(photographs, 0) * pixels as f64 + maps + if surface { SURFACE } else { 0.0 }) as u64
}

/// Bytes per pixel of the photographs and the priors of a capture; of those of files the last are in memory.
fn held(photographs: u64, priors: u64) -> f64 {
    PHOTOGRAPH * photographs.min(RECENT as u64) as f64 + PRIOR * priors as f64
}

fn pixel_bytes(config: &Config) -> f64 {
    PIXEL + VIEW * (config.views.count as f64 + 1.0) + RENDERED * rendered(config)
}

fn rendered(config: &Config) -> f64 {
    config.novel.count.max(1) as f64
}

/// Upper bound of an evaluation's memory by the size of the scenes, 1.1 to 2 times the measured peak, without the prior's inference.
#[derive(Debug, Clone, Copy)]
pub struct SceneMemory {
    /// Bytes per pixel.
    pixel: f64,
    /// Bytes at any size.
    fixed: f64,
}

impl SceneMemory {
    /// For scenes on which `methods` run one after the other: the configuration of a loop, seed included, or `None` for a baseline.
    /// With `share_fields` the fields of a scene are kept until the scene is done.
    pub fn new(methods: &[Option<Config>], share_fields: bool) -> Self {
        let loops = || methods.iter().flatten();
        let most = |bytes: fn(&Config) -> f64| loops().map(bytes).fold(0.0, f64::max);
        let mut pixel = SCENE + most(pixel_bytes).max(SCORES) + METHOD * methods.len() as f64;
        let mut fixed = most(|config| config.nerf.fit_bytes());
        if share_fields {
            fixed += distinct(loops(), fit_part).iter().map(|fit| fit.nerf.field.bytes()).sum::<f64>();
            pixel += SHARED_VIEW * distinct(loops(), render_part).iter().map(rendered).sum::<f64>();
        }
        Self { pixel, fixed }
    }

    /// Upper bound of the bytes for `scenes` scenes of that many pixels at once.
    pub fn bytes(&self, pixels: u64, scenes: u64) -> u64 {
        (EVALUATION + scenes as f64 * (pixels as f64 * self.pixel + self.fixed)) as u64
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
    (BASE + pixels as f64 * (64.0 + 24.0 * views as f64)) as u64
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
        let bytes =
            |pixels, photographs, threads| scene_bytes(pixels, photographs, photographs, threads, &config);
        // Peaks without a network, MiB.
        for (photographs, measured) in [(3, 161.3), (5, 170.6), (8, 232.5), (60, 608.7)] {
            let ratio = scene_bytes(640 * 480, photographs, 1, 2, &config) as f64 / (measured * MIB);
            assert!((0.9..1.25).contains(&ratio), "{photographs}: {ratio}");
        }
        let pixels = 640 * 480;
        assert!(bytes(pixels, 5, 2) < 1 << 30 && bytes(pixels, 3, 2) < bytes(pixels, 5, 2));
        assert!(bytes(pixels, 5, 2) < bytes(pixels, 5, 5) && bytes(pixels, 5, 9) == bytes(pixels, 5, 5));
        // Of a long capture, of those whose sweeps are not kept prior and small photograph.
        let more = |n| bytes(pixels, n + 1, 2) - bytes(pixels, n, 2);
        assert!(more(8) < more(7) && more(24) < more(8));
        assert_eq!(more(80), PRIOR as u64 * pixels + 17 * 160 * 160);
        assert_eq!(bytes(pixels, 81, 2) - scene_bytes(pixels, 81, 1, 2, &config), 80 * PRIOR as u64 * pixels);
        assert_eq!(bytes(u64::MAX, 5, 2), u64::MAX);
    }

    #[test]
    fn the_files_of_a_capture_take_what_was_measured() {
        for (size, count, surface, measured) in
            [(320 * 240, 15, false, 67.7), (320 * 240, 15, true, 235.0), (640 * 480, 60, false, 689.3)]
        {
            let ratio = gathered_bytes(size, count, surface) as f64 / (measured * MIB);
            assert!((1.0..1.25).contains(&ratio), "{ratio}");
        }
        // Of a long capture without a network.
        let config = Preset::MultiView.config();
        let long = [scene_bytes(1_000_000, 300, 1, 2, &config), gathered_bytes(1_000_000, 300, false)];
        assert!(long.iter().all(|bytes| *bytes < 2 << 30), "{long:?}");
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
        assert_eq!(memory.bytes(640 * 480, 3) - one, 2 * (one - EVALUATION as u64));
        assert_eq!(memory.bytes(u64::MAX, 2), u64::MAX);
        // A fusion's settings need no field of their own; another seed does.
        let mut fused = full.clone();
        fused.fusion.kappa *= 2.0;
        let shared = bytes(&[seed(0), Some(fused)], true);
        assert_eq!(shared, bytes(&[seed(0), seed(0)], true));
        assert!(shared < bytes(&[seed(0), seed(1)], true) && shared > bytes(&[seed(0), seed(1)], false));
    }
}
