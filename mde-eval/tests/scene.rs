//! The rooms are what they claim: deterministic, closed, different, and one world for every camera.

use mde_eval::Error;
use mde_eval::nalgebra::{Isometry3, Point2, Vector3};
use mde_eval::ndarray::s;
use mde_eval::scene::{Room, World, room};

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
    }
}

/// What one camera sees at a pixel, another one sees at the same place unless something is in between.
#[test]
fn another_pose_sees_the_same_world() {
    let world = World::new(Room::Study, 0).unwrap();
    let camera = world.camera(160, 120).unwrap();
    let pose = Isometry3::new(Vector3::new(0.08, -0.05, 0.1), Vector3::new(0.02, -0.03, 0.05));
    let (here, there) = (world.depth(&camera, &Isometry3::identity()), world.depth(&camera, &pose));
    let (mut seen, mut hidden) = (0, 0);
    for ((y, x), &z) in there.indexed_iter() {
        let point = pose.inverse() * camera.unproject(Point2::new(x as f64, y as f64), f64::from(z));
        let Some(pixel) = camera.project(&point) else { continue };
        let (u, v) = (pixel.x.round(), pixel.y.round());
        if !(0.0..160.0).contains(&u) || !(0.0..120.0).contains(&v) {
            continue;
        }
        // Half a pixel of slant, at most, from the pixel's centre.
        let around = here[(v as usize, u as usize)];
        if (f64::from(around) - point.z).abs() < 0.03 * point.z { seen += 1 } else { hidden += 1 }
    }
    assert!(seen > 15_000 && hidden < seen / 8, "{seen} {hidden}");
}

/// Depth is taken at pixel centres and does not depend on the size of the image around them.
#[test]
fn a_picture_three_times_as_large_has_the_same_depths_in_its_middle_pixels() {
    let (small, large) = (room(Room::Kitchen, 1, 64, 48).unwrap(), room(Room::Kitchen, 1, 192, 144).unwrap());
    let sampled = large.depth.slice(s![1..;3, 1..;3]);
    assert!(small.depth.iter().zip(sampled).all(|(a, b)| (a - b).abs() < 1e-5 * a));
}

#[test]
fn empty_images_are_refused() {
    assert!(matches!(room(Room::Study, 0, 0, 10), Err(Error::Camera(_))));
}

/// Thin structures are there: poles and legs a few pixels wide, in front of something far behind.
#[test]
fn the_study_has_thin_structures() {
    let depth = room(Room::Study, 0, 320, 240).unwrap().depth;
    let thin = depth.rows().into_iter().flat_map(|row| {
        let row = row.to_vec();
        (4..row.len() - 4)
            .filter(|&x| row[x] < 0.85 * row[x - 4] && row[x] < 0.85 * row[x + 4])
            .collect::<Vec<_>>()
    });
    assert!(thin.count() > 300);
}
