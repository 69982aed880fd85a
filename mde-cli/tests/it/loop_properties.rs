//! Properties of the whole loop for arbitrary inputs.

use crate::library::{config, go_on};
use mde_cli::mde_nerf::{self, FieldCallback, FieldConfig, FitReport, RadianceField, RenderedView};
use mde_cli::mde_prior::{DepthKind, FilePrior, PriorDepth};
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_warp::{PinholeCamera, Pose, PosedView};
use mde_cli::{Config, Preset, Refinement, Stages, refine};
use ndarray::{Array2, Array3, Axis, Zip, s};
use proptest::prelude::*;

/// As from a file.
fn map(depth: &Array2<f32>) -> FilePrior {
    FilePrior::of_map("prior.npy", PriorDepth::from_values(depth.clone(), DepthKind::Metric).unwrap())
}

fn run(image: &Array3<f32>, prior: &Array2<f32>, config: &Config, fov: f64) -> mde_cli::Result<Refinement> {
    let (height, width) = prior.dim();
    let camera = PinholeCamera::from_fov(fov, width, height)?;
    refine(image.view(), &camera, Stages::new(&map(prior)), config, &mut go_on)
}

/// Every known depth is positive and finite with a finite variance; the others are missing.
///
/// As printed, Eq. 15 can give a variance of 0; it is never below.
fn check(refinement: &Refinement) {
    let depth = &refinement.depth;
    for (d, v) in depth.mean().iter().zip(depth.variance()) {
        let known = *d > 0.0 && d.is_finite() && *v >= 0.0 && v.is_finite();
        assert!(known || (*d == 0.0 && *v == f32::INFINITY), "depth {d}, variance {v}");
    }
    assert!(depth.mean().iter().any(|d| *d > 0.0));
}

/// A preset made short, with settings over that.
fn short(preset: Preset, more: &str) -> Config {
    let text = "refinement.order = 'paper'\nviews.count = 2\nnovel.count = 2\n\
        nerf.train = { steps = 12, rays = 32, warm-up = 2 }\n\
        nerf.sampling = { coarse = 4, band = 2, fine = 2 }\nnerf.render = { coarse = 4, fine = 4 }\n";
    let mut config = config(preset, text);
    match &mut config.nerf.field {
        FieldConfig::Hash(field) => {
            (field.levels, field.log2_rows, field.finest, field.width) = (3, 8, 32, 16)
        }
        FieldConfig::Mlp(field) => (field.layers, field.width) = (2, 16),
    }
    config.with_text(more, "more").unwrap()
}

prop_compose! {
    fn any_config()(
        preset in prop::sample::select(&Preset::ALL[..]),
        calibration in prop::sample::select(&["none", "wls"][..]),
        variance in prop::sample::select(&["moments", "fixed-median", "fixed-relative"][..]),
        fusion in prop::sample::select(&["bayes", "nerf-only"][..]),
        carry in prop::sample::select(&["carry", "anchor"][..]),
        (views, novel, iterations) in (0_usize..4, 0_usize..3, 1_usize..3),
        translation in 0.0..0.5_f64,
        degrees in 0.0..30.0_f64,
        seed in 0_u64..1000,
    ) -> Config {
        short(preset, &format!(
            "seed = {seed}\nnovel.count = {novel}\n\
             refinement = {{ prior = '{carry}', iterations = {iterations} }}\n\
             views = {{ count = {views}, translation = {translation:?}, rotation-degrees = {degrees:?} }}\n\
             fusion = {{ calibration = '{calibration}', prior-variance = '{variance}', fusion = '{fusion}' }}\n"
        ))
    }
}

