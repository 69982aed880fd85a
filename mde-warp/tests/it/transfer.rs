//! The two forms of the projection between cameras.

use mde_warp::ndarray::{Array2, Array3};
use mde_warp::proptest::pose;
use mde_warp::transfer::{PlaneTransfer, Projected, Transfer};
use mde_warp::{PinholeCamera, Pose, PosedView};
use proptest::prelude::*;

fn view(focal: f64, pose: Pose) -> PosedView {
    let camera = PinholeCamera::new(focal, 1.1 * focal, 30.5, 21.0, 64, 48).unwrap();
    let mask = Array2::from_elem(camera.dim(), true);
    PosedView::new(Array3::zeros((48, 64, 3)), camera, pose, mask, Vec::new()).unwrap()
}

proptest! {
    #[test]
    fn both_forms_are_one_projection(
        from in pose(1.0, 40.0), to in pose(1.0, 40.0), focals in (30.0..200.0_f64, 30.0..200.0_f64),
        u in 0.0..63.0_f64, v in 0.0..47.0_f64, disparity in 0.0..2.0_f64,
    ) {
        let (source, target) = (view(focals.0, from), view(focals.1, to));
        let rays = Transfer::new((&source.camera, &source.pose), (&target.camera, &target.pose)).unwrap();
        let (a, b) = (rays.project(u, v, disparity), PlaneTransfer::new(&source, &target).at(u, v, disparity));
        match b {
            // Within the image: far outside of it a pixel is ill-conditioned.
            Some(b) if b.ratio > 0.1 => {
                for (a, b) in [(a.x, b.x), (a.y, b.y), (a.ratio.recip(), b.ratio)] {
                    prop_assert!((a - b).abs() <= 1e-12 * b.abs().max(100.0), "{} {}", a, b);
                }
            }
            Some(_) => {}
            None => prop_assert_eq!(a, Projected::default()),
        }
    }
}
