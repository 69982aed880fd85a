//! Photographs of one static scene, each at the size at which it is refined, with its camera.

pub mod camera;
pub mod known;
pub mod size;

pub use camera::{CameraSource, GivenCamera, KnownCamera};
pub use known::{KnownDepth, KnownDepths};
pub use mde_prior::pixels::{Image, Pixels};
pub use size::{SMALLEST, Sizes, byte, thumbnail};
pub(crate) use size::{shrunk, within};

use crate::error::{Error, Result};
use mde_prior::resample::nearest;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::Point3;
use ndarray::{ArcArray, Array2, Ix2};
use serde::Serialize;

/// A photograph at the size at which it is refined.
#[derive(Debug, Clone)]
pub struct Photograph {
    /// Its name in reports and messages; unique within a scene.
    pub name: String,
    /// Its colours, without lens distortion.
    pub image: Pixels,
    /// False where the image has no content, `[height, width]`.
    pub mask: ArcArray<bool, Ix2>,
    /// The camera at this size. An assumed focal length is estimated where there are several photographs without poses.
    pub camera: KnownCamera,
    /// World to camera; none where it is to be estimated.
    pub pose: Option<Pose>,
    /// `(height, width)` as given.
    pub original: (usize, usize),
    /// The photograph at the size of the results, where it is refined at a smaller one.
    pub full: Option<Image>,
}

impl Photograph {
    /// A photograph of that camera, as it is.
    pub fn new(name: impl Into<String>, image: impl Into<Pixels>, camera: KnownCamera) -> Self {
        let image = image.into();
        let original = image.size();
        let mask = Array2::from_elem(original, true).into_shared();
        Self { name: name.into(), image, mask, camera, pose: None, original, full: None }
    }

    /// Resizes it. One of `several` photographs has its results at the size of the refinement. Other sizes are reported to `warn`.
    ///
    /// # Errors
    /// [`Error::Argument`] for a size that is too small, [`Error::Warp`] for a camera that can't be resized, and those of [`Pixels::read`].
    pub fn resized(mut self, sizes: &Sizes, several: bool, warn: &mut dyn FnMut(String)) -> Result<Self> {
        let size = sizes.of_results(self.original);
        let at = sizes.of_refinement(size);
        let (height, width) = size;
        let full = shrunk(self.image.read()?, size);
        if size != self.original {
            let (from_height, from_width) = self.original;
            warn(format!(
                "resized from {from_width}x{from_height} to {width}x{height} pixels; {{max-size}} sets this"
            ));
        }
        if width.min(height) < SMALLEST {
            return Err(Error::Argument(format!(
                "{}: the image is {width}x{height}; give one of {SMALLEST}x{SMALLEST} pixels or more",
                self.name
            )));
        }
        if at != size {
            let (rows, columns) = at;
            warn(format!("{width}x{height} pixels: refined at {columns}x{rows}; {{work-size}} sets this"));
            self.full = (!several).then(|| full.clone());
        }
        self.image = shrunk(full, at).into();
        self.camera = self.camera.resized(at)?;
        if self.mask.dim() != at {
            self.mask = nearest(self.mask.view(), at).into_shared();
        }
        Ok(self)
    }

    /// `(height, width)` of the refinement.
    pub fn size(&self) -> (usize, usize) {
        self.image.size()
    }

    /// `(height, width)` of the results.
    pub fn of_results(&self) -> (usize, usize) {
        self.full.as_ref().map_or(self.size(), |full| (full.dim().0, full.dim().1))
    }

    /// The photograph with that pose and camera, without a depth hypothesis and with an empty image.
    pub(crate) fn place(&self, pose: Pose, camera: PinholeCamera) -> PosedView {
        let (image, mask) = (Image::default((0, 0, 3)), self.mask.clone());
        PosedView { image, camera, pose, mask, hypotheses: Vec::new() }
    }
}

