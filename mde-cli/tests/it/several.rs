//! Several photographs through the library: a procedural room with exact depth and poses.

use crate::library::{Known, SIZE, STUDY, config, go_on, inputs, ratios, refine_several, rendered};
use mde_cli::config::Order;
use mde_cli::mde_fusion::{Fused, Fuser, FusionReport, Prior};
use mde_cli::mde_prior::DisparityRule;
use mde_cli::ndarray::{Array2, Array3, ArrayView2};
use mde_cli::scene::{KnownDepth, Photograph, Scene};
use mde_cli::several::prepared::PreparedScene;
use mde_cli::{Config, Event, Preset, Refinement, Stages};
use mde_eval::scene::Room;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use std::ops::ControlFlow;

fn run(capture: &Scene, prior: &Known, config: &Config) -> Refinement {
    refine_several(capture, Stages::new(prior), config, &mut go_on).unwrap()
}

/// A fit whose depth is not judged.
fn short(more: &str) -> Config {
    let text = format!("nerf.train = {{ steps = 20, rays = 64 }}\nnerf.field.finest = 64\n{more}");
    config(Preset::MultiView, &text)
}

fn ratio(a: ArrayView2<'_, f32>, b: &Array2<f32>) -> f64 {
    median(ratios(a, b)).unwrap()
}

/// As many rays per pixel as 700 steps have at 320x240, and a grid of that many cells.
#[test]
fn parallax_halves_the_typical_error_of_the_prior() {
    let (capture, prior) = inputs(&STUDY, true);
    let text = "nerf.train = { steps = 250, rays = 512 }\nnerf.field.finest = 128\n";
    let refined = run(&capture, &prior, &config(Preset::MultiView, text));
    let report = refined.capture.as_ref().unwrap();
    assert_eq!((report.fallback.as_deref(), report.used()), (None, 4));
    // The median after the median alignment: at this size edges are too coarse for a mean.
    let typical_error = |depth: ArrayView2<'_, f32>| {
        let scale = ratio(depth, &STUDY.truth);
        median(ratios(depth, &STUDY.truth).map(|ratio| (ratio / scale - 1.0).abs())).unwrap()
    };
    let depth = refined.depth.mean();
    let (before, after) = (typical_error(refined.prior.view()), typical_error(depth));
    assert!(after < 0.5 * before, "{after} of {before}");
    // In the unit of the prior, not of the poses: the prior's median is kept within its error.
    let to_prior = ratio(depth, &refined.prior);
    assert!((0.8..1.25).contains(&to_prior), "{to_prior}");

    // Sigma is the root sum of squares of its components, each of which says something.
    let names: Vec<_> = refined.components.iter().map(|part| part.name).collect();
    let all =
        ["termination", "in-bin", "ambiguity", "prior", "view-disagreement", "parallax", "poses", "edges"];
    assert_eq!(names, all);
    for (at, &variance) in refined.depth.variance().indexed_iter() {
        let sum: f32 = refined.components.iter().map(|part| part.sigma[at].powi(2)).sum();
        assert!(variance > 0.0);
        assert!((sum / variance - 1.0).abs() < 1e-4 || variance.is_infinite() && sum.is_infinite());
    }
    for part in refined.components.iter().filter(|part| part.name != "poses") {
        let known = part.sigma.iter().filter(|s| s.is_finite());
        assert!(known.clone().all(|s| *s >= 0.0) && known.clone().any(|s| *s > 0.0), "{}", part.name);
    }

    // The capture's unit is that of its poses.
    let refined = refined.in_capture_unit().unwrap();
    // Poses of a rendered room are exact and in metres, as is its truth.
    let metres = ratio(refined.depth.mean(), &STUDY.truth);
    assert!((metres.ln()).abs() < 0.05, "{metres}");
    // Poses stay in the unit of the depth; one that is shifted too has none.
    let placed =
        |r: &Refinement| r.capture.as_ref().unwrap().photographs[1].pose.map(|pose| pose.translation.x);
    let before = placed(&refined).unwrap();
    let refined = refined.scaled(2.0, 0.0).unwrap();
    assert_eq!(placed(&refined), Some(2.0 * before));
    let depth = refined.depth.mean();
    let pixels = depth.indexed_iter().step_by(97);
    let known: Vec<KnownDepth> = pixels
        .map(|((y, x), z)| (x as f64, y as f64, 3.0 * f64::from(*z) + 5.0))
        .map(|(x, y, depth)| KnownDepth { x, y, depth, sigma: 0.0 })
        .collect();
    let (refined, _) = refined.scaled_to(&known, false).unwrap();
    assert_eq!(placed(&refined), None);
}

