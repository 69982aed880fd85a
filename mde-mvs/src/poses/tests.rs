use super::features::Keypoint;
use super::matching::match_features;
use super::refine::Capture;
use super::two_view::verified_matches;
use super::*;
use crate::silent;
use crate::synthetic::{Plane, pose_at, render};
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::statistics::median;
use mde_warp::{Pose, PosedView};
use nalgebra::Vector3;
use ndarray::{Array2, Array3};
use rand::RngExt;
use std::sync::OnceLock;

const PERIOD: f64 = 0.1;

/// Two walls and a floor.
fn planes() -> Vec<Plane> {
    vec![
        Plane::slanted(3.0, 0.5, 0.1),
        Plane::slanted(4.0, -0.9, 0.0),
        Plane { normal: Vector3::new(0.0, 1.0, 0.0), offset: 0.9 },
    ]
}

pub(super) fn camera() -> PinholeCamera {
    PinholeCamera::from_fov(60.0, 320, 240).unwrap()
}

/// Poses of a phone held about the first, some degrees turned.
fn held() -> Vec<Pose> {
    vec![
        Pose::identity(),
        pose_at([0.25, 0.05, 0.0], [0.02, -0.04, 0.01]),
        pose_at([-0.2, -0.1, 0.1], [-0.03, 0.06, -0.02]),
        pose_at([0.1, -0.25, -0.1], [0.05, 0.01, 0.06]),
    ]
}

/// The depth of a prior with errors: times a factor, and a slow wave of 10 %.
pub(super) fn with_errors(depth: &Array2<f32>, factor: f32) -> Array2<f32> {
    let wave = |(y, x): (usize, usize)| 1.0 + 0.1 * (x as f32 / 50.0).sin() * (y as f32 / 40.0).cos();
    Array2::from_shape_fn(depth.dim(), |at| depth[at] * factor * wave(at))
}

/// Views of the room, with priors of .8 of the depth.
fn scene(poses: &[Pose]) -> Vec<(PosedView, ArcArray2<f32>)> {
    let rendered = poses.iter().map(|pose| render(&planes(), camera(), *pose, PERIOD));
    rendered.map(|(view, depth)| (view, with_errors(&depth, 0.8).into_shared())).collect()
}

fn standard() -> &'static [(PosedView, ArcArray2<f32>)] {
    static SCENE: OnceLock<Vec<(PosedView, ArcArray2<f32>)>> = OnceLock::new();
    SCENE.get_or_init(|| scene(&held()))
}

pub(super) fn photographs(scene: &[(PosedView, ArcArray2<f32>)]) -> Vec<PoseInput<'_>> {
    scene.iter().map(|(view, prior)| input(view, Some(prior))).collect()
}

fn input<'a>(view: &'a PosedView, prior: Option<&'a ArcArray2<f32>>) -> PoseInput<'a> {
    PoseInput { image: view.image.view(), camera: view.camera, focal_assumed: false, prior }
}

fn prepared(photographs: &[PoseInput], has_poses: bool) -> Result<Vec<Prepared>> {
    let most = max_features(photographs.len(), has_poses);
    photographs.par_iter().map(|photograph| Prepared::new(photograph, most)).collect()
}

fn estimate(photographs: &[PoseInput], reference: usize) -> Estimated {
    estimate_poses(&prepared(photographs, false).unwrap(), Some(reference), 0, &mut silent).unwrap()
}

fn refine(photographs: &[PoseInput], poses: &[Pose], reference: impl Into<Option<usize>>) -> Refined {
    refine_poses(&prepared(photographs, true).unwrap(), poses, reference.into(), 0, &mut silent).unwrap()
}

fn poses(refined: &Refined) -> Vec<Pose> {
    refined.photographs.iter().map(|photograph| photograph.pose.unwrap()).collect()
}

/// Depths of the reference over the true ones.
fn ratios(depths: &[(Point2<f64>, f64)]) -> Vec<f64> {
    let truth = render(&planes(), camera(), Pose::identity(), PERIOD).1;
    depths.iter().map(|(p, z)| z / f64::from(truth[(p.y.round() as usize, p.x.round() as usize)])).collect()
}

