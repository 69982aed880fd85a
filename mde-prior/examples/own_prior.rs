//! A custom depth prior: the lower in the image and the brighter, the nearer; averaged with its mirror image.
#![allow(clippy::print_stdout)]

use mde_prior::augment::Predictions;
use mde_prior::ndarray::{Array2, Array3, ArrayView3};
use mde_prior::{AugmentationConfig, DepthKind, DepthPrior, DisparityRule, PriorDepth, Result};

struct GroundPlane;

impl DepthPrior for GroundPlane {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let (height, width, _) = image.dim();
        let disparity = Array2::from_shape_fn((height, width), |(y, x)| {
            y as f32 / height as f32 + 0.1 * image[[y, x, 1]]
        });
        PriorDepth::from_values(disparity, DepthKind::AffineDisparity)
    }

    /// The prior looks at the image, so it can predict crops and mirror images.
    fn accepts_new_images(&self) -> bool {
        true
    }
}

fn main() -> Result<()> {
    let image = Array3::from_shape_fn((6, 8, 3), |(y, x, _)| ((x + y) % 3) as f32 / 2.0);
    let augmentation =
        AugmentationConfig { predictions: Predictions::Most(2), ..AugmentationConfig::default() };
    let depth = augmentation.predict(&GroundPlane, image.view())?.depth(&DisparityRule::default())?;
    println!("depth in metres, assuming a room of 0.8 to 8 m:\n{depth:.2}");
    Ok(())
}
