//! Several photographs through the loop as a library and through the program: a procedural room with exact depth and poses.
#![allow(clippy::unwrap_used)]

mod common;

use assert_cmd::Command;
use common::capture::{Known, inputs, rendered_at};
use common::wait_until;
use mde_cli::config::{Config, Preset};
use mde_cli::mde_fusion::{Fused, Fuser, FusionReport, Prior};
use mde_cli::mde_mvs::capture::{
    CaptureFiles, Distortion, Frame, Lens, PixelCentres, read_transforms, transforms_json,
};
use mde_cli::mde_prior::DisparityRule;
use mde_cli::mde_prior::format::{ReadOptions, read_values, write_npy};
use mde_cli::mde_prior::photo::write_image;
use mde_cli::ndarray::{Array2, Array3};
use mde_cli::refinement::event::Event;
use mde_cli::refinement::scale::KnownDepth;
use mde_cli::refinement::stages::Stages;
use mde_cli::refiner::plan::capture_bytes;
use mde_cli::reports::Refinement;
use mde_cli::several::prepared::PreparedCapture;
use mde_cli::several::{Capture, Photograph, refine_capture};
use mde_eval::capture::Capture as Rendered;
use mde_eval::scene::Room;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use std::ops::ControlFlow;

const WIDTH: usize = 128;
const HEIGHT: usize = 96;

fn rendered(room: Room, views: usize) -> Rendered {
    rendered_at(room, views, [WIDTH, HEIGHT])
}

fn config() -> Config {
    // As many rays per pixel as 700 steps have at 320x240, and a grid of that many cells.
    let text = "nerf.train.steps = 250\nnerf.train.rays = 512\nnerf.field.finest = 128\n";
    Config::with_overrides(Preset::MultiView, text, "test").unwrap()
}

fn run(capture: &Capture, prior: &Known, config: &Config) -> Refinement {
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    refine_capture(capture, Stages::new(prior), config, &mut go_on).unwrap()
}

/// Median of \\(|d / t - 1|\\) after the median alignment: at this size edges are too coarse for a mean.
fn typical_error(depth: &Array2<f32>, truth: &Array2<f32>) -> f64 {
    let ratios =
        || depth.iter().zip(truth).filter(|(d, t)| **d > 0.0 && **t > 0.0).map(|(d, t)| f64::from(d / t));
    let scale = median(ratios()).unwrap();
    median(ratios().map(|ratio| (ratio / scale - 1.0).abs())).unwrap()
}

#[test]
fn parallax_halves_the_typical_error_of_the_prior() {
    let room = rendered(Room::Study, 4);
    let (capture, prior) = inputs(&room, true);
    let refined = run(&capture, &prior, &config());
    let report = refined.capture.as_ref().unwrap();
    assert_eq!(report.fallback, None);
    assert_eq!(report.used(), 4);
    let before = typical_error(&refined.prior, &room.truth);
    let after = typical_error(&refined.depth.mean().to_owned(), &room.truth);
    assert!(after < 0.5 * before, "{after} of {before}");
    // In the unit of the prior, not of the poses: the prior's median is kept within its error.
    let ratio =
        median(refined.depth.mean().iter().zip(&refined.prior).map(|(d, p)| f64::from(d / p))).unwrap();
    assert!((0.8..1.25).contains(&ratio), "{ratio}");
    assert!(refined.depth.variance().iter().all(|v| *v > 0.0));
}

#[test]
fn photographs_of_another_place_leave_the_reference_alone() {
    let (mut capture, mut prior) = inputs(&rendered(Room::Study, 2), false);
    let (other, others) = inputs(&rendered(Room::Kitchen, 2), false);
    capture.photographs[1] = Photograph { name: "elsewhere".to_owned(), ..other.photographs[1].clone() };
    prior.0.extend(others.0);
    let refined = run(&capture, &prior, &config());
    let report = refined.capture.unwrap();
    assert!(
        report.fallback.as_ref().is_some_and(|reason| reason.contains("elsewhere")),
        "{:?}",
        report.fallback
    );
    assert_eq!(report.used(), 1);
    assert!(refined.field.is_none() && refined.augmentation.predictions > 1, "the default preset");
}

/// Where photographs are small, half of their matches may be wrong, and their poses right.
#[test]
fn small_photographs_keep_their_poses() {
    let (capture, prior) = inputs(&rendered_at(Room::Study, 3, [96, 72]), true);
    let text = "nerf.train.steps = 5\nnerf.train.rays = 64\nnerf.field.finest = 64\n";
    let refined = run(&capture, &prior, &Config::with_overrides(Preset::MultiView, text, "test").unwrap());
    let report = refined.capture.unwrap();
    assert_eq!((report.fallback.as_deref(), report.used()), (None, 3), "{:?}", report.photographs);
}

