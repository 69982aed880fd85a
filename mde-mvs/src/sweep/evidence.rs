//! Where the depth of each pixel comes from.

use super::consensus::agreement;
use crate::Result;
use crate::statistics::is_flat;
use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{Array1, Array2, ArrayView2};

/// Logarithm of the factor on sigma: constant, and per chance that a photograph confirms the depth.
const CONFIRMED: [f32; 2] = [1.39, -2.05];

/// Where the depth of each pixel of the reference comes from, and how many photographs support it; all `[height, width]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Origin of the depth: 0 where there is none, 1 the gauged prior where no other photograph sees the point, 2 the sweep fused with the
    /// prior, 3 the field.
    pub origin: Array2<f32>,
    /// Number of other photographs in which the pixel's point lies.
    pub seen: Array2<f32>,
    /// Number of other photographs whose own depth agrees, there and back, within a pixel and 10 % of the depth.
    pub confirmed: Array2<f32>,
}

impl Evidence {
    /// Of a depth of the first view in a unit of which that of the poses is `factor` times; `fused` is the consensus of each view, `field`
    /// the depth of a field in the first.
    ///
    /// # Errors
    /// As [`agreement`].
    pub fn new(
        views: &[PosedView],
        fused: &[&GaussianDepth],
        field: Option<&GaussianDepth>,
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
            let by_field = field.is_some_and(|field| field.get(row, column).is_some());
            match depth.get(row, column) {
                None => 0.0,
                Some(_) if by_field => 3.0,
                Some(_) if found.visible[(row, column)] > 0 => 2.0,
                Some(_) => 1.0,
            }
        });
        Ok(Self { origin, seen: found.visible.mapv(f32::from), confirmed: found.agree.mapv(f32::from) })
    }

    /// The three maps by their names.
    pub fn arrays(&self) -> [(&'static str, ArrayView2<'_, f32>); 3] {
        [("origin", self.origin.view()), ("seen", self.seen.view()), ("confirmed", self.confirmed.view())]
    }

    /// Factor on sigma of each pixel of that `depth`: \\( e^{1.39 - 2.05 p} \\) with \\( p = (c + 1) / (n + 2) \\), Laplace's estimate of the
    /// chance that a further photograph confirms the depth when `c` of the `n` that see the point do. The coefficients give intervals the
    /// same coverage at every share of such photographs; they are fitted to ten procedural rooms.
    ///
    /// Where the `prior` is the same depth everywhere, nothing is known of a pixel that no photograph confirms but the depths of the others:
    /// the variance of their logarithms is added to its relative variance.
    pub fn sigma_factor(&self, depth: &GaussianDepth, prior: ArrayView2<'_, f32>) -> Array2<f32> {
        let [constant, slope] = CONFIRMED;
        let others = depth.mean().into_iter().zip(&self.confirmed).filter(|(z, c)| **z > 0.0 && **c > 0.0);
        let logs: Array1<f64> = others.map(|(z, _)| f64::from(z.ln())).collect();
        let flat = is_flat(prior.iter().filter(|z| **z > 0.0).map(|z| f64::from(z.ln())));
        let spread = if flat && !logs.is_empty() { logs.var(0.0) as f32 } else { 0.0 };
        Array2::from_shape_fn(depth.dim(), |at| {
            let (confirmed, seen) = (self.confirmed[at], self.seen[at]);
            let factor = (constant + slope * (confirmed + 1.0) / (seen + 2.0)).exp();
            match depth.get(at.0, at.1) {
                Some((z, variance)) if confirmed == 0.0 => {
                    (factor * factor + spread * z * z / variance).sqrt()
                }
                _ => factor,
            }
        })
    }

    /// Share of the pixels with a depth that at least one other photograph confirms.
    pub fn confirmed_share(&self) -> f64 {
        let known = self.origin.iter().filter(|origin| **origin > 0.0).count();
        self.confirmed.iter().filter(|count| **count > 0.0).count() as f64 / known.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// Six of six, one of one, none seen, none of one, none of six; without a prior's shape the last three may have any depth of the others.
    #[test]
    fn sigma_falls_with_the_photographs_that_confirm() {
        let (confirmed, seen) = (array![[6.0, 1.0, 0.0, 0.0, 0.0]], array![[6.0, 1.0, 0.0, 1.0, 6.0]]);
        let evidence = Evidence { origin: Array2::from_elem((1, 5), 2.0), seen, confirmed };
        let depth = array![[1.0, 4.0, 3.0, 3.0, 3.0]];
        let depth = GaussianDepth::new(depth.clone(), depth.mapv(|z: f32| (0.1 * z).powi(2))).unwrap();
        let [shaped, flat] = [array![[1.0, 1.0, 2.0, 2.0, 2.0]], array![[2.0; 5]]]
            .map(|prior: Array2<f32>| evidence.sigma_factor(&depth, prior.view()));
        assert!(shaped.iter().zip(shaped.iter().skip(1)).all(|(a, b)| a < b), "{shaped}");
        for (at, chance) in [7.0 / 8.0, 2.0 / 3.0, 0.5, 1.0 / 3.0, 1.0 / 8.0].into_iter().enumerate() {
            let (shaped, flat) = (shaped[(0, at)], flat[(0, at)]);
            assert!((shaped.ln() - (1.39 - 2.05 * chance)).abs() < 1e-6, "{shaped}");
            // Half of the logarithm of 4 over the relative sigma.
            let added = if at < 2 { 0.0 } else { 2.0_f32.ln() / 0.1 };
            assert!((flat / shaped.hypot(added) - 1.0).abs() < 1e-5, "{at}: {flat}");
        }
    }
}