fn rotation_error(found: &Pose, truth: &Pose) -> f64 {
    found.rotation.angle_to(&truth.rotation).to_degrees()
}

/// Matches of one small place give a pose that may be off by many degrees; all of them, shaken alike, do not.
#[test]
fn a_photograph_of_uncertain_rotation_has_no_pose() {
    let photographs = photographs(&standard()[..3]);
    let mut shots = prepared(&photographs, false).unwrap();
    for (index, shot) in shots.iter_mut().enumerate() {
        for Keypoint { pixel, .. } in &mut shot.features.keypoints {
            let mut rng = CounterRng::new(5, "poses-test", index as u64, pixel.x.to_bits());
            *pixel += Vector2::from_fn(|_, _| 3.0 * (rng.random::<f64>() - 0.5));
        }
    }
    let verdict = |nearest: usize| {
        let compare = |[i, j]: [usize; 2]| {
            let mut found = match_features(&shots[i].features, &shots[j].features);
            if j == 2 {
                let from_middle = |m: &[usize; 2]| (shots[2].pixel(m[1]) - Point2::new(160.0, 120.0)).norm();
                found.sort_by(|a, b| from_middle(a).total_cmp(&from_middle(b)));
                found.truncate(nearest);
            }
            two_view::relative_pose([&shots[i], &shots[j]], [i, j], &found, 0)
        };
        let pairs = compared(&neighbours::all(3), compare, &mut silent).unwrap();
        let found = estimate::adjusted(&shots.iter().collect::<Vec<_>>(), &pairs);
        assert!(found.photographs[1].pose.is_some());
        (found.photographs[2].verdict, found.photographs[2].pose.is_some())
    };
    assert_eq!(verdict(usize::MAX), (Verdict::Posed, true));
    let (few, posed) = verdict(40);
    assert!(matches!(few, Verdict::Uncertain(degrees) if degrees > 3.0) && !posed, "{few:?}");
}

/// The same picture twice, or a camera on a tripod: no parallax without poses, and with given ones no contradiction.
#[test]
fn a_camera_that_has_not_moved_has_no_parallax() {
    let twice = [standard()[0].clone(), standard()[0].clone()];
    let found = estimate(&photographs(&twice), 0).photographs;
    assert!(matches!(found[1].verdict, Verdict::NoParallax(pixels) if pixels < 0.1), "{}", found[1].verdict);
    let given = refine(&photographs(&twice), &[Pose::identity(); 2], 0).photographs;
    assert_eq!(given[1].pose, Some(Pose::identity()));
}

#[test]
fn poses_of_rendered_photographs_are_found_in_the_unit_of_the_prior() {
    let found = estimate(&photographs(standard()), 0);
    assert_eq!(found.photographs[0].verdict, Verdict::Reference);
    assert_eq!(found.photographs[0].pose, Some(Pose::identity()));
    for (i, (photograph, truth)) in found.photographs.iter().zip(held()).enumerate().skip(1) {
        assert_eq!(photograph.verdict, Verdict::Posed);
        let pose = photograph.pose.unwrap();
        assert!(rotation_error(&pose, &truth) < 0.15, "{}", rotation_error(&pose, &truth));
        let off = centre(&pose) / 0.8 - centre(&truth);
        assert!(off.norm() < 0.05 * centre(&truth).norm(), "{off}");
        let deviation = found.covariance.block(i, i).unwrap().diagonal().map(f64::sqrt);
        assert!(deviation.iter().all(|d| *d > 0.0 && *d < 0.02), "{deviation}");
    }
    assert_eq!(found.focal_factor, 1.0);

    // Depths in the reference are .8 of the truth there.
    let mut ratios = ratios(&found.depths);
    ratios.sort_by(f64::total_cmp);
    let [low, middle, high] = [0.1, 0.5, 0.9].map(|q| ratios[(q * ratios.len() as f64) as usize]);
    assert!(ratios.len() > 300 && (middle - 0.8).abs() < 0.03, "{} {middle}", ratios.len());
    assert!(high / low < 1.06, "{low} {high}");
}