/// Poses and photographs of another place do not belong together: neither with one such photograph among others, nor with all.
#[test]
fn photographs_that_do_not_fit_their_poses_are_left_out_by_name() {
    let at = |room| rendered_at(room, 4, [256, 192]);
    let (good, prior) = inputs(&at(Room::Study), true);
    let (other, others) = inputs(&at(Room::Kitchen), false);
    let prior = Known(prior.0.into_iter().chain(others.0).collect());
    let mut config = config();
    config.refinement.iterations = 0;
    let with = |strange: std::ops::Range<usize>| {
        let mut capture = good.clone();
        for index in strange {
            let photograph = &other.photographs[index];
            capture.photographs[index].image.clone_from(&photograph.image);
        }
        run(&capture, &prior, &config)
    };
    let report = |refined: &Refinement| refined.capture.clone().unwrap();
    let as_given = report(&with(0..0));
    assert_eq!((as_given.used(), &as_given.fallback), (4, &None));
    assert!(as_given.photographs.iter().all(|photograph| photograph.matches > Some(20)), "{as_given:?}");

    let one = report(&with(2..3));
    assert_eq!((one.used(), &one.fallback), (3, &None), "{:?}", one.photographs);
    let verdict = &one.photographs[2].verdict;
    assert!(!one.photographs[2].used && verdict.contains("matches"), "{verdict}");

    let all = with(1..4);
    let found = report(&all);
    assert_eq!(found.used(), 1);
    assert!(
        found.fallback.as_ref().is_some_and(|reason| reason.contains("photograph 0")),
        "{:?}",
        found.fallback
    );
    assert!(all.augmentation.predictions > 1, "the default preset");
}

/// The scale between poses and prior is that of the points where there are some.
#[test]
fn points_of_the_capture_give_its_scale() {
    let room = rendered(Room::Study, 3);
    let (mut capture, prior) = inputs(&room, true);
    let mut config = config();
    config.refinement.iterations = 0;
    let Photograph { camera, pose, .. } = capture.photographs[capture.reference];
    let back = pose.unwrap().inverse();
    let points = room.truth.indexed_iter().step_by(97).filter(|(_, z)| **z > 0.0);
    capture.points = points
        .map(|((y, x), &z)| back * camera.unproject([x as f64, y as f64].into(), f64::from(z)))
        .collect();
    let scale = |capture: &Capture| run(capture, &prior, &config).capture.unwrap().scale.unwrap();
    let exact = scale(&capture);
    let own = prior.0[room.reference].1.to_depth(&DisparityRule::default()).unwrap();
    let ratios = room.truth.iter().zip(&own);
    let expected = median(ratios.filter(|(z, _)| **z > 0.0).map(|(z, p)| f64::from(z / p))).unwrap();
    assert!((exact[0] / expected).ln().abs() < 0.1, "{exact:?}, {expected}");
    // In a world of twice the size, seen from the same place, the scale is that of the points.
    let centre = back.translation.vector;
    capture.points.iter_mut().for_each(|point| point.coords += point.coords - centre);
    let twice = scale(&capture);
    assert!((twice[0] / exact[0] - 2.0).abs() < 0.05, "{twice:?}, {exact:?}");
}

/// The field as it is.
struct FieldAlone;

impl Fuser for FieldAlone {
    fn fuse(&self, _: &Prior, views: &[GaussianDepth]) -> mde_cli::mde_fusion::Result<Fused> {
        let field = views[0].clone();
        let report = FusionReport::default();
        Ok(Fused { depth: field.clone(), aggregated: field.clone(), aligned: field, report })
    }
}

/// Sigma of its components, each of which says something, whether a pixel has the field's depth or the consensus'.
fn is_the_root_sum_of_squares(refined: &Refinement) {
    let names: Vec<_> = refined.components.iter().map(|part| part.name).collect();
    assert_eq!(
        names,
        ["termination", "in-bin", "ambiguity", "prior", "view-disagreement", "parallax", "poses"]
    );
    for (at, &variance) in refined.depth.variance().indexed_iter() {
        let sum: f32 = refined.components.iter().map(|part| part.sigma[at].powi(2)).sum();
        assert!((sum / variance - 1.0).abs() < 1e-4 || variance.is_infinite() && sum.is_infinite());
    }
    for part in refined.components.iter().filter(|part| part.name != "poses") {
        let known = part.sigma.iter().filter(|s| s.is_finite());
        assert!(known.clone().all(|s| *s >= 0.0) && known.clone().any(|s| *s > 0.0), "{}", part.name);
    }
}

/// Eq. 10-17 in the printed order where the settings say so, or another fusion.
#[test]
fn the_printed_fusion_is_there_with_several_photographs() {
    let (capture, prior) = inputs(&rendered(Room::Study, 3), true);
    let mut config = config();
    let usual = run(&capture, &prior, &config);
    assert_eq!(usual.capture.as_ref().unwrap().fusion, None);
    is_the_root_sum_of_squares(&usual);

    config.fusion = Preset::Paper.config().fusion;
    let printed = run(&capture, &prior, &config);
    let report = printed.capture.as_ref().unwrap().fusion.clone().unwrap();
    assert!(report.degenerate.is_none() && report.a > 0.0 && report.b != 0.0, "{report:?}");
    let field = usual.depth.mean();
    assert!(printed.depth.mean().iter().zip(field).any(|(a, b)| (a / b - 1.0).abs() > 0.01));
    assert_eq!(printed.components.iter().map(|part| part.name).collect::<Vec<_>>(), ["field"]);

    let stages = Stages::new(&prior).with_fuser(&FieldAlone);
    let alone =
        refine_capture(&capture, stages, &config, &mut |_: &Event| ControlFlow::Continue(())).unwrap();
    assert!(alone.depth.mean().iter().zip(field).all(|(a, b)| *a == 0.0 || (a / b - 1.0).abs() < 1e-5));
}

