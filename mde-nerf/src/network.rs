//! The network: density and colour of points of the unit cube, and the backward pass.

use crate::config::FieldConfig;
use crate::encoding::{Frequency, HashGrid, HashLayout};
use crate::mlp::{Mlp, MlpTape};
use crate::points::{BLOCK, Points};
use crate::scalar::{Scalar, vectorized};
use crate::volume::Shade;

/// Raw densities are clamped to ± this before the exponential.
const MAX_RAW_DENSITY: f64 = 15.0;

/// Density and colour of points: \\(\sigma = e^{y_0}\\), \\(c = 1/(1+e^{-y})\\).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Network<T> {
    pub(crate) encoding: Encoding<T>,
    pub(crate) mlp: Mlp<T>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Encoding<T> {
    Frequency(Frequency),
    Hash(HashGrid<T>),
}

/// Gradients of the parameters.
#[derive(Debug, Default)]
pub(crate) struct Gradients<T> {
    /// Points with less gradient than this share of their tile's mean are sampled; 0: none, exact.
    pub(crate) floor: f64,
    pub(crate) mlp: Vec<T>,
    /// Per level `[points, features]`, in the order of `points`; empty for a frequency encoding.
    pub(crate) features: Vec<Vec<T>>,
    pub(crate) points: Points<T>,
}

impl<T: Scalar> Gradients<T> {
    /// Forgets what was gathered of the table; the network's gradient stays.
    pub(crate) fn clear(&mut self) {
        self.features.iter_mut().for_each(Vec::clear);
        self.points.clear();
    }
}

/// Intermediate values of a forward pass over a tile, for the backward pass.
#[derive(Debug, Default)]
pub(crate) struct Tape<T> {
    /// Padded to whole blocks.
    pub(crate) points: Points<T>,
    /// One per point.
    pub(crate) shades: Vec<Shade<T>>,
    /// Gradients of `shades`, the input of the backward pass, which makes them those of the raw outputs.
    pub(crate) d_shades: Vec<Shade<T>>,
    features: Vec<T>,
    mlp: MlpTape<T>,
}

impl<T: Scalar> Tape<T> {
    /// Samples the points for the backward pass: one whose gradient is below `floor` times the tile's mean stays with the probability
    /// that is its share of that bound, and with the bound's gradient (systematic sampling).
    fn sample(&mut self, floor: f64) {
        let Self { points, d_shades, features, mlp, .. } = self;
        let sizes: Vec<T> = d_shades.iter().map(size).collect();
        let least = T::from_f64(floor) * sizes.iter().copied().sum::<T>() / T::from_index(sizes.len() as u32);
        let mut due = T::from_f64(0.5);
        let mut kept = Vec::new();
        for (point, (d, &size)) in d_shades.iter_mut().zip(&sizes).enumerate() {
            let share = (size / least).min(T::ONE);
            due += share;
            if due >= T::ONE {
                due = due - T::ONE;
                *d = d.map(|d| d / share);
                kept.push(point);
            }
        }
        let (count, padded) = (sizes.len(), kept.len().next_multiple_of(BLOCK));
        for rows in mlp.activations.iter_mut().chain([features]).chain(&mut points.axes) {
            keep_rows(rows, count, &kept, padded);
        }
        keep_rows(d_shades, count, &kept, padded);
        d_shades[kept.len()..].fill([T::ZERO; 4]);
    }
}

/// Moves the rows of the points `kept` to the front, of `count` points', and drops those from `padded` on.
fn keep_rows<T: Copy>(rows: &mut Vec<T>, count: usize, kept: &[usize], padded: usize) {
    let width = rows.len() / count.max(1);
    for (to, from) in kept.iter().enumerate() {
        rows.copy_within(from * width..(from + 1) * width, to * width);
    }
    rows.truncate(padded * width);
}

/// The largest of a point's gradients.
fn size<T: Scalar>(d: &Shade<T>) -> T {
    d.iter().fold(T::ZERO, |most, &x| most.max(x).max(-x))
}

impl<T: Scalar> Network<T> {
    pub(crate) fn new(config: &FieldConfig, seed: u64) -> Self {
        let encoding = match config {
            FieldConfig::Mlp(c) => Encoding::Frequency(Frequency { frequencies: c.frequencies }),
            FieldConfig::Hash(c) => Encoding::Hash(HashGrid::new(HashLayout::new(c), seed)),
        };
        Self { encoding, mlp: Mlp::new(&widths(config), seed, "density-network") }
    }

    /// A network of this configuration with the given parameters, or `None` where a length is wrong.
    pub(crate) fn from_parameters(config: &FieldConfig, table: Vec<T>, mlp: Vec<T>) -> Option<Self> {
        let encoding = match config {
            FieldConfig::Mlp(c) => Encoding::Frequency(Frequency { frequencies: c.frequencies }),
            FieldConfig::Hash(c) => {
                let layout = HashLayout::new(c);
                (layout.table_len() == table.len()).then_some(Encoding::Hash(HashGrid { layout, table }))?
            }
        };
        let mut network = Self { encoding, mlp: Mlp::new(&widths(config), 0, "") };
        (network.mlp.parameters.len() == mlp.len()).then_some(())?;
        network.mlp.parameters = mlp;
        network.mlp.refresh();
        Some(network)
    }

