//! The one way with procedural rooms: what earlier ways of their own got wrong.

use crate::config::{Config, Preset};
use crate::prior::{OpenPrior, PriorForm, PriorOrigin};
use crate::refiner::{MemoryLimit, Observer, Refined, Refiner, Settings, Silent, Unit};
use crate::scene::{CameraSource, KnownCamera, Photograph, Scene};
use mde_eval::capture::Capture;
use mde_eval::scene::{CaptureConfig, Room, World};
use mde_prior::augment::Predictions;
use mde_prior::{DepthKind, DepthPrior, InferenceMemory, ModelSpec, PriorDepth};
use mde_uncertainty::pooled::Tails;
use ndarray::{ArcArray, Array2, ArrayView3, Ix3};

const SIZE: [usize; 2] = [128, 96];

/// The exact depth of the first photograph, a constant elsewhere; of a network that takes so many bytes, and a prediction a hundred million.
pub(super) struct Network {
    pub(super) known: Option<(ArcArray<f32, Ix3>, Array2<f32>)>,
    pub(super) bytes: u64,
}

impl DepthPrior for Network {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        let (height, width, _) = image.dim();
        let depth = match &self.known {
            Some((known, depth)) if known.view() == image => depth.clone(),
            _ => Array2::from_elem((height, width), 3.0),
        };
        PriorDepth::from_values(depth, DepthKind::Metric)
    }

    fn accepts_new_images(&self) -> bool {
        true
    }

    fn concurrency(&self) -> usize {
        usize::MAX
    }

    fn memory(&self, _: usize, _: usize) -> Option<InferenceMemory> {
        Some(InferenceMemory { model: self.bytes, prediction: 100_000_000 })
    }
}

fn room() -> Capture {
    let config = CaptureConfig { views: 3, ..CaptureConfig::default() };
    World::new(Room::Kitchen, 0).unwrap().capture("kitchen", &config, SIZE[0], SIZE[1]).unwrap()
}

fn network(room: Option<&Capture>, bytes: u64, change: impl FnOnce(&mut PriorOrigin)) -> OpenPrior<'static> {
    let known = room.map(|room| (room.views[0].view.image.clone(), room.truth.clone()));
    let mut origin = PriorOrigin::new(PriorForm::Network, DepthKind::Metric, "net.onnx");
    change(&mut origin);
    OpenPrior::given(Box::new(Network { known, bytes }), origin)
}

fn photographs(room: &Capture, posed: bool) -> Vec<Photograph> {
    let photograph = |(index, known): (usize, &mde_eval::capture::CapturedView)| {
        let source = CameraSource::Exif(20.0 + index as f64);
        let camera = KnownCamera { camera: known.view.camera, source };
        let pose = posed.then_some(known.view.pose);
        Photograph { pose, ..Photograph::new(format!("{index}.png"), known.view.image.clone(), camera) }
    };
    room.views.iter().enumerate().map(photograph).collect()
}

/// Several photographs without a field, which takes the time.
fn settings() -> Settings {
    let mut settings = Settings::new(Preset::MultiView);
    settings.config.refinement.iterations = 0;
    settings
}

#[derive(Default)]
struct Warnings(Vec<String>);

impl Observer for Warnings {
    fn warn(&mut self, warning: String) {
        self.0.push(warning);
    }
}

fn refined<'s>(
    refiner: &'s Refiner<'_>,
    scene: &'s Scene,
    photograph: usize,
    seen: &mut dyn Observer,
) -> Refined<'s> {
    let plan = refiner.plan("test", (SIZE[1], SIZE[0]), scene.photographs.len()).unwrap();
    refiner.prepare(scene, &plan, seen).unwrap().refine(photograph, None, seen).unwrap()
}

/// Two photographs of one place show nothing of its depth.
fn still(room: &Capture) -> Scene {
    let mut photographs = photographs(room, false);
    photographs.truncate(2);
    photographs[1].image = photographs[0].image.clone();
    Scene::several(photographs).unwrap()
}

