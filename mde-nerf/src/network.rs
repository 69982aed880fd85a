//! The two networks: from points of the unit cube to density and colour, and back.

use crate::config::FieldConfig;
use crate::encoding::{Frequency, HashGrid, HashLayout};
use crate::mlp::{Mlp, MlpTape};
use crate::points::Points;
use crate::scalar::Scalar;
use crate::volume::Shade;

/// Raw densities are cut at ± this before the exponential.
const MAX_RAW_DENSITY: f64 = 15.0;

/// Density and colour of points: \\(\sigma = e^{y_0}\\), \\(c = 1/(1+e^{-y})\\).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Network<T> {
    pub(crate) encoding: Encoding<T>,
    /// Density, and colour too where there is no second network.
    pub(crate) density: Mlp<T>,
    pub(crate) colour: Option<Mlp<T>>,
    /// Features that the density network sees, where it is not all of them; the second network then sees them all instead
    /// of what the first makes of them.
    coarse: Option<usize>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Encoding<T> {
    Frequency(Frequency),
    Hash(HashGrid<T>),
}

/// Where the gradients of a pass go.
#[derive(Debug, Default)]
pub(crate) struct Gradients<T> {
    pub(crate) density: Vec<T>,
    pub(crate) colour: Vec<T>,
    /// Per level `[points, features]`, in the order of `points`; empty for a frequency encoding.
    pub(crate) features: Vec<Vec<T>>,
    pub(crate) points: Points<T>,
}

/// What a forward pass over a tile leaves for the pass back.
#[derive(Debug, Default)]
pub(crate) struct Tape<T> {
    /// Padded to whole blocks.
    pub(crate) points: Points<T>,
    /// One a point.
    pub(crate) shades: Vec<Shade<T>>,
    /// Gradients of `shades`, for the pass back.
    pub(crate) d_shades: Vec<Shade<T>>,
    features: Vec<T>,
    /// Those that the density network sees, where it is not all of them.
    coarse: Vec<T>,
    density: MlpTape<T>,
    colour: MlpTape<T>,
}

impl<T: Scalar> Network<T> {
    pub(crate) fn new(config: &FieldConfig, seed: u64) -> Self {
        let widths = Widths::of(config);
        let encoding = match config {
            FieldConfig::Mlp(c) => Encoding::Frequency(Frequency { frequencies: c.frequencies }),
            FieldConfig::Hash(_) => Encoding::Hash(HashGrid::new(hash_layout(config), seed)),
        };
        Self {
            encoding,
            density: Mlp::new(&widths.density, seed, "density-network"),
            colour: widths.colour.map(|w| Mlp::new(&w, seed, "colour-network")),
            coarse: coarse_features(config),
        }
    }

    /// A network of this configuration with the given parameters, or nothing where a length is wrong.
    pub(crate) fn from_parameters(
        config: &FieldConfig,
        table: Vec<T>,
        density: Vec<T>,
        colour: Vec<T>,
    ) -> Option<Self> {
        let widths = Widths::of(config);
        let encoding = match config {
            FieldConfig::Mlp(c) => Encoding::Frequency(Frequency { frequencies: c.frequencies }),
            FieldConfig::Hash(_) => {
                let layout = hash_layout(config);
                (layout.table_len() == table.len()).then_some(())?;
                Encoding::Hash(HashGrid { layout, table })
            }
        };
        let colour = match widths.colour {
            Some(widths) => Some(Mlp::from_parameters(&widths, colour)?),
            None => None,
        };
        let density = Mlp::from_parameters(&widths.density, density)?;
        Some(Self { encoding, density, colour, coarse: coarse_features(config) })
    }

    /// Gradient buffers of the right size, all zero.
    pub(crate) fn gradients(&self) -> Gradients<T> {
        Gradients {
            density: vec![T::ZERO; self.density.parameters.len()],
            colour: vec![T::ZERO; self.colour.as_ref().map_or(0, |c| c.parameters.len())],
            features: match &self.encoding {
                Encoding::Frequency(_) => Vec::new(),
                Encoding::Hash(grid) => vec![Vec::new(); grid.layout.level_count()],
            },
            points: Points::default(),
        }
    }

    /// Multiply-adds of the networks a point, forward.
    pub(crate) fn multiply_adds(&self) -> usize {
        self.density.multiply_adds() + self.colour.as_ref().map_or(0, Mlp::multiply_adds)
    }

    /// Number of parameters, padding included.
    pub(crate) fn parameter_count(&self) -> usize {
        let table = if let Encoding::Hash(grid) = &self.encoding { grid.table.len() } else { 0 };
        table + self.density.parameters.len() + self.colour.as_ref().map_or(0, |c| c.parameters.len())
    }

