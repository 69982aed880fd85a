//! Captures: several photographs of one scene, with poses and the true depth of one of them.

use mde_prior::PriorDepth;
use mde_uncertainty::random::CounterRng;
use mde_warp::{Pose, PosedView};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use ndarray::Array2;
use rand::RngExt;
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Rotation errors of given poses that make sense, degrees.
pub(crate) const POSE_NOISES: RangeInclusive<f64> = 0.0..=10.0;
/// Metres by which a centre is off for a rotation error of one degree.
const METRES_PER_DEGREE: f64 = 0.02;

/// Photographs of one scene with cameras and poses, and the true depth of the reference.
///
/// The world is the frame of the reference's camera: its pose is the identity. Lengths are in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Identifier within its data set.
    pub id: String,
    /// The photographs, the reference first.
    pub views: Vec<CapturedView>,
    /// True z-depth of the reference, `[height, width]`, 0 = missing. Never an input of a method.
    pub truth: Array2<f32>,
    /// Largest depth at which the truth is reliable.
    pub trusted_depth: f64,
}

/// One photograph of a [`Capture`].
#[derive(Debug, Clone, PartialEq)]
pub struct CapturedView {
    /// The photograph without lens distortion, with its camera and its pose as given to methods; no depth hypothesis.
    pub view: PosedView,
    /// Its monocular depth where the capture has one, as procedural captures do.
    pub prior: Option<PriorDepth>,
    /// Its true pose, world to camera, where it is known. Never an input of a method.
    pub true_pose: Option<Pose>,
}

/// The pose of the photograph `index`, off by `degrees` about a random axis and by 20 mm per degree in a random direction.
pub(crate) fn disturbed(pose: &Pose, degrees: f64, seed: u64, index: usize) -> Pose {
    if degrees == 0.0 {
        return *pose;
    }
    let mut rng = CounterRng::new(seed, "capture-poses", 0, index as u64);
    let axis = Unit::new_normalize(direction(&mut rng));
    let rotation = UnitQuaternion::from_axis_angle(&axis, degrees.to_radians());
    let shift = direction(&mut rng) * (METRES_PER_DEGREE * degrees);
    Isometry3::from_parts(Translation3::from(shift), rotation) * pose
}

/// A direction, uniform over the sphere.
pub(crate) fn direction(rng: &mut CounterRng) -> Vector3<f64> {
    on_sphere(rng.random_range(-1.0..1.0), rng.random())
}

/// The point of the unit sphere at a height of -1 to 1 and a share of the turn.
pub(crate) fn on_sphere(z: f64, turn: f64) -> Vector3<f64> {
    let (sin, cos) = (TAU * turn).sin_cos();
    let across = (1.0 - z * z).sqrt();
    Vector3::new(across * cos, across * sin, z)
}