#[test]
fn captures_that_are_none_are_refused_by_name() {
    let (capture, prior) = inputs(&rendered(Room::Study, 3), true);
    let refused = |change: &dyn Fn(&mut Capture)| {
        let mut capture = capture.clone();
        change(&mut capture);
        let mut go_on = |_: &Event| ControlFlow::Continue(());
        refine_capture(&capture, Stages::new(&prior), &config(), &mut go_on).err().unwrap().to_string()
    };
    for (change, named) in [
        (&(|c: &mut Capture| c.photographs.truncate(1)) as &dyn Fn(&mut Capture), "two or more"),
        (&|c: &mut Capture| c.reference = 9, "reference 9"),
        (&|c: &mut Capture| c.photographs[1].pose = None, "2 of 3 photographs have a pose"),
        (&|c: &mut Capture| c.photographs[1].name = "photograph 0".to_owned(), "photograph 0"),
        (&|c: &mut Capture| c.photographs[2].image = Array3::zeros((4, 4, 3)), "photograph 2"),
    ] {
        let message = refused(change);
        assert!(message.contains(named) && message.lines().count() == 1, "{message}");
    }
}

/// The program on a folder of photographs, with the poses of a file and without: the maps and their record.
#[test]
fn the_program_takes_photographs_with_poses_and_without() {
    // At this size matches are few; this room has enough.
    let room = rendered(Room::Kitchen, 3);
    let folder = on_disk(&room);
    let path = |name: &str| folder.path().join(name);
    let refine = |views: &str, more: &[&str], out: &str| {
        let mut command = Command::cargo_bin("mde").unwrap();
        command.current_dir(folder.path()).args(["refine", "images/0.png", "--views", views]);
        command.args(["--prior-depth", "prior.npy", "--config", "quick.toml", "-q", "-o", out]).args(more);
        command.assert()
    };
    let record = |out: &str| -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(path(out).join("run.json")).unwrap()).unwrap()
    };
    refine("transforms.json", &[], "posed").success();
    let posed = record("posed");
    assert_eq!(posed["preset"], "multi-view");
    assert_eq!(posed["capture"]["photographs"].as_array().unwrap().len(), 3);
    assert_ne!(posed["capture"]["poses"], "estimated");
    assert!(posed["capture"]["fallback"].is_null(), "{}", posed["capture"]);
    assert!(path("posed/report.html").is_file() && path("posed/sigma.npy").is_file());

    let fov = 2.0 * (0.5 * WIDTH as f64 / room.views[0].view.camera.fx).atan().to_degrees();
    refine("images", &["--fov", &fov.to_string()], "found").success();
    let found = record("found");
    assert_eq!(found["capture"]["poses"], "estimated");
    assert!(found["capture"]["fallback"].is_null(), "{}", found["capture"]);

    let message = |assert: assert_cmd::assert::Assert| {
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    };
    let missing = message(refine("nowhere", &[], "out").failure());
    assert!(missing.contains("nowhere") && missing.lines().count() == 1, "{missing}");
    std::fs::remove_file(path("images/2.png")).unwrap();
    let gone = message(refine("transforms.json", &[], "out").failure());
    assert!(gone.contains("2.png") && gone.lines().count() == 1, "{gone}");
    assert!(!path("out").exists());
}

/// Photographs of a room on disk: `images/0.png` ..., `transforms.json`, `prior.npy` of the first, `quick.toml`.
fn on_disk(room: &Rendered) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("images")).unwrap();
    let mut frames = Vec::new();
    for (index, known) in room.views.iter().enumerate() {
        let photograph = path(&format!("images/{index}.png"));
        write_image(&photograph, known.view.image.view()).unwrap();
        let lens = Lens { camera: known.view.camera, distortion: Distortion::default() };
        frames.push(Frame { photograph, lens, pose: known.view.pose });
    }
    std::fs::write(path("transforms.json"), transforms_json(&frames, folder.path(), |_| Vec::new())).unwrap();
    let prior = room.views[0].prior.as_ref().unwrap().to_depth(&DisparityRule::default()).unwrap();
    write_npy(path("prior.npy"), prior.view()).unwrap();
    std::fs::write(path("quick.toml"), "nerf.train = { steps = 50, rays = 128 }\nnerf.field.finest = 64\n")
        .unwrap();
    folder
}

