use super::check;
use crate::{Error, Refined, Result, Task};
use mde_mvs::consensus::reconstruct;
use mde_mvs::silent;
use mde_mvs::sweep::{Surfaces, sweep};
use mde_uncertainty::GaussianDepth;
use mde_warp::{Pose, PosedView};
use ndarray::{Array2, ArrayView2};

/// Plane sweep of the photograph against the further ones, with known poses and nothing else: no prior, no consistency over
/// photographs, no field. Depth and sigma are in the unit of the poses.
///
/// Planes are even in inverse depth ([`mde_mvs::sweep`]), from half the largest baseline to infinity: nearer surfaces have
/// disparities of several times the focal length.
pub fn plane_sweep(task: &Task<'_>) -> Result<Refined> {
    let views = photographs(task)?;
    let distance = |view: &PosedView| view.pose.inverse().translation.vector.norm();
    let baseline = views.iter().map(distance).fold(0.0, f64::max);
    let sources: Vec<usize> = (1..views.len()).collect();
    let surfaces = Surfaces::Planes { near: 0.5 * baseline, far: f64::INFINITY };
    let found = sweep(&views, 0, &sources, surfaces).map_err(|error| Error::Method(error.to_string()))?;
    Ok(refined(&found.depth))
}

/// The prior in the unit of the poses: its affine gauge in log depth, fitted to the plane sweeps of all photographs
/// ([`mde_mvs::scale::Gauge`]). All that poses give without a depth per pixel.
pub fn gauged_prior(task: &Task<'_>) -> Result<Refined> {
    let views = photographs(task)?;
    let mut priors = vec![task.prior.to_owned()];
    for view in task.views {
        priors.push(match view.prior {
            Some(prior) => prior.clone(),
            None => task.predict(view.view.image.view())?,
        });
    }
    let priors: Vec<ArrayView2<'_, f32>> = priors.iter().map(|prior| prior.view()).collect();
    let known =
        reconstruct(&views, &priors, None, &mut silent).map_err(|error| Error::Method(error.to_string()))?;
    let reference = known.views.into_iter().next().ok_or(Error::NoViews)?;
    Ok(refined(&reference.prior))
}

fn refined(depth: &GaussianDepth) -> Refined {
    let sigma = depth.sigma().mapv(|sigma| if sigma.is_finite() { sigma } else { 0.0 });
    Refined { sigma: Some(sigma), ..depth.mean().to_owned().into() }
}

/// The photograph and the further ones of a task with poses.
fn photographs(task: &Task<'_>) -> Result<Vec<PosedView>> {
    check(task)?;
    if task.views.is_empty() || task.views.iter().any(|view| !view.posed) {
        return Err(Error::NoViews);
    }
    let mask = Array2::from_elem(task.camera.dim(), true);
    let own = PosedView::new(task.image.to_owned(), *task.camera, Pose::identity(), mask, Vec::new())?;
    let mut views = vec![own];
    views.extend(task.views.iter().map(|view| view.view.clone()));
    Ok(views)
}
