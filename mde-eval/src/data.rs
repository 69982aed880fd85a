//! Data sets: images with true depth and a camera.

mod dense;
mod files;
mod kind;
mod maps;
mod nyu;
mod plain;
mod posed;
mod resized;
mod rooms;
mod shard;
mod sunrgbd;
mod truth;

pub use dense::DenseResults;
pub use kind::{DataSetKind, Options, open};
pub use maps::{MapPair, map_pairs};
pub use nyu::Nyu;
pub use plain::{PlainFolders, PlainScene};
pub use posed::Posed;
pub use resized::Resized;
pub use rooms::{CaptureGrid, Captures, Rooms};
pub use shard::Shard;
pub use sunrgbd::SunRgbd;
pub use truth::TrueDepth;

use crate::capture::{Capture, CapturedView};
use crate::raster::same_shape;
use crate::{Error, Result};
use mde_prior::{DepthPrior, PriorDepth};
use mde_warp::{PinholeCamera, PosedView};
use ndarray::{Array2, Array3, ArrayView3};
use std::path::Path;

/// Scenes that are loaded one by one.
pub trait DataSet: Send + Sync {
    /// Identifiers of the scenes, in order; unique, and the same wherever the data lies.
    fn ids(&self) -> &[String];

    /// Name of the place that a scene shows; by default the scene's own identifier. The errors on scenes
    /// of one place are correlated, so intervals resample places ([`statistics`](crate::statistics)).
    fn place(&self, index: usize) -> Option<&str> {
        self.ids().get(index).map(String::as_str)
    }

    /// Loads a scene by its index in [`DataSet::ids`].
    ///
    /// # Errors
    /// [`Error::Scene`] beyond the last one; [`Error::Layout`], [`Error::Prior`] or [`Error::Io`] for files that are missing or
    /// broken, and where the camera is unknown.
    fn load(&self, index: usize) -> Result<Sample>;
}

/// One scene of a data set.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Identifier within its data set.
    pub id: String,
    /// The image, `[height, width, 3]`, sRGB in 0 to 1.
    pub image: Array3<f32>,
    /// True z-depth in metres, `[height, width]`, 0 = missing.
    pub depth: Array2<f32>,
    /// The camera, pixel centres at integers from 0.
    pub camera: PinholeCamera,
    /// Whether the camera has the caller's field of view, because the scene has none: worth a warning.
    pub assumed_camera: bool,
    /// Largest depth at which the truth is reliable, metres.
    pub trusted_depth: f64,
    /// Further photographs of the scene; most data sets have none. The world is the frame of `camera`.
    pub views: Vec<CapturedView>,
    /// The monocular depth of the image, where the data set brings one.
    pub prior: Option<PriorDepth>,
}

impl Sample {
    /// A scene of one image with its true depth in metres and its camera, reliable at any depth.
    pub fn new(id: impl Into<String>, image: Array3<f32>, depth: Array2<f32>, camera: PinholeCamera) -> Self {
        Self {
            id: id.into(),
            image,
            depth,
            camera,
            assumed_camera: false,
            trusted_depth: f64::INFINITY,
            views: Vec::new(),
            prior: None,
        }
    }

    /// The reference of a capture with its truth, and the further photographs.
    ///
    /// # Errors
    /// [`Error::Scene`] without photographs, [`Error::Shape`] where truth and reference differ in size.
    pub fn of_capture(capture: Capture) -> Result<Self> {
        let Capture { id, views, truth: depth, trusted_depth } = capture;
        let mut views = views.into_iter();
        let Some(reference) = views.next() else {
            return Err(Error::Scene { index: 0, count: 0 });
        };
        let PosedView { image, camera, .. } = reference.view;
        same_shape("the true depth", depth.dim(), camera.dim())?;
        let (views, prior) = (views.collect(), reference.prior);
        Ok(Self { trusted_depth, views, prior, ..Self::new(id, image.into_owned(), depth, camera) })
    }

    /// Checksum (CRC-32) of the image, its camera, its own prior, the further photographs with theirs and, where given, a depth map.
    pub fn fingerprint(&self, depth: Option<&Array2<f32>>) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        let views = || self.views.iter().map(|captured| &captured.view);
        for camera in views().map(|view| &view.camera).chain([&self.camera]) {
            for number in [camera.fx, camera.fy, camera.cx, camera.cy] {
                hasher.update(&number.to_le_bytes());
            }
        }
        for view in views() {
            view.pose.to_homogeneous().iter().for_each(|number| hasher.update(&number.to_le_bytes()));
            view.image.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
        }
        for prior in self.views.iter().map(|captured| &captured.prior).chain([&self.prior]).flatten() {
            hasher.update(prior.kind.to_string().as_bytes());
            let known = prior.map.iter().zip(&prior.valid);
            known.for_each(|(value, valid)| hasher.update(&if *valid { *value } else { 0.0 }.to_le_bytes()));
        }
        for value in self.image.iter().chain(depth.into_iter().flatten()) {
            hasher.update(&value.to_le_bytes());
        }
        hasher.update(format!("{:?}", self.image.dim()).as_bytes());
        hasher.finalize()
    }
}

/// The monocular depths that a data set brings for the photographs of a scene, as a prior: it has no depth of any other image.
pub struct OwnPriors<'s>(pub &'s Sample);

impl DepthPrior for OwnPriors<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> mde_prior::Result<PriorDepth> {
        let Self(sample) = self;
        let own = (image == sample.image).then_some(sample.prior.as_ref());
        let known = || sample.views.iter().find(|one| one.view.image == image).map(|one| one.prior.as_ref());
        let unknown = || mde_prior::Error::Input("no depth of this image; name a model".to_owned());
        own.or_else(known).flatten().cloned().ok_or_else(unknown)
    }

    fn accepts_new_images(&self) -> bool {
        !self.0.views.is_empty() && self.0.views.iter().all(|view| view.prior.is_some())
    }
}

/// The camera of a scene without one: square pixels and the assumed horizontal field of view in degrees, if any.
fn assumed(fov: Option<f64>, missing: &Path, (height, width): (usize, usize)) -> Result<PinholeCamera> {
    let reason = "holds no camera; assume a field of view for such scenes";
    let fov = fov.ok_or_else(|| files::layout(missing, reason))?;
    Ok(PinholeCamera::from_fov(fov, width, height)?)
}
