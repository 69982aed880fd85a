use crate::error::Result;
use crate::reports::Refinement;
use mde_prior::Certainty;
use mde_prior::resample::{Filter, nearest, resize};
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::filter::JointUpsampling;
use ndarray::{Array2, Array3, ArrayView3, Axis, Zip};
use rayon::prelude::*;

/// Standard deviation of the upsampling in colour (0 to 1).
const COLOUR: f64 = 0.1;

impl Refinement {
    /// The result for a larger version of its image: depth, sigma and its components are upsampled with the edges of the larger image,
    /// the prior is interpolated. `small` is the image that was refined, `large` the other, both `[height, width, 3]`.
    ///
    /// # Errors
    /// [`Error::Depth`](crate::Error::Depth) where `small` has another size than the depth, or `large` is empty.
    pub fn upsampled(self, small: ArrayView3<'_, f32>, large: ArrayView3<'_, f32>) -> Result<Self> {
        let (height, width, _) = large.dim();
        let channels = |image: ArrayView3<'_, f32>| -> Vec<Array2<f32>> {
            image.axis_iter(Axis(2)).map(|channel| channel.to_owned()).collect()
        };
        let (small, large) = (channels(small), channels(large));
        let upsampling = JointUpsampling::new(&small, &large, COLOUR)?;
        let mut maps = vec![self.depth.mean().to_owned(), self.depth.sigma()];
        maps.extend(self.components.iter().map(|component| component.sigma.clone()));
        let count = maps.len();
        let views: Vec<_> = maps.iter().map(|map| map.view()).collect();
        let mut upsampled = Array3::<f32>::zeros((height, count, width));
        let rows = upsampled.as_slice_mut().unwrap_or_default().par_chunks_mut((count * width).max(1));
        rows.enumerate().try_for_each(|(y, rows)| {
            let mut rows: Vec<&mut [f32]> = rows.chunks_mut(width.max(1)).collect();
            upsampling.row(&views, y, &mut rows)
        })?;
        // The values of a map where there is a depth.
        let known = |index: usize, missing: f32, value: fn(f32) -> f32| {
            let [map, depth] = [index, 0].map(|index| upsampled.index_axis(Axis(1), index));
            Zip::from(map).and(depth).map_collect(|&s, &z| if z > 0.0 { value(s) } else { missing })
        };
        let depth = known(0, 0.0, |z| z);
        let variance = known(1, f32::INFINITY, |s| s * s);
        let mut components = self.components;
        for (part, index) in components.iter_mut().zip(2..) {
            part.sigma = known(index, f32::INFINITY, |s| s);
        }
        let prior = match self.prior.iter().all(|&z| z > 0.0) {
            true => resize(self.prior.view(), (height, width), Filter::Bilinear),
            false => nearest(self.prior.view(), (height, width)),
        };
        let depth = GaussianDepth::new(depth, variance)?;
        let resized = |map: Array2<f32>| resize(map.view(), (height, width), Filter::Bilinear);
        let certainty =
            self.certainty.map(|Certainty { meaning, map }| Certainty { meaning, map: resized(map) });
        Ok(Self { depth, prior, components, certainty, ..self })
    }
}