    /// The hash grid, where the encoding is one.
    pub(crate) fn grid(&self) -> Option<&HashGrid<T>> {
        match &self.encoding {
            Encoding::Hash(grid) => Some(grid),
            Encoding::Frequency(_) => None,
        }
    }

    /// Zeroed gradient buffers.
    pub(crate) fn gradients(&self) -> Gradients<T> {
        Gradients {
            floor: 0.0,
            mlp: vec![T::ZERO; self.mlp.parameters.len()],
            features: vec![Vec::new(); self.grid().map_or(0, |grid| grid.layout.level_count())],
            points: Points::default(),
        }
    }

    /// `tape.shades` of `tape.points`.
    pub(crate) fn forward(&self, tape: &mut Tape<T>) {
        self.encode(tape);
        self.evaluate(tape);
    }

    /// The points' features.
    pub(crate) fn encode(&self, tape: &mut Tape<T>) {
        let Tape { points, features, .. } = tape;
        let stride = self.mlp.input_width();
        // The columns that pad a row are never written: they stay zero.
        features.resize(points.len() * stride, T::ZERO);
        match &self.encoding {
            Encoding::Frequency(encoding) => encoding.forward(points, features, stride),
            Encoding::Hash(grid) => grid.forward(points, features, stride),
        }
    }

    /// From features to shades.
    pub(crate) fn evaluate(&self, tape: &mut Tape<T>) {
        let Tape { points, shades, features, mlp, .. } = tape;
        self.mlp.forward(features, mlp);
        shades.resize(points.len(), [T::ZERO; 4]);
        let raw = mlp.output().chunks_exact(self.mlp.output_width());
        vectorized!(T, || {
            for (shade, d) in shades.iter_mut().zip(raw) {
                *shade = activate([d[0], d[1], d[2], d[3]]);
            }
        });
    }

    /// Adds the gradients of the parameters, given those of the tape's shades.
    pub(crate) fn backward(&self, tape: &mut Tape<T>, gradients: &mut Gradients<T>) {
        for (d, shade) in tape.d_shades.iter_mut().zip(&tape.shades) {
            *d = d_activate(shade, d);
        }
        if gradients.floor > 0.0 {
            tape.sample(gradients.floor);
        }
        let Tape { points, d_shades, features, mlp, .. } = tape;
        let width = self.mlp.output_width();
        for (row, d) in mlp.d_output().chunks_exact_mut(width).zip(&*d_shades) {
            row[..4].copy_from_slice(d);
        }
        let grid = self.grid();
        let d_features = self.mlp.backward(features, mlp, &mut gradients.mlp, grid.is_some());
        let Some(grid) = grid else { return };
        let count = grid.layout.features;
        for (level, of_level) in gradients.features.iter_mut().enumerate() {
            let start = of_level.len();
            of_level.resize(start + points.len() * count, T::ZERO);
            let rows = d_features.chunks_exact(self.mlp.input_width());
            for (to, from) in of_level[start..].chunks_exact_mut(count).zip(rows) {
                to.copy_from_slice(&from[level * count..][..count]);
            }
        }
        gradients.points.extend(points);
    }
}

/// Widths of the network's layers.
fn widths(config: &FieldConfig) -> Vec<usize> {
    let [input, layers, width] = config.shape();
    [vec![input], vec![width; layers], vec![4]].concat()
}

#[inline(always)]
fn activate<T: Scalar>(raw: [T; 4]) -> Shade<T> {
    let limit = T::from_f64(MAX_RAW_DENSITY);
    let density = raw[0].min(limit).max(-limit).fast_exp();
    [density, raw[1].sigmoid(), raw[2].sigmoid(), raw[3].sigmoid()]
}

/// Gradient of the raw outputs. The density's passes through the clamp, so that a saturated point can recover.
#[inline(always)]
fn d_activate<T: Scalar>(shade: &Shade<T>, d: &Shade<T>) -> [T; 4] {
    let colour = |i: usize| d[i] * shade[i] * (T::ONE - shade[i]);
    [d[0] * shade[0], colour(1), colour(2), colour(3)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Few points with much gradient each remain; its sum changes by less than the bound.
        #[test]
        fn sampled_gradients_add_up(powers in prop::collection::vec(0.0..6.0_f64, BLOCK * 8), floor in 0.1..2.0_f64) {
            let mut tape = Tape::<f64>::default();
            powers.iter().for_each(|&x| tape.points.push([x; 3]));
            tape.d_shades.extend(powers.iter().map(|x| [0.0, -10.0_f64.powf(-x), 0.0, 0.0]));
            tape.features.extend(powers.iter().flat_map(|&x| [x, -x]));
            let sum = |tape: &Tape<f64>| tape.d_shades.iter().map(size).sum::<f64>();
            let all = sum(&tape);
            let least = floor * all / powers.len() as f64;
            tape.sample(floor);
            prop_assert!((sum(&tape) - all).abs() < least * (1.0 + 1e-9));
            let points: Vec<f64> = tape.points.blocks().flat_map(|block| *block[0]).collect();
            prop_assert_eq!(points.len(), tape.d_shades.len());
            for ((d, features), &x) in tape.d_shades.iter().zip(tape.features.chunks(2)).zip(&points) {
                let expected = 10.0_f64.powf(-x).max(least);
                prop_assert!(size(d) == 0.0 || (size(d) / expected - 1.0).abs() < 1e-9);
                prop_assert_eq!(features, [x, -x]);
            }
        }
    }
}
