use crate::error::in_range;
use crate::{Pose, Result};
use mde_uncertainty::OutOfRange;
use mde_uncertainty::random::CounterRng;
use nalgebra::{Translation3, Unit, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_distr::{Distribution, UnitSphere};
use std::f64::consts::TAU;

/// The golden angle \\( \pi (3 - \sqrt 5) \\), in radians.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Poses of the synthetic cameras about the original one (Section III.A: "a few degrees/centimetres").
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default, rename_all = "kebab-case"))]
pub struct ViewSampling {
    /// Number of poses N, without the original one. Paper: 10.
    pub count: usize,
    /// Radius of the disc in x/y that the cameras move on, as a fraction of the median depth.
    pub translation: f64,
    /// Largest rotation, degrees.
    pub rotation_degrees: f64,
    /// Share of the poses that only rotate (and so carry no depth), rounded down; at most one half. Not part of a configuration file.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub rotation_only: f64,
}

impl Default for ViewSampling {
    fn default() -> Self {
        Self { count: 10, translation: 0.015, rotation_degrees: 1.0, rotation_only: 0.2 }
    }
}

impl ViewSampling {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) with the first field at fault.
    pub fn validate(&self) -> Result<()> {
        let fraction = "give 0 to 0.5 (of the median depth; 0.01 to 0.02 is usual)";
        let degrees = "give 0 to 30 (degrees; about 1 is usual)";
        in_range("count", self.count as f64, [0.0, 1e6], "give at most 1000000")?;
        in_range("translation", self.translation, [0.0, 0.5], fraction)?;
        in_range("rotation-degrees", self.rotation_degrees, [0.0, 30.0], degrees)?;
        in_range("rotation-only", self.rotation_only, [0.0, 0.5], "give 0 to 0.5 (a share of the poses)")
    }
}

/// Small perturbations of the original camera, `sampling.count` of them; the same for the same arguments.
///
/// The rule, with \\( m \\) the median depth, \\( T \\) `translation`, \\( \Theta \\) `rotation_degrees`, and \\( n = \text{count} - \lfloor \text{count} \cdot \text{rotation\\_only} \rfloor \\), which is at
/// least half of the poses:
///
/// * pose \\( k < n \\) puts the camera on Vogel's spiral on a disc,
///   \\[ c_k = m \left( T \sqrt{\tfrac{k + 1/2}{n}} \cos\varphi_k,\; T \sqrt{\tfrac{k + 1/2}{n}} \sin\varphi_k,\;
///   0 \right), \qquad \varphi_k = \varphi_0 + k \pi (3 - \sqrt 5), \\]
///   which fills the disc evenly for any \\( n \\); \\( \varphi_0 \\) is drawn from the seed;
/// * poses \\( k \ge n \\) stay at the origin;
/// * every pose turns about an axis uniform on the sphere by an angle uniform in \\( [0, \Theta] \\), so the middle of
///   the image moves by at most \\( f (\tan\Theta + T) \\) pixels, to first order.
///
/// The pose is \\( X_k = R_k (X - c_k) \\).
///
/// ```
/// use mde_warp::{ViewSampling, sample_poses};
///
/// let poses = sample_poses(&ViewSampling::default(), 2.0, 7)?;
/// assert_eq!(poses.len(), 10);
/// let centre = poses[0].inverse().translation.vector;
/// assert!(centre.norm() > 0.0 && centre.norm() <= 0.015 * 2.0);
/// # Ok::<(), mde_warp::Error>(())
/// ```
///
/// # Errors
/// [`Config`](crate::Error::Config) for a setting out of its range, or a median depth that is not finite and positive.
pub fn sample_poses(sampling: &ViewSampling, median_depth: f64, seed: u64) -> Result<Vec<Pose>> {
    sampling.validate()?;
    let remedy = "give a finite depth > 0 (is every pixel of the prior missing?)";
    OutOfRange::check(median_depth.is_finite() && median_depth > 0.0, "median depth", &median_depth, remedy)?;
    let moving = sampling.count - (sampling.count as f64 * sampling.rotation_only).floor() as usize;
    let mut start = CounterRng::new(seed, "view-spiral", 0, 0);
    let phase = TAU * start.random::<f64>();
    let centre = |k: usize| {
        let radius = sampling.translation * ((k as f64 + 0.5) / moving as f64).sqrt();
        let angle = phase + GOLDEN_ANGLE * k as f64;
        Vector3::new(radius * angle.cos(), radius * angle.sin(), 0.0) * median_depth
    };
    let pose = |k: usize| {
        let mut rng = CounterRng::new(seed, "view-rotation", 0, k as u64);
        let axis: [f64; 3] = UnitSphere.sample(&mut rng);
        let angle = sampling.rotation_degrees.to_radians() * rng.random::<f64>();
        let rotation = UnitQuaternion::from_axis_angle(&Unit::new_normalize(Vector3::from(axis)), angle);
        let centre = if k < moving { centre(k) } else { Vector3::zeros() };
        Pose::from_parts(Translation3::from(-(rotation * centre)), rotation)
    };
    Ok((0..sampling.count).map(pose).collect())
}