/// With noise, which no compression makes small; enlarged, as rooms take seconds to render at such a size.
#[test]
fn the_report_of_several_large_photographs_is_below_five_megabytes() {
    let mut room = rendered_at(Room::Study, 3, [160, 120]);
    for (index, known) in room.views.iter_mut().enumerate() {
        let mut state = index as u32 + 1;
        let small = &known.view.image;
        known.view.image = Array3::from_shape_fn((480, 640, 3), |(y, x, c)| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            small[(y / 4, x / 4, c)] + 0.04 * ((state >> 8) as f32 / (1 << 24) as f32 - 0.5)
        });
        known.view.camera = known.view.camera.resized(640, 480).unwrap();
        let prior = known.prior.as_mut().unwrap();
        prior.map = Array2::from_shape_fn((480, 640), |(y, x)| prior.map[(y / 4, x / 4)]);
        prior.valid = Array2::from_elem((480, 640), true);
    }
    let folder = on_disk(&room);
    std::fs::write(
        folder.path().join("quick.toml"),
        "nerf.train = { steps = 5, rays = 128 }\nnerf.render = { coarse = 4, fine = 4 }\nnerf.field.finest = 64\n",
    )
    .unwrap();
    let refine =
        "refine images/0.png --prior-depth prior.npy --config quick.toml --views transforms.json -o out";
    mde(&folder, refine).success();
    assert!(record(&folder, "out")["capture"]["fallback"].is_null());
    let bytes = std::fs::metadata(folder.path().join("out/report.html")).unwrap().len();
    assert!((2_000_000..5_000_000).contains(&bytes), "{bytes}");
}

fn mde(folder: &tempfile::TempDir, arguments: &str) -> assert_cmd::assert::Assert {
    let mut command = Command::cargo_bin("mde").unwrap();
    command.current_dir(folder.path()).args(arguments.split_whitespace()).arg("-q").assert()
}

