//! The loop on one photograph: stages that this workspace has never heard of, and properties for arbitrary inputs.

use crate::library::{HEIGHT, Known, WIDTH, config, go_on, tiny};
use mde_cli::config::{IterationPrior, Order, RefinementConfig};
use mde_cli::mde_fusion::{self, Fused, Fuser, FusionReport, Prior};
use mde_cli::mde_nerf::{self, FieldCallback, FieldConfig, FitReport, RadianceField, RenderedView};
use mde_cli::mde_prior::{self, AugmentationConfig, DepthKind, DepthPrior, FilePrior, PriorDepth};
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_warp::{PinholeCamera, Pose, PosedView};
use mde_cli::{Config, Error, Event, Preset, Refinement, Stage, Stages, refine};
use mde_eval::baseline::Unsharp;
use mde_eval::field::FilteredField;
use mde_eval::scene::{Room, Scene, room};
use ndarray::{Array2, Array3, ArrayView3, Axis, s};
use proptest::prelude::*;
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex};

static SCENE: LazyLock<Scene> = LazyLock::new(|| room(Room::Study, 0, WIDTH, HEIGHT).unwrap());

/// As from a file.
fn map(depth: &Array2<f32>) -> FilePrior {
    FilePrior::of_map("prior.npy", PriorDepth::from_values(depth.clone(), DepthKind::Metric).unwrap())
}

/// A wall that records its inputs.
struct Wall(Arc<Mutex<Vec<String>>>);

impl RadianceField for Wall {
    fn fit(&mut self, views: &[PosedView], callback: &mut FieldCallback<'_>) -> mde_nerf::Result<FitReport> {
        let original = views[0].pose == Pose::identity() && views[0].mask.iter().all(|real| *real);
        let moved = views[1..].iter().all(|view| view.pose != Pose::identity());
        self.0.lock().unwrap().push(format!("fit {} {original} {moved}", views.len()));
        let event = mde_nerf::FieldEvent::Fit { step: 1, steps: 1, loss: 0.0, psnr: 30.0 };
        if callback(&event).is_break() {
            return Err(mde_nerf::Error::Interrupted);
        }
        Ok(FitReport { steps: 1, psnr: 30.0, ..FitReport::default() })
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut FieldCallback<'_>,
    ) -> mde_nerf::Result<RenderedView> {
        self.0.lock().unwrap().push(format!("render {}", *pose == Pose::identity()));
        if callback(&mde_nerf::FieldEvent::Render { row: 1, rows: 1 }).is_break() {
            return Err(mde_nerf::Error::Interrupted);
        }
        let size = (camera.height, camera.width);
        let depth = GaussianDepth::new(Array2::from_elem(size, 3.0), Array2::from_elem(size, 1e-2))?;
        let image = Array3::zeros((size.0, size.1, 3));
        Ok(RenderedView { image, depth, opacity: Array2::ones(size), in_bin: None })
    }
}

/// Half-way between the prior and the first view; remembers the priors, and whether they came with a variance.
#[derive(Default)]
struct HalfWay(RefCell<Vec<(bool, Array2<f32>)>>);

impl Fuser for HalfWay {
    fn fuse(&self, prior: &Prior, evidence: &[GaussianDepth]) -> mde_fusion::Result<Fused> {
        self.0.borrow_mut().push((prior.variance().is_some(), prior.mean().to_owned()));
        let view = evidence[0].clone();
        let mean = 0.5 * &prior.mean() + 0.5 * &view.mean();
        let depth = GaussianDepth::new(mean, Array2::from_elem(prior.dim(), 0.04))?;
        Ok(Fused { depth, aggregated: view.clone(), aligned: view, report: FusionReport::default() })
    }
}

fn foreign() -> Config {
    let mut config = config(Preset::Paper, &tiny(60, 2));
    config.novel.count = 0;
    config
}

