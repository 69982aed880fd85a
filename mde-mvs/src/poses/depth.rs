//! What uncertain poses do to depth.

use super::bundle::twist;
use crate::Result;
use mde_uncertainty::OutOfRange;
use mde_warp::{Pose, PosedView};
use nalgebra::{DMatrix, DVector, Point2, Point3, RowVector2, Vector3, Vector6};
use ndarray::{Array2, ArrayView2};

/// Variance of the log depth of each pixel of `views[0]` that comes from the poses of the views; 0 where no other one shows the pixel.
///
/// A pixel with ray \\( d \\) and depth \\( z \\) is seen by view \\( v \\) at \\( u_v = \pi(R_v z d + t_v) \\). With
/// \\( g_v = \partial u_v / \partial \log z \\), the depth of least squares of all views moves by
///
/// \\[ \delta \log z = - \frac{\sum_v g_v^\top A_v \xi_v}{\sum_v \lVert g_v \rVert^2}, \quad
///   \operatorname{var} \log z = \frac{\sum_{v, w} g_v^\top A_v \Sigma_{vw} A_w^\top g_w}{\left( \sum_v \lVert g_v \rVert^2 \right)^2} \\]
///
/// when the poses move by the left perturbations \\( \xi_v \\) (translation before rotation), with \\( A_v = \partial u_v / \partial \xi_v \\).
/// One common scale has no part in it: with all translations \\( \xi_v = \alpha t_v \\) every depth moves by \\( \alpha \\), so
/// \\( \alpha = \sum_v t_v^\top \xi_v / \sum_v \lVert t_v \rVert^2 \\) is taken from \\( \delta \log z \\).
///
/// `covariance`, \\( \Sigma \\), is that of [`of_motions`](super::PoseCovariance::of_motions), from the frame of `views[0]`.
///
/// # Errors
/// [`Config`](crate::Error::Config) for a covariance of another size.
pub fn depth_variance(
    views: &[PosedView],
    covariance: &DMatrix<f64>,
    depth: ArrayView2<'_, f32>,
) -> Result<Array2<f32>> {
    let Some((reference, others)) = views.split_first() else { return Ok(Array2::zeros(depth.dim())) };
    let (rows, size) = (6 * others.len(), covariance.shape());
    OutOfRange::check(size == (rows, rows), "rows of the covariance", &size.0, "give six per motion")?;
    let back = reference.pose.inverse();
    let motions: Vec<Pose> = others.iter().map(|view| view.pose * back).collect();
    let length: f64 = motions.iter().map(|motion| motion.translation.vector.norm_squared()).sum();
    if length == 0.0 {
        return Ok(Array2::zeros(depth.dim()));
    }
    let mut row = DVector::zeros(rows);
    Ok(Array2::from_shape_fn(depth.dim(), |(y, x)| {
        let z = f64::from(depth[(y, x)]);
        if !(z > 0.0 && z.is_finite()) {
            return 0.0;
        }
        let point = reference.camera.ray(Point2::new(x as f64, y as f64)) * z;
        let seen: Vec<_> =
            others.iter().zip(&motions).map(|(view, by)| derivative(view, by, &point)).collect();
        let information: f64 = seen.iter().flatten().map(|(slope, _)| slope).sum();
        if information <= 0.0 {
            return 0.0;
        }
        for (v, (seen, motion)) in seen.iter().zip(&motions).enumerate() {
            let common = twist(&(motion.translation.vector / length), &Vector3::zeros());
            let own = seen.map_or(common, |(_, own)| common + own / information);
            row.fixed_rows_mut::<6>(6 * v).copy_from(&own);
        }
        row.dot(&(covariance * &row)).max(0.0) as f32
    }))
}

