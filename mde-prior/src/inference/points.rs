//! Outputs that hold points.

use super::graph::Output;
use ndarray::{Array2, Array3, Axis, s};

/// Pixels along an axis on which the shift is found.
const SAMPLES: usize = 48;

/// A map of points, `[height, width, 3]`.
pub(super) struct Points(Array3<f32>);

impl Points {
    /// From `[1, height, width, 3]` or `[1, 3, height, width]`.
    pub(super) fn new(output: Output) -> Result<Self, String> {
        let Output { shape, values } = output;
        let wrong = || {
            format!(
                "the output's shape is {shape:?}, not that of points; check output-name and output-channel"
            )
        };
        let (&[1, a, b, c] | &[a, b, c]) = shape.as_slice() else { return Err(wrong()) };
        let points = Array3::from_shape_vec((a, b, c), values).map_err(|_| wrong())?;
        match (a, c) {
            (_, 3) => Ok(Self(points)),
            (3, _) => Ok(Self(points.permuted_axes([1, 2, 0]))),
            _ => Err(wrong()),
        }
    }

    /// A channel, `[height, width]`.
    pub(super) fn channel(&self, index: usize) -> Result<Array2<f32>, String> {
        let Self(points) = self;
        if index >= points.dim().2 {
            return Err(format!("output-channel is {index}; give 0 to {}", points.dim().2 - 1));
        }
        Ok(points.index_axis(Axis(2), index).to_owned())
    }

    /// The shift `t` of depth for which the rays of a camera with its principal point in the middle go through the points, and the focal
    /// length `f` in pixels: with `u` the pixel's place, they minimise the sum of `|f x / (z + t) - u|^2`, `f` being closed-form (MoGe,
    /// Wang et al., 2025). A golden-section search over the logarithm of `t` less its least value. Nothing where too few points are valid.
    pub(super) fn camera(&self, mask: Option<&Array2<bool>>) -> Option<(f32, f64)> {
        let Self(points) = self;
        let (height, width, _) = points.dim();
        let steps = (height.div_ceil(SAMPLES), width.div_ceil(SAMPLES));
        let diagonal = ((height * height + width * width) as f64).sqrt();
        let mut samples = Vec::new();
        for y in (steps.0 / 2..height).step_by(steps.0) {
            for x in (steps.1 / 2..width).step_by(steps.1) {
                let point = points.slice(s![y, x, ..]);
                if mask.is_none_or(|mask| mask.get((y, x)).copied().unwrap_or(false))
                    && point.iter().all(|v| v.is_finite())
                {
                    let place = |at: usize, side: usize| (2.0 * at as f64 + 1.0 - side as f64) / diagonal;
                    let [px, py, pz] = [point[0], point[1], point[2]].map(f64::from);
                    samples.push((px, py, pz, place(x, width), place(y, height)));
                }
            }
        }
        let nearest = samples.iter().map(|s| s.2).fold(f64::INFINITY, f64::min);
        let spread = samples.iter().map(|s| s.2).fold(f64::NEG_INFINITY, f64::max) - nearest;
        if samples.len() < 16 || !(spread >= 0.0 && spread.is_finite()) {
            return None;
        }
        let rays = |log: f64| {
            let t = log.exp() - nearest;
            samples.iter().map(move |&(x, y, z, u, v)| (x / (z + t), y / (z + t), u, v))
        };
        let focal = |log: f64| {
            let (up, down) = rays(log)
                .fold((0.0, 0.0), |(up, down), (a, b, u, v)| (up + a * u + b * v, down + a * a + b * b));
            if down > 0.0 { up / down } else { 0.0 }
        };
        let cost = |log: f64| {
            let f = focal(log);
            rays(log).map(|(a, b, u, v)| (f * a - u).powi(2) + (f * b - v).powi(2)).sum::<f64>()
        };
        let size = spread.max(1e-6);
        let (mut low, mut high) = ((1e-3 * size).ln(), (1e3 * size).ln());
        // The cost has one valley where the points are a scene; a coarse search first.
        let coarse = (0..=60).map(|i| low + (high - low) * f64::from(i) / 60.0);
        let best = coarse.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(low);
        let step = (high - low) / 60.0;
        (low, high) = (best - step, best + step);
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        for _ in 0..60 {
            let (a, b) = (high - golden * (high - low), low + golden * (high - low));
            if cost(a) < cost(b) { high = b } else { low = a }
        }
        let best = 0.5 * (low + high);
        // Places are in halves of the diagonal.
        Some(((best.exp() - nearest) as f32, 0.5 * diagonal * focal(best)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Points of a camera, their depth moved: the shift brings it back.
        #[test]
        fn the_shift_of_a_scene_is_found(f in 0.6..2.5_f32, moved in -3.0..0.9_f32, seed: u8) {
            let (height, width) = (60, 80);
            let diagonal = (height as f32).hypot(width as f32);
            let depth = |y: usize, x: usize| {
                1.0 + 0.02 * y as f32 + if (20..50).contains(&x) { 0.0 } else { 1.5 } + 0.3 * (f32::from(seed) + 0.1 * x as f32).sin()
            };
            let points = Array3::from_shape_fn((height, width, 3), |(y, x, c)| {
                let z = depth(y, x);
                let u = (2.0 * x as f32 + 1.0 - width as f32) / diagonal;
                let v = (2.0 * y as f32 + 1.0 - height as f32) / diagonal;
                [u * z / f, v * z / f, z - moved][c]
            });
            let (shift, focal) = Points(points).camera(None).unwrap();
            prop_assert!((shift - moved).abs() < 0.01, "{shift} {moved}");
            // The rays' places are in halves of the diagonal.
            let pixels = f64::from(0.5 * f * diagonal);
            prop_assert!((focal / pixels - 1.0).abs() < 0.01, "{focal} {pixels}");
        }
    }

    #[test]
    fn both_orders_of_axes_are_points_and_others_are_not() {
        let output =
            |shape: &[usize]| Output { shape: shape.to_vec(), values: (0..24).map(|v| v as f32).collect() };
        let last = Points::new(output(&[1, 2, 4, 3])).unwrap();
        assert_eq!(last.channel(2).unwrap()[(0, 1)], 5.0);
        let first = Points::new(output(&[3, 2, 4])).unwrap();
        assert_eq!(first.channel(2).unwrap()[(0, 1)], 17.0);
        assert!(first.channel(3).is_err());
        assert!(Points::new(output(&[1, 24])).is_err() && Points::new(output(&[2, 3, 4])).is_err());
    }
}