/// The result is bit for bit the same with one thread and with four, and wherever the reference comes among the photographs.
#[test]
fn threads_and_the_place_of_the_reference_change_nothing() {
    let given = photographs(standard());
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let one = pool(1).install(|| estimate(&given, 0));
    assert_eq!(pool(4).install(|| estimate(&given, 0)), one);

    let order = [1, 2, 0, 3];
    let turned = order.map(|i| given[i]);
    let other = estimate(&turned, 2);
    for (place, &i) in order.iter().enumerate() {
        assert_eq!(other.photographs[place], one.photographs[i]);
    }
    assert_eq!(other.depths, one.depths);

    let mut off = held();
    off[1] = pose_at([0.005, 0.0, 0.0], [0.005, 0.0, 0.0]) * off[1];
    let (one, other) = (refine(&given, &off, 0), refine(&turned, &order.map(|i| off[i]), 2));
    assert!(one.accepted);
    assert_eq!(order.map(|i| one.photographs[i].clone()).as_slice(), other.photographs);
}

/// Under a constant prior the matches alone give poses and shape.
#[test]
fn a_constant_prior_is_enough_where_there_is_parallax() {
    let flat = ArcArray2::from_elem((240, 320), 1.0);
    let mut views = photographs(standard());
    views.iter_mut().for_each(|photograph| photograph.prior = Some(&flat));
    let found = estimate(&views, 0);
    let ratios = ratios(&found.depths);
    let unit = median(ratios.iter().copied()).unwrap();
    let error = median(ratios.iter().map(|ratio| (ratio / unit - 1.0).abs())).unwrap();
    assert!(ratios.len() > 300 && error < 0.03, "{} {error}", ratios.len());
    for (photograph, truth) in found.photographs.iter().zip(held()).skip(1) {
        let pose = photograph.pose.unwrap();
        assert!(rotation_error(&pose, &truth) < 0.5, "{}", rotation_error(&pose, &truth));
        assert!((centre(&pose) / unit - centre(&truth)).norm() < 0.15 * centre(&truth).norm());
    }
}

/// With a focal length that is wrong, which looks like a step aside before a constant prior.
#[test]
fn a_turn_on_the_spot_has_no_parallax() {
    let turns = [[0.0; 3], [0.01, 0.08, 0.0], [-0.02, -0.11, 0.01]];
    let mut scene = scene(&turns.map(|turn| pose_at([0.0; 3], turn)));
    scene.iter_mut().for_each(|(_, prior)| prior.fill(3.0));
    let mut turned = photographs(&scene);
    for one in &mut turned {
        (one.camera.fx, one.camera.fy, one.focal_assumed) =
            (0.85 * one.camera.fx, 0.85 * one.camera.fy, true);
    }
    let found = estimate(&turned, 0).photographs;
    for one in &found[1..] {
        assert!(matches!(one.verdict, Verdict::NoParallax(pixels) if pixels < 0.6), "{}", one.verdict);
    }
}

