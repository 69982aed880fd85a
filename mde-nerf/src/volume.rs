//! Volume rendering of one ray and its reverse mode.
//!
//! All rendered quantities are sums over the ray's bins with the termination weights: colour
//! \\(C = \sum_i w_i c_i + T_{M+1} b\\) before a background \\(b\\), opacity \\(A = \sum_i w_i\\), and the depth moments of
//! Eq. 4-5. One number per bin, \\(h_i = \partial L / \partial w_i\\), therefore carries every loss, and
//!
//! \\[ \frac{\partial L}{\partial \sigma_j} = \Delta_j \Bigl( T_{j+1} h_j - \sum_{k>j} w_k h_k \Bigr),\qquad
//!     \frac{\partial L}{\partial c_j} = w_j \frac{\partial L}{\partial C}. \\]

use crate::scalar::Scalar;
use mde_uncertainty::termination::{InBinVariance, Moments, moments};

/// A ray's bins, front to back: representative depth z, its extent in z, and the path length through it.
#[derive(Debug, Default, Clone)]
pub(crate) struct Bins<T> {
    pub(crate) depth: Vec<T>,
    pub(crate) extent: Vec<T>,
    pub(crate) path: Vec<T>,
    /// Of the representative depth, scaled to 0 at far and 1 at near.
    pub(crate) disparity: Vec<T>,
}

impl<T> Bins<T> {
    pub(crate) fn clear(&mut self) {
        for part in [&mut self.depth, &mut self.extent, &mut self.path, &mut self.disparity] {
            part.clear();
        }
    }
}

/// Transmittances and gradients below this are set to 0.
const NEGLIGIBLE: f64 = 1e-18;

/// A point's density and colour.
pub(crate) type Shade<T> = [T; 4];

/// A rendered ray; the weights are kept for the backward pass.
#[derive(Debug, Default, Clone)]
pub(crate) struct Rendered<T> {
    pub(crate) weights: Vec<T>,
    /// \\(T_{i+1}\\): the transmittance behind each bin.
    behind: Vec<T>,
    pub(crate) colour: [T; 3],
    pub(crate) depth: Moments<T>,
}

impl<T: Scalar> Rendered<T> {
    /// Renders `shades` (one per bin, front to back) over `background`.
    #[inline(always)]
    pub(crate) fn composite(
        &mut self,
        bins: &Bins<T>,
        shades: &[Shade<T>],
        background: [T; 3],
        in_bin: InBinVariance,
    ) {
        let Self { weights, behind, .. } = self;
        // First the transmittance of each bin, vectorised; then the running product.
        behind.clear();
        behind.extend(shades.iter().zip(&bins.path).map(|(shade, &path)| (-(shade[0] * path)).fast_exp()));
        weights.clear();
        let mut transmittance = T::ONE;
        let mut colour = [T::ZERO; 3];
        for (keep, shade) in behind.iter_mut().zip(shades) {
            let weight = transmittance * (T::ONE - *keep);
            transmittance = flush(transmittance * *keep);
            *keep = transmittance;
            for (c, &s) in colour.iter_mut().zip(&shade[1..]) {
                *c += weight * s;
            }
            weights.push(weight);
        }
        for (c, b) in colour.iter_mut().zip(background) {
            *c += transmittance * b;
        }
        self.colour = colour;
        self.depth = moments(&self.weights, &bins.depth, &bins.extent, in_bin);
    }

    /// Gradients of the shades, one per bin, from the gradient of the colour and, in `h`, those of the weights other than
    /// through the colour. `h` is overwritten.
    #[inline(always)]
    pub(crate) fn backward(
        &self,
        bins: &Bins<T>,
        shades: &[Shade<T>],
        background: [T; 3],
        d_colour: [T; 3],
        h: &mut [T],
        mut emit: impl FnMut(usize, Shade<T>),
    ) {
        for (h, shade) in h.iter_mut().zip(shades) {
            for axis in 0..3 {
                *h += d_colour[axis] * (shade[axis + 1] - background[axis]);
            }
        }
        let mut suffix = T::ZERO;
        for j in (0..self.weights.len()).rev() {
            let weight = self.weights[j];
            let d_density = bins.path[j] * (self.behind[j] * h[j] - suffix);
            suffix += weight * h[j];
            let [red, green, blue] = d_colour.map(|d| flush(weight * d));
            emit(j, [flush(d_density), red, green, blue]);
        }
    }
}

/// Flushes small numbers to zero: their products would be denormal, which is slow.
#[inline(always)]
fn flush<T: Scalar>(x: T) -> T {
    if x.abs() < T::from_f64(NEGLIGIBLE) { T::ZERO } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_uncertainty::proptest::ray;
    use mde_uncertainty::termination;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weights_are_those_of_equation_three((density, depth, extent) in ray()) {
            let shades: Vec<_> = density.iter().map(|s| [*s, 0.2, 0.5, 0.8]).collect();
            let bins = Bins { depth, path: extent.iter().map(|d| 1.1 * d).collect(), extent, ..Bins::default() };
            let mut out = Rendered::default();
            out.composite(&bins, &shades, [0.5; 3], InBinVariance::Midpoint);
            let mut weights = vec![0.0; density.len()];
            let escaped = termination::weights(&density, &bins.path, &mut weights);
            prop_assert!((out.behind[density.len() - 1] - escaped).abs() < 1e-12);
            for (a, b) in out.weights.iter().zip(&weights) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
    }
}
