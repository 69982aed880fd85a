use crate::pose::check_pose;
use crate::{Error, PinholeCamera, Pose, Result};
use mde_uncertainty::GaussianDepth;
use ndarray::{ArcArray, ArrayView3, Ix2, Ix3};

/// An image with its camera and pose: a warp of the input, or another photograph of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedView {
    /// sRGB colours in [0, 1], `[height, width, 3]`; clones share them.
    pub image: ArcArray<f32, Ix3>,
    /// Its camera.
    pub camera: PinholeCamera,
    /// World to camera.
    pub pose: Pose,
    /// True where the pixel is valid for training, `[height, width]`.
    pub mask: ArcArray<bool, Ix2>,
    /// Hypotheses of this view's z-depth with variance, each `[height, width]` in the prior's unit; may be empty.
    pub hypotheses: Vec<GaussianDepth>,
}

impl PosedView {
    /// A view from its parts, checked by [`validate`](Self::validate).
    ///
    /// # Errors
    /// Those of [`validate`](Self::validate).
    pub fn new(
        image: impl Into<ArcArray<f32, Ix3>>,
        camera: PinholeCamera,
        pose: Pose,
        mask: impl Into<ArcArray<bool, Ix2>>,
        hypotheses: Vec<GaussianDepth>,
    ) -> Result<Self> {
        let view = Self { image: image.into(), camera, pose, mask: mask.into(), hypotheses };
        view.validate()?;
        Ok(view)
    }

    /// Checks the camera, that the pose and the colours are finite, and that every map has the camera's size.
    ///
    /// # Errors
    /// [`Error::Camera`], [`Error::Pose`], [`Error::Shape`] or [`Error::Colour`] for the first part at fault.
    pub fn validate(&self) -> Result<()> {
        self.camera.validate()?;
        check_pose("view's", &self.pose)?;
        check_image(self.image.view(), &self.camera)?;
        self.camera.check_map("mask", self.mask.dim())?;
        self.hypotheses.iter().try_for_each(|h| self.camera.check_map("depth hypothesis", h.dim()))
    }
}

pub(crate) fn check_image(image: ArrayView3<'_, f32>, camera: &PinholeCamera) -> Result<()> {
    let expected = [camera.height, camera.width, 3];
    if image.shape() != expected {
        let (found, expected) = (image.shape().to_vec(), expected.to_vec());
        return Err(Error::Shape { what: "image", found, expected });
    }
    let Some(at) = image.iter().position(|value| !value.is_finite()) else { return Ok(()) };
    let (row, column, channel) = (at / 3 / camera.width, at / 3 % camera.width, at % 3);
    Err(Error::Colour { row, column, channel, value: image[[row, column, channel]] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, Array3};

    fn view() -> PosedView {
        let camera = PinholeCamera::from_fov(60.0, 3, 2).unwrap();
        let (image, mask) = (Array3::zeros((2, 3, 3)), Array2::from_elem((2, 3), true));
        PosedView::new(image, camera, Pose::identity(), mask, vec![GaussianDepth::missing(2, 3)]).unwrap()
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let mut wrong = view();
        wrong.mask = Array2::from_elem((3, 2), true).into_shared();
        assert!(matches!(wrong.validate(), Err(Error::Shape { what: "mask", .. })));
        let mut wrong = view();
        wrong.image[(1, 2, 0)] = f32::NAN;
        assert!(matches!(wrong.validate(), Err(Error::Colour { row: 1, column: 2, channel: 0, .. })));
        let mut wrong = view();
        wrong.hypotheses.push(GaussianDepth::missing(2, 2));
        assert!(matches!(wrong.validate(), Err(Error::Shape { what: "depth hypothesis", .. })));
        let mut wrong = view();
        wrong.pose.translation.vector.x = f64::INFINITY;
        assert!(matches!(wrong.validate(), Err(Error::Pose { .. })));
    }
}
