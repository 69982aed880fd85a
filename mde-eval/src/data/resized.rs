use super::{DataSet, Sample};
use crate::Result;
use mde_prior::resample::{nearest, shrink};
use mde_uncertainty::OutOfRange;
use mde_warp::PosedView;

/// A data set at another size, such as the paper's 640 x 480.
///
/// The image is resampled bilinearly (antialiased where it shrinks), the camera follows with pixel centres at integers, and the truth takes
/// the nearest pixel's value: depths are never mixed and holes stay holes. Width and height scale each by their own factor.
pub struct Resized {
    data: Box<dyn DataSet>,
    width: usize,
    height: usize,
}

impl Resized {
    /// The scenes of `data` in `width` x `height` pixels.
    ///
    /// # Errors
    /// [`Config`](crate::Error::Config) for a size of 0.
    pub fn new(data: Box<dyn DataSet>, width: usize, height: usize) -> Result<Self> {
        if width.min(height) == 0 {
            let value = format!("{width}x{height}");
            return Err(OutOfRange::new("the size", value, "use at least 1x1 pixels").into());
        }
        Ok(Self { data, width, height })
    }
}

impl DataSet for Resized {
    fn ids(&self) -> &[String] {
        self.data.ids()
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.data.place(index)
    }

    fn load(&self, index: usize) -> Result<Sample> {
        let mut sample = self.data.load(index)?;
        let size = (self.height, self.width);
        sample.prior = sample.prior.map(|prior| prior.resized(size)).transpose()?;
        for captured in &mut sample.views {
            let view = &captured.view;
            let image = shrink(view.image.view(), size);
            let mask = nearest(view.mask.view(), size);
            let camera = view.camera.resized(self.width, self.height)?;
            captured.view = PosedView::new(image, camera, view.pose, mask, Vec::new())?;
            captured.prior = captured.prior.take().map(|prior| prior.resized(size)).transpose()?;
        }
        if sample.depth.dim() == size {
            return Ok(sample);
        }
        let image = shrink(sample.image.view(), size);
        let depth = nearest(sample.depth.view(), size);
        let camera = sample.camera.resized(self.width, self.height)?;
        Ok(Sample { image, depth, camera, ..sample })
    }
}
