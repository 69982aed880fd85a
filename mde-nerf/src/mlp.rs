//! A multilayer perceptron over tiles of points, with its reverse mode by hand.

use crate::gemm::{Epilogue, padded};
use crate::scalar::Scalar;
use mde_warp::random::CounterRng;
use rand::RngExt;

/// Fully connected layers, ReLU between them, none after the last.
///
/// Layer \\(l\\): \\(Y_l = \max(0, X_l W_l + b_l)\\), one row a point; all widths padded with zeros.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mlp<T> {
    /// Padded widths, input first.
    widths: Vec<usize>,
    /// Per layer: the weights `[inputs, outputs]`, then the bias `[outputs]`.
    pub(crate) parameters: Vec<T>,
    /// The weights again, `[outputs, inputs]`, for the pass back to the inputs.
    transposed: Vec<T>,
}

/// What a pass over a tile leaves behind for the pass back: every layer's input, and the output.
#[derive(Debug, Default)]
pub(crate) struct MlpTape<T> {
    /// Row-major `[points, width]`, one a layer, input first, output last.
    pub(crate) activations: Vec<Vec<T>>,
    /// Gradients on the way back, current and next.
    upstream: [Vec<T>; 2],
}

impl<T: Scalar> Mlp<T> {
    /// `widths` counts the used columns, input first; weights are drawn uniformly with He's variance \\(2 / n_{in}\\).
    pub(crate) fn new(widths: &[usize], seed: u64, purpose: &str) -> Self {
        let mut mlp = Self {
            widths: widths.iter().map(|&w| padded(w)).collect(),
            parameters: Vec::new(),
            transposed: Vec::new(),
        };
        for (layer, used) in widths.windows(2).enumerate() {
            let mut rng = CounterRng::new(seed, purpose, layer as u64, 0);
            let last = layer + 2 == widths.len();
            // The last layer starts small: a new field is nearly uniform.
            let bound = (6.0 / used[0] as f64).sqrt() * if last { 0.1 } else { 1.0 };
            for input in 0..padded(used[0]) {
                mlp.parameters.extend((0..padded(used[1])).map(|output| {
                    let draw = bound * (2.0 * rng.random::<f64>() - 1.0);
                    if input < used[0] && output < used[1] { T::from_f64(draw) } else { T::ZERO }
                }));
            }
            mlp.parameters.extend(std::iter::repeat_n(T::ZERO, padded(used[1])));
        }
        mlp.refresh();
        mlp
    }

    /// An MLP of `widths` with the given parameters, or nothing where their number is wrong.
    pub(crate) fn from_parameters(widths: &[usize], parameters: Vec<T>) -> Option<Self> {
        let mut mlp = Self { parameters: Vec::new(), ..Self::new(widths, 0, "") };
        let expected = mlp.layers().last().map_or(0, |(range, k, m)| range + (k + 1) * m);
        mlp.parameters = parameters;
        (mlp.parameters.len() == expected).then(|| {
            mlp.refresh();
            mlp
        })
    }

    /// Per layer: where its parameters begin, and its padded input and output widths.
    fn layers(&self) -> impl DoubleEndedIterator<Item = (usize, usize, usize)> + ExactSizeIterator + use<T> {
        let mut start = 0;
        let layers: Vec<_> = self
            .widths
            .windows(2)
            .map(|w| {
                let layer = (start, w[0], w[1]);
                start += (w[0] + 1) * w[1];
                layer
            })
            .collect();
        layers.into_iter()
    }

    /// Padded width of the input.
    pub(crate) fn input_width(&self) -> usize {
        self.widths.first().copied().unwrap_or(0)
    }

    /// Padded width of the output.
    pub(crate) fn output_width(&self) -> usize {
        self.widths.last().copied().unwrap_or(0)
    }

    /// To be called after the parameters changed: brings the transposed weights up to date.
    pub(crate) fn refresh(&mut self) {
        self.transposed.clear();
        for (start, k, m) in self.layers() {
            let w = &self.parameters[start..start + k * m];
            self.transposed.extend((0..m).flat_map(|output| (0..k).map(move |input| w[input * m + output])));
        }
    }

    /// Multiply-adds of a forward pass, a point.
    pub(crate) fn multiply_adds(&self) -> usize {
        self.layers().map(|(_, k, m)| k * m).sum()
    }

    /// The outputs of `tape.activations[0]` (`[points, input]`), kept layer by layer in the tape.
    pub(crate) fn forward(&self, tape: &mut MlpTape<T>) {
        tape.activations.resize_with(self.widths.len(), Vec::new);
        let points = tape.activations[0].len() / self.input_width().max(1);
        let count = self.layers().len();
        for (layer, (start, k, m)) in self.layers().enumerate() {
            let (before, after) = tape.activations.split_at_mut(layer + 1);
            let (x, y) = (&before[layer], &mut after[0]);
            y.resize(points * m, T::ZERO);
            let (w, rest) = self.parameters[start..].split_at(k * m);
            T::matmul(x, w, y, k, m, Epilogue { bias: Some(&rest[..m]), relu: layer + 1 < count });
        }
    }

