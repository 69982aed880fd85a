use super::files::{layout, same_size};
use crate::Result;
use mde_mvs::capture::{Frame, Lens};
use mde_prior::format::{ReadOptions, read_depth};
use mde_prior::resample::nearest;
use nalgebra::Point2;
use ndarray::{Array2, ArrayView2};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A file of true depth, with the photograph that it is of where that is one of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueDepth {
    path: PathBuf,
    /// Steps of a PNG per unit.
    scale: Option<f64>,
    pub(super) frame: Option<Frame>,
}

impl TrueDepth {
    pub(super) fn of_file(path: PathBuf) -> Self {
        Self { path, scale: None, frame: None }
    }

    /// That of a frame of a `transforms.json` with that content, if it names one.
    pub(super) fn of_frame(transforms: &Path, content: &Value, frame: &Frame) -> Result<Option<Self>> {
        let folder = transforms.parent().unwrap_or(Path::new(""));
        let is_own = |one: &&Value| {
            let named = one["file_path"].as_str().map(|path| folder.join(path));
            let own = [frame.photograph.clone(), frame.photograph.with_extension("")];
            named.is_some_and(|path| own.contains(&path))
        };
        let mut frames = content["frames"].as_array().into_iter().flatten();
        let Some(file) = frames.find(is_own).and_then(|one| one["depth_file_path"].as_str()) else {
            return Ok(None);
        };
        let units = &content["depth_units_per_metre"];
        let scale = if units.is_null() { Some(1000.0) } else { units.as_f64().filter(|scale| *scale > 0.0) };
        let wrong = || format!("depth_units_per_metre is {units}; use a positive finite number");
        let scale = Some(scale.ok_or_else(|| layout(transforms, wrong()))?);
        Ok(Some(Self { path: folder.join(file), scale, frame: Some(frame.clone()) }))
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The same for a prediction of that size: a photograph may have been refined at another one.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_for(&self, size: (usize, usize)) -> Result<Array2<f32>> {
        let depth = self.read()?;
        Ok(if self.frame.is_some() { nearest(depth.view(), size) } else { depth })
    }

    /// z-depth `[height, width]`, 0 = missing; of a photograph without its lens distortion.
    ///
    /// # Errors
    /// [`Error::Prior`](crate::Error::Prior) for a file that can't be read, [`Error::Layout`](crate::Error::Layout) for a photograph of another
    /// size.
    pub fn read(&self) -> Result<Array2<f32>> {
        let depth = read_depth(&self.path, &ReadOptions { png_scale: self.scale, ..ReadOptions::default() })?;
        let Some(Frame { lens, .. }) = &self.frame else { return Ok(depth) };
        let (height, width) = lens.camera.dim();
        same_size(&self.path, depth.dim(), (height, width, 3))?;
        Ok(undistorted(depth.view(), lens))
    }
}

/// The depth of the photograph's nearest pixel at each pixel of the pinhole camera, which has the same axes; 0 without one.
fn undistorted(depth: ArrayView2<'_, f32>, lens: &Lens) -> Array2<f32> {
    if lens.distortion.is_none() {
        return depth.to_owned();
    }
    Array2::from_shape_fn(depth.dim(), |(y, x)| {
        let Some(at) = lens.photograph_pixel(Point2::new(x as f64, y as f64)) else { return 0.0 };
        let (row, column) = (at.y.round(), at.x.round());
        if row < 0.0 || column < 0.0 {
            return 0.0;
        }
        depth.get((row as usize, column as usize)).copied().unwrap_or(0.0)
    })
}
