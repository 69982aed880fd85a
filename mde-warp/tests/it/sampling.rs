//! The documented properties of `sample_poses`.

use mde_warp::{ViewSampling, sample_poses};
use proptest::prelude::*;

proptest! {
    #[test]
    fn poses_keep_their_bounds(
        (count, translation, rotation_degrees, rotation_only) in
            (0..40_usize, 0.001..0.1_f64, 0.0..10.0_f64, 0.0..=0.5_f64),
        depth in 0.1..50.0_f64,
        seed: u64,
    ) {
        let sampling = ViewSampling { count, translation, rotation_degrees, rotation_only };
        let poses = sample_poses(&sampling, depth, seed).unwrap();
        prop_assert_eq!(poses.len(), sampling.count);
        let mut moving = 0;
        for pose in &poses {
            let centre = pose.inverse().translation.vector;
            let sideways = centre.xy().norm();
            prop_assert!(sideways <= sampling.translation * depth * (1.0 + 1e-12));
            prop_assert!(centre.z.abs() <= 1e-12 * depth);
            prop_assert!(pose.rotation.angle() <= sampling.rotation_degrees.to_radians() + 1e-7);
            // The innermost point of the spiral has radius T sqrt(1 / 2n).
            moving += usize::from(sideways > 0.5 * sampling.translation * depth / (sampling.count as f64).sqrt());
        }
        prop_assert!(2 * moving >= sampling.count, "{moving} of {}", sampling.count);
    }

    /// No two of n cameras on the disc crowd: the even share of area of each is pi T^2 / n.
    #[test]
    fn the_disc_is_filled_evenly(seed: u64, count in 2..60_usize) {
        let sampling = ViewSampling { count, rotation_only: 0.0, ..ViewSampling::default() };
        let centres: Vec<_> = sample_poses(&sampling, 1.0, seed).unwrap().iter()
            .map(|pose| pose.inverse().translation.vector.xy() / sampling.translation).collect();
        let apart = 1.0 / (count as f64).sqrt();
        for (i, a) in centres.iter().enumerate() {
            for b in &centres[..i] {
                prop_assert!((a - b).norm() > apart, "{} {}", (a - b).norm(), apart);
            }
        }
        let mean = centres.iter().sum::<mde_warp::nalgebra::Vector2<f64>>() / count as f64;
        prop_assert!(mean.norm() < 0.5 * apart, "mean {}", mean.norm());
    }
}
