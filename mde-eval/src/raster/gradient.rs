use super::{Map, Mask, erode};
use ndarray::Array2;

/// The magnitude of the [Gradient] of a map `[height, width]`.
pub(crate) fn sobel(map: Map<'_>) -> Array2<f32> {
    Gradient::sobel(&map.mapv(f64::from)).magnitude.mapv(|g| g as f32)
}

/// The two parts of a Sobel gradient and its magnitude, each `[height, width]`.
///
/// Un-normalised (gain 8), with the border replicated:
///
/// \\[ |\nabla D| = \sqrt{(K * D)^2 + (K^\top * D)^2},\qquad
///     K = \begin{bmatrix} 1 & 0 & -1 \\\\ 2 & 0 & -2 \\\\ 1 & 0 & -1 \end{bmatrix} \\]
///
/// Divide by 8 for depth per pixel. The operator reads all eight neighbours: read it on an [eroded](super::erode) mask.
pub(crate) struct Gradient {
    /// Down the rows.
    down: Array2<f64>,
    /// Along the columns.
    right: Array2<f64>,
    pub(crate) magnitude: Array2<f64>,
}

impl Gradient {
    pub(crate) fn sobel(map: &Array2<f64>) -> Self {
        // Separable: a difference one way, 1 2 1 the other.
        let (mut down, mut right) = (Array2::zeros(map.dim()), Array2::zeros(map.dim()));
        let (height, width) = map.dim();
        for y in 0..height {
            let (above, here, below) =
                (map.row(y.saturating_sub(1)), map.row(y), map.row((y + 1).min(height - 1)));
            let (difference, sum) = (&below - &above, &above + 2.0 * &here + below);
            for x in 0..width {
                let (left, next) = (x.saturating_sub(1), (x + 1).min(width - 1));
                down[(y, x)] = difference[left] + 2.0 * difference[x] + difference[next];
                right[(y, x)] = sum[next] - sum[left];
            }
        }
        let mut magnitude = down.clone();
        magnitude.zip_mut_with(&right, |d, r| *d = (*d * *d + r * r).sqrt());
        Self { down, right, magnitude }
    }

    /// The magnitude where it is at least `low` and no smaller than on either side across the edge (interpolated between
    /// the two neighbours that the gradient passes between), 0 elsewhere: non-maximum suppression (Canny, 1986).
    ///
    /// Only within `mask`, eroded, and off the image's border.
    pub(crate) fn thin(&self, mask: Mask<'_>, low: f64) -> Array2<f64> {
        let mask = erode(mask);
        let (height, width) = self.magnitude.dim();
        let mut out = Array2::zeros((height, width));
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let here = self.magnitude[(y, x)];
                if !mask[(y, x)] || here < low || here <= 0.0 {
                    continue;
                }
                let (down, right) = (self.down[(y, x)], self.right[(y, x)]);
                // Downwards along columns of equal sign, upwards where the signs differ.
                let along = if down * right >= 0.0 { 1 } else { -1 };
                let (steep, flat) = (down.abs().max(right.abs()), down.abs().min(right.abs()));
                let straight = if down.abs() >= right.abs() { (along, 0) } else { (0, 1) };
                let weight = flat / steep;
                let side = |sign: isize| {
                    let at = |(dy, dx): (isize, isize)| {
                        self.magnitude[(y.wrapping_add_signed(sign * dy), x.wrapping_add_signed(sign * dx))]
                    };
                    weight * at((along, 1)) + (1.0 - weight) * at(straight)
                };
                if side(1) <= here && side(-1) <= here {
                    out[(y, x)] = here;
                }
            }
        }
        out
    }
}