#[test]
fn several_photographs_have_neither_the_intervals_nor_the_scale_of_one() {
    let room = room();
    // A constant: against the exact depth the photographs would be refused.
    let prior = network(None, 0, |origin| origin.model_hash = Some("029a5197".to_owned()));
    let error_bar = crate::refiner::error_bar::ErrorBar::open(Some(0.5), None).unwrap();
    let settings = Settings { error_bar, ..settings() };
    let refiner = Refiner::new(&prior, settings).unwrap();
    let several = Scene::several(photographs(&room, true)).unwrap();
    let found = refined(&refiner, &several, 0, &mut Silent);
    let capture = found.refinement.capture.as_ref().unwrap();
    assert!(capture.fallback.is_none(), "{capture:?}");
    let half_width = found.stated.interval.unwrap().half_width;
    assert_eq!((half_width, found.stated.scale.is_some()), (Tails::Heavy.half_width(0.5).unwrap(), false));
}

#[test]
fn refused_photographs_leave_no_scale_and_the_settings_as_they_are() {
    let room = room();
    let prior = network(Some(&room), 0, |_| {});
    let mut settings = settings();
    settings.config.augmentation.predictions = Predictions::Most(2);
    settings.config.sigma.spread = 7.0;
    let expected = Config { seed: 0, ..settings.config.clone() };
    settings.unit = Unit::Capture;
    let refiner = Refiner::new(&prior, settings).unwrap();
    let scene = still(&room);
    let mut seen = Warnings::default();
    let found = refined(&refiner, &scene, 0, &mut seen);
    let report = found.refinement.capture.as_ref().unwrap();
    assert!(report.fallback.is_some() && report.scale.is_none(), "{report:?}");
    assert!(found.refinement.components.iter().all(|part| part.name != "gauge"));
    assert_eq!(found.unit, "m");
    assert!(seen.0.iter().any(|warning| warning.contains("{unit}")), "{:?}", seen.0);
    let alone = Settings { config: expected, ..Settings::new(Preset::MultiView) };
    let alone = Refiner::new(&prior, alone).unwrap();
    let one = Scene::one(photographs(&room, false).remove(0));
    let same = refined(&alone, &one, 0, &mut Silent);
    assert_eq!(found.refinement.augmentation.predictions, same.refinement.augmentation.predictions);
    assert_eq!(found.refinement.depth, same.refinement.depth);
}

/// Its camera's source, and the metres of its own focal length.
#[test]
fn each_photograph_has_its_own_camera() {
    let room = room();
    let spec = ModelSpec { canonical_focal: Some(1000.0), ..ModelSpec::new(128, 96, DepthKind::Metric) };
    let prior = network(Some(&room), 0, |origin| origin.model = Some(spec));
    let mut photographs = photographs(&room, true);
    photographs[1].camera.camera.fx *= 2.0;
    let scene = Scene::several(photographs.clone()).unwrap();
    let refiner = Refiner::new(&prior, settings()).unwrap();
    let plan = refiner.plan("test", (SIZE[1], SIZE[0]), 3).unwrap();
    let prepared = refiner.prepare(&scene, &plan, &mut Silent).unwrap();
    let of = |index: usize| prepared.several().unwrap().prior_depth(index).unwrap();
    // Both are constant for the network.
    assert!((of(1)[(0, 0)] / of(2)[(0, 0)] - 2.0).abs() < 1e-5);
    let alone = Scene::one(photographs.remove(0));
    let plan = refiner.plan("test", (SIZE[1], SIZE[0]), 1).unwrap();
    let own = refiner.prepare(&alone, &plan, &mut Silent).unwrap().prior_depth().unwrap();
    assert_eq!(*of(0), own);
    drop(prepared);
    let second = refined(&refiner, &scene, 2, &mut Silent);
    assert_eq!(second.camera.source, CameraSource::Exif(22.0));
    let title = second.camera.title();
    assert!(title.contains(" px +- 1 % (") && title.ends_with("whole millimetres of 35 mm film"), "{title}");
}

#[test]
fn a_plan_counts_the_network_for_one_photograph_and_for_several() {
    let huge = network(None, 3 << 30, |_| {});
    let memory = MemoryLimit { gib: 2.0 };
    let refiner = Refiner::new(&huge, Settings { memory, ..settings() }).unwrap();
    for photographs in [1, 3] {
        let refused = refiner.plan("photo.png", (96, 128), photographs).unwrap_err().to_string();
        assert!(refused.contains("{max-memory}") && refused.contains("network"), "{refused}");
    }
}