/// Runs the foreign stages; the callback stops the `stop`-th event.
fn with_wall(
    config: &Config,
    fuser: &HalfWay,
    stop: usize,
) -> (mde_cli::Result<Refinement>, Vec<String>, Vec<Event>) {
    let log = Arc::new(Mutex::new(Vec::new()));
    let mut events = Vec::new();
    let mut observe = |event: &Event| {
        events.push(*event);
        if events.len() == stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let prior = map(&SCENE.depth);
    let stages = Stages::new(&prior).with_field(|_| Ok(Box::new(Wall(log.clone())))).with_fuser(fuser);
    let result = refine(SCENE.image.view(), &SCENE.camera, stages, config, &mut observe);
    let log = log.lock().unwrap().clone();
    (result, log, events)
}

/// Twice half-way: from the prior, and then from the prior or the first result, as configured.
#[test]
fn foreign_stages_are_called_in_order_and_their_word_is_final() {
    for (rule, has_variance, share) in
        [(IterationPrior::Carry, true, 0.25), (IterationPrior::Anchor, false, 0.5)]
    {
        let mut config = foreign();
        config.refinement.prior = rule;
        let fuser = HalfWay::default();
        let (result, log, events) = with_wall(&config, &fuser, usize::MAX);
        let refinement = result.unwrap();
        let once = ["fit 4 true true", "render true"];
        assert_eq!(log, [once, once].concat());
        let stages = events.iter().filter_map(|event| match event {
            Event::Begin { stage, iteration, iterations: 2 } => Some((*stage, *iteration)),
            _ => None,
        });
        let around = |i| [(Stage::Warp, i), (Stage::Fit, i), (Stage::Render, i), (Stage::Fuse, i)];
        assert_eq!(stages.collect::<Vec<_>>(), [&[(Stage::Prior, 0)], &around(0)[..], &around(1)].concat());
        let priors = fuser.0.borrow();
        assert_eq!((priors[0].0, priors[1].0), (false, has_variance), "{rule:?}");
        assert_eq!(priors[0].1 == priors[1].1, rule == IterationPrior::Anchor, "{rule:?}");
        for (refined, prior) in refinement.depth.mean().iter().zip(&refinement.prior) {
            assert!((refined - (share * prior + (1.0 - share) * 3.0)).abs() < 1e-5, "{rule:?}");
        }
        assert_eq!((refinement.iterations.len(), refinement.iterations[0].warp.views), (2, 3));
    }
}

#[test]
fn the_callback_can_stop_at_every_event() {
    let events = with_wall(&foreign(), &HalfWay::default(), usize::MAX).2.len();
    for stop in 1..=events {
        let (result, _, heard) = with_wall(&foreign(), &HalfWay::default(), stop);
        assert!(matches!(result, Err(Error::Interrupted)), "event {stop}: {:?}", heard.last());
        assert_eq!(heard.len(), stop);
    }
}

#[test]
fn a_prior_of_another_size_and_a_field_that_fails_are_errors() {
    let small = PriorDepth::from_values(Array2::ones((2, 3)), DepthKind::Metric).unwrap();
    let fuser = HalfWay::default();
    let run = |prior: &dyn DepthPrior| {
        let stages =
            Stages::new(prior).with_field(|_| Err(mde_nerf::Error::NotFitted.into())).with_fuser(&fuser);
        refine(SCENE.image.view(), &SCENE.camera, stages, &foreign(), &mut go_on).map(|_| ())
    };
    assert!(matches!(
        run(&Known(vec![(SCENE.image.clone(), small)])),
        Err(Error::Size { prior: [2, 3], image: [HEIGHT, WIDTH] })
    ));
    assert!(matches!(run(&map(&SCENE.depth)), Err(Error::Field(mde_nerf::Error::NotFitted))));
}

/// Takes the red channel of any image for depth, and counts the calls.
struct Red(AtomicUsize);

impl DepthPrior for Red {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        self.0.fetch_add(1, Ordering::Relaxed);
        PriorDepth::from_values(image.map_axis(Axis(2), |c| 0.5 + c[0]), DepthKind::Metric)
    }

    fn accepts_new_images(&self) -> bool {
        true
    }
}

