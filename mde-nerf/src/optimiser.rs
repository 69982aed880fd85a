//! Adam, for a table without its first moment, the schedule, and the average of the parameters.

use crate::config::TrainConfig;
use crate::scalar::{Scalar, vectorized};

/// Adam's decay of the first moment.
const BETA1: f64 = 0.9;
/// Adam's decay of the second moment.
const BETA2: f64 = 0.99;
/// Adam's epsilon.
const EPSILON: f64 = 1e-15;
/// Learning rate at the last step, as a fraction of the configured one.
const FINAL_RATE: f64 = 0.1;
/// Decay per step of the moving average of the parameters.
const AVERAGE: f64 = 0.95;

/// The rate and Adam's bias corrections at one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AdamStep {
    rate: f32,
    /// \\(1 / (1 - \beta_1^t)\\) and \\(1 / (1 - \beta_2^t)\\).
    corrections: [f32; 2],
}

impl AdamStep {
    /// Step `step` (from 0) of `config.steps`: linear warm-up, then exponential decay to the final rate.
    pub(crate) fn new(config: &TrainConfig, step: usize) -> Self {
        let t = (step + 1) as f64;
        let warm = (t / (config.warm_up as f64).max(1.0)).min(1.0);
        let progress = step as f64 / (config.steps as f64 - 1.0).max(1.0);
        let rate = config.learning_rate * FINAL_RATE.powf(progress) * warm;
        let correction = |beta: f64| (1.0 / (1.0 - beta.powf(t))) as f32;
        Self { rate: rate as f32, corrections: [BETA1, BETA2].map(correction) }
    }

    /// The second moment after a squared gradient, the step per gradient by it, and whether the gradient counts.
    #[inline(always)]
    fn scaled(&self, second: f32, square: f32) -> (f32, f32, bool) {
        let second = BETA2 as f32 * second + (1.0 - BETA2) as f32 * square;
        let root = (second * self.corrections[1]).sqrt();
        (second, self.rate / (root + EPSILON as f32), square > NEGLIGIBLE * NEGLIGIBLE)
    }
}

/// Gradients below this count as zero: their squares would be denormal, which is slow.
const NEGLIGIBLE: f32 = 1e-18;

/// One Adam step (Kingma and Ba, 2015) of the parameters whose gradient is not zero, which is then cleared.
pub(crate) fn adam(
    parameters: &mut [f32],
    [first, second]: [&mut [f32]; 2],
    gradient: &mut [f32],
    step: AdamStep,
) {
    let beta1 = BETA1 as f32;
    for (((p, m), v), g) in parameters.iter_mut().zip(first).zip(second).zip(gradient) {
        let (v_new, rate, touched) = step.scaled(*v, *g * *g);
        if touched {
            *v = v_new;
            *m = beta1 * *m + (1.0 - beta1) * *g;
            *p -= rate * step.corrections[0] * *m;
        }
        *g = 0.0;
    }
}

/// Adam's step without the first moment (RMSProp; Tieleman and Hinton, 2012) of a table's rows of `width` numbers.
///
/// The numbers of a row (1, 2, 4 or 8) share their second moment, \\(v \leftarrow \beta_2 v + (1 - \beta_2) \lVert g \rVert^2 / F\\): the
/// step is equivariant to rotations of a row's features. A first moment makes depth no better, and would be nearly half of the bytes moved.
pub(crate) fn step_rows(
    table: &mut [f32],
    second: &mut [f32],
    gradient: &mut [f32],
    width: usize,
    step: AdamStep,
) {
    match width {
        1 => rows::<1>(table, second, gradient, step),
        2 => rows::<2>(table, second, gradient, step),
        4 => rows::<4>(table, second, gradient, step),
        _ => rows::<8>(table, second, gradient, step),
    }
}

fn rows<const F: usize>(table: &mut [f32], second: &mut [f32], gradient: &mut [f32], step: AdamStep) {
    vectorized!(f32, || {
        let rows = table.as_chunks_mut::<F>().0.iter_mut().zip(gradient.as_chunks_mut::<F>().0);
        for ((p, g), v) in rows.zip(second) {
            let square = g.iter().map(|g| g * g).sum::<f32>() / F as f32;
            let (v_new, rate, touched) = step.scaled(*v, square);
            let rate = if touched { rate } else { 0.0 };
            *v = if touched { v_new } else { *v };
            for (p, g) in p.iter_mut().zip(g) {
                *p -= rate * *g;
                *g = 0.0;
            }
        }
    });
}