/// A picture and a depth: smooth, noisy, constant, with steps, with holes, of any unit.
fn any_scene() -> impl Strategy<Value = (Array3<f32>, Array2<f32>)> {
    (8_usize..20, 8_usize..24, 0_u32..7, any::<u64>(), -3.0..3.0_f64, 0.0..1.0_f64).prop_map(
        |(height, width, kind, seed, exponent, missing)| {
            let noise = |y: usize, x: usize, c: usize| {
                let mixed = (seed ^ ((y * 131 + x * 17 + c * 7) as u64)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                (mixed >> 40) as f32 / (1 << 24) as f32
            };
            let unit = 10_f64.powf(exponent) as f32;
            let image = Array3::from_shape_fn((height, width, 3), |(y, x, c)| match kind {
                0 => 0.5,
                1 => noise(y, x, c),
                _ => (0.5 + 0.4 * ((x + 2 * y + c) as f32 * 0.7).sin()).clamp(0.0, 1.0),
            });
            let depth = Array2::from_shape_fn((height, width), |(y, x)| {
                let there = f64::from(noise(y, x, 3)) >= missing || (y, x) == (height / 2, width / 2);
                let depth = match kind {
                    0 => 2.0,
                    1 => 0.1 + 10.0 * noise(y, x, 4),
                    2 if x < width / 2 => 1.0,
                    2 => 50.0,
                    3 if (x + y) % 2 == 0 => 100.0,
                    4 if x + y == 0 => 1e6,
                    3 | 4 => 1.0,
                    _ => 1.0 + 0.1 * y as f32 + 0.05 * x as f32,
                };
                if there { depth * unit } else { 0.0 }
            });
            (image, depth)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

    #[test]
    fn any_scene_under_any_settings((image, prior) in any_scene(), config in any_config(), fov in 1.0..179.0_f64) {
        let refinement = run(&image, &prior, &config, fov).map_err(|error| TestCaseError::fail(error.to_string()))?;
        check(&refinement);
    }
}

fn study() -> (Array3<f32>, Array2<f32>) {
    use mde_eval::scene::{Room, room};
    let scene = room(Room::Study, 0, 32, 24).unwrap();
    (scene.image, scene.depth.mapv(|z| z * 1.1 + 0.2))
}

/// The largest relative deviation.
fn deviation(a: &Array2<f32>, b: &Array2<f32>) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| if a == b { 0.0 } else { f64::from((a / b - 1.0).abs()) })
        .fold(0.0, f64::max)
}

#[test]
fn a_prior_of_another_scale_gives_the_result_of_that_scale() {
    let (image, prior) = study();
    for preset in Preset::ALL {
        let config = short(preset, "");
        let one = run(&image, &prior, &config, 60.0).unwrap();
        // Powers of two change no digit.
        for scale in [0.25_f32, 1024.0] {
            let other = run(&image, &prior.mapv(|z| z * scale), &config, 60.0).unwrap();
            let depth = deviation(&one.depth.mean().mapv(|z| z * scale), &other.depth.mean().to_owned());
            let sigma = deviation(&one.depth.sigma().mapv(|s| s * scale), &other.depth.sigma());
            assert!(
                depth < 1e-4 && sigma < 1e-3,
                "{preset:?} times {scale}: depth {depth:e}, sigma {sigma:e}"
            );
        }
    }
}

/// The first view's depth, changed per pixel by its colour: a field without random draws, equivariant to mirroring.
#[derive(Default)]
struct Tinted(Option<PosedView>);

impl RadianceField for Tinted {
    fn fit(&mut self, views: &[PosedView], _: &mut dyn FieldCallback) -> mde_nerf::Result<FitReport> {
        self.0 = views.first().cloned();
        Ok(FitReport::default())
    }

    fn render(
        &self,
        _: &PinholeCamera,
        pose: &Pose,
        _: &mut dyn FieldCallback,
    ) -> mde_nerf::Result<RenderedView> {
        assert_eq!(*pose, Pose::identity());
        let view = self.0.as_ref().ok_or(mde_nerf::Error::NotFitted)?;
        let red = view.image.index_axis(Axis(2), 0);
        let mean = Zip::from(view.hypotheses[0].mean()).and(red).map_collect(|z, c| z * (0.9 + 0.3 * c));
        let variance = mean.mapv(|z| (0.03 * z).powi(2));
        let opacity = Array2::ones(mean.dim());
        let depth = GaussianDepth::new(mean, variance)?;
        Ok(RenderedView { image: view.image.to_owned(), depth, opacity, in_bin: None })
    }
}

/// Without random draws the loop commutes with mirroring, and the seed has no influence.
#[test]
fn a_mirrored_image_gives_the_mirrored_result() {
    let (image, prior) = study();
    let mirrored = (image.slice(s![.., ..;-1, ..]).to_owned(), prior.slice(s![.., ..;-1]).to_owned());
    // `fast` leaves a map as it is.
    for preset in Preset::ALL.into_iter().filter(|preset| *preset != Preset::Fast) {
        let mut config = short(preset, "");
        (config.views.count, config.novel.count) = (0, 0);
        let run = |image: &Array3<f32>, prior: &Array2<f32>, seed: u64| {
            let camera = PinholeCamera::from_fov(60.0, prior.ncols(), prior.nrows()).unwrap();
            let prior = map(prior);
            let stages = Stages::new(&prior).with_field(|_| Ok(Box::new(Tinted::default())));
            let config = Config { seed, ..config.clone() };
            refine(image.view(), &camera, stages, &config, &mut go_on).unwrap()
        };
        let one = run(&image, &prior, 0);
        assert!(one.depth == run(&image, &prior, 1).depth, "{preset:?}: the seed has an influence");
        let moved = deviation(&one.depth.mean().to_owned(), &prior);
        assert!(moved > 1e-3, "{preset:?}: nothing is refined, so nothing is tested ({moved:e})");
        let other = run(&mirrored.0, &mirrored.1, 0);
        for (name, one, mut other) in [
            ("depth", one.depth.mean().to_owned(), other.depth.mean().to_owned()),
            ("sigma", one.depth.sigma(), other.depth.sigma()),
        ] {
            other.invert_axis(Axis(1));
            // Sums over the pixels run in another order.
            let off = deviation(&one, &other);
            assert!(off < 1e-4, "{preset:?}: {name} deviates by {off:e}");
        }
    }
}