/// With the common error in its sigma, whose components make the whole; the report records that a file's map is not augmented.
#[test]
fn without_a_field_the_augmented_map_is_the_result_and_a_map_is_not_augmented() {
    let mut config = Config { augmentation: AugmentationConfig::multi_crop(), ..foreign() };
    config.refinement.iterations = 0;
    config.fusion.common_error = 0.1;
    let augmented = |prior: &dyn DepthPrior, config: &Config| {
        let mut calls = Vec::new();
        let mut listen = |event: &Event| {
            if let Event::Part { done, total, .. } = event {
                calls.push((*done, *total));
            }
            ControlFlow::Continue(())
        };
        let fuser = HalfWay::default();
        let stages = Stages::new(prior).with_field(|_| panic!("a field was made")).with_fuser(&fuser);
        let refined = refine(SCENE.image.view(), &SCENE.camera, stages, config, &mut listen).unwrap();
        (refined, calls)
    };
    let model = Red(AtomicUsize::new(0));
    let (refined, calls) = augmented(&model, &config);
    let predictions = refined.augmentation.predictions;
    assert!(predictions > 9 && model.0.load(Ordering::Relaxed) == predictions);
    assert_eq!(calls.last(), Some(&(predictions, predictions)));
    assert!(refined.field.is_none() && refined.augmentation.fewer.is_none());
    for (mean, sigma) in refined.depth.mean().iter().zip(refined.depth.sigma()) {
        assert!(*mean > 0.0 && sigma >= 0.1 * mean);
    }
    let names: Vec<_> = refined.components.iter().map(|part| part.name).collect();
    assert_eq!(names, ["spread", "disagreement", "common"]);
    for (at, variance) in refined.depth.variance().indexed_iter() {
        let sum: f32 = refined.components.iter().map(|part| part.sigma[at].powi(2)).sum();
        // Hypotheses that agree have a floor of a thousandth of the depth.
        let floor = 1e-6 * refined.depth.mean()[at].powi(2);
        assert!((variance - sum).abs() <= 1.01 * floor + 1e-4 * sum, "{variance} {sum} at {at:?}");
    }
    let refinement = RefinementConfig { iterations: 1, order: Order::Poses, ..config.refinement.clone() };
    assert_eq!(augmented(&model, &Config { refinement, ..config.clone() }).0.depth, refined.depth);
    let (kept, calls) = augmented(&map(&SCENE.depth), &config);
    assert_eq!((kept.depth.mean(), calls.len()), (kept.prior.view(), 0));
    assert!(kept.augmentation.fewer.is_some());
}

fn run(image: &Array3<f32>, prior: &Array2<f32>, config: &Config, fov: f64) -> mde_cli::Result<Refinement> {
    let (height, width) = prior.dim();
    let camera = PinholeCamera::from_fov(fov, width, height)?;
    refine(image.view(), &camera, Stages::new(&map(prior)), config, &mut go_on)
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

    /// Every known depth is positive and finite with a finite variance; the others are missing.
    #[test]
    fn any_scene_under_any_settings((image, prior) in any_scene(), config in any_config(), fov in 1.0..179.0_f64) {
        let depth = run(&image, &prior, &config, fov).map_err(|error| TestCaseError::fail(error.to_string()))?.depth;
        for (d, v) in depth.mean().iter().zip(depth.variance()) {
            // As printed, Eq. 15 can give a variance of 0; it is never below.
            let known = *d > 0.0 && d.is_finite() && *v >= 0.0 && v.is_finite();
            prop_assert!(known || (*d == 0.0 && *v == f32::INFINITY), "depth {d}, variance {v}");
        }
        prop_assert!(depth.mean().iter().any(|d| *d > 0.0));
    }
}

fn study() -> (Array3<f32>, Array2<f32>) {
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
            let filter = || Box::new(Unsharp { amount: 2.0 });
            let stages = Stages::new(&prior).with_field(|_| Ok(Box::new(FilteredField::new(filter(), 0))));
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
