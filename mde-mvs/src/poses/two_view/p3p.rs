//! A camera's pose from points of known position.

use super::roots::real_roots;
use mde_warp::Pose;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Sine of the angle by which a point may miss its ray. Near a double root half of the digits are left.
const MISSED: f64 = 3e-4;
/// Denominator of u below which two poses have nearly the same v, and u is of rounding alone.
const SHARED: f64 = 1e-4;

/// Poses (world to camera) that put three points on three rays: at most four (Grunert, 1841; in the form of Haralick et al., 1994).
///
/// With \\( s_i \\) the distances along the unit rays, \\( s_2 = u s_1 \\) and \\( s_3 = v s_1 \\), the three cosine laws
/// leave a quartic in \\( v \\).
pub(super) fn p3p(points: [Point3<f64>; 3], rays: [Vector3<f64>; 3]) -> Vec<Pose> {
    let j = rays.map(|ray| ray.normalize());
    let [p, q, r] = points;
    let [a2, b2, c2] = [q - r, p - r, p - q].map(|side| side.norm_squared());
    if a2.min(b2).min(c2) <= 1e-18 * a2.max(b2).max(c2) || !(a2 + b2 + c2).is_finite() {
        return Vec::new();
    }
    let (ca, cb, cg) = (j[1].dot(&j[2]), j[0].dot(&j[2]), j[0].dot(&j[1]));
    let d = (a2 - c2) / b2;
    let (ab, cb2) = (a2 / b2, c2 / b2);
    let sum = ab + cb2;
    let coefficients = [
        (1.0 + d).powi(2) - 4.0 * ab * cg * cg,
        4.0 * (-d * (1.0 + d) * cb + 2.0 * ab * cg * cg * cb - (1.0 - sum) * ca * cg),
        2.0 * (d * d - 1.0 + 2.0 * d * d * cb * cb + 2.0 * (1.0 - cb2) * ca * ca - 4.0 * sum * ca * cb * cg
            + 2.0 * (1.0 - ab) * cg * cg),
        4.0 * (d * (1.0 - d) * cb - (1.0 - sum) * ca * cg + 2.0 * cb2 * ca * ca * cb),
        (d - 1.0).powi(2) - 4.0 * cb2 * ca * ca,
    ];
    let mut ratios: Vec<[f64; 2]> = Vec::new();
    for v in real_roots(coefficients) {
        let below = 2.0 * (cg - v * ca);
        let u = ((d - 1.0) * v * v - 2.0 * d * cb * v + 1.0 + d) / below;
        // Where that is 0 / 0, two poses share v: the law of the first two points has both.
        let half = (cg * cg - 1.0 + cb2 * (1.0 + v * v - 2.0 * v * cb)).max(0.0).sqrt();
        let of_v = if below.abs() > SHARED { [u, u] } else { [cg + half, cg - half] };
        for u in of_v {
            let new = ratios.iter().all(|[w, t]| (v - w).abs() + (u - t).abs() > 1e-6);
            if new && v > 0.0 && u > 0.0 && u.is_finite() {
                ratios.push([v, u]);
            }
        }
    }
    let poses = ratios.into_iter().filter_map(|[v, u]| {
        let first = (b2 / (1.0 + v * v - 2.0 * v * cb)).sqrt();
        let seen = [j[0] * first, j[1] * (u * first), j[2] * (v * first)];
        first.is_finite().then(|| align(points, seen)).flatten()
    });
    let missed = |pose: &Pose| {
        let each = points.iter().zip(&j).map(|(p, ray)| (pose * p).coords.normalize().cross(ray).norm());
        each.fold(0.0, f64::max)
    };
    let mut found: Vec<(f64, Pose)> =
        poses.map(|pose| (missed(&pose), pose)).filter(|(missed, _)| *missed < MISSED).collect();
    if found.len() > 4 {
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.truncate(4);
    }
    found.into_iter().map(|(_, pose)| pose).collect()
}

/// The rigid motion that carries one triangle to a congruent one: the frames on both, which are exact for congruent ones.
fn align(from: [Point3<f64>; 3], to: [Vector3<f64>; 3]) -> Option<Pose> {
    let frame = |p: [Vector3<f64>; 3]| -> Option<Matrix3<f64>> {
        let x = (p[1] - p[0]).try_normalize(1e-12)?;
        let z = x.cross(&(p[2] - p[0])).try_normalize(1e-12)?;
        Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
    };
    let from = from.map(|p| p.coords);
    let rotation = Rotation3::from_matrix_unchecked(frame(to)? * frame(from)?.transpose());
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    let translation = (0..3).map(|i| to[i] - rotation * from[i]).sum::<Vector3<f64>>() / 3.0;
    Some(Isometry3::from_parts(Translation3::from(translation), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_warp::proptest::pose;
    use proptest::prelude::*;

    proptest! {
        /// Among the poses from three exact points is the true one, and all of them put the points on the rays.
        #[test]
        fn the_true_pose_is_among_the_solutions(
            truth in pose(1.0, 40.0),
            raw in [(-1.0..1.0_f64, -1.0..1.0_f64, 2.0..6.0_f64), (-1.0..1.0, -1.0..1.0, 2.0..6.0), (-1.0..1.0, -1.0..1.0, 2.0..6.0)],
        ) {
            let seen = raw.map(|(x, y, z)| Point3::new(x * z, y * z, z));
            let area = (seen[1] - seen[0]).cross(&(seen[2] - seen[0])).norm();
            prop_assume!(area > 0.3);
            let points = seen.map(|p| truth.inverse() * p);
            let rays = seen.map(|p| p.coords / p.z);
            let found = p3p(points, rays);
            prop_assert!(!found.is_empty() && found.len() <= 4);
            let best = found.iter().map(|p| (p.inverse() * truth).translation.vector.norm() + p.rotation.angle_to(&truth.rotation)).fold(f64::INFINITY, f64::min);
            // Near a double root, half of the digits are left, and the conditioning of the triangle takes some of them.
            prop_assert!(best < 1e-3, "{}", best);
            for pose in &found {
                for (p, ray) in points.iter().zip(&rays) {
                    let there = pose * p;
                    prop_assert!((there.coords / there.z - ray).norm() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn points_on_a_line_or_at_one_place_have_no_pose() {
        let at = |x: f64| Point3::new(x, 0.0, 2.0);
        let rays = [0.0, 0.1, 0.2].map(|x| Vector3::new(x, 0.0, 1.0));
        assert!(p3p([at(1.0); 3], rays).is_empty());
        assert!(p3p([Point3::new(f64::NAN, 0.0, 1.0), at(0.0), at(1.0)], rays).is_empty());
    }
}
