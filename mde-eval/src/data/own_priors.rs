use super::Sample;
use mde_prior::{DepthPrior, Error, PriorDepth, Result};
use ndarray::ArrayView3;

/// The monocular depths that a data set brings for the photographs of a scene, as a prior: it has no depth of any other image.
pub struct OwnPriors<'s>(pub &'s Sample);

impl DepthPrior for OwnPriors<'_> {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let Self(sample) = self;
        let own = (image == sample.image).then_some(sample.prior.as_ref());
        let known = || sample.views.iter().find(|one| one.view.image == image).map(|one| one.prior.as_ref());
        let unknown = || Error::Input("no depth of this image; name a model".to_owned());
        own.or_else(known).flatten().cloned().ok_or_else(unknown)
    }

    fn accepts_new_images(&self) -> bool {
        !self.0.views.is_empty() && self.0.views.iter().all(|view| view.prior.is_some())
    }
}
