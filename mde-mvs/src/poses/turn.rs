//! Whether a camera has only turned.

use super::MIN_MATCHES;
use super::bundle::{Bundle, Observed};
use mde_uncertainty::statistics::median;
use nalgebra::{Matrix2x4, Matrix4, Point2, UnitQuaternion, Vector2, Vector3, Vector4};

/// Steps of the fit: it begins at the rotation of the pose.
const STEPS: usize = 10;
/// Half the distance between two values of a difference quotient, radians and of the logarithm of the focal length.
const STEP: f64 = 1e-5;
/// Deviations are those of the focal length within this.
const FOCAL: f64 = 0.3;

impl Bundle {
    /// Median distance, over the noise, of the reference's points in a photograph from where a turn on the spot takes them. The focal
    /// length follows where it is assumed: a wrong one looks like a step aside. Nothing where too few points are in both.
    pub(super) fn turn_error(&self, photograph: usize) -> Option<f64> {
        let cameras = &self.cameras;
        let [from, to] = [0, photograph].map(|v| &cameras.lenses[v]);
        let pixel = |track: &Observed, v: usize| match track.anchor == v {
            true => Some(track.pixel),
            false => track.views.iter().find(|(view, _)| *view == v).map(|(_, pixel)| *pixel),
        };
        let pairs =
            self.tracks.iter().filter_map(|track| Some([pixel(track, 0)?, pixel(track, photograph)?]));
        let pairs: Vec<[Point2<f64>; 2]> = pairs.collect();
        if pairs.len() < MIN_MATCHES {
            return None;
        }
        let (start, assumed) = (cameras.poses[photograph].rotation, from.assumed || to.assumed);
        let residual = |by: &Vector4<f64>, [p, q]: &[Point2<f64>; 2]| -> Vector2<f64> {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(by.x, by.y, by.z)) * start;
            let log_focal = cameras.log_focal + by.w;
            (to.project(&(turn * from.ray(p, log_focal)), log_focal) - q.coords) / to.noise
        };
        let mut by = Vector4::zeros();
        for _ in 0..STEPS {
            let held = if assumed { FOCAL.powi(-2) } else { f64::MAX.sqrt() };
            let mut normal = Matrix4::from_diagonal(&Vector4::new(0.0, 0.0, 0.0, held));
            let mut slope = Vector4::new(0.0, 0.0, 0.0, held * by.w);
            for pair in &pairs {
                let at = residual(&by, pair);
                let along = |axis: usize| {
                    let step = Vector4::ith(axis, STEP);
                    (residual(&(by + step), pair) - residual(&(by - step), pair)) / (2.0 * STEP)
                };
                let jacobian = Matrix2x4::from_columns(&[0, 1, 2, 3].map(along));
                // Points with parallax do not pull the turn off the others.
                let weight = at.norm().max(1.0).recip();
                normal += weight * jacobian.transpose() * jacobian;
                slope += weight * jacobian.transpose() * at;
            }
            let Some(solved) = normal.cholesky().map(|found| found.solve(&slope)) else { break };
            by -= solved;
        }
        median(pairs.iter().map(|pair| residual(&by, pair).norm()))
    }
}
