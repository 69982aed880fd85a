use ndarray::{Array2, ArrayViewMut1};

/// Separable Gaussian with zeros outside, cut off at four sigma.
pub(crate) fn blur(map: Array2<f64>, sigma: f64) -> Array2<f64> {
    blur_within(map, sigma, (4.0 * sigma + 0.5) as usize)
}

/// [`blur`] cut off at a radius in pixels.
pub(crate) fn blur_within(mut map: Array2<f64>, sigma: f64, radius: usize) -> Array2<f64> {
    let mut kernel: Vec<f64> = (0..=radius).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let total = kernel[0] + 2.0 * kernel[1..].iter().sum::<f64>();
    kernel.iter_mut().for_each(|k| *k /= total);
    let mut padded = Vec::new();
    for row in map.rows_mut() {
        convolve(row, &kernel, &mut padded);
    }
    // Transposed, so that both passes run along memory.
    let mut turned = map.t().as_standard_layout().into_owned();
    for row in turned.rows_mut() {
        convolve(row, &kernel, &mut padded);
    }
    turned.t().as_standard_layout().into_owned()
}

/// Convolves with a symmetric kernel, given from its middle on.
fn convolve(mut line: ArrayViewMut1<'_, f64>, kernel: &[f64], padded: &mut Vec<f64>) {
    let radius = kernel.len() - 1;
    padded.clear();
    padded.resize(line.len() + 2 * radius, 0.0);
    padded[radius..radius + line.len()].iter_mut().zip(&line).for_each(|(to, from)| *to = *from);
    for (x, out) in line.iter_mut().enumerate() {
        let window = &padded[x..x + 2 * radius + 1];
        let (left, right) = (window[..radius].iter().rev(), &window[radius + 1..]);
        let sides = left.zip(right).zip(&kernel[1..]).map(|((l, r), k)| k * (l + r));
        *out = kernel[0] * window[radius] + sides.sum::<f64>();
    }
}
