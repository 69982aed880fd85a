//! Adam, its schedule, and the average of the parameters.

use crate::config::TrainConfig;
use crate::scalar::Scalar;

/// Adam's rate and bias corrections at one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AdamStep {
    rate: f32,
    beta1: f32,
    beta2: f32,
    epsilon: f32,
    /// \\(1 / (1 - \beta_2^t)\\).
    correction2: f32,
}

impl AdamStep {
    /// Step `step` (from 0) of `config.steps`: linear warm-up, then exponential decay to the final rate.
    pub(crate) fn new(config: &TrainConfig, step: usize) -> Self {
        let t = (step + 1) as f64;
        let warm = (t / (config.warm_up as f64).max(1.0)).min(1.0);
        let progress = step as f64 / (config.steps as f64 - 1.0).max(1.0);
        let rate =
            config.learning_rate * (config.final_learning_rate / config.learning_rate).powf(progress) * warm;
        Self {
            rate: (rate / (1.0 - config.beta1.powf(t))) as f32,
            beta1: config.beta1 as f32,
            beta2: config.beta2 as f32,
            epsilon: config.epsilon as f32,
            correction2: (1.0 / (1.0 - config.beta2.powf(t))) as f32,
        }
    }
}

/// Adam's moments of some parameters, with a place for their gradient.
#[derive(Debug, Default, Clone)]
pub(crate) struct Adam {
    first: Vec<f32>,
    second: Vec<f32>,
    pub(crate) gradient: Vec<f32>,
}

impl Adam {
    pub(crate) fn new(parameters: usize) -> Self {
        Self { first: vec![0.0; parameters], second: vec![0.0; parameters], gradient: vec![0.0; parameters] }
    }

    /// Mutable slices of the first and second moments and the gradient.
    pub(crate) fn parts(&mut self) -> [&mut [f32]; 3] {
        [&mut self.first, &mut self.second, &mut self.gradient]
    }
}

/// One Adam step (Kingma and Ba, 2015) of the parameters whose gradient is not zero, which is then cleared.
///
/// Skipping the others is what keeps a hash table cheap, where most rows are untouched at any step.
pub(crate) fn adam(parameters: &mut [f32], [first, second, gradient]: [&mut [f32]; 3], step: AdamStep) {
    f32::vectorized(
        #[inline(always)]
        || {
            let moments = first.iter_mut().zip(second.iter_mut());
            for ((p, (m, v)), g) in parameters.iter_mut().zip(moments).zip(gradient.iter_mut()) {
                let m_new = step.beta1 * *m + (1.0 - step.beta1) * *g;
                let v_new = step.beta2 * *v + (1.0 - step.beta2) * *g * *g;
                let p_new = *p - step.rate * m_new / ((v_new * step.correction2).sqrt() + step.epsilon);
                let touched = *g != 0.0;
                *m = if touched { m_new } else { *m };
                *v = if touched { v_new } else { *v };
                *p = if touched { p_new } else { *p };
                *g = 0.0;
            }
        },
    );
}

/// An exponential moving average of the parameters.
///
/// It forgets within some tens of steps, so it starts only [`Average::span`] steps before the end: what earlier steps
/// would add is below 1e-4.
#[derive(Debug)]
pub(crate) struct Average {
    decay: f32,
    mean: Vec<f32>,
}

impl Average {
    pub(crate) fn new(decay: f64) -> Self {
        Self { decay: decay as f32, mean: Vec::new() }
    }

    /// Steps after which a decay has forgotten all but 1e-4.
    pub(crate) fn span(decay: f64) -> usize {
        if decay > 0.0 { (1e-4_f64.ln() / decay.ln()).ceil() as usize } else { 0 }
    }

    pub(crate) fn add(&mut self, parameters: &[f32]) {
        if self.mean.is_empty() {
            self.mean.extend_from_slice(parameters);
            return;
        }
        for (mean, p) in self.mean.iter_mut().zip(parameters) {
            *mean += (1.0 - self.decay) * (p - *mean);
        }
    }

    /// Puts the average in the parameters' place, where there is one.
    pub(crate) fn write(&self, parameters: &mut [f32]) {
        for (p, mean) in parameters.iter_mut().zip(&self.mean) {
            *p = *mean;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The update written out as in the paper, in `f64`.
    #[test]
    fn adam_follows_its_definition_and_leaves_untouched_parameters_alone() {
        let config = TrainConfig { steps: 10, warm_up: 0, ..TrainConfig::default() };
        let gradients = [[0.5_f64, 0.0, -2.0], [0.25, 0.0, 1.0], [-0.1, 0.0, 3.0]];
        let mut state = Adam::new(3);
        let mut fast = [1.0_f32, 2.0, 3.0];
        let (mut exact, mut m, mut v) = ([1.0_f64, 2.0, 3.0], [0.0_f64; 3], [0.0_f64; 3]);
        for (step, gradient) in gradients.iter().enumerate() {
            let t = step as i32 + 1;
            let rate = config.learning_rate
                * (config.final_learning_rate / config.learning_rate).powf(step as f64 / 9.0);
            for i in 0..3 {
                state.gradient[i] = gradient[i] as f32;
                m[i] = config.beta1 * m[i] + (1.0 - config.beta1) * gradient[i];
                v[i] = config.beta2 * v[i] + (1.0 - config.beta2) * gradient[i].powi(2);
                let (m_hat, v_hat) =
                    (m[i] / (1.0 - config.beta1.powi(t)), v[i] / (1.0 - config.beta2.powi(t)));
                exact[i] -= rate * m_hat / (v_hat.sqrt() + config.epsilon);
            }
            adam(&mut fast, state.parts(), AdamStep::new(&config, step));
            assert!(state.gradient.iter().all(|&g| g == 0.0));
        }
        assert_eq!(fast[1], 2.0);
        for (f, e) in fast.iter().zip(exact) {
            assert!((f64::from(*f) - e).abs() < 1e-6, "{f} {e}");
        }
    }

    #[test]
    fn the_average_forgets_what_it_skips() {
        let decay = 0.95;
        let steps = 300;
        let at = |step: usize| ((step * 7919) % 13) as f32;
        let mut full = Average::new(decay);
        let mut late = Average::new(decay);
        for step in 0..steps {
            full.add(&[at(step)]);
            if step + Average::span(decay) >= steps {
                late.add(&[at(step)]);
            }
        }
        let (mut a, mut b) = ([0.0], [0.0]);
        full.write(&mut a);
        late.write(&mut b);
        assert!((a[0] - b[0]).abs() < 13.0 * 1.1e-4, "{a:?} {b:?}");
    }
}