/// Turned on the spot, in another place, and blank: each has its verdict, and the others their poses.
#[test]
fn what_does_not_fit_is_named() {
    let mut poses = held();
    poses.truncate(2);
    poses.push(pose_at([0.0, 0.0, 0.0], [0.03, -0.05, 0.0]));
    poses.extend([Pose::identity(), Pose::identity()]);
    let mut scene = scene(&poses);
    let elsewhere = [Plane::slanted(53.0, 0.2, -0.3)];
    scene[3].0 = render(&elsewhere, camera(), pose_at([0.0, 0.0, 50.0], [0.0; 3]), PERIOD).0;
    scene[4].0.image = Array3::from_elem((240, 320, 3), 0.4).into_shared();
    let found = estimate(&photographs(&scene), 0);
    let verdict = |i: usize| found.photographs[i].verdict;
    assert_eq!(verdict(1), Verdict::Posed);
    assert!(matches!(verdict(2), Verdict::NoParallax(pixels) if pixels < 2.0), "{}", verdict(2));
    assert!(rotation_error(&found.photographs[2].pose.unwrap(), &poses[2]) < 0.1);
    assert!(matches!(verdict(3), Verdict::AnotherPlace { .. }), "{}", verdict(3));
    assert!(verdict(4) == Verdict::TooFewFeatures(0), "{}", verdict(4));
    for i in 3..5 {
        assert_eq!((found.photographs[i].pose, found.covariance.block(i, i)), (None, None));
    }
    for (i, of) in [(2, "no parallax"), (3, "another place"), (4, "sharper")] {
        assert!(verdict(i).to_string().contains(of), "{}", verdict(i));
    }
    // Without a reference the blank one can be the first.
    let mut turned = photographs(&scene);
    turned.rotate_right(1);
    let found = estimate_poses(&prepared(&turned, false).unwrap(), None, 0, &mut silent).unwrap().photographs;
    let [first, second] = [1, 2].map(|i| found[i].pose.unwrap());
    assert!(found[0].verdict == Verdict::TooFewFeatures(0), "{}", found[0].verdict);
    assert!(rotation_error(&(second * first.inverse()), &poses[1]) < 0.15);
}

/// A photograph that shares nothing with the reference is attached through one between them, whose prior has another scale.
#[test]
fn a_photograph_is_attached_through_another() {
    let poses = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]].map(|at| pose_at(at, [0.0; 3]));
    // At that depth a photograph shows 2.5 of the wall.
    let wall = [Plane::slanted(2.2, 0.05, 0.1)];
    let shown = |i: usize| {
        let (view, depth) = render(&wall, camera(), poses[i], PERIOD);
        (view, (depth * (1.0 + 0.3 * i as f32)).into_shared())
    };
    let scene = [0, 1, 2, 3].map(shown);
    let found = estimate(&photographs(&scene), 0);
    let last = &found.photographs[3];
    assert_eq!(last.verdict, Verdict::Posed);
    assert!(rotation_error(&last.pose.unwrap(), &poses[3]) < 1.0);
    assert!((centre(&last.pose.unwrap()) - centre(&poses[3])).norm() < 0.15);
}

#[test]
fn an_assumed_focal_length_is_refined() {
    let poses = [
        Pose::identity(),
        pose_at([0.5, 0.1, 0.0], [0.05, -0.2, 0.1]),
        pose_at([-0.4, -0.2, 0.1], [-0.12, 0.2, -0.15]),
        pose_at([0.1, -0.5, -0.1], [0.2, 0.05, 0.3]),
    ];
    let scene = scene(&poses);
    let mut assumed = photographs(&scene);
    for photograph in &mut assumed {
        photograph.camera.fx *= 1.15;
        photograph.camera.fy *= 1.15;
        photograph.focal_assumed = true;
    }
    let found = estimate(&assumed, 0);
    let (error, sigma) = ((found.focal_factor * 1.15).ln(), found.focal_sigma.unwrap());
    assert!(error.abs() < 0.03_f64.min(2.0 * sigma) && sigma < 0.1, "{error} {sigma}");
    assert!((found.photographs[2].camera.fx / camera().fx - 1.0).abs() < 0.03);
    for (photograph, truth) in found.photographs.iter().zip(&poses).skip(1) {
        assert!(rotation_error(&photograph.pose.unwrap(), truth) < 0.5);
    }
}

