//! The loop over stages that this workspace has never heard of.
#![allow(clippy::unwrap_used)]

mod common;

use common::{HEIGHT, TINY, WIDTH};
use mde_cli::config::Preset;
use mde_cli::config::{Config, FieldUse, IterationPrior, RefinementConfig};
use mde_cli::error::Error;
use mde_cli::mde_fusion::{self, Fused, Fuser, FusionReport, Prior};
use mde_cli::mde_nerf::{self, FieldCallback, FitReport, RadianceField, RenderedView};
use mde_cli::mde_prior::{self, AugmentationConfig, DepthKind, DepthPrior, PriorDepth};
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_warp::{PinholeCamera, Pose, PosedView};
use mde_cli::refinement::event::{Event, Stage};
use mde_cli::refinement::refine;
use mde_cli::refinement::stages::Stages;
use mde_cli::reports::Refinement;
use mde_eval::scene::{Room, Scene, room};
use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
use ndarray::{Array2, Array3, ArrayView3};
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// A wall that records its inputs.
struct Wall {
    depth: f32,
    log: Arc<Mutex<Vec<String>>>,
}

impl RadianceField for Wall {
    fn fit(&mut self, views: &[PosedView], callback: &mut dyn FieldCallback) -> mde_nerf::Result<FitReport> {
        let original = views[0].pose == Pose::identity() && views[0].mask.iter().all(|real| *real);
        let moved = views[1..].iter().all(|view| view.pose != Pose::identity());
        self.log.lock().unwrap().push(format!("fit {} {original} {moved}", views.len()));
        let event = mde_nerf::FieldEvent::Fit { step: 1, steps: 1, loss: 0.0, psnr: 30.0 };
        if callback.on_event(&event).is_break() {
            return Err(mde_nerf::Error::Interrupted);
        }
        Ok(FitReport { steps: 1, psnr: vec![30.0], ..FitReport::default() })
    }

    fn render(
        &self,
        camera: &PinholeCamera,
        pose: &Pose,
        callback: &mut dyn FieldCallback,
    ) -> mde_nerf::Result<RenderedView> {
        self.log.lock().unwrap().push(format!("render {}", *pose == Pose::identity()));
        if callback.on_event(&mde_nerf::FieldEvent::Render { row: 1, rows: 1 }).is_break() {
            return Err(mde_nerf::Error::Interrupted);
        }
        let size = (camera.height, camera.width);
        Ok(RenderedView {
            image: Array3::zeros((size.0, size.1, 3)),
            depth: GaussianDepth::new(Array2::from_elem(size, self.depth), Array2::from_elem(size, 1e-2))?,
            opacity: Array2::ones(size),
            in_bin: None,
        })
    }
}

/// Half-way between the prior and the first view; remembers whether the prior came with a variance.
#[derive(Default)]
struct HalfWay {
    knew_variance: RefCell<Vec<bool>>,
    priors: RefCell<Vec<Array2<f32>>>,
}

impl Fuser for HalfWay {
    fn fuse(&self, prior: &Prior, evidence: &[GaussianDepth]) -> mde_fusion::Result<Fused> {
        self.knew_variance.borrow_mut().push(prior.variance().is_some());
        self.priors.borrow_mut().push(prior.mean().to_owned());
        let view = evidence[0].clone();
        let mean = 0.5 * &prior.mean() + 0.5 * &view.mean();
        let depth = GaussianDepth::new(mean, Array2::from_elem(prior.dim(), 0.04))?;
        Ok(Fused { depth, aggregated: view.clone(), aligned: view, report: FusionReport::default() })
    }
}

fn scene() -> Scene {
    room(Room::Study, 0, WIDTH, HEIGHT).unwrap()
}

fn prior(scene: &Scene) -> SimulatedPrior {
    SimulatedPrior::new(&scene.depth, &SimulatedPriorConfig::default()).unwrap()
}

fn config() -> Config {
    let mut config = Config::with_overrides(Preset::Paper, TINY, "tiny").unwrap();
    config.novel.count = 0;
    config
}

fn with_nerf(config: &Config) -> Refinement {
    let scene = scene();
    let prior = prior(&scene);
    let stages = Stages::new(&prior);
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    refine(scene.image.view(), &scene.camera, stages, config, &mut go_on).unwrap()
}

