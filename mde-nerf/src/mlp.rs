//! A multilayer perceptron over tiles of points, with a hand-derived backward pass.

use crate::gemm::{Epilogue, Shape, padded};
use crate::scalar::{Scalar, vectorized};
use mde_uncertainty::random::CounterRng;
use rand::RngExt;

/// Fully connected layers, ReLU between them, none after the last.
///
/// Layer \\(l\\): \\(Y_l = \max(0, X_l W_l + b_l)\\), one row per point; all widths padded with zeros.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mlp<T> {
    /// Used widths, input first; every matrix is padded.
    widths: Vec<usize>,
    /// Per layer: the weights `[inputs, outputs]`, then the bias `[outputs]`.
    pub(crate) parameters: Vec<T>,
    /// Transposed weights `[outputs, inputs]`, for the gradient of the inputs.
    transposed: Vec<T>,
}

/// Intermediate values of a forward pass over a tile, for the backward pass.
#[derive(Debug, Default)]
pub(crate) struct MlpTape<T> {
    /// Every layer's output, row-major `[points, padded width]`.
    pub(crate) activations: Vec<Vec<T>>,
    /// Gradients of the current and the next layer of the backward pass.
    upstream: [Vec<T>; 2],
}

impl<T: Scalar> MlpTape<T> {
    /// The outputs of the last forward pass, `[points, padded output]`.
    pub(crate) fn output(&self) -> &[T] {
        self.activations.last().map_or(&[], Vec::as_slice)
    }

    /// A zeroed buffer for the gradient of the outputs, the input of the backward pass.
    pub(crate) fn d_output(&mut self) -> &mut [T] {
        let length = self.output().len();
        let d_output = &mut self.upstream[0];
        d_output.clear();
        d_output.resize(length, T::ZERO);
        d_output
    }
}

impl<T: Scalar> Mlp<T> {
    /// `widths` counts the used columns, input first; weights are drawn uniformly with He's variance \\(2 / n_{in}\\).
    pub(crate) fn new(widths: &[usize], seed: u64, purpose: &str) -> Self {
        let mut mlp = Self { widths: widths.to_vec(), parameters: Vec::new(), transposed: Vec::new() };
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

    fn layers(&self) -> Vec<Layer> {
        let mut start = 0;
        let layer = |w: &[usize]| {
            let layer = Layer { start, k: padded(w[0]), m: padded(w[1]), used: [w[0], w[1]] };
            start += (layer.k + 1) * layer.m;
            layer
        };
        self.widths.windows(2).map(layer).collect()
    }

    /// Padded width of the input.
    pub(crate) fn input_width(&self) -> usize {
        padded(self.widths.first().copied().unwrap_or(0))
    }

    /// Padded width of the output.
    pub(crate) fn output_width(&self) -> usize {
        padded(self.widths.last().copied().unwrap_or(0))
    }

    /// Updates the transposed weights after a change of the parameters.
    pub(crate) fn refresh(&mut self) {
        self.transposed.clear();
        for Layer { start, k, m, .. } in self.layers() {
            let w = &self.parameters[start..start + k * m];
            self.transposed.extend((0..m).flat_map(|output| (0..k).map(move |input| w[input * m + output])));
        }
    }

    /// Multiply-adds per point of a forward pass, without padding.
    #[cfg(feature = "bench")]
    pub(crate) fn multiply_adds(&self) -> usize {
        self.widths.windows(2).map(|w| w[0] * w[1]).sum()
    }

    /// The outputs for `input` (`[points, padded input]`), kept layer by layer in the tape.
    pub(crate) fn forward(&self, input: &[T], tape: &mut MlpTape<T>) {
        let points = input.len() / self.input_width().max(1);
        let count = self.widths.len().saturating_sub(1);
        tape.activations.resize_with(count, Vec::new);
        for (index, Layer { start, k, m, used }) in self.layers().into_iter().enumerate() {
            let (before, after) = tape.activations.split_at_mut(index);
            let (x, y) = (before.last().map_or(input, Vec::as_slice), &mut after[0]);
            y.resize(points * m, T::ZERO);
            let (w, rest) = self.parameters[start..].split_at(k * m);
            let shape = Shape { inputs: k, used: used[0], outputs: m };
            T::matmul(x, w, y, shape, Epilogue { bias: Some(&rest[..m]), relu: index + 1 < count });
        }
    }

    /// From the gradient of the outputs (in [`MlpTape::d_output`]) to that of the parameters (added to `gradient`) and, with
    /// `want_input`, of the inputs.
    ///
    /// \\[ \frac{\partial L}{\partial W} \mathrel{+}= X^T G,\qquad \frac{\partial L}{\partial b} \mathrel{+}= 1^T G,\qquad
    ///     \frac{\partial L}{\partial X} = G W^T,\qquad G = \frac{\partial L}{\partial Y} \odot [Y > 0] \\]
    pub(crate) fn backward<'t>(
        &self,
        input: &[T],
        tape: &'t mut MlpTape<T>,
        gradient: &mut [T],
        want_input: bool,
    ) -> &'t [T] {
        let [current, next] = &mut tape.upstream;
        let mut transposed_end = self.transposed.len();
        for (index, Layer { start, k, m, used }) in self.layers().into_iter().enumerate().rev() {
            let below = index.checked_sub(1).map(|i| tape.activations[i].as_slice());
            let x = below.unwrap_or(input);
            let (d_weights, rest) = gradient[start..].split_at_mut(k * m);
            T::outer(x, current, d_weights, Shape { inputs: k, used: used[0], outputs: m });
            add_rows(current, &mut rest[..m]);
            let w = &self.transposed[transposed_end - k * m..transposed_end];
            transposed_end -= k * m;
            if index == 0 && !want_input {
                return &[];
            }
            next.resize(x.len(), T::ZERO);
            let shape = Shape { inputs: m, used: used[1], outputs: k };
            T::matmul(current, w, next, shape, Epilogue { bias: None, relu: false });
            if let Some(activation) = below {
                mask(next, activation);
            }
            std::mem::swap(current, next);
        }
        current
    }
}

/// A layer: its parameters begin at `start` with `[k, m]` weights; `used` of its inputs and outputs are not padding.
struct Layer {
    start: usize,
    k: usize,
    m: usize,
    used: [usize; 2],
}

/// Sums the rows of `[points, width]`.
fn add_rows<T: Scalar>(rows: &[T], sum: &mut [T]) {
    vectorized!(T, || {
        for row in rows.chunks_exact(sum.len()) {
            for (s, &r) in sum.iter_mut().zip(row) {
                *s += r;
            }
        }
    });
}

/// Zeroes the gradient where the ReLU is 0.
fn mask<T: Scalar>(gradient: &mut [T], activation: &[T]) {
    vectorized!(T, || {
        for (g, &a) in gradient.iter_mut().zip(activation) {
            *g = if a > T::ZERO { *g } else { T::ZERO };
        }
    });
}
