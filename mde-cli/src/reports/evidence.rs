//! Where the depth of each pixel comes from.

use crate::error::Result;
use mde_mvs::consensus::agreement;
use mde_nerf::RenderedView;
use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::Array2;
use serde::Serialize;

/// Origin of the depth of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Origin {
    /// No depth.
    Missing,
    /// The gauged prior; no other photograph sees the point.
    Prior,
    /// The sweep fused with the prior.
    Consensus,
    /// The field.
    Field,
}

/// Where the depth of each pixel of the reference comes from, and how many photographs support it; all `[height, width]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Origin of the depth.
    pub origin: Array2<Origin>,
    /// Number of other photographs in which the pixel's point lies.
    pub seen: Array2<u8>,
    /// Number of other photographs whose own depth agrees, there and back, within a pixel and 10 % of the depth.
    pub confirmed: Array2<u8>,
}

impl Evidence {
    /// Of a depth of the reference in the prior's unit; `fused` is the consensus of each view, `factor` the unit of the poses per unit of
    /// the prior.
    pub(crate) fn new(
        views: &[PosedView],
        fused: &[&GaussianDepth],
        rendered: Option<&RenderedView>,
        depth: &GaussianDepth,
        factor: f64,
    ) -> Result<Self> {
        let unit = factor as f32;
        let own = depth.clone().map(|mean, variance| (unit * mean, unit * unit * variance));
        let mut depths = fused.to_vec();
        if let Some(first) = depths.first_mut() {
            *first = &own;
        }
        let others: Vec<usize> = (1..views.len()).collect();
        let found = agreement(views, &depths, 0, &others)?;
        let origin = Array2::from_shape_fn(depth.dim(), |(row, column)| {
            let by_field = rendered.is_some_and(|rendered| rendered.depth.get(row, column).is_some());
            match depth.get(row, column) {
                None => Origin::Missing,
                Some(_) if by_field => Origin::Field,
                Some(_) if found.visible[(row, column)] > 0 => Origin::Consensus,
                Some(_) => Origin::Prior,
            }
        });
        Ok(Self { origin, seen: found.visible, confirmed: found.agree })
    }

    /// The three maps as floats, by their names; `origin` is 0 for none, 1 for the prior, 2 for the consensus, 3 for the field.
    pub fn arrays(&self) -> [(&'static str, Array2<f32>); 3] {
        let origin = self.origin.mapv(|origin| match origin {
            Origin::Missing => 0.0,
            Origin::Prior => 1.0,
            Origin::Consensus => 2.0,
            Origin::Field => 3.0,
        });
        [
            ("origin", origin),
            ("seen", self.seen.mapv(f32::from)),
            ("confirmed", self.confirmed.mapv(f32::from)),
        ]
    }

    /// Share of the pixels with a depth that at least one other photograph confirms.
    pub fn confirmed_share(&self) -> f64 {
        let known = self.origin.iter().filter(|origin| **origin != Origin::Missing).count();
        self.confirmed.iter().filter(|count| **count > 0).count() as f64 / known.max(1) as f64
    }
}
