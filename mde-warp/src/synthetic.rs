use crate::{PinholeCamera, Pose, PosedView, Result, ViewSampling, WarpConfig, WarpedView};
use crate::{forward_warp, sample_poses};
use mde_uncertainty::GaussianDepth;
use ndarray::{Array2, ArrayView3};

/// Coverage of the synthetic views.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct WarpReport {
    /// Number of views.
    pub views: usize,
    /// Mean share of a view's pixels that are holes: within the source image, but of a surface that it does not show. They are filled and masked.
    pub mean_hole_fraction: f64,
    /// Largest share of any view.
    pub max_hole_fraction: f64,
    /// Mean share of a view's pixels outside of the source image.
    pub mean_outside_fraction: f64,
}

impl WarpReport {
    fn add(&mut self, view: &WarpedView) {
        let mean = |old: f64, new: f64| (old * self.views as f64 + new) / (self.views + 1) as f64;
        self.mean_hole_fraction = mean(self.mean_hole_fraction, view.hole_fraction);
        self.mean_outside_fraction = mean(self.mean_outside_fraction, view.outside_fraction);
        self.max_hole_fraction = self.max_hole_fraction.max(view.hole_fraction);
        self.views += 1;
    }
}

/// The training views of a radiance field (Section III.A, Eq. 1): the photograph itself, sRGB in 0 to 1 `[height, width, 3]`, then its warps
/// by `depth` (`[height, width]`) to poses that are [sampled](sample_poses) about it.
///
/// # Errors
/// Those of [`PosedView::new`], [`sample_poses`] and [`forward_warp`].
pub fn synthesise(
    image: ArrayView3<'_, f32>,
    depth: &GaussianDepth,
    camera: &PinholeCamera,
    (sampling, config): (&ViewSampling, &WarpConfig),
    median_depth: f64,
    seed: u64,
) -> Result<(Vec<PosedView>, WarpReport)> {
    let (here, mask) = (Pose::identity(), Array2::from_elem(depth.dim(), true));
    let mut views = vec![PosedView::new(image.to_owned(), *camera, here, mask, vec![depth.clone()])?];
    let mut report = WarpReport::default();
    for pose in sample_poses(sampling, median_depth, seed)? {
        let warped = forward_warp(image, depth, camera, &here, camera, &pose, config)?;
        report.add(&warped);
        views.push(warped.view);
    }
    Ok((views, report))
}
