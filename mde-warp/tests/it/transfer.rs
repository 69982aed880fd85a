//! The projection between cameras, of products of matrices, against the one through a point in space.

use mde_warp::PinholeCamera;
use mde_warp::proptest::pose;
use mde_warp::transfer::Transfer;
use proptest::prelude::*;

proptest! {
    #[test]
    fn a_transfer_goes_through_the_point(
        from in pose(1.0, 40.0), to in pose(1.0, 40.0), focals in (30.0..200.0_f64, 30.0..200.0_f64),
        u in 0.0..63.0_f64, v in 0.0..47.0_f64, depth in 0.5..100.0_f64,
    ) {
        let camera = |focal: f64| PinholeCamera::new(focal, 1.1 * focal, 30.5, 21.0, 64, 48).unwrap();
        let (source, target) = (camera(focals.0), camera(focals.1));
        let point = to * from.inverse() * source.unproject([u, v].into(), depth);
        match Transfer::between((&source, &from), (&target, &to)).at(u, v, depth.recip()) {
            // Far outside the image a pixel is ill-conditioned.
            Some(seen) if seen.ratio > 0.1 => {
                let pixel = target.project(&point).unwrap();
                for (a, b) in [(seen.x, pixel.x), (seen.y, pixel.y), (seen.ratio, point.z / depth)] {
                    prop_assert!((a - b).abs() <= 1e-12 * b.abs().max(100.0), "{} {}", a, b);
                }
            }
            Some(_) => {}
            None => prop_assert!(point.z <= 1e-5 * depth, "{}", point.z),
        }
    }
}
