//! The networks: density and colour of points of the unit cube, and the backward pass.

use crate::config::FieldConfig;
use crate::encoding::{Frequency, HashGrid, HashLayout};
use crate::mlp::{Mlp, MlpTape};
use crate::points::Points;
use crate::scalar::Scalar;
use crate::volume::Shade;

/// Raw densities are clamped to ± this before the exponential.
const MAX_RAW_DENSITY: f64 = 15.0;

/// Density and colour of points: \\(\sigma = e^{y_0}\\), \\(c = 1/(1+e^{-y})\\).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Network<T> {
    pub(crate) encoding: Encoding<T>,
    /// Density, and colour too where there is no second network.
    pub(crate) density: Mlp<T>,
    /// The second network; its input is the output of the first.
    pub(crate) colour: Option<Mlp<T>>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Encoding<T> {
    Frequency(Frequency),
    Hash(HashGrid<T>),
}

/// Gradients of the parameters.
#[derive(Debug, Default)]
pub(crate) struct Gradients<T> {
    pub(crate) density: Vec<T>,
    pub(crate) colour: Vec<T>,
    /// Per level `[points, features]`, in the order of `points`; empty for a frequency encoding.
    pub(crate) features: Vec<Vec<T>>,
    pub(crate) points: Points<T>,
}

/// Intermediate values of a forward pass over a tile, for the backward pass.
#[derive(Debug, Default)]
pub(crate) struct Tape<T> {
    /// Padded to whole blocks.
    pub(crate) points: Points<T>,
    /// One per point.
    pub(crate) shades: Vec<Shade<T>>,
    /// Gradients of `shades`, the input of the backward pass.
    pub(crate) d_shades: Vec<Shade<T>>,
    features: Vec<T>,
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
        }
    }

    #[cfg(feature = "serde")]
    /// A network of this configuration with the given parameters, or `None` where a length is wrong.
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
        Some(Self { encoding, density, colour })
    }

    /// Zeroed gradient buffers.
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

    /// Multiply-adds of the networks per point in the forward pass.
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
        let Tape { points, features, .. } = tape;
        let stride = self.density.input_width();
        // The columns that pad a row are never written: they stay zero.
        features.resize(points.len() * stride, T::ZERO);
        match &self.encoding {
            Encoding::Frequency(encoding) => encoding.forward(points, features, stride),
            Encoding::Hash(grid) => grid.forward(points, features, stride),
        }
    }

    /// From features to shades.
    pub(crate) fn evaluate(&self, tape: &mut Tape<T>) {
        let Tape { points, shades, features, density, colour, .. } = tape;
        self.density.forward(features, density);
        shades.resize(points.len(), [T::ZERO; 4]);
        let raw = density.output().chunks_exact(self.density.output_width());
        if let Some(network) = &self.colour {
            network.forward(density.output(), colour);
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
        let Tape { points, shades, d_shades, features, density, colour } = tape;
        let width = self.density.output_width();
        let pairs = || shades.iter().zip(d_shades.iter());
        if let Some(network) = &self.colour {
            let rows = colour.d_output().chunks_exact_mut(network.output_width());
            for (row, (shade, d)) in rows.zip(pairs()) {
                row[..3].copy_from_slice(&d_activate(shade, d)[1..]);
            }
            let d_input = network.backward(density.output(), colour, &mut gradients.colour, true);
            let d_raw = density.d_output();
            d_raw.copy_from_slice(d_input);
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
        let d_features = self.density.backward(features, density, &mut gradients.density, true);
        let count = grid.layout.features();
        for (level, of_level) in gradients.features.iter_mut().enumerate() {
            let start = of_level.len();
            of_level.resize(start + points.len() * count, T::ZERO);
            let rows = d_features.chunks_exact(self.density.input_width());
            for (to, from) in of_level[start..].chunks_exact_mut(count).zip(rows) {
                to.copy_from_slice(&from[level * count..][..count]);
            }
        }
        gradients.points.extend(points);
    }
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
                if c.geometry == 0 {
                    return Self { density: stack(input, c.width, c.layers, 4), colour: None };
                }
                // The input of the colour network is all of the density network's outputs, the density included.
                let outputs = c.geometry + 1;
                Self {
                    density: stack(input, c.width, c.layers, outputs),
                    colour: Some(stack(outputs, c.width, 1, 3)),
                }
            }
        }
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

/// Gradient of the raw outputs. The density's passes through the clamp, so that a saturated point can recover.
#[inline(always)]
fn d_activate<T: Scalar>(shade: &Shade<T>, d: &Shade<T>) -> [T; 4] {
    let colour = |i: usize| d[i] * shade[i] * (T::ONE - shade[i]);
    [d[0] * shade[0], colour(1), colour(2), colour(3)]
}
