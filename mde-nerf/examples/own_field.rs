//! Another implementation of `RadianceField`: the depth of the first view as a grey surface, rendered by reprojection. `cargo run --release -p mde-nerf --example own_field`.
#![allow(clippy::print_stdout)]

use mde_nerf::{Error, FieldCallback, FitReport, RadianceField, RenderedView, Result, silent};
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView, ReprojectConfig, reproject};
use ndarray::{Array2, Array3};

#[derive(Default)]
struct Surface {
    view: Option<PosedView>,
}

impl RadianceField for Surface {
    fn fit(&mut self, views: &[PosedView], _: &mut FieldCallback<'_>) -> Result<FitReport> {
        self.view = Some(views.first().ok_or(Error::NoPixels)?.clone());
        Ok(FitReport::default())
    }

    fn render(&self, camera: &PinholeCamera, pose: &Pose, _: &mut FieldCallback<'_>) -> Result<RenderedView> {
        let view = self.view.as_ref().ok_or(Error::NotFitted)?;
        let depth = view.hypotheses.first().ok_or(Error::NoRange)?;
        let depth = reproject(depth, &view.camera, &view.pose, camera, pose, &ReprojectConfig::default())
            .map_err(|error| Error::External(error.into()))?;
        let opacity = depth.support().mapv(|known| f32::from(u8::from(known)));
        let image = Array3::from_elem((camera.height, camera.width, 3), 0.5);
        Ok(RenderedView { image, depth, opacity, in_bin: None })
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let camera = PinholeCamera::from_fov(60.0, 64, 48)?;
    let slant = Array2::from_shape_fn((48, 64), |(_, x)| 1.0 + 0.02 * x as f32);
    let depth = GaussianDepth::new(slant, Array2::zeros((48, 64)))?;
    let (image, mask) = (Array3::zeros((48, 64, 3)), Array2::from_elem((48, 64), true));
    let view = PosedView::new(image, camera, Pose::identity(), mask, vec![depth])?;
    let mut field: Box<dyn RadianceField> = Box::new(Surface::default());
    field.fit(&[view], &mut silent)?;
    let rendered = field.render(&camera, &Pose::translation(0.1, 0.0, 0.0), &mut silent)?;
    let covered = 100.0 * rendered.opacity.mean().unwrap_or(0.0);
    println!("{covered:.1} % of the pixels are covered from 0.1 to the side");
    Ok(())
}
