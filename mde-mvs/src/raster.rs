use ndarray::{Array2, ArrayView3, Axis};

/// Luma of sRGB colours (Rec. 601), `[height, width]`.
pub(crate) fn luma(image: ArrayView3<'_, f32>) -> Array2<f32> {
    image.map_axis(Axis(2), |c| 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2])
}
