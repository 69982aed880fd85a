//! The nearest surface at every target pixel.

use crate::mesh::{Mesh, Patch};
use mde_uncertainty::GaussianDepth;
use ndarray::Array2;

/// The surface sample at a target pixel: its position in the source image and its inverse depth in the target.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Hit {
    /// 1 / z in the target; 0 where no surface covers the pixel.
    pub(crate) inverse_depth: f64,
    /// Source column.
    pub(crate) u: f64,
    /// Source row.
    pub(crate) v: f64,
    pub(crate) patch: Patch,
}

impl Hit {
    pub(crate) fn is_empty(&self) -> bool {
        self.inverse_depth <= 0.0
    }

    /// Whether this hides `other`. Where a surface meets its own continuation the surface wins, whatever the rounding.
    fn hides(&self, other: &Self) -> bool {
        let nearness = |hit: &Self| hit.inverse_depth * if hit.patch.is_joined() { 1.0 + 1e-9 } else { 1.0 };
        nearness(self) > nearness(other)
    }

    /// z in the target.
    pub(crate) fn depth(&self) -> f64 {
        self.inverse_depth.recip()
    }

    /// Variance of the source's z-depth here, interpolated between the pixels of the surface.
    pub(crate) fn source_variance(&self, source: &GaussianDepth) -> f64 {
        let variance = source.variance();
        let at = |pixel| variance.get(pixel).map_or(f64::INFINITY, |&v| f64::from(v));
        self.patch.pixels(self.u, self.v).map(|(pixel, weight)| weight * at(pixel)).sum()
    }
}

/// The nearest sample of the surface at every target pixel, `[height, width]`.
pub(crate) fn front(mesh: &Mesh) -> Array2<Hit> {
    let mut hits = Array2::from_elem(mesh.transfer.dim(), Hit::default());
    mesh.rasterise(|pixel, new| {
        if let Some(hit) = hits.get_mut(pixel)
            && new.hides(hit)
        {
            *hit = new;
        }
    });
    hits
}