/// An exponential moving average of the parameters.
///
/// It starts only [`Average::span`] steps before the end: the weight of earlier steps is below 1e-4.
#[derive(Debug, Default)]
pub(crate) struct Average(Vec<f32>);

impl Average {
    /// Steps after which a weight has decayed to 1e-4.
    pub(crate) fn span() -> usize {
        (1e-4_f64.ln() / AVERAGE.ln()).ceil() as usize
    }

    pub(crate) fn add(&mut self, parameters: &[f32]) {
        if self.0.is_empty() {
            self.0.extend_from_slice(parameters);
            return;
        }
        for (mean, p) in self.0.iter_mut().zip(parameters) {
            *mean += (1.0 - AVERAGE as f32) * (p - *mean);
        }
    }

    /// Replaces the parameters by the average, where there is one.
    pub(crate) fn write(&self, parameters: &mut [f32]) {
        for (p, mean) in parameters.iter_mut().zip(&self.0) {
            *p = *mean;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The updates written out as in the papers, in `f64`; rows have one second moment, and parameters a first moment as well.
    #[test]
    fn steps_follow_their_definition_and_leave_untouched_rows_alone() {
        let config = TrainConfig { steps: 10, warm_up: 0, ..TrainConfig::default() };
        const N: usize = 16;
        for (width, beta1) in [(1, BETA1), (1, 0.0), (2, 0.0), (4, 0.0), (8, 0.0)] {
            let mut fast: [f32; N] = std::array::from_fn(|i| 1.0 + i as f32);
            let (mut first, mut second) = ([0.0; N], vec![0.0; N / width]);
            let (mut exact, mut m, mut v) = (fast.map(f64::from), [0.0_f64; N], vec![0.0_f64; N / width]);
            for step in 0..5 {
                let t = step as i32 + 1;
                let rate = config.learning_rate * FINAL_RATE.powf(step as f64 / 9.0);
                // The first row is never touched.
                let drawn = |i: usize| ((i * 7 + step * 5) % 11) as f32 - 4.5;
                let mut g: [f32; N] = std::array::from_fn(|i| if i < width { 0.0 } else { drawn(i) });
                for (row, v) in v.iter_mut().enumerate().skip(1) {
                    let of_row = row * width..(row + 1) * width;
                    let square = of_row.clone().map(|i| f64::from(g[i]).powi(2)).sum::<f64>() / width as f64;
                    *v = BETA2 * *v + (1.0 - BETA2) * square;
                    let v_hat = *v / (1.0 - BETA2.powi(t));
                    for i in of_row {
                        m[i] = beta1 * m[i] + (1.0 - beta1) * f64::from(g[i]);
                        let m_hat = m[i] / (1.0 - beta1.powi(t));
                        exact[i] -= rate * m_hat / (v_hat.sqrt() + EPSILON);
                    }
                }
                let now = AdamStep::new(&config, step);
                if beta1 > 0.0 {
                    adam(&mut fast, [&mut first, &mut second], &mut g, now);
                } else {
                    step_rows(&mut fast, &mut second, &mut g, width, now);
                }
                assert!(g.iter().all(|&g| g == 0.0));
            }
            assert_eq!(fast[0], 1.0);
            for (f, e) in fast.iter().zip(exact) {
                assert!((f64::from(*f) - e).abs() < 2e-6, "{width} {beta1}: {f} {e}");
            }
        }
    }

    #[test]
    fn the_late_average_equals_the_full_one() {
        let steps = 300;
        let (mut full, mut late) = (Average::default(), Average::default());
        for step in 0..steps {
            let value = ((step * 7919) % 13) as f32;
            full.add(&[value]);
            if step + Average::span() >= steps {
                late.add(&[value]);
            }
        }
        let (mut a, mut b) = ([0.0], [0.0]);
        full.write(&mut a);
        late.write(&mut b);
        assert!((a[0] - b[0]).abs() < 13.0 * 1.1e-4, "{a:?} {b:?}");
    }
}
