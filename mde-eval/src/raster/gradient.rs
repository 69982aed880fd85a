use crate::raster::Map;
use ndarray::Array2;

/// Sobel gradient magnitude of a map `[height, width]`, un-normalised (gain 8), with the border replicated:
///
/// \\[ |\nabla D| = \sqrt{(K * D)^2 + (K^\top * D)^2},\qquad
///     K = \begin{bmatrix} 1 & 0 & -1 \\\\ 2 & 0 & -2 \\\\ 1 & 0 & -1 \end{bmatrix} \\]
///
/// Divide by 8 for depth per pixel. The operator reads all eight neighbours: read it on an [eroded](super::erode) mask.
pub(crate) fn sobel(map: Map<'_>) -> Array2<f32> {
    let (height, width) = map.dim();
    let mut out = Array2::zeros((height, width));
    for y in 0..height {
        for x in 0..width {
            let at = |dy: isize, dx: isize| {
                let row = (y as isize + dy).clamp(0, height as isize - 1) as usize;
                f64::from(map[(row, (x as isize + dx).clamp(0, width as isize - 1) as usize)])
            };
            let horizontal = (at(-1, -1) - at(-1, 1)) + 2.0 * (at(0, -1) - at(0, 1)) + (at(1, -1) - at(1, 1));
            let vertical = (at(-1, -1) - at(1, -1)) + 2.0 * (at(-1, 0) - at(1, 0)) + (at(-1, 1) - at(1, 1));
            out[(y, x)] = (horizontal * horizontal + vertical * vertical).sqrt() as f32;
        }
    }
    out
}