    /// `tape.shades` of `tape.points`.
    pub(crate) fn forward(&self, tape: &mut Tape<T>) {
        self.encode(tape);
        self.evaluate(tape);
    }

    /// The points' features.
    pub(crate) fn encode(&self, tape: &mut Tape<T>) {
        let Tape { points, features, coarse, .. } = tape;
        let stride = self.features_stride();
        // Nobody writes to the columns that pad a row: they stay zero.
        features.resize(points.len() * stride, T::ZERO);
        match &self.encoding {
            Encoding::Frequency(encoding) => encoding.forward(points, features, stride),
            Encoding::Hash(grid) => grid.forward(points, features, stride),
        }
        if let Some(count) = self.coarse {
            let width = self.density.input_width();
            coarse.resize(points.len() * width, T::ZERO);
            for (to, from) in coarse.chunks_exact_mut(width).zip(features.chunks_exact(stride)) {
                to[..count].copy_from_slice(&from[..count]);
            }
        }
    }

    /// Numbers a point in the row of its features.
    fn features_stride(&self) -> usize {
        match (&self.colour, self.coarse) {
            (Some(colour), Some(_)) => colour.input_width(),
            _ => self.density.input_width(),
        }
    }

    /// From features to shades.
    pub(crate) fn evaluate(&self, tape: &mut Tape<T>) {
        let Tape { points, shades, features, coarse, density, colour, .. } = tape;
        self.density.forward(if self.coarse.is_some() { coarse } else { features }, density);
        shades.resize(points.len(), [T::ZERO; 4]);
        let raw = density.output().chunks_exact(self.density.output_width());
        if let Some(network) = &self.colour {
            network.forward(if self.coarse.is_some() { features } else { density.output() }, colour);
            let rgb = colour.output().chunks_exact(network.output_width());
            T::vectorized(
                #[inline(always)]
                || {
                    for ((shade, d), c) in shades.iter_mut().zip(raw).zip(rgb) {
                        *shade = activate([d[0], c[0], c[1], c[2]]);
                    }
                },
            );
        } else {
            T::vectorized(
                #[inline(always)]
                || {
                    for (shade, d) in shades.iter_mut().zip(raw) {
                        *shade = activate([d[0], d[1], d[2], d[3]]);
                    }
                },
            );
        }
    }

    /// Adds the gradients of the parameters, given those of the tape's shades.
    pub(crate) fn backward(&self, tape: &mut Tape<T>, gradients: &mut Gradients<T>) {
        let Tape { points, shades, d_shades, features, coarse, density, colour } = tape;
        let width = self.density.output_width();
        let pairs = || shades.iter().zip(d_shades.iter());
        // What the colours ask of the features themselves.
        let mut d_seen: &[T] = &[];
        if let Some(network) = &self.colour {
            let rows = colour.d_output().chunks_exact_mut(network.output_width());
            for (row, (shade, d)) in rows.zip(pairs()) {
                row[..3].copy_from_slice(&d_activate(shade, d)[1..]);
            }
            let input = if self.coarse.is_some() { features.as_slice() } else { density.output() };
            let d_input = network.backward(input, colour, &mut gradients.colour, true);
            let d_raw = density.d_output();
            if self.coarse.is_some() {
                d_raw.fill(T::ZERO);
                d_seen = d_input;
            } else {
                d_raw.copy_from_slice(d_input);
            }
            for (row, (shade, d)) in d_raw.chunks_exact_mut(width).zip(pairs()) {
                row[0] += d_activate(shade, d)[0];
            }
        } else {
            for (row, (shade, d)) in density.d_output().chunks_exact_mut(width).zip(pairs()) {
                row[..4].copy_from_slice(&d_activate(shade, d));
            }
        }
        let Encoding::Hash(grid) = &self.encoding else {
            self.density.backward(features, density, &mut gradients.density, false);
            return;
        };
        let seen = if self.coarse.is_some() { coarse } else { features };
        let d_features = self.density.backward(seen, density, &mut gradients.density, true);
        let count = grid.layout.features();
        let coarse_levels = self.coarse.map_or(usize::MAX, |columns| columns / count);
        for (level, of_level) in gradients.features.iter_mut().enumerate() {
            let start = of_level.len();
            of_level.resize(start + points.len() * count, T::ZERO);
            let of_level = &mut of_level[start..];
            if level < coarse_levels {
                for (to, from) in
                    of_level.chunks_exact_mut(count).zip(columns(d_features, &self.density, level, count))
                {
                    to.copy_from_slice(from);
                }
            }
            if let (Some(colour), Some(_)) = (&self.colour, self.coarse) {
                for (to, from) in of_level.chunks_exact_mut(count).zip(columns(d_seen, colour, level, count))
                {
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += *from);
                }
            }
        }
        gradients.points.extend(points);
    }
}

