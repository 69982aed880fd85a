//! Depths of tracks from their matches, with the poses as they are.

use super::{Bundle, Cameras, INVERSE_DEPTH, Linear, Observed, Seen};
use crate::poses::OUTLIER_PIXELS;
use nalgebra::Point2;

/// Gauss-Newton steps of a track's depth.
const STEPS: usize = 10;

impl Bundle {
    /// The depth of every track that fits its matches best.
    pub(in crate::poses) fn triangulate(&mut self) {
        self.tracks.iter_mut().for_each(|track| self.cameras.triangulate(track));
    }

    /// How far each match is from where its track should be, at the depth that fits that best, pixels; at most what an outlier is.
    pub(in crate::poses) fn misses(mut self) -> Vec<f64> {
        self.triangulate();
        self.residuals().map(|r| r.map_or(OUTLIER_PIXELS, |r| r.norm().min(OUTLIER_PIXELS))).collect()
    }
}

impl Cameras {
    /// The inverse depth \\( w \\) at which the distances of a track from where it was found have the least sum: the best of those
    /// of its views, and Gauss-Newton steps from it that are reweighted to the sum of distances.
    pub(in crate::poses) fn triangulate(&self, track: &mut Observed) {
        let cost_at = |track: &mut Observed, inverse_depth: f64| -> f64 {
            track.inverse_depth = inverse_depth;
            let residuals = track.views.iter().map(|(v, p)| self.residual(track, *v, p));
            residuals.map(|r| r.map_or(f64::MAX.sqrt(), |r| r.norm())).sum()
        };
        let mut best = (f64::INFINITY, track.inverse_depth);
        for view in 0..track.views.len() {
            let (v, p) = track.views[view];
            let start = self.inverse_depth(track, v, &p);
            let cost = cost_at(track, start);
            if cost < best.0 {
                best = (cost, start);
            }
        }
        for _ in 0..STEPS {
            track.inverse_depth = best.1;
            let (mut slope, mut curvature) = (0.0, 0.0);
            let seen = track.views.iter().filter_map(|(v, p)| self.linear(track, *v, p));
            for Linear { residual, depth, .. } in seen {
                let weight = residual.norm().max(1e-6).recip();
                slope += weight * residual.dot(&depth);
                curvature += weight * depth.norm_squared();
            }
            let next = (best.1 - slope / curvature).max(INVERSE_DEPTH[0]);
            let cost = cost_at(track, next);
            if cost.is_nan() || cost >= best.0 {
                break;
            }
            best = (cost, next);
        }
        track.inverse_depth = best.1;
    }

    /// The inverse depth, positive, at which a track comes nearest to the ray \\( q \\) of a pixel. Its point over the depth is
    /// \\( R d + w t \\), and \\( (R d + w t) \times q = 0 \\) gives
    /// \\[ w = -\frac{(R d \times q) \cdot (t \times q)}{\lVert t \times q \rVert^2} , \\]
    /// by the angle between the rays and for any ratio of baseline to depth.
    fn inverse_depth(&self, track: &Observed, view: usize, pixel: &Point2<f64>) -> f64 {
        let Seen { rotation, translation, ray, .. } = self.seen(track, view);
        let there = self.lenses[view].ray(&self.straight(view, pixel), self.log_focal);
        let (turned, moved) = ((rotation * ray).cross(&there), translation.cross(&there));
        let found = -turned.dot(&moved) / moved.norm_squared();
        if found.is_finite() { found.clamp(INVERSE_DEPTH[0], INVERSE_DEPTH[1]) } else { INVERSE_DEPTH[0] }
    }
}