    /// The outputs of the last forward pass, `[points, output]`.
    pub(crate) fn output<'t>(&self, tape: &'t MlpTape<T>) -> &'t [T] {
        tape.activations.last().map_or(&[], Vec::as_slice)
    }

    /// From the gradient of the outputs to that of the parameters (added to `gradient`) and, where asked for, of the inputs.
    ///
    /// \\[ \frac{\partial L}{\partial W} \mathrel{+}= X^T G,\qquad \frac{\partial L}{\partial b} \mathrel{+}= 1^T G,\qquad
    ///     \frac{\partial L}{\partial X} = G W^T,\qquad G = \frac{\partial L}{\partial Y} \odot [Y > 0] \\]
    pub(crate) fn backward<'t>(
        &self,
        tape: &'t mut MlpTape<T>,
        d_output: &[T],
        gradient: &mut [T],
        want_input: bool,
    ) -> &'t [T] {
        let [current, next] = &mut tape.upstream;
        current.clear();
        current.extend_from_slice(d_output);
        let mut transposed_end = self.transposed.len();
        for (layer, (start, k, m)) in self.layers().enumerate().rev() {
            let x = &tape.activations[layer];
            let (d_weights, rest) = gradient[start..].split_at_mut(k * m);
            T::outer(x, current, d_weights, k, m);
            add_rows(current, &mut rest[..m]);
            let w = &self.transposed[transposed_end - k * m..transposed_end];
            transposed_end -= k * m;
            if layer == 0 && !want_input {
                return &[];
            }
            next.resize(x.len(), T::ZERO);
            T::matmul(current, w, next, m, k, Epilogue { bias: None, relu: false });
            if layer > 0 {
                mask(next, x);
            }
            std::mem::swap(current, next);
        }
        current
    }
}

/// Adds the rows of `[points, width]` up.
fn add_rows<T: Scalar>(rows: &[T], sum: &mut [T]) {
    T::vectorized(
        #[inline(always)]
        || {
            for row in rows.chunks_exact(sum.len()) {
                for (s, &r) in sum.iter_mut().zip(row) {
                    *s += r;
                }
            }
        },
    );
}

/// Zeroes the gradient where the activation was cut.
fn mask<T: Scalar>(gradient: &mut [T], activation: &[T]) {
    T::vectorized(
        #[inline(always)]
        || {
            for (g, &a) in gradient.iter_mut().zip(activation) {
                *g = if a > T::ZERO { *g } else { T::ZERO };
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(purpose: &str, n: usize) -> Vec<f64> {
        let mut rng = CounterRng::new(5, purpose, 0, 0);
        (0..n).map(|_| 2.0 * rng.random::<f64>() - 1.0).collect()
    }

    /// Every parameter and every input against central differences, in `f64`. The loss is a fixed linear form of the
    /// outputs; a kink of the ReLU inside the step would show as a large error, so the seed avoids one.
    #[test]
    fn gradients_agree_with_central_differences() {
        let widths = [5, 7, 20, 3];
        let mut mlp = Mlp::<f64>::new(&widths, 3, "test");
        for (p, n) in mlp.parameters.iter_mut().zip(noise("bias", 1 << 14)) {
            *p += if *p == 0.0 { 0.0 } else { 0.1 * n };
        }
        mlp.refresh();
        let points = 3;
        let input = noise("input", points * mlp.input_width());
        let form = noise("form", points * mlp.output_width());
        let loss = |mlp: &Mlp<f64>, input: &[f64]| -> f64 {
            let mut tape = MlpTape { activations: vec![input.to_vec()], ..Default::default() };
            mlp.forward(&mut tape);
            mlp.output(&tape).iter().zip(&form).map(|(y, f)| y * f).sum()
        };
        let mut tape = MlpTape { activations: vec![input.clone()], ..Default::default() };
        mlp.forward(&mut tape);
        let mut gradient = vec![0.0; mlp.parameters.len()];
        let d_input = mlp.backward(&mut tape, &form, &mut gradient, true).to_vec();

        let h = 1e-6;
        for (i, by_hand) in gradient.iter().enumerate() {
            let mut nudged = mlp.clone();
            nudged.parameters[i] += h;
            let up = loss(&nudged, &input);
            nudged.parameters[i] -= 2.0 * h;
            let slope = (up - loss(&nudged, &input)) / (2.0 * h);
            assert!((slope - by_hand).abs() < 1e-7 * (1.0 + slope.abs()), "parameter {i}: {slope} {by_hand}");
        }
        for i in 0..input.len() {
            let mut nudged = input.clone();
            nudged[i] += h;
            let up = loss(&mlp, &nudged);
            nudged[i] -= 2.0 * h;
            let slope = (up - loss(&mlp, &nudged)) / (2.0 * h);
            assert!(
                (slope - d_input[i]).abs() < 1e-7 * (1.0 + slope.abs()),
                "input {i}: {slope} {}",
                d_input[i]
            );
        }
    }

    #[test]
    fn the_fast_pass_agrees_with_the_reference() {
        let widths = [24, 64, 64, 4];
        let exact = Mlp::<f64>::new(&widths, 9, "test");
        let fast = Mlp::<f32>::new(&widths, 9, "test");
        let points = 37;
        let input = noise("input", points * exact.input_width());
        let form = noise("form", points * exact.output_width());
        let narrow = |v: &[f64]| v.iter().map(|&x| x as f32).collect::<Vec<_>>();

        let mut tape = MlpTape { activations: vec![input.clone()], ..Default::default() };
        exact.forward(&mut tape);
        let mut gradient = vec![0.0; exact.parameters.len()];
        exact.backward(&mut tape, &form, &mut gradient, false);

        let mut fast_tape = MlpTape { activations: vec![narrow(&input)], ..Default::default() };
        fast.forward(&mut fast_tape);
        let mut fast_gradient = vec![0.0; fast.parameters.len()];
        fast.backward(&mut fast_tape, &narrow(&form), &mut fast_gradient, false);

        for (f, e) in fast.output(&fast_tape).iter().zip(exact.output(&tape)) {
            assert!((f64::from(*f) - e).abs() < 1e-5);
        }
        for (f, e) in fast_gradient.iter().zip(&gradient) {
            assert!((f64::from(*f) - e).abs() < 1e-4 * (1.0 + e.abs()), "{f} {e}");
        }
    }
}