/// A level's part of the rows that a network took in.
fn columns<'d, T: Scalar>(
    rows: &'d [T],
    network: &Mlp<T>,
    level: usize,
    count: usize,
) -> impl Iterator<Item = &'d [T]> {
    rows.chunks_exact(network.input_width()).map(move |row| &row[level * count..][..count])
}

/// Used widths of the networks' layers.
struct Widths {
    density: Vec<usize>,
    colour: Option<Vec<usize>>,
}

impl Widths {
    fn of(config: &FieldConfig) -> Self {
        let stack = |input, width, layers, output| {
            let mut widths = vec![input];
            widths.extend(std::iter::repeat_n(width, layers));
            widths.push(output);
            widths
        };
        match config {
            FieldConfig::Mlp(c) => {
                let input = Frequency { frequencies: c.frequencies }.width();
                Self { density: stack(input, c.width, c.layers, 4), colour: None }
            }
            FieldConfig::Hash(c) => {
                let input = c.levels * c.features;
                if c.density_levels > 0 {
                    return Self {
                        density: stack(c.density_levels * c.features, c.width, c.layers, 1),
                        colour: Some(stack(input, c.width, c.layers, 3)),
                    };
                }
                if c.geometry == 0 {
                    return Self { density: stack(input, c.width, c.layers, 4), colour: None };
                }
                // The colour network sees all of the density network's outputs, the density itself included.
                let outputs = c.geometry + 1;
                Self {
                    density: stack(input, c.width, c.layers, outputs),
                    colour: Some(stack(outputs, c.width, 1, 3)),
                }
            }
        }
    }
}

/// Features that the density network sees, where it is not all of them.
fn coarse_features(config: &FieldConfig) -> Option<usize> {
    match config {
        FieldConfig::Hash(c) if c.density_levels > 0 => Some(c.density_levels * c.features),
        _ => None,
    }
}

fn hash_layout(config: &FieldConfig) -> HashLayout {
    match config {
        FieldConfig::Hash(c) => HashLayout::new(c.levels, c.features, c.log2_rows, c.coarsest, c.finest),
        FieldConfig::Mlp(_) => HashLayout::new(0, 1, 0, 1, 1),
    }
}

#[inline(always)]
fn activate<T: Scalar>(raw: [T; 4]) -> Shade<T> {
    let limit = T::from_f64(MAX_RAW_DENSITY);
    let density = raw[0].min(limit).max(-limit).fast_exp();
    [density, raw[1].sigmoid(), raw[2].sigmoid(), raw[3].sigmoid()]
}

/// Gradient of the raw outputs. The density's passes through its cut, so that a saturated point can come back.
#[inline(always)]
fn d_activate<T: Scalar>(shade: &Shade<T>, d: &Shade<T>) -> [T; 4] {
    let colour = |i: usize| d[i] * shade[i] * (T::ONE - shade[i]);
    [d[0] * shade[0], colour(1), colour(2), colour(3)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::HashFieldConfig;

    #[test]
    fn what_only_the_fine_levels_tell_apart_moves_no_surface() {
        let config = HashFieldConfig { levels: 4, density_levels: 2, log2_rows: 8, ..Default::default() };
        let mut network = Network::<f64>::new(&FieldConfig::Hash(config), 3);
        let shades = |network: &Network<f64>| {
            let mut tape = Tape::default();
            (0..9).for_each(|i| tape.points.push([0.1 * f64::from(i), 0.4, 0.7]));
            tape.points.pad();
            network.forward(&mut tape);
            tape.shades
        };
        let nudged = |network: &mut Network<f64>, level: usize| {
            let Encoding::Hash(grid) = &mut network.encoding else { panic!("no grid") };
            let layout = grid.layout.clone();
            layout.split_levels(&mut grid.table)[level].iter_mut().for_each(|row| *row += 0.3);
        };
        let before = shades(&network);
        nudged(&mut network, 2);
        nudged(&mut network, 3);
        let fine = shades(&network);
        assert!(before.iter().zip(&fine).all(|(a, b)| a[0] == b[0] && a[1] != b[1]));
        nudged(&mut network, 1);
        assert!(fine.iter().zip(shades(&network)).all(|(a, b)| a[0] != b[0]));
    }
}