/// Poses and photographs of another place do not belong together: neither with one such photograph among others, nor with all.
#[test]
fn photographs_that_do_not_fit_their_poses_are_left_out_by_name() {
    let at = |room| rendered(room, 4, [256, 192]);
    let (good, prior) = inputs(&at(Room::Study), true);
    let (other, others) = inputs(&at(Room::Kitchen), false);
    let prior = Known(prior.0.into_iter().chain(others.0).collect());
    let config = short("refinement.iterations = 0\n");
    let with = |strange: std::ops::Range<usize>| {
        let mut capture = good.clone();
        for index in strange {
            capture.photographs[index].image.clone_from(&other.photographs[index].image);
        }
        let refined = run(&capture, &prior, &config);
        (refined.capture.unwrap(), refined.augmentation.predictions)
    };
    let (as_given, _) = with(0..0);
    assert_eq!((as_given.used(), &as_given.fallback), (4, &None));
    assert!(as_given.photographs.iter().all(|photograph| photograph.matches > Some(20)), "{as_given:?}");
    let (one, _) = with(2..3);
    assert_eq!((one.used(), &one.fallback), (3, &None), "{:?}", one.photographs);
    let verdict = &one.photographs[2].verdict;
    assert!(!one.photographs[2].used && verdict.contains("matches"), "{verdict}");
    let (all, predictions) = with(1..4);
    assert!(all.used() == 1 && predictions > 1, "the default preset");
    assert!(all.fallback.as_ref().unwrap().contains("photograph 0"), "{:?}", all.fallback);
}

