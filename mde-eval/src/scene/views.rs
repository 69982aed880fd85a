use super::World;
use super::solid::Ray;
use crate::capture::{Capture, CapturedView, POSE_NOISES, direction, disturbed};
use crate::error::check;
use crate::simulated::{SimulatedPriorConfig, simulated_prior};
use crate::{Error, Result};
use mde_uncertainty::OutOfRange;
use mde_uncertainty::random::{CounterRng, derived_seed};
use mde_uncertainty::statistics::median;
use mde_warp::{Pose, PosedView};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use ndarray::Array2;
use rand::RngExt;
use std::f64::consts::{PI, TAU};

/// How a room is photographed several times.
#[derive(Debug, Clone, PartialEq)]
pub struct CaptureConfig {
    /// Number of photographs, with the reference.
    pub views: usize,
    /// Distance of every further photograph from the reference over the reference's median depth.
    pub baseline: f64,
    /// Rotation error of the given poses of the further photographs, degrees about a random axis. Their centres are off by
    /// 20 mm per degree in a random direction.
    pub pose_noise: f64,
    /// Gain of the first further photograph: its colours are multiplied by 1 + gain for even seeds, by 1 - gain for odd ones.
    pub gain: f64,
    /// Seed of the places of the cameras, of the errors, and of the priors, which differ in their faults.
    pub seed: u64,
}

impl Default for CaptureConfig {
    /// Five photographs at a tenth of the median depth, exact poses, one exposure, disparity priors.
    fn default() -> Self {
        Self { views: 5, baseline: 0.1, pose_noise: 0.0, gain: 0.0, seed: 0 }
    }
}

/// Free space that a camera needs around it, metres.
const CLEARANCE: f64 = 0.2;
/// Share of the way that cameras turn towards the middle of the reference's view.
const TOE_IN: f64 = 0.5;
/// Random turn of each camera, degrees.
const TURN: f64 = 1.5;

impl CaptureConfig {
    /// Checks the fields.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field at fault.
    pub fn validate(&self) -> Result<()> {
        let baseline = self.baseline > 0.0 && self.baseline <= 1.0;
        check([
            ("views", self.views as f64, (2..=32).contains(&self.views), "use 2 to 32 photographs"),
            ("baseline", self.baseline, baseline, "use a number in (0, 1]"),
            ("pose-noise", self.pose_noise, POSE_NOISES.contains(&self.pose_noise), "use 0 to 10 degrees"),
            ("gain", self.gain, (0.0..=0.9).contains(&self.gain), "use 0 to 0.9"),
        ])
    }
}

impl World {
    /// Photographs the room `width` by `height` pixels from its own camera, the reference, and from places around it, with exact
    /// poses and the exact depth of the reference.
    ///
    /// The further cameras stand on a circle about the reference, as far as the room's furniture leaves space, and turn half
    /// way towards the middle of its view.
    ///
    /// ```
    /// use mde_eval::scene::{CaptureConfig, Room, World};
    ///
    /// let capture = World::new(Room::Study, 0)?.capture("study-0", &CaptureConfig::default(), 64, 48)?;
    /// assert_eq!((capture.views.len(), capture.truth.dim()), (5, (48, 64)));
    /// # Ok::<(), mde_eval::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Config`] for a field at fault or a baseline that the room has no space for; [`Error::Camera`] for an empty image.
    pub fn capture(&self, id: &str, config: &CaptureConfig, width: usize, height: usize) -> Result<Capture> {
        config.validate()?;
        let camera = self.camera(width, height)?;
        let reference = self.render(&camera, &Pose::identity());
        let known = reference.depth.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z));
        let middle = median(known).ok_or(Error::Empty("a capture"))?;
        let poses = std::iter::once(Pose::identity()).chain(self.poses(config, middle)?);
        let mut views = Vec::new();
        for (index, pose) in poses.enumerate() {
            let scene = if index == 0 { reference.clone() } else { self.render(&camera, &pose) };
            let gain = match (index, config.seed % 2) {
                (1, 0) => 1.0 + config.gain,
                (1, _) => 1.0 - config.gain,
                _ => 1.0,
            } as f32;
            let image = if gain == 1.0 { scene.image } else { scene.image.mapv(|c| (gain * c).min(1.0)) };
            let given =
                if index == 0 { pose } else { disturbed(&pose, config.pose_noise, config.seed, index) };
            let seed = derived_seed(config.seed, "capture-prior", index as u64);
            let faults = SimulatedPriorConfig { seed, ..SimulatedPriorConfig::disparity() };
            let mask = Array2::from_elem(camera.dim(), true);
            views.push(CapturedView {
                view: PosedView::new(image, camera, given, mask, Vec::new())?,
                prior: Some(simulated_prior(&scene.depth, &faults)?),
                true_pose: Some(pose),
            });
        }
        let (id, trusted_depth) = (id.to_owned(), f64::INFINITY);
        Ok(Capture { id, views, truth: reference.depth, trusted_depth })
    }

    /// Poses of the further photographs, world to camera.
    fn poses(&self, config: &CaptureConfig, middle: f64) -> Result<Vec<Pose>> {
        let further = config.views - 1;
        let distance = config.baseline * middle;
        let mut rng = CounterRng::new(config.seed, "capture-views", 0, 0);
        let start = TAU * rng.random::<f64>();
        // Seen from the reference, no two stand in nearly the same direction.
        let apart = (PI / 9.0).min(PI / further as f64);
        let (mut poses, mut taken) = (Vec::new(), Vec::<f64>::new());
        for index in 0..further {
            let nominal = start + TAU * index as f64 / further as f64;
            let tilt = rng.random_range(-0.2..0.2);
            let turn = direction(&mut rng).scale(TURN.to_radians() * rng.random::<f64>());
            let pose = |angle: f64| {
                let centre = Vector3::new(angle.cos(), angle.sin(), tilt).normalize() * distance;
                let towards = Vector3::new(0.0, 0.0, middle) - centre;
                let toe_in =
                    Rotation3::scaled_rotation_between(&Vector3::z(), &towards, TOE_IN).unwrap_or_default();
                let rotation = UnitQuaternion::from_scaled_axis(turn) * UnitQuaternion::from(toe_in);
                Isometry3::from_parts(Translation3::from(centre), rotation).inverse()
            };
            let free = |angle: &f64| {
                let difference = |other: &f64| {
                    let turns = (angle - other).rem_euclid(TAU);
                    turns.min(TAU - turns)
                };
                taken.iter().all(|other| difference(other) >= apart) && self.has_space(&pose(*angle))
            };
            let step =
                |k: u32| f64::from(k.div_ceil(2)) * if k.is_multiple_of(2) { -1.0 } else { 1.0 } * PI / 36.0;
            let Some(angle) = (0..72).map(|k| nominal + step(k)).find(free) else {
                let remedy = "use a smaller baseline or fewer views; the room has no space for the cameras";
                return Err(OutOfRange::new("baseline", config.baseline, remedy).into());
            };
            taken.push(angle);
            poses.push(pose(angle));
        }
        Ok(poses)
    }

    /// Whether a camera can be carried from the reference to a pose, and has nothing right before it.
    fn has_space(&self, pose: &Pose) -> bool {
        let origin = self.setting.eye.origin;
        let way = self.setting.eye.moved(pose).origin - origin;
        let length = way.norm();
        let ray = Ray { origin, direction: way / length };
        if self.bodies.nearest(&ray, length + CLEARANCE).is_some() {
            return false;
        }
        let Ok(camera) = self.camera(16, 12) else { return false };
        self.depth(&camera, pose).iter().all(|z| f64::from(*z) > CLEARANCE)
    }
}
