//! The rooms are what they claim: deterministic, closed, different, and one world for every camera.

use mde_eval::Error;
use mde_eval::mde_uncertainty::statistics::median;
use mde_eval::nalgebra::{Isometry3, Point2, Vector3};
use mde_eval::ndarray::s;
use mde_eval::scene::{CaptureConfig, Room, World, room};

#[test]
fn rooms_are_closed_coloured_and_reproducible() {
    for kind in Room::ALL {
        let scene = room(kind, 5, 80, 60).unwrap();
        assert_eq!(scene.image.dim(), (60, 80, 3));
        assert!(scene.depth.iter().all(|z| (0.2..15.0).contains(z)), "{kind}");
        assert!(scene.image.iter().all(|c| (0.0..=1.0).contains(c)));
        let mean = scene.image.mean().unwrap();
        assert!((0.2..0.8).contains(&mean), "{kind}: {mean}");
        assert_eq!(room(kind, 5, 80, 60).unwrap(), scene);
        assert_ne!(room(kind, 6, 80, 60).unwrap().depth, scene.depth);
        assert!(matches!(room(kind, 5, 0, 10), Err(Error::Camera(_))));
    }
}

/// Depth is taken at pixel centres and does not depend on the size of the image around them.
#[test]
fn a_picture_three_times_as_large_has_the_same_depths_in_its_middle_pixels() {
    let (small, large) = (room(Room::Kitchen, 1, 64, 48).unwrap(), room(Room::Kitchen, 1, 192, 144).unwrap());
    let sampled = large.depth.slice(s![1..;3, 1..;3]);
    assert!(small.depth.iter().zip(sampled).all(|(a, b)| (a - b).abs() < 1e-5 * a));
}

/// Thin structures are there: poles and legs a few pixels wide, in front of something far behind.
#[test]
fn the_study_has_thin_structures() {
    let depth = room(Room::Study, 0, 320, 240).unwrap().depth;
    let thin = depth.windows((1, 9)).into_iter().filter(|w| w[(0, 4)] < 0.85 * w[(0, 0)].min(w[(0, 8)]));
    assert!(thin.count() > 300);
}

fn centre(pose: &Isometry3<f64>) -> Vector3<f64> {
    pose.inverse().translation.vector
}

/// A capture is one world: a point of the reference appears in every further photograph at the projected pixel unless something is in
/// between.
#[test]
fn photographs_of_a_capture_show_one_world() {
    let world = World::new(Room::Workshop, 0).unwrap();
    let capture =
        world.capture("w", &CaptureConfig { views: 4, ..CaptureConfig::default() }, 96, 72).unwrap();
    let reference = &capture.views[0].view;
    assert_eq!((reference.pose, capture.truth.dim()), (Isometry3::identity(), (72, 96)));
    for captured in &capture.views[1..] {
        let pose = captured.true_pose.unwrap();
        assert_eq!(captured.view.pose, pose);
        let there = world.depth(&captured.view.camera, &pose);
        let (mut seen, mut hidden) = (0, 0);
        for ((y, x), &z) in capture.truth.indexed_iter() {
            let point = pose * reference.camera.unproject(Point2::new(x as f64, y as f64), f64::from(z));
            let Some(pixel) = captured.view.camera.project(&point) else { continue };
            let Some(&depth) = there.get((pixel.y.round() as usize, pixel.x.round() as usize)) else {
                continue;
            };
            if (f64::from(depth) - point.z).abs() < 0.03 * point.z { seen += 1 } else { hidden += 1 }
        }
        assert!(seen > 4000 && hidden < seen / 5, "{seen} {hidden}");
    }
}

#[test]
fn conditions_change_what_they_name_and_nothing_else() {
    let world = World::new(Room::Bedroom, 1).unwrap();
    let plain = CaptureConfig { views: 4, seed: 2, ..CaptureConfig::default() };
    let capture = |config: &CaptureConfig| world.capture("b", config, 32, 24).unwrap();
    let exact = capture(&plain);
    assert_eq!(capture(&plain), exact);
    assert_ne!(capture(&CaptureConfig { seed: 3, ..plain.clone() }).views[1], exact.views[1]);
    let middle = median(exact.truth.iter().map(|z| f64::from(*z))).unwrap();
    for further in &exact.views[1..] {
        assert!((centre(&further.view.pose).norm() / middle - 0.1).abs() < 1e-9);
    }

    let noisy = capture(&CaptureConfig { pose_noise: 0.3, ..plain.clone() });
    assert_eq!(noisy.views[0], exact.views[0]);
    for (noisy, exact) in noisy.views[1..].iter().zip(&exact.views[1..]) {
        assert_eq!((noisy.true_pose, &noisy.view.image), (exact.true_pose, &exact.view.image));
        let error = noisy.view.pose * exact.view.pose.inverse();
        assert!((error.rotation.angle().to_degrees() - 0.3).abs() < 1e-9);
        assert!((error.translation.vector.norm() - 0.006).abs() < 1e-9);
    }

    for (seed, gain) in [(2, 1.2_f32), (3, 0.8)] {
        let even = CaptureConfig { seed, ..plain.clone() };
        let (before, after) = (capture(&even), capture(&CaptureConfig { gain: 0.2, ..even }));
        for (index, (before, after)) in before.views.iter().zip(&after.views).enumerate() {
            let gain = if index == 1 { gain } else { 1.0 };
            let expected = before.view.image.mapv(|c| (gain * c).min(1.0));
            assert!(expected.iter().zip(&after.view.image).all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }
}

/// Cameras stand in the open in every room, however wide the baseline.
#[test]
fn every_room_has_space_for_eight_cameras() {
    for (room, seed) in Room::ALL.into_iter().flat_map(|room| [(room, 0), (room, 7)]) {
        let world = World::new(room, seed).unwrap();
        for baseline in [0.02, 0.2] {
            let config = CaptureConfig { views: 8, baseline, seed, ..CaptureConfig::default() };
            let capture = world.capture("room", &config, 16, 12).unwrap();
            let centres: Vec<_> = capture.views.iter().map(|view| centre(&view.view.pose)).collect();
            let radius = centres[1].norm();
            for (i, a) in centres.iter().enumerate() {
                assert!(centres[..i].iter().all(|b| (a - b).norm() > 0.2 * radius), "{room} {baseline}");
            }
            for captured in &capture.views {
                let depth = world.depth(&captured.view.camera, &captured.true_pose.unwrap());
                assert!(depth.iter().all(|z| *z > 0.2), "{room} {baseline}");
                assert!(captured.prior.is_some());
            }
        }
    }
}