/// Given poses that are .3 degrees and 5 mm off are repaired; exact ones stay as they are, and so do those of a camera turned on the spot.
#[test]
fn given_poses_are_repaired_and_exact_ones_kept() {
    let given = photographs(standard());
    let exact = refine(&given, &held(), 0);
    assert_eq!((exact.accepted, poses(&exact)), (false, held()));

    let turned = [[0.0; 3], [0.03, -0.05, 0.0], [-0.02, 0.04, 0.01]].map(|turn| pose_at([0.0; 3], turn));
    let kept = refine(&photographs(&scene(&turned)), &turned, 0);
    assert_eq!((kept.accepted, kept.withheld, poses(&kept)), (false, None, turned.to_vec()));

    let mut off = held();
    for (i, pose) in off.iter_mut().enumerate().skip(1) {
        let angle = 0.3_f64.to_radians();
        let turn = [[angle, 0.0, 0.0], [0.0, -angle, 0.0], [0.0, 0.6 * angle, 0.8 * angle]][i - 1];
        let moved = [[0.005, 0.0, 0.0], [0.0, 0.0, -0.005], [-0.003, 0.004, 0.0]][i - 1];
        *pose = pose_at(moved, turn) * *pose;
    }
    let refined = refine(&given, &off, 0);
    assert!(refined.accepted);
    let [before, after] = refined.withheld.unwrap();
    assert!(after < 0.5 * before, "{before} {after}");
    assert_eq!(poses(&refined)[0], off[0]);
    for (pose, truth) in poses(&refined).iter().zip(held()).skip(1) {
        let error = rotation_error(pose, &truth);
        assert!(error < 0.1, "{error}");
        assert!((centre(pose) - centre(&truth)).norm() < 0.006);
    }
    let error = median(ratios(&refined.depths).iter().map(|ratio| (ratio - 1.0).abs())).unwrap();
    assert!(error < 0.02, "{error}");
}

/// A walk of 7.5 m along a wall 2.4 m away: every photograph is used, and poses that are .2 degrees off are repaired, though the longest
/// baseline is three times the depth.
#[test]
fn a_walk_longer_than_its_depth_keeps_every_photograph() {
    let place = |i: i32| [0.5 * f64::from(i), 0.04 * f64::from(i % 3), 0.0];
    let walk: Vec<Pose> = (0..16).map(|i| pose_at(place(i), [0.0, 0.02 * f64::from(i % 4), 0.0])).collect();
    let wall = [Plane::slanted(2.4, 0.02, 0.1)];
    let scene: Vec<_> = walk.iter().map(|pose| render(&wall, camera(), *pose, PERIOD).0).collect();
    let given: Vec<_> = scene.iter().map(|view| input(view, None)).collect();
    let mut off = walk.clone();
    for (i, pose) in off.iter_mut().enumerate().filter(|(i, _)| *i != 7) {
        let turn = 0.2_f64.to_radians() * if i % 2 == 0 { 1.0 } else { -1.0 };
        *pose = pose_at([0.0; 3], [turn, 0.0, turn]) * *pose;
    }
    let refined = refine(&given, &off, 7);
    for (i, found) in refined.photographs.iter().enumerate() {
        assert!(found.verdict.has_pose() && found.matches > 100, "{found:?}");
        assert!(refined.covariance.block(i, i).is_some() == (i != 7), "{i}");
        assert!(found.depth.is_some_and(|depth| (depth / 2.4 - 1.0).abs() < 0.2), "{i}: {:?}", found.depth);
    }
    let neighbours = |poses: &[Pose], i: usize| poses[i + 1] * poses[i].inverse();
    let error = |found: &[Pose]| {
        median((0..15).map(|i| rotation_error(&neighbours(found, i), &neighbours(&walk, i)))).unwrap()
    };
    let after = error(&poses(&refined));
    assert!(refined.accepted && after < 0.06 * error(&off), "{after} {}", error(&off));
}