/// The scale between poses and prior is that of the points where there are some.
#[test]
fn points_of_the_capture_give_its_scale() {
    let room = rendered(Room::Study, 3, SIZE);
    let (mut capture, prior) = inputs(&room, true);
    let config = short("refinement.iterations = 0\n");
    let Photograph { camera, pose, .. } = capture.photographs[0].clone();
    let back = pose.unwrap().inverse();
    let points = room.truth.indexed_iter().step_by(97).filter(|(_, z)| **z > 0.0);
    capture.points = points
        .map(|((y, x), &z)| back * camera.camera.unproject([x as f64, y as f64].into(), f64::from(z)))
        .collect();
    let scale = |capture: &Scene| run(capture, &prior, &config).capture.unwrap().scale.unwrap()[0];
    let exact = scale(&capture);
    let expected = ratio(room.truth.view(), &prior.0[0].1.to_depth(&DisparityRule::default()).unwrap());
    assert!((exact / expected).ln().abs() < 0.1, "{exact}, {expected}");
    // In a world of twice the size, seen from the same place, the scale is that of the points.
    let centre = back.translation.vector;
    capture.points.iter_mut().for_each(|point| point.coords += point.coords - centre);
    let twice = scale(&capture);
    assert!((twice / exact - 2.0).abs() < 0.05, "{twice}, {exact}");
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

/// Eq. 10-17 in the printed order where the settings say so, or another fusion.
#[test]
fn the_printed_fusion_is_there_with_several_photographs() {
    let (capture, prior) = inputs(&rendered(Room::Study, 3, SIZE), true);
    let text = "nerf.train = { steps = 100, rays = 256 }\nnerf.field.finest = 128\n";
    let mut config = config(Preset::MultiView, text);
    let usual = run(&capture, &prior, &config);
    assert_eq!(usual.capture.as_ref().unwrap().fusion, None);
    config.refinement.order = Order::Paper;
    config.fusion = Preset::Paper.config().fusion;
    let printed = run(&capture, &prior, &config);
    let report = printed.capture.as_ref().unwrap().fusion.clone().unwrap();
    assert!(report.degenerate.is_none() && report.a > 0.0 && report.b != 0.0, "{report:?}");
    let field = usual.depth.mean();
    assert!(printed.depth.mean().iter().zip(field).any(|(a, b)| (a / b - 1.0).abs() > 0.01));
    assert_eq!(printed.components.iter().map(|part| part.name).collect::<Vec<_>>(), ["field"]);
    let alone =
        refine_several(&capture, Stages::new(&prior).with_fuser(&FieldAlone), &config, &mut go_on).unwrap();
    let rendered = alone.field.unwrap().render(
        &capture.photographs[0].camera.camera,
        &Pose::identity(),
        &mut |_: &mde_cli::mde_nerf::FieldEvent| ControlFlow::Continue(()),
    );
    let [scale, _] = alone.capture.unwrap().scale.unwrap();
    let own = rendered.unwrap().depth.mean().mapv(|z| z / scale as f32);
    assert!(alone.depth.mean().iter().zip(&own).all(|(a, b)| *a == 0.0 || (a / b - 1.0).abs() < 1e-5));
}

#[test]
fn captures_that_are_none_are_refused_by_name() {
    let (capture, prior) = inputs(&rendered(Room::Study, 3, [64, 48]), true);
    for (change, named) in [
        (&(|s: &mut Scene| s.photographs.truncate(1)) as &dyn Fn(&mut Scene), "two or more"),
        (&|s: &mut Scene| s.photographs[1].pose = None, "2 of 3 photographs have a pose"),
        (&|s: &mut Scene| s.photographs[1].name = "photograph 0".to_owned(), "photograph 0"),
        (&|s: &mut Scene| s.photographs[2].image = Array3::zeros((4, 4, 3)).into(), "photograph 2"),
    ] {
        let mut capture = capture.clone();
        change(&mut capture);
        let refused = refine_several(&capture, Stages::new(&prior), &short(""), &mut go_on).err().unwrap();
        let message = refused.to_string();
        assert!(message.contains(named) && message.lines().count() == 1, "{message}");
    }
}

/// What is called used has a place in the fit and was swept, and what is called withheld was not; whatever was refined before.
#[test]
fn used_and_withheld_photographs_are_what_they_are_called() {
    let (capture, prior) = inputs(&rendered(Room::Study, 7, [96, 72]), true);
    let config = short("multi-view.max-views = 5\n");
    let refine = |order: &[usize]| {
        let mut prepared = PreparedScene::new(&capture, &Stages::new(&prior), &config, &mut go_on).unwrap();
        let mut refine = |index: usize| prepared.refine(index, Stages::new(&prior), &mut go_on);
        assert!(refine(capture.photographs.len()).is_err());
        order.iter().map(|&index| refine(index).unwrap()).collect::<Vec<_>>()
    };
    let all = refine(&[0, 1, 2, 3, 4, 5, 6]);
    for (refined, index) in refine(&[6, 3, 0]).iter().zip([6, 3, 0]) {
        assert_eq!(refined.depth, all[index].depth);
    }
    assert_eq!(run(&capture, &prior, &config).depth, all[0].depth);
    assert_ne!(all[1].depth, all[0].depth);
    let scale = |refined: &Refinement| refined.capture.as_ref().unwrap().scale.unwrap()[0].to_bits();
    for (index, refined) in all.iter().enumerate() {
        // One scale for all, so that depths and poses fit each other.
        assert_eq!(scale(refined), scale(&all[0]));
        let report = refined.capture.as_ref().unwrap();
        assert_eq!((report.fallback.as_deref(), report.used()), (None, 5), "{index}");
        for photograph in &report.photographs {
            let swept = photograph.verified.is_some();
            assert_eq!([photograph.pose.is_some(), swept], [photograph.used; 2], "{index}: {photograph:?}");
        }
        let novel = report.novel.as_ref().unwrap();
        let shown = &report.photographs[novel.photograph];
        assert_eq!((novel.withheld, !novel.withheld), (shown.verified.is_none(), shown.used), "{index}");
    }
}

/// The frame is the reference's, whose pose is exact in it; to another photograph it is as uncertain as that photograph is.
#[test]
fn the_pose_of_the_reference_is_uncertain_to_the_others() {
    let (capture, prior) = inputs(&rendered(Room::Study, 2, [256, 192]), false);
    let config = short("");
    let mut prepared = PreparedScene::new(&capture, &Stages::new(&prior), &config, &mut go_on).unwrap();
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
    let (capture, prior) = inputs(&STUDY, false);
    let config = short("");
    let refine = |threads: usize, at_once: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut seen = Vec::new();
        let refined = pool.install(|| {
            let mut watch = |event: &Event| {
                if let Event::Part { stage, done, total } = event {
                    seen.push((stage.name(), *done, *total));
                }
                go_on(event)
            };
            let stages = Stages::new(&prior).with_predictions_at_once(at_once);
            refine_several(&capture, stages, &config, &mut watch).unwrap()
        });
        let report = refined.capture.as_ref().unwrap();
        assert_eq!(report.fallback, None);
        // Photographs predicted, pairs matched, photographs swept.
        let counted = |stage, all| (1..=all).map(move |done| (stage, done, all));
        let expected = counted("prior", 4).chain([("poses", 6, 6)]).chain(counted("sweep", report.used()));
        assert_eq!(seen, expected.collect::<Vec<_>>());
        let depth = refined.depth.clone();
        let estimated = refined.in_capture_unit().err().unwrap().to_string();
        assert!(estimated.contains("estimated") && estimated.lines().count() == 1, "{estimated}");
        depth
    };
    let one = refine(1, 1);
    for (threads, at_once) in [(3, 8), (2, 1)] {
        assert!(refine(threads, at_once) == one, "{threads} threads, {at_once} predictions at once");
    }
}
