//! Motion of calibrated cameras from a fundamental matrix.

use super::Lens;
use super::fundamental::PixelPair;
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The second camera's pose in the first one's frame, with a translation of length 1, and the median depth of the pairs in the first: of the
/// four motions of the essential matrix \\( E = K_2^\top F K_1 \\) (Hartley and Zisserman, 2004, 9.6) the one with most points in front of
/// both cameras. Nothing where hardly half of them are.
pub(super) fn motion(
    f: &Matrix3<f64>,
    pairs: &[PixelPair],
    [first, second]: [&Lens; 2],
) -> Option<(Pose, f64)> {
    let essential = intrinsics(second).transpose() * f * intrinsics(first);
    let svd = essential.svd(true, true);
    let [u, vt] = [svd.u?, svd.v_t?].map(|m| if m.determinant() < 0.0 { -m } else { m });
    let direction: Vector3<f64> = u.column(svd.singular_values.imin()).into();
    let turn = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let rays: Vec<_> = pairs.iter().map(|(p, q)| (first.ray(p, 0.0), second.ray(q, 0.0))).collect();
    let candidates = [turn, turn.transpose()].into_iter().flat_map(|turn| {
        let rotation = Rotation3::from_matrix_unchecked(u * turn * vt);
        [direction, -direction]
            .map(|t| Pose::from_parts(Translation3::from(t), UnitQuaternion::from(rotation)))
    });
    let best = candidates.map(|pose| (depths(&pose, &rays), pose)).max_by_key(|(depths, _)| depths.len())?;
    (2 * best.0.len() > pairs.len()).then_some(())?;
    Some((best.1, median(best.0)?))
}

fn intrinsics(lens: &Lens) -> Matrix3<f64> {
    let (f, c) = (lens.focal, lens.centre);
    Matrix3::new(f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0)
}

/// Depths, in the first camera, of the points in front of both.
fn depths(pose: &Pose, rays: &[(Vector3<f64>, Vector3<f64>)]) -> Vec<f64> {
    let t = pose.translation.vector;
    let depth = |(p, q): &(Vector3<f64>, Vector3<f64>)| {
        let (turned, moved) = ((pose.rotation * p).cross(q), t.cross(q));
        let depth = -moved.norm_squared() / turned.dot(&moved);
        (depth > 0.0 && (pose.rotation * p * depth + t).z > 0.0).then_some(depth)
    };
    rays.iter().filter_map(depth).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point2, Point3, Vector2};
    use proptest::prelude::*;

    fn lens(focal: f64) -> Lens {
        let (focal, centre) = (Vector2::new(focal, 1.1 * focal), Vector2::new(310.0, 250.0));
        Lens { focal, centre, assumed: false, noise: 1.0 }
    }

    proptest! {
        /// The motion of exact pairs, whichever way the camera went.
        #[test]
        fn exact_pairs_give_their_motion(
            turn in prop::array::uniform3(-0.4..0.4_f64), t in prop::array::uniform3(-1.0..1.0_f64), seed in 0..100_u32,
        ) {
            let translation = Vector3::from(t);
            prop_assume!(translation.norm() > 0.2);
            let translation = translation.normalize();
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            let pose = Pose::from_parts(translation.into(), rotation);
            let lenses = [lens(500.0), lens(620.0)];
            let unit = |i: u32, k: u32| f64::from((i * 7919 + k * 104_729 + seed * 31) % 997) / 997.0;
            let points: Vec<Point3<f64>> = (0..40)
                .map(|i| Point3::new(4.0 * unit(i, 1) - 2.0, 3.0 * unit(i, 2) - 1.5, 4.0 + 6.0 * unit(i, 3)))
                .collect();
            let pixel = |lens: &Lens, p: &Point3<f64>| Point2::from(lens.project(&p.coords, 0.0));
            prop_assume!(points.iter().all(|p| (pose * p).z > 0.1));
            let pairs: Vec<PixelPair> =
                points.iter().map(|p| (pixel(&lenses[0], p), pixel(&lenses[1], &(pose * p)))).collect();
            let inverse = |lens: &Lens| intrinsics(lens).try_inverse().unwrap();
            let e = translation.cross_matrix() * rotation.to_rotation_matrix().into_inner();
            let f = inverse(&lenses[1]).transpose() * e * inverse(&lenses[0]);
            let (found, depth) = motion(&f, &pairs, [&lenses[0], &lenses[1]]).unwrap();
            prop_assert!(found.rotation.angle_to(&rotation) < 1e-6, "{}", found);
            prop_assert!((found.translation.vector - translation).norm() < 1e-6, "{}", found);
            let expected = median(points.iter().map(|p| p.z)).unwrap();
            prop_assert!((depth / expected - 1.0).abs() < 1e-6);
        }
    }
}