fn record(folder: &tempfile::TempDir, out: &str) -> serde_json::Value {
    let text = std::fs::read_to_string(folder.path().join(out).join("run.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn message(assert: &assert_cmd::assert::Assert) -> String {
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

fn fov(room: &Rendered) -> f64 {
    2.0 * (0.5 * WIDTH as f64 / room.views[0].view.camera.fx).atan().to_degrees()
}

#[test]
fn a_photograph_of_a_prepared_capture_does_not_depend_on_those_before() {
    let (capture, prior) = inputs(&rendered_at(Room::Study, 4, [96, 72]), true);
    let config = Config::with_overrides(
        Preset::MultiView,
        "nerf.train.steps = 20\nnerf.train.rays = 64\nnerf.field.finest = 64\nmulti-view.max-views = 3\n",
        "test",
    )
    .unwrap();
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let refine = |order: &[usize]| {
        let mut go_on = |_: &Event| ControlFlow::Continue(());
        let mut prepared = PreparedCapture::new(&capture, &Stages::new(&prior), &config, &mut go_on).unwrap();
        let mut found = Vec::new();
        for &index in order {
            found.push(prepared.refine(index, Stages::new(&prior), &mut go_on).unwrap());
        }
        found
    };
    let (forth, back) = (refine(&[0, 1, 3]), refine(&[3, 1, 0]));
    for (one, other) in forth.iter().zip(back.iter().rev()) {
        assert_eq!(one.depth, other.depth);
        assert_eq!(one.capture.as_ref().unwrap().used(), 3, "max-views");
    }
    let single = refine_capture(&capture, Stages::new(&prior), &config, &mut go_on).unwrap();
    assert_eq!(single.depth, forth[0].depth);
    assert_ne!(forth[1].depth, forth[0].depth);
    // One scale for all, so that depths and poses fit each other.
    let scale = |r: &Refinement| r.capture.as_ref().unwrap().scale.unwrap()[0];
    assert!(forth.iter().all(|r| scale(r).to_bits() == scale(&forth[0]).to_bits()));
    let (mut prepared, outside) = (
        PreparedCapture::new(&capture, &Stages::new(&prior), &config, &mut go_on).unwrap(),
        capture.photographs.len(),
    );
    assert!(prepared.refine(outside, Stages::new(&prior), &mut go_on).is_err());
}

/// Photographs that are swept together need not all be in the fit of each: what is called used has a place in it, and what is called
/// withheld was not swept.
#[test]
fn used_and_withheld_photographs_are_what_they_are_called() {
    let (capture, prior) = inputs(&rendered_at(Room::Study, 7, [96, 72]), true);
    let text =
        "nerf.train.steps = 5\nnerf.train.rays = 64\nnerf.field.finest = 64\nmulti-view.max-views = 5\n";
    let config = Config::with_overrides(Preset::MultiView, text, "test").unwrap();
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let mut prepared = PreparedCapture::new(&capture, &Stages::new(&prior), &config, &mut go_on).unwrap();
    let mut shared = 0;
    for index in 0..capture.photographs.len() {
        let refined = prepared.refine(index, Stages::new(&prior), &mut go_on).unwrap();
        let report = refined.capture.unwrap();
        assert_eq!(report.fallback, None);
        for photograph in &report.photographs {
            assert_eq!(photograph.used, photograph.pose.is_some(), "{index}: {photograph:?}");
            shared += usize::from(photograph.verified.is_some() && !photograph.used);
        }
        let novel = report.novel.unwrap();
        let shown = &report.photographs[novel.photograph];
        assert_eq!((novel.withheld, !novel.withheld), (shown.verified.is_none(), shown.used), "{index}");
    }
    assert!(shared > 0, "the case is among them");
}

/// The frame is the reference's, whose pose is exact in it; to another photograph it is as uncertain as that photograph is.
#[test]
fn the_pose_of_the_reference_is_uncertain_to_the_others() {
    let (capture, prior) = inputs(&rendered_at(Room::Study, 2, [256, 192]), false);
    let text = "nerf.train.steps = 5\nnerf.train.rays = 64\nnerf.field.finest = 64\n";
    let config = Config::with_overrides(Preset::MultiView, text, "test").unwrap();
    let mut go_on = |_: &Event| ControlFlow::Continue(());
    let mut prepared = PreparedCapture::new(&capture, &Stages::new(&prior), &config, &mut go_on).unwrap();
    let mut typical = |index: usize| {
        let refined = prepared.refine(index, Stages::new(&prior), &mut go_on).unwrap();
        assert_eq!(refined.capture.as_ref().unwrap().fallback, None);
        let poses = refined.components.iter().find(|part| part.name == "poses").unwrap();
        let relative = poses.sigma.iter().zip(refined.depth.mean()).filter(|(_, z)| **z > 0.0);
        median(relative.map(|(sigma, z)| f64::from(sigma / z))).unwrap()
    };
    let (first, second) = (typical(0), typical(1));
    assert!(first > 0.0 && (0.5..2.0).contains(&(second / first)), "{first} {second}");
}

/// Nor does a byte of poses, predictions, sweeps and field depend on the number of threads or of predictions at once.
#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let (capture, prior) = inputs(&rendered(Room::Study, 4), false);
    let text = "nerf.train.steps = 20\nnerf.train.rays = 64\nnerf.field.finest = 64\n";
    let config = Config::with_overrides(Preset::MultiView, text, "test").unwrap();
    let refine = |threads: usize, at_once: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut seen = Vec::new();
        let refined = pool.install(|| {
            let mut watch = |event: &Event| {
                match event {
                    Event::Predicted { done, total } => seen.push(("prior", *done, *total)),
                    Event::Part { stage, done, total } => seen.push((stage.name(), *done, *total)),
                    _ => {}
                }
                ControlFlow::Continue(())
            };
            let stages = Stages::new(&prior).with_predictions_at_once(at_once);
            refine_capture(&capture, stages, &config, &mut watch).unwrap()
        });
        let report = refined.capture.as_ref().unwrap();
        assert_eq!(report.fallback, None);
        // Photographs predicted, pairs matched, photographs swept.
        let counted = |stage, all| (1..=all).map(move |done| (stage, done, all));
        let expected = counted("prior", 4).chain([("poses", 6, 6)]).chain(counted("sweep", report.used()));
        assert_eq!(seen, expected.collect::<Vec<_>>());
        refined.depth
    };
    let one = refine(1, 1);
    for (threads, at_once) in [(3, 8), (3, 2), (2, 1)] {
        assert!(refine(threads, at_once) == one, "{threads} threads, {at_once} predictions at once");
    }
}

#[test]
fn the_capture_s_unit_is_that_of_its_poses() {
    let room = rendered(Room::Study, 3);
    let (capture, prior) = inputs(&room, true);
    let refined = run(&capture, &prior, &config());
    let ratio = |depth: &Array2<f32>| {
        median(
            depth
                .iter()
                .zip(&room.truth)
                .filter(|(d, t)| **d > 0.0 && **t > 0.0)
                .map(|(d, t)| f64::from(d / t)),
        )
        .unwrap()
    };
    let in_prior = refined.depth.clone();
    let refined = refined.in_capture_unit().unwrap();
    let factor = refined.capture.as_ref().unwrap().scale.unwrap()[0];
    // Poses of a rendered room are exact and in metres, as is its truth.
    let metres = ratio(&refined.depth.mean().to_owned());
    assert!((metres.ln()).abs() < 0.05, "{metres}");
    let pixel = (HEIGHT / 2, WIDTH / 2);
    let relative = |map: &mde_uncertainty::GaussianDepth| map.variance()[pixel].sqrt() / map.mean()[pixel];
    assert!((relative(&refined.depth) / relative(&in_prior) - 1.0).abs() < 1e-4);
    assert!((f64::from(refined.depth.mean()[pixel] / in_prior.mean()[pixel]) / factor - 1.0).abs() < 1e-5);
    // Poses stay in the unit of the depth; one that is shifted too has none.
    let placed = |r: &Refinement| r.capture.as_ref().unwrap().photographs[1].pose.map(|rows| rows[0][3]);
    let before = placed(&refined).unwrap();
    let refined = refined.scaled(2.0, 0.0).unwrap();
    assert_eq!(placed(&refined), Some(2.0 * before));
    let known: Vec<KnownDepth> = (0..WIDTH * HEIGHT)
        .step_by(97)
        .map(|i| (i % WIDTH, i / WIDTH))
        .map(|(x, y)| (x, y, 3.0 * f64::from(refined.depth.mean()[(y, x)]) + 5.0))
        .map(|(x, y, depth)| KnownDepth { x: x as f64, y: y as f64, depth, sigma: 0.0 })
        .collect();
    let (refined, _) = refined.scaled_to(&known, false).unwrap();
    assert_eq!(placed(&refined), None);

    let (capture, prior) = inputs(&room, false);
    let estimated = run(&capture, &prior, &config()).in_capture_unit().err().unwrap().to_string();
    assert!(estimated.contains("estimated") && estimated.lines().count() == 1, "{estimated}");
}

#[test]
fn the_program_limits_photographs_and_names_the_unit() {
    let room = rendered(Room::Study, 4);
    let folder = on_disk(&room);
    let refine = "refine images/0.png --prior-depth prior.npy --config quick.toml";
    let views = format!("{refine} --views transforms.json --max-views 2 --export sigma");
    mde(&folder, &format!("{views} --unit capture -o out")).success();
    let record = record(&folder, "out");
    // The factor to the prior counts in the prior's unit only.
    mde(&folder, &format!("{views} -o metres")).success();
    let exported = |name: &str| folder.path().join(name).exists();
    assert!(exported("out/sigma/ambiguity.npy") && !exported("out/sigma/gauge.npy"));
    assert!(exported("metres/sigma/gauge.npy"));
    let used = record["capture"]["photographs"].as_array().unwrap().iter().filter(|p| p["used"] == true);
    assert_eq!((used.count(), record["unit"].as_str()), (2, Some("capture")));
    if let Some(peak) = record["peak_memory_bytes"].as_u64() {
        let estimate = capture_bytes((WIDTH * HEIGHT) as u64, 4, 2, &config());
        assert!((peak..4 * peak).contains(&estimate), "estimate {estimate}, peak {peak}");
    }
    let memory = mde(&folder, &format!("{refine} --views transforms.json --max-memory 0.01 -o no")).failure();
    assert!(message(&memory).contains("--max-memory 0.01"), "{}", message(&memory));
    let depth = read_values(folder.path().join("out/depth.npy"), &ReadOptions::default()).unwrap();
    let ratio =
        median(depth.iter().zip(&room.truth).filter(|(_, t)| **t > 0.0).map(|(d, t)| f64::from(d / t)));
    assert!(ratio.unwrap().ln().abs() < 0.15, "{ratio:?}");

    let unit = mde(&folder, &format!("{refine} --views images --unit capture -o no")).failure();
    assert!(message(&unit).contains("--unit prior"), "{}", message(&unit));
    assert!(!folder.path().join("no").exists());
}

/// What `mde poses` writes is a capture that `mde refine` reads, with the poses and the focal length that it found.
#[test]
fn poses_are_written_and_read_again() {
    // At this size matches are few; this room has enough.
    let room = rendered(Room::Kitchen, 3);
    let folder = on_disk(&room);
    write_image(folder.path().join("black.png"), Array3::zeros((HEIGHT, WIDTH, 3)).view()).unwrap();
    let fov = fov(&room);
    std::fs::create_dir(folder.path().join("out")).unwrap();
    let poses =
        format!("poses images/0.png images black.png --prior-depth prior.npy --fov {fov} -o out/found.json");
    mde(&folder, &poses).success();
    let again = mde(&folder, &poses).failure();
    assert!(message(&again).contains("--force"), "{}", message(&again));
    mde(&folder, &format!("{poses} --force")).success();
    let size = |path: &std::path::Path| mde_cli::mde_prior::photo::image_size(path);
    let found =
        read_transforms(&folder.path().join("out/found.json"), PixelCentres::Integers, &size).unwrap();
    // A file of nerfstudio: pixel centres at halves, without the key.
    let file = folder.path().join("out/found.json");
    let text = std::fs::read_to_string(&file).unwrap();
    let without_key = folder.path().join("out/transforms.json");
    std::fs::write(&without_key, text.replace("pixel_centres", "some_key")).unwrap();
    let read = CaptureFiles::find(&without_key).unwrap().read(None, &size).unwrap();
    assert_eq!(read.frames[0].lens.camera, found.frames[0].lens.camera);
    // The black photograph fits nowhere; at this size another may not.
    let index =
        |frame: &Frame| frame.photograph.file_stem().unwrap().to_str().unwrap().parse::<usize>().unwrap();
    assert!((2..=3).contains(&found.frames.len()) && index(&found.frames[0]) == 0);
    let frame = room.views[0].view.pose.inverse();
    for frame_found in &found.frames {
        let known = &room.views[index(frame_found)];
        let turned = (known.view.pose * frame).rotation.angle_to(&frame_found.pose.rotation).to_degrees();
        assert!(turned < 3.0, "{turned}");
        assert!((frame_found.lens.camera.fx / known.view.camera.fx - 1.0).abs() < 1e-9);
    }
    let refine =
        "refine images/0.png --views out/found.json --prior-depth prior.npy --config quick.toml -o refined";
    mde(&folder, refine).success();
    let record = record(&folder, "refined");
    assert_ne!(record["capture"]["poses"], "estimated");
    assert!(record["capture"]["fallback"].is_null());

    let alone =
        mde(&folder, &format!("poses images/0.png black.png --prior-depth prior.npy --fov {fov} -o no.json"));
    let told = message(&alone.failure());
    assert!(told.contains("black.png") && told.contains("features") && told.lines().count() == 1, "{told}");
    let one = message(&mde(&folder, "poses images/0.png --prior-depth prior.npy -o no.json").failure());
    assert!(one.contains("two or more") && !folder.path().join("no.json").exists(), "{one}");
}

/// All photographs with a network of brightness: what is written fits together, and a finished photograph is not refined again.
#[test]
#[cfg(feature = "onnx")]
fn every_photograph_gets_a_folder_and_all_a_cloud() {
    let room = rendered(Room::Study, 3);
    let folder = on_disk(&room);
    let path = |name: &str| folder.path().join(name);
    let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures");
    std::fs::copy(fixtures.join("grey_nchw.onnx"), path("grey.onnx")).unwrap();
    let all = "refine images/1.png --views transforms.json --all --prior-model grey.onnx --model-profile fastdepth \
               --prior-kind metric --config quick.toml --unit capture -o out";
    mde(&folder, all).success();
    let record = record(&folder, "out");
    let rows = record["photographs"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    let transforms = read_transforms(&path("out/transforms.json"), PixelCentres::Integers, &|p| {
        mde_cli::mde_prior::photo::image_size(p)
    })
    .unwrap();
    let whole: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path("out/transforms.json")).unwrap()).unwrap();
    for (index, name) in ["1", "0", "2"].iter().enumerate() {
        assert_eq!(rows[index]["folder"], *name);
        for file in ["depth.npy", "sigma.npy", "run.json", "report.html", "image.png"] {
            assert!(path(&format!("out/{name}/{file}")).is_file(), "{name}/{file}");
        }
        assert_eq!(whole["frames"][index]["depth_file_path"], format!("{name}/depth.png"));
        assert!(path("out").join(whole["frames"][index]["sigma_file_path"].as_str().unwrap()).is_file());
        // In the world of the capture, in its unit; the reference's pose is as given.
        let known = &room.views[name.parse::<usize>().unwrap()].view.pose;
        let apart = (transforms.frames[index].pose * known.inverse()).translation.vector.norm();
        assert!(apart < if index == 0 { 1e-9 } else { 0.02 }, "{apart}");
    }
    let page = std::fs::read_to_string(path("out/index.html")).unwrap();
    assert!(["1", "0", "2"].iter().all(|name| page.contains(&format!("href=\"{name}/report.html\""))));
    let cloud = std::fs::read(path("out/cloud.ply")).unwrap();
    assert!(record["points"].as_u64().unwrap() > (WIDTH * HEIGHT / 10) as u64, "{}", record["points"]);

    // The same command has nothing left to do; of other settings nothing is taken, nor with --force.
    let depths =
        || ["0", "1", "2"].map(|name| std::fs::read(path(&format!("out/{name}/depth.npy"))).unwrap());
    let first = depths();
    let kept = |arguments: &str| {
        let told = message(&mde(&folder, arguments).success());
        told.matches("finished before").count()
    };
    assert_eq!(kept(&all), 3);
    assert!(depths() == first && std::fs::read(path("out/cloud.ply")).unwrap() == cloud, "the same bytes");
    assert_eq!(kept(&format!("{all} --seed 1")), 0);
    assert!(depths() != first);
    assert_eq!(kept(&all), 0);
    assert_eq!(kept(&format!("{all} --force")), 0);
    assert!(depths() == first && std::fs::read(path("out/cloud.ply")).unwrap() == cloud, "the same bytes");

    // A calibration counts by its content.
    let calibration = include_str!("../src/calibration/default.toml");
    let calibrated = |file: &str, more: &str| {
        std::fs::write(path(file), format!("{calibration}{more}")).unwrap();
        kept(&format!("{all} --calibration {file}"))
    };
    assert_eq!((calibrated("one.toml", ""), calibrated("same.toml", "")), (0, 3));
    assert_eq!(calibrated("same.toml", "# other bytes\n"), 0);

    // A folder of others is not written to.
    std::fs::create_dir(path("thesis")).unwrap();
    std::fs::write(path("thesis/chapter.txt"), "years").unwrap();
    let refused = mde(&folder, &all.replace("-o out", "-o thesis")).failure();
    assert!(message(&refused).contains("another name to -o"), "{}", message(&refused));
}