/// Where six of seven matches are wrong, such as a pattern's repetitions, a right pose stays, and one that is 10 degrees off does not.
#[test]
fn wrong_matches_do_not_contradict_a_right_pose() {
    let inputs = prepared(&photographs(&standard()[..2]), true).unwrap();
    let shots: Vec<&Prepared> = inputs.iter().collect();
    let found = match_features(&shots[0].features, &shots[1].features);
    let mut pair = verified_matches([shots[0], shots[1]], [0, 1], &found, 0);
    let right = pair.agreeing.split_off(pair.agreeing.len() % 7);
    let there = |i: usize| right[if i.is_multiple_of(7) { i } else { (i + 77) % right.len() }][1];
    pair.agreeing = (0..right.len()).map(|i| [right[i][0], there(i)]).collect();
    for (turn, is_right) in [(0.0, true), (0.17, false)] {
        let poses = [Pose::identity(), pose_at([0.0; 3], [0.0, turn, 0.0]) * held()[1]];
        let (pairs, verdicts) = (std::slice::from_ref(&pair), vec![Verdict::Posed; 2]);
        let mut capture = Capture { shots: &shots, pairs, poses: &poses, verdicts };
        assert_eq!(capture.leave_out(&poses, OUTLIER_PIXELS), !is_right, "{turn}");
    }
}

/// One camera thrown 10 m away, or two exchanged, are left out; the others stay. So is one that is too far along the line of all cameras,
/// where every pair fits by itself.
#[test]
fn a_wrong_pose_is_left_out_and_the_others_are_kept() {
    let mut poses = held();
    poses.push(pose_at([-0.3, 0.2, 0.05], [0.04, 0.07, 0.0]));
    poses.push(pose_at([0.35, -0.1, 0.1], [-0.06, -0.05, 0.03]));
    let left_out = |given: &[PoseInput], poses: &[Pose]| -> Vec<usize> {
        let found = refine(given, poses, 0).photographs;
        (0..found.len()).filter(|&i| !found[i].verdict.has_pose()).collect()
    };
    let held = scene(&poses);
    let given = photographs(&held);
    assert!(left_out(&given, &poses).is_empty());
    let mut thrown = poses.clone();
    thrown[1] = Pose::translation(10.0, 0.0, 0.0) * thrown[1];
    assert_eq!(left_out(&given, &thrown), [1]);
    let mut exchanged = poses.clone();
    exchanged.swap(2, 5);
    assert_eq!(left_out(&given, &exchanged), [2, 5]);
    // Without a reference the first photograph is like any other.
    let mut first = poses.clone();
    first[0] = Pose::translation(10.0, 0.0, 0.0) * first[0];
    let found = refine(&given, &first, None).photographs;
    assert!(!found[0].verdict.has_pose() && found[1].verdict == Verdict::Reference);
    assert!(
        found[1..].iter().zip(&poses[1..]).all(|(one, pose)| rotation_error(&one.pose.unwrap(), pose) < 0.1)
    );
    let mut line = [0.0, 0.2, -0.2, 0.4, -0.4].map(|x| pose_at([x, 0.0, 0.0], [0.0; 3]));
    let along = scene(&line);
    let given = photographs(&along);
    assert!(left_out(&given, &line).is_empty());
    line[1] = pose_at([1.5, 0.0, 0.0], [0.0; 3]);
    assert_eq!(left_out(&given, &line), [1]);
}

#[test]
fn what_cannot_be_estimated_is_refused() {
    let given = photographs(standard());
    let text = |photographs: &[PoseInput], reference| {
        let found = prepared(photographs, false);
        found.and_then(|all| estimate_poses(&all, Some(reference), 0, &mut silent)).unwrap_err().to_string()
    };
    assert!(text(&given[..1], 0).contains("number of photographs"));
    assert!(text(&given, 4).contains("reference"));
    let without = PoseInput { prior: None, ..given[0] };
    assert!(text(&[without, given[1]], 0).contains("prior of the reference"));
    let small = PinholeCamera::from_fov(60.0, 100, 240).unwrap();
    assert!(text(&[PoseInput { camera: small, ..given[0] }, given[1]], 0).contains("shape"));

    let given = prepared(&given, true).unwrap();
    let refine = |poses: &[Pose]| refine_poses(&given, poses, None, 0, &mut silent);
    assert!(refine(&held()[..2]).unwrap_err().to_string().contains("number of poses"));
    let mut poses = held();
    poses[1].translation.vector.x = f64::NAN;
    assert!(refine(&poses).unwrap_err().to_string().contains("given pose"));
}
