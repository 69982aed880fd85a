use super::plan::side;
use ndarray::{Array1, Array2, ArrayView2, Zip, s};

/// Added to every weight, so that no pixel of a crop has weight 0.
const LEAST: f32 = 1e-6;

/// Rows, columns and sides of the n x n crops of level n: `(y, x, height, width)`.
pub(super) fn crops(
    (height, width): (usize, usize),
    n: usize,
) -> impl Iterator<Item = (usize, usize, usize, usize)> + use<> {
    let side = |whole: usize| ((side(n) * whole as f64).ceil() as usize).clamp(1, whole);
    let (tall, wide) = (side(height), side(width));
    let start = move |i: usize, whole: usize, crop: usize| {
        (i as f64 * (whole - crop) as f64 / n.saturating_sub(1).max(1) as f64).round() as usize
    };
    (0..n * n).map(move |i| (start(i / n, height, tall), start(i % n, width, wide), tall, wide))
}

/// Weighted sums of the changes by a level's crops, under a half sine over each.
pub(super) struct Changes {
    sum: Array2<f32>,
    squares: Array2<f32>,
    weight: Array2<f32>,
    squared_weight: Array2<f32>,
}

impl Changes {
    pub(super) fn new(size: (usize, usize)) -> Self {
        let [sum, squares, weight, squared_weight] = [(); 4].map(|()| Array2::zeros(size));
        Self { sum, squares, weight, squared_weight }
    }

    pub(super) fn add(&mut self, (y, x): (usize, usize), change: ArrayView2<'_, f32>) {
        let (height, width) = change.dim();
        let sine = |at: usize, side: usize| (std::f32::consts::PI * (at as f32 + 0.5) / side as f32).sin();
        let across = Array1::from_shape_fn(width, |u| sine(u, width));
        let window = s![y..y + height, x..x + width];
        let Self { sum, squares, weight, squared_weight } = self;
        let mut maps = [sum, squares, weight, squared_weight].map(|map| map.slice_mut(window));
        for (v, change) in change.outer_iter().enumerate() {
            let down = sine(v, height);
            let [sum, square, weight, squared] = maps.each_mut().map(|map| map.row_mut(v));
            Zip::from(sum).and(square).and(weight).and(squared).and(change).and(&across).for_each(
                |sum, square, weight, squared, &d, &across| {
                    let w = down * across + LEAST;
                    *sum += w * d;
                    *square += w * d * d;
                    *weight += w;
                    *squared += w * w;
                },
            );
        }
    }

    /// Mean and unbiased variance per pixel, zero where there is no crop, and the sum of the variances about the mean.
    pub(super) fn mean_and_variance(self) -> (Array2<f32>, Array2<f32>, f64) {
        let (Self { mut sum, mut squares, weight, squared_weight }, mut all) = (self, 0.0);
        let pixels = Zip::from(&mut sum).and(&mut squares).and(&weight).and(&squared_weight);
        pixels.for_each(|sum, square, &weight, &squared| {
            let scale = if weight > 0.0 { 1.0 / weight } else { 0.0 };
            *sum *= scale;
            let variance = (*square * scale - *sum * *sum).max(0.0);
            all += f64::from(variance);
            // Bessel's correction with Kish's number of crops; one alone has no variance.
            let crops = (weight * weight / squared).max(1.1);
            *square = variance * crops / (crops - 1.0);
        });
        (sum, squares, all)
    }
}