/// Killed after its first photograph, the same command takes that one and writes what an unbroken run writes.
#[test]
#[cfg(feature = "onnx")]
fn a_killed_capture_goes_on_after_the_finished_photographs() {
    let room = rendered(Room::Study, 3);
    let folder = on_disk(&room);
    let path = |name: &str| folder.path().join(name);
    let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../mde-prior/tests/fixtures");
    std::fs::copy(fixtures.join("grey_nchw.onnx"), path("grey.onnx")).unwrap();
    let all = "refine images/1.png --views transforms.json --all --prior-model grey.onnx --model-profile fastdepth \
               --prior-kind metric --config quick.toml --interval 0.8";
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("mde"))
        .current_dir(folder.path())
        .args(format!("{all} -q -o out").split_whitespace())
        .spawn()
        .unwrap();
    wait_until(&mut child, || path("out/1/finished.json").is_file());
    child.kill().unwrap();
    assert!(!child.wait().unwrap().success() && !path("out/run.json").exists());
    let again = mde(&folder, &format!("{all} -o out")).success();
    let said = String::from_utf8_lossy(&again.get_output().stdout).into_owned();
    assert!(said.contains("lower.npy and upper.npy in each folder: 80 % interval"), "{said}");
    let told = message(&again);
    assert!(
        told.contains("1.png: finished before") && told.matches("finished before").count() <= 2,
        "{told}"
    );
    // One whose map was cut since.
    std::fs::write(path("out/1/sigma.npy"), "").unwrap();
    assert_eq!(
        message(&mde(&folder, &format!("{all} -o out")).success()).matches("finished before").count(),
        2
    );
    mde(&folder, &format!("{all} -o unbroken")).success();
    for name in ["1/depth.npy", "1/sigma.npy", "0/depth.npy", "2/sigma.npy", "cloud.ply", "transforms.json"] {
        let read = |run: &str| std::fs::read(path(run).join(name)).unwrap();
        assert!(read("out") == read("unbroken"), "{name}");
    }
    let unfinished = std::fs::read_dir(path("out")).unwrap().map(|entry| entry.unwrap().file_name());
    assert!(!unfinished.into_iter().any(|name| name.to_string_lossy().starts_with(".mde-")));
}