/// Runs the foreign stages; the callback stops the `stop`-th event.
fn with_wall(
    config: &Config,
    fuser: &HalfWay,
    stop: usize,
) -> (mde_cli::error::Result<Refinement>, Vec<String>, Vec<Event>) {
    let scene = scene();
    let log = Arc::new(Mutex::new(Vec::new()));
    let mut events = Vec::new();
    let mut observe = |event: &Event| {
        events.push(*event);
        if events.len() == stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let prior = prior(&scene);
    let stages = Stages::new(&prior)
        .with_field(|_| Ok(Box::new(Wall { depth: 3.0, log: log.clone() })))
        .with_fuser(fuser);
    let result = refine(scene.image.view(), &scene.camera, stages, config, &mut observe);
    let log = log.lock().unwrap().clone();
    (result, log, events)
}

#[test]
fn foreign_stages_are_called_in_order_and_their_word_is_final() {
    let fuser = HalfWay::default();
    let (result, log, events) = with_wall(&config(), &fuser, usize::MAX);
    let refinement = result.unwrap();
    let once = ["fit 4 true true", "render true"];
    assert_eq!(log, [once, once].concat());
    let stages: Vec<_> = events
        .iter()
        .filter_map(|event| match event {
            Event::Begin { stage, iteration, iterations: 2 } => Some((*stage, *iteration)),
            _ => None,
        })
        .collect();
    let around = |i| [(Stage::Warp, i), (Stage::Fit, i), (Stage::Render, i), (Stage::Fuse, i)];
    assert_eq!(stages, [vec![(Stage::Prior, 0)], around(0).to_vec(), around(1).to_vec()].concat());
    // Half-way, twice.
    for (refined, prior) in refinement.depth.mean().iter().zip(&refinement.prior) {
        assert!((refined - (0.25 * prior + 0.75 * 3.0)).abs() < 1e-5);
    }
    assert_eq!(refinement.iterations.len(), 2);
    assert_eq!(refinement.iterations[0].warp.views, 3);
}

#[test]
fn the_second_prior_is_what_the_configuration_says() {
    for (rule, knows, same) in [(IterationPrior::Carry, true, false), (IterationPrior::Anchor, false, true)] {
        let mut config = config();
        config.refinement.prior = rule;
        let fuser = HalfWay::default();
        with_wall(&config, &fuser, usize::MAX).0.unwrap();
        assert_eq!(*fuser.knew_variance.borrow(), [false, knows], "{rule:?}");
        let priors = fuser.priors.borrow();
        assert_eq!(priors[0] == priors[1], same, "{rule:?}");
    }
}

#[test]
fn the_callback_can_stop_at_every_event() {
    let events = with_wall(&config(), &HalfWay::default(), usize::MAX).2.len();
    for stop in 1..=events {
        let (result, _, heard) = with_wall(&config(), &HalfWay::default(), stop);
        assert!(matches!(result, Err(Error::Interrupted)), "event {stop}: {:?}", heard.last());
        assert_eq!(heard.len(), stop);
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
    let config = config();
    let (first, second) = (with_nerf(&config), with_nerf(&config));
    assert!(first.depth == second.depth);
    assert!(first.prior == second.prior);
    let other = with_nerf(&Config { seed: 1, ..config });
    assert!(first.depth != other.depth);
    assert!(first.prior == other.prior);
}

#[test]
fn a_prior_of_another_size_and_a_wrong_configuration_are_refused() {
    struct Small;
    impl DepthPrior for Small {
        fn predict(
            &self,
            _: ndarray::ArrayView3<'_, f32>,
        ) -> mde_cli::mde_prior::Result<mde_cli::mde_prior::PriorDepth> {
            mde_cli::mde_prior::PriorDepth::from_values(Array2::ones((2, 3)), DepthKind::Metric)
        }
    }
    let (scene, fuser) = (scene(), HalfWay::default());
    let run = |prior: &dyn DepthPrior, config: &Config| {
        let stages =
            Stages::new(prior).with_field(|_| Err(mde_nerf::Error::NotFitted.into())).with_fuser(&fuser);
        let mut go_on = |_: &Event| ControlFlow::Continue(());
        refine(scene.image.view(), &scene.camera, stages, config, &mut go_on).map(|_| ())
    };
    assert!(matches!(run(&Small, &config()), Err(Error::Size { prior: [2, 3], image: [HEIGHT, WIDTH] })));
    let good = prior(&scene);
    assert!(matches!(run(&good, &config()), Err(Error::Field(mde_nerf::Error::NotFitted))));
    let mut many = config();
    many.refinement.iterations = 101;
    assert!(matches!(run(&good, &many), Err(Error::Config { .. })));
}

/// Takes the red channel of any image for depth, and counts the calls.
struct Red(AtomicUsize);

impl DepthPrior for Red {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        self.0.fetch_add(1, Ordering::Relaxed);
        PriorDepth::from_values(image.map_axis(ndarray::Axis(2), |c| 0.5 + c[0]), DepthKind::Metric)
    }

    fn accepts_new_images(&self) -> bool {
        true
    }
}

/// Without a field the augmented map is the result, with the common error in its sigma. A map from a file is not augmented, and
/// the report records it.
#[test]
fn without_a_field_the_augmented_map_is_the_result_and_a_map_is_not_augmented() {
    let scene = scene();
    let fuser = HalfWay::default();
    let mut config = Config { augmentation: AugmentationConfig::multi_crop(), ..config() };
    config.refinement.iterations = 0;
    config.fusion.common_error = 0.1;
    let run = |prior: &dyn DepthPrior| {
        let mut calls = Vec::new();
        let mut listen = |event: &Event| {
            if let Event::Predicted { done, total } = event {
                calls.push((*done, *total));
            }
            ControlFlow::Continue(())
        };
        let stages = Stages::new(prior).with_field(|_| panic!("a field was made")).with_fuser(&fuser);
        let refined = refine(scene.image.view(), &scene.camera, stages, &config, &mut listen).unwrap();
        (refined, calls)
    };
    let model = Red(AtomicUsize::new(0));
    let (refined, calls) = run(&model);
    let predictions = refined.augmentation.predictions;
    assert!(predictions > 9 && model.0.load(Ordering::Relaxed) == predictions);
    assert_eq!(calls.last(), Some(&(predictions, predictions)));
    assert!(refined.field.is_none() && refined.augmentation.skipped.is_none());
    for (mean, sigma) in refined.depth.mean().iter().zip(refined.depth.sigma()) {
        assert!(*mean > 0.0 && sigma >= 0.1 * mean);
    }
    let once = Config {
        refinement: RefinementConfig { iterations: 1, order: Order::Poses, ..config.refinement.clone() },
        ..config.clone()
    };
    let stages = Stages::new(&model).with_field(|_| panic!("a field was made")).with_fuser(&fuser);
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let same = refine(scene.image.view(), &scene.camera, stages, &once, &mut go_on).unwrap();
    assert_eq!(same.depth, refined.depth);
    let map = prior(&scene);
    let (kept, calls) = run(&map);
    assert_eq!((kept.depth.mean(), calls.len()), (kept.prior.view(), 0));
    assert!(kept.augmentation.skipped.is_some());
}

/// The components of sigma are separate: no part is above the whole, and together they are the whole.
#[test]
fn the_parts_of_sigma_make_the_whole() {
    let scene = scene();
    let fuser = HalfWay::default();
    let mut config = Config { augmentation: AugmentationConfig::multi_crop(), ..config() };
    config.refinement.iterations = 0;
    config.fusion.common_error = 0.1;
    let model = Red(AtomicUsize::new(0));
    let stages = Stages::new(&model).with_field(|_| panic!("a field was made")).with_fuser(&fuser);
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let refined = refine(scene.image.view(), &scene.camera, stages, &config, &mut go_on).unwrap();
    let names: Vec<_> = refined.components.iter().map(|part| part.name).collect();
    assert_eq!(names, ["spread", "disagreement", "common"]);
    for (at, variance) in refined.depth.variance().indexed_iter() {
        let sum: f32 = refined.components.iter().map(|part| part.sigma[at].powi(2)).sum();
        // Hypotheses that agree have a floor of a thousandth of the depth.
        let floor = 1e-6 * refined.depth.mean()[at].powi(2);
        assert!((variance - sum).abs() <= 1.01 * floor + 1e-4 * sum, "{variance} {sum} at {at:?}");
    }
}