/// \\( \lVert g \rVert^2 \\) and \\( g^\top A \\) of a point in the reference's frame; nothing where the view does not show it.
fn derivative(view: &PosedView, motion: &Pose, point: &Vector3<f64>) -> Option<(f64, Vector6<f64>)> {
    let turned = motion.rotation * point;
    let there = turned + motion.translation.vector;
    if there.z <= 1e-9 {
        return None;
    }
    let camera = &view.camera;
    let pixel = camera.project(&Point3::from(there))?;
    if !camera.contains(pixel) {
        return None;
    }
    let across = Vector3::new(camera.fx / there.z, 0.0, -camera.fx * there.x / (there.z * there.z));
    let down = Vector3::new(0.0, camera.fy / there.z, -camera.fy * there.y / (there.z * there.z));
    let slope = RowVector2::new(across.dot(&turned), down.dot(&turned));
    let translation = slope.x * across + slope.y * down;
    // (omega x p) . a = omega . (p x a).
    Some((slope.norm_squared(), twist(&translation, &there.cross(&translation))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::poses::bundle::exp;
    use crate::synthetic::{Plane, scene};
    use proptest::prelude::*;

    const CENTRES: [[f64; 3]; 3] = [[0.0; 3], [0.3, 0.05, 0.0], [-0.1, 0.25, 0.1]];

    /// Log depth of least squares of the pixels that the true poses give, under perturbed poses.
    fn moved(views: &[PosedView], by: &[Vector6<f64>], z: f64, (y, x): (usize, usize)) -> f64 {
        let ray = views[0].camera.ray(Point2::new(x as f64, y as f64));
        let project = |view: &PosedView, pose: &Pose, log: f64| {
            view.camera.project(&(pose * Point3::from(ray * log.exp()))).unwrap()
        };
        let of_view = |(view, by): (&PosedView, &Vector6<f64>), log: f64| {
            (project(view, &view.pose, z.ln()) - project(view, &(exp(by) * view.pose), log)).norm_squared()
        };
        let cost = |log: f64| -> f64 { views[1..].iter().zip(by).map(|pair| of_view(pair, log)).sum() };
        // The cost is a parabola about its least, near log z.
        let (h, at) = (1e-3, z.ln());
        let (a, b, c) = (cost(at - h), cost(at), cost(at + h));
        -h * (c - a) / (2.0 * (a - 2.0 * b + c))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        /// Both poses move by one draw: the variance is the square of the depth's move.
        #[test]
        fn the_variance_is_that_of_the_depth_of_least_squares(
            draw in prop::collection::vec(-1.0..1.0_f64, 12), y in 20..50_usize, x in 30..66_usize,
        ) {
            let plane = [Plane::slanted(2.0, 0.3, 0.1)];
            let (views, depths) = scene(&plane, (72, 96), &CENTRES);
            let step = 1e-5;
            let still = [Vector6::zeros(); 2];
            let joint = DVector::from_vec(draw) * step;
            let mut by = [0, 6].map(|start| joint.fixed_rows::<6>(start).into_owned());
            // Without the common scale, as there.
            let lengths: f64 = views[1..].iter().map(|view| view.pose.translation.vector.norm_squared()).sum();
            let along = |(by, view): (&Vector6<f64>, &PosedView)| by.fixed_rows::<3>(0).dot(&view.pose.translation.vector);
            let scale = by.iter().zip(&views[1..]).map(along).sum::<f64>() / lengths;
            for (by, view) in by.iter_mut().zip(&views[1..]) {
                let without = by.fixed_rows::<3>(0) - view.pose.translation.vector * scale;
                by.fixed_rows_mut::<3>(0).copy_from(&without);
            }
            let found = depth_variance(&views, &(&joint * joint.transpose()), depths[0].view()).unwrap()[(y, x)];
            let z = f64::from(depths[0][(y, x)]);
            let expected = (moved(&views, &by, z, (y, x)) - moved(&views, &still, z, (y, x))).abs();
            let seen = |view: &PosedView| {
                let point = views[0].camera.ray(Point2::new(x as f64, y as f64)) * z;
                derivative(view, &view.pose, &point).is_some()
            };
            prop_assume!(views[1..].iter().all(seen));
            prop_assert!((f64::from(found).sqrt() - expected).abs() < 0.01 * step + 0.01 * expected,
                "{found} {expected}");
        }
    }

    /// One longer or shorter translation is another unit, not another shape; one of two is a shape.
    #[test]
    fn the_common_length_of_translations_is_no_variance_of_depth() {
        let plane = [Plane::slanted(2.0, 0.3, 0.1)];
        let (views, depths) = scene(&plane, (48, 64), &CENTRES[..2]);
        let direction = twist(&(views[1].pose.translation.vector * 0.1), &Vector3::zeros());
        let one = DMatrix::from_column_slice(6, 6, (direction * direction.transpose()).as_slice());
        let found = depth_variance(&views, &one, depths[0].view()).unwrap();
        assert!(found.iter().all(|v| *v < 1e-12), "{found}");
        let (views, depths) = scene(&plane, (48, 64), &CENTRES);
        let found = depth_variance(&views, &one.resize(12, 12, 0.0), depths[0].view()).unwrap();
        assert!(found.iter().filter(|v| **v > 1e-4).count() > 500, "{found}");
        assert!(depth_variance(&views, &DMatrix::zeros(6, 6), depths[0].view()).is_err());
        let none = depth_variance(&views, &DMatrix::zeros(12, 12), depths[0].view()).unwrap();
        assert!(none.iter().all(|v| *v == 0.0));
    }

    /// A pixel shows what lies up to half a pixel from its centre.
    #[test]
    fn the_outer_pixels_are_shown_to_their_rims() {
        let plane = [Plane::slanted(2.0, 0.0, 0.0)];
        let first_row = |beyond: f64| {
            let focal = scene(&plane, (48, 64), &CENTRES[..1]).0[0].camera.fy;
            let (views, depths) = scene(&plane, (48, 64), &[[0.0; 3], [0.1, beyond * 2.0 / focal, 0.0]]);
            depth_variance(&views, &(DMatrix::identity(6, 6) * 1e-6), depths[0].view()).unwrap()[(0, 32)]
        };
        assert!(first_row(0.3) > 0.5 * first_row(0.0) && first_row(0.0) > 0.0);
        assert_eq!(first_row(0.7), 0.0);
    }
}
