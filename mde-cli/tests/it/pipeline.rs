//! The loop over stages that this workspace has never heard of.

use crate::library::{HEIGHT, TINY, WIDTH, config, go_on};
use mde_cli::config::{IterationPrior, Order, RefinementConfig};
use mde_cli::mde_fusion::{self, Fused, Fuser, FusionReport, Prior};
use mde_cli::mde_nerf::{self, FieldCallback, FitReport, RadianceField, RenderedView};
use mde_cli::mde_prior::{self, AugmentationConfig, DepthKind, DepthPrior, PriorDepth};
use mde_cli::mde_uncertainty::GaussianDepth;
use mde_cli::mde_warp::{PinholeCamera, Pose, PosedView};
use mde_cli::{Config, Error, Event, Preset, Refinement, Stage, Stages, refine};
use mde_eval::scene::{Room, Scene, room};
use mde_eval::simulated::{SimulatedPrior, SimulatedPriorConfig};
use ndarray::{Array2, Array3, ArrayView3};
use std::cell::RefCell;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex};

static SCENE: LazyLock<Scene> = LazyLock::new(|| room(Room::Study, 0, WIDTH, HEIGHT).unwrap());
static PRIOR: LazyLock<SimulatedPrior> =
    LazyLock::new(|| SimulatedPrior::new(&SCENE.depth, &SimulatedPriorConfig::default()).unwrap());

/// A wall that records its inputs.
struct Wall(Arc<Mutex<Vec<String>>>);

impl RadianceField for Wall {
    fn fit(&mut self, views: &[PosedView], callback: &mut dyn FieldCallback) -> mde_nerf::Result<FitReport> {
        let original = views[0].pose == Pose::identity() && views[0].mask.iter().all(|real| *real);
        let moved = views[1..].iter().all(|view| view.pose != Pose::identity());
        self.0.lock().unwrap().push(format!("fit {} {original} {moved}", views.len()));
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
        self.0.lock().unwrap().push(format!("render {}", *pose == Pose::identity()));
        if callback.on_event(&mde_nerf::FieldEvent::Render { row: 1, rows: 1 }).is_break() {
            return Err(mde_nerf::Error::Interrupted);
        }
        let size = (camera.height, camera.width);
        Ok(RenderedView {
            image: Array3::zeros((size.0, size.1, 3)),
            depth: GaussianDepth::new(Array2::from_elem(size, 3.0), Array2::from_elem(size, 1e-2))?,
            opacity: Array2::ones(size),
            in_bin: None,
        })
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

fn short() -> Config {
    let mut config = config(Preset::Paper, TINY);
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
    let stages = Stages::new(&*PRIOR).with_field(|_| Ok(Box::new(Wall(log.clone())))).with_fuser(fuser);
    let result = refine(SCENE.image.view(), &SCENE.camera, stages, config, &mut observe);
    let log = log.lock().unwrap().clone();
    (result, log, events)
}

#[test]
fn foreign_stages_are_called_in_order_and_their_word_is_final() {
    let (result, log, events) = with_wall(&short(), &HalfWay::default(), usize::MAX);
    let refinement = result.unwrap();
    let once = ["fit 4 true true", "render true"];
    assert_eq!(log, [once, once].concat());
    let stages = events.iter().filter_map(|event| match event {
        Event::Begin { stage, iteration, iterations: 2 } => Some((*stage, *iteration)),
        _ => None,
    });
    let around = |i| [(Stage::Warp, i), (Stage::Fit, i), (Stage::Render, i), (Stage::Fuse, i)];
    assert_eq!(stages.collect::<Vec<_>>(), [&[(Stage::Prior, 0)], &around(0)[..], &around(1)].concat());
    // Half-way, twice.
    for (refined, prior) in refinement.depth.mean().iter().zip(&refinement.prior) {
        assert!((refined - (0.25 * prior + 0.75 * 3.0)).abs() < 1e-5);
    }
    assert_eq!((refinement.iterations.len(), refinement.iterations[0].warp.views), (2, 3));
}

#[test]
fn the_second_prior_is_what_the_configuration_says() {
    for (rule, knows, same) in [(IterationPrior::Carry, true, false), (IterationPrior::Anchor, false, true)] {
        let mut config = short();
        config.refinement.prior = rule;
        let fuser = HalfWay::default();
        with_wall(&config, &fuser, usize::MAX).0.unwrap();
        let priors = fuser.0.borrow();
        assert_eq!((priors[0].0, priors[1].0), (false, knows), "{rule:?}");
        assert_eq!(priors[0].1 == priors[1].1, same, "{rule:?}");
    }
}

#[test]
fn the_callback_can_stop_at_every_event() {
    let events = with_wall(&short(), &HalfWay::default(), usize::MAX).2.len();
    for stop in 1..=events {
        let (result, _, heard) = with_wall(&short(), &HalfWay::default(), stop);
        assert!(matches!(result, Err(Error::Interrupted)), "event {stop}: {:?}", heard.last());
        assert_eq!(heard.len(), stop);
    }
}

#[test]
fn a_prior_of_another_size_and_a_field_that_fails_are_errors() {
    struct Small;
    impl DepthPrior for Small {
        fn predict(&self, _: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
            PriorDepth::from_values(Array2::ones((2, 3)), DepthKind::Metric)
        }
    }
    let fuser = HalfWay::default();
    let run = |prior: &dyn DepthPrior| {
        let stages =
            Stages::new(prior).with_field(|_| Err(mde_nerf::Error::NotFitted.into())).with_fuser(&fuser);
        refine(SCENE.image.view(), &SCENE.camera, stages, &short(), &mut go_on).map(|_| ())
    };
    assert!(matches!(run(&Small), Err(Error::Size { prior: [2, 3], image: [HEIGHT, WIDTH] })));
    assert!(matches!(run(&*PRIOR), Err(Error::Field(mde_nerf::Error::NotFitted))));
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

/// Without a field the augmented map is the result, with the common error in its sigma, whose components make the whole. A map from
/// a file is not augmented, and the report records it.
#[test]
fn without_a_field_the_augmented_map_is_the_result_and_a_map_is_not_augmented() {
    let mut config = Config { augmentation: AugmentationConfig::multi_crop(), ..short() };
    config.refinement.iterations = 0;
    config.fusion.common_error = 0.1;
    let run = |prior: &dyn DepthPrior, config: &Config| {
        let mut calls = Vec::new();
        let mut listen = |event: &Event| {
            if let Event::Predicted { done, total } = event {
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
    let (refined, calls) = run(&model, &config);
    let predictions = refined.augmentation.predictions;
    assert!(predictions > 9 && model.0.load(Ordering::Relaxed) == predictions);
    assert_eq!(calls.last(), Some(&(predictions, predictions)));
    assert!(refined.field.is_none() && refined.augmentation.skipped.is_none());
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
    assert_eq!(run(&model, &Config { refinement, ..config.clone() }).0.depth, refined.depth);
    let (kept, calls) = run(&*PRIOR, &config);
    assert_eq!((kept.depth.mean(), calls.len()), (kept.prior.view(), 0));
    assert!(kept.augmentation.skipped.is_some());
}