/// Photographs of one static scene.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// One, or several: all with a pose or all without.
    pub photographs: Vec<Photograph>,
    /// Whether each photograph is refined, in the frame of any with a pose; else the first is, in its own.
    pub every: bool,
    /// Points that the reference shows, such as COLMAP's, in the world of the poses. 16 or more give the scale between poses and prior,
    /// which the sweeps find otherwise. Not used without poses.
    pub points: Vec<Point3<f64>>,
    /// Names and faults of photographs that could not be read.
    pub unreadable: Vec<(String, String)>,
    /// Depths that give the result its scale.
    pub known: Option<KnownDepths>,
    /// The scale that the photograph shares with others.
    pub same_scale: Option<SameScale>,
}

impl Scene {
    /// One photograph.
    pub fn one(photograph: Photograph) -> Self {
        Self { photographs: vec![photograph], ..Self::default() }
    }

    /// Two or more photographs, of which the first is refined.
    ///
    /// # Errors
    /// [`Error::Capture`] with the photograph at fault and the remedy.
    pub fn several(photographs: Vec<Photograph>) -> Result<Self> {
        let scene = Self { photographs, ..Self::default() };
        scene.validate()?;
        Ok(scene)
    }

    /// Whether there is more than one photograph.
    pub fn is_several(&self) -> bool {
        self.photographs.len() > 1
    }

    /// Whether the photographs came with poses.
    pub fn is_posed(&self) -> bool {
        self.is_several() && self.photographs.iter().all(|photograph| photograph.pose.is_some())
    }

    /// Checks several photographs: their number, names, sizes, cameras and poses.
    pub(crate) fn validate(&self) -> Result<()> {
        let fault = |reason: String, remedy: &'static str| Err(Error::Capture { reason, remedy });
        let count = self.photographs.len();
        if count < 2 {
            return fault(format!("{count} photographs"), "give two or more");
        }
        let posed = self.photographs.iter().filter(|photograph| photograph.pose.is_some()).count();
        if posed != 0 && posed != count {
            let reason = format!("{posed} of {count} photographs have a pose");
            return fault(reason, "give poses for all of them or for none");
        }
        for (index, photograph) in self.photographs.iter().enumerate() {
            let name = &photograph.name;
            if self.photographs[..index].iter().any(|other| other.name == *name) {
                return fault(format!("two photographs are named {name}"), "rename one");
            }
            let pose = photograph.pose.unwrap_or_else(Pose::identity);
            let place = photograph.place(pose, photograph.camera.camera);
            if !photograph.image.are_in_file()
                && let Err(error) = (PosedView { image: photograph.image.read()?, ..place }).validate()
            {
                return fault(format!("{name}: {error}"), "check the photograph and its camera");
            }
        }
        Ok(())
    }

    /// Identifies the content of the photographs, their cameras, poses and points: their CRC-32 in hexadecimal digits.
    ///
    /// # Errors
    /// Those of [`Pixels::read`].
    pub fn identity(&self) -> Result<String> {
        let mut hasher = crc32fast::Hasher::new();
        let mut number = |value: f64| hasher.update(&value.to_le_bytes());
        for photograph in &self.photographs {
            number(f64::from(photograph.image.content()?));
            photograph.mask.iter().for_each(|real| number(f64::from(u8::from(*real))));
            let PinholeCamera { fx, fy, cx, cy, width, height } = photograph.camera.camera;
            [fx, fy, cx, cy, width as f64, height as f64].into_iter().for_each(&mut number);
            if let Some(pose) = photograph.pose {
                pose.to_homogeneous().iter().copied().for_each(&mut number);
            }
        }
        self.points.iter().flat_map(|point| [point.x, point.y, point.z]).for_each(number);
        for photograph in &self.photographs {
            hasher.update(photograph.name.as_bytes());
            hasher.update(&[0, u8::from(photograph.camera.is_assumed())]);
        }
        Ok(format!("{:08x}", hasher.finalize()))
    }
}

/// The factor that brings a photograph's depth to the scale of others; in the record, that of the refined map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SameScale {
    /// The factor.
    pub factor: f64,
    /// Standard deviation of its logarithm, relative to the mean over the group.
    pub log_sigma: f64,
    /// Number of the photographs that share a scale, from 0; not in the record, as it changes with other photographs.
    #[serde(skip)]
    pub group: usize,
    /// Photographs in the group.
    pub photographs: usize,
}

impl SameScale {
    /// Whether no other photograph has this scale.
    pub fn is_alone(&self) -> bool {
        self.photographs < 2
    }
}