/// The demo of several photographs: better than its prior, the same with any number of threads, and refined again from its files.
#[test]
fn the_demo_has_photographs_without_poses() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let quick = "nerf.train = { steps = 120, rays = 256 }\nnerf.field.finest = 128\n";
    std::fs::write(path("quick.toml"), quick).unwrap();
    let mde = |arguments: &str| {
        let mut command = Command::cargo_bin("mde").unwrap();
        command.current_dir(folder.path()).args(arguments.split(' ')).assert().success()
    };
    let demo = "demo --size 160x120 --config quick.toml";
    let said = mde(&format!("{demo} -o demo"));
    let said = String::from_utf8_lossy(&said.get_output().stdout).into_owned();
    assert!(said.contains("AbsRel") && said.contains("90 % intervals hold"), "{said}");
    mde(&format!("{demo} --threads 1 -q -o again"));
    for name in ["depth.npy", "sigma.npy", "prior.npy", "views/rendered.png", "evidence.npz"] {
        let read = |run: &str| std::fs::read(path(run).join(name)).unwrap();
        assert!(read("demo") == read("again"), "{name}");
    }
    let record = |run: &str| -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(path(run).join("run.json")).unwrap()).unwrap()
    };
    let told = record("demo");
    let capture = &told["capture"];
    assert_eq!((&capture["poses"], &capture["fallback"]), (&"estimated".into(), &serde_json::Value::Null));
    let photographs = capture["photographs"].as_array().unwrap();
    let used: Vec<bool> =
        photographs.iter().map(|photograph| photograph["used"].as_bool().unwrap()).collect();
    assert_eq!((used.len(), used.iter().filter(|used| **used).count()), (6, 5), "{photographs:?}");
    let novel = &capture["novel"];
    assert_eq!(novel["withheld"], true);
    assert!(!used[novel["photograph"].as_u64().unwrap() as usize]);
    let psnr = |key: &str| novel[key].as_f64().unwrap();
    assert!(psnr("psnr") > 16.0 && psnr("psnr_of_prior") > 16.0, "{novel}");
    let scores = &told["scores"]["by_alignment"]["median"];
    let abs_rel = |which: &str| scores[which]["abs_rel"].as_f64().unwrap();
    assert!(abs_rel("refined") < 0.8 * abs_rel("prior"), "{} {}", abs_rel("refined"), abs_rel("prior"));

    let options = |name: &str| mde_cli::mde_prior::format::ReadOptions {
        npz_array: Some(name.to_owned()),
        ..Default::default()
    };
    let map = |name: &str| {
        mde_cli::mde_prior::format::read_values(path("demo/evidence.npz"), &options(name)).unwrap()
    };
    let (seen, confirmed) = (map("seen"), map("confirmed"));
    assert!(seen.iter().zip(&confirmed).all(|(seen, confirmed)| confirmed <= seen && *seen <= 4.0));
    let known = map("origin").iter().filter(|origin| **origin > 0.0).count();
    let share = confirmed.iter().filter(|count| **count > 0.0).count() as f64 / known as f64;
    assert!((share - capture["confirmed"].as_f64().unwrap()).abs() < 1e-9 && share > 0.2, "{share}");

    let again = "--views demo/photographs --prior-depth demo/prior.npy --fov 62 --config quick.toml -q";
    mde(&format!("refine demo/photographs/0.png {again} -o from-files"));
    let found = record("from-files");
    assert_eq!(found["capture"]["fallback"], serde_json::Value::Null, "{found}");
    assert_eq!(found["capture"]["photographs"].as_array().unwrap().len(), 6);
    // Fewer than the most that may be used: none is left out.
    assert_eq!(found["capture"]["novel"]["withheld"], false);
}
