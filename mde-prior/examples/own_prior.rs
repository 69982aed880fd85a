//! A depth prior of one's own: the lower in the picture and the brighter, the nearer.
#![allow(clippy::print_stdout)]

use mde_prior::ndarray::{Array2, Array3, ArrayView3};
use mde_prior::{DepthKind, DepthPrior, DisparityRule, FlipAverage, PriorDepth, Result};

struct GroundPlane;

impl DepthPrior for GroundPlane {
    fn predict(&self, image: ArrayView3<'_, f32>) -> Result<PriorDepth> {
        let (height, width, _) = image.dim();
        let disparity = Array2::from_shape_fn((height, width), |(y, x)| {
            y as f32 / height as f32 + 0.1 * image[[y, x, 1]]
        });
        PriorDepth::from_values(disparity, DepthKind::AffineDisparity)
    }
}

fn main() -> Result<()> {
    let image = Array3::from_shape_fn((6, 8, 3), |(y, x, _)| ((x + y) % 3) as f32 / 2.0);
    let prior: Box<dyn DepthPrior> = Box::new(FlipAverage(GroundPlane));
    let depth = prior.predict(image.view())?.to_depth(&DisparityRule::default())?;
    println!("depth in metres, assuming a room of 0.8 to 8 m:\n{depth:.2}");
    Ok(())
}
