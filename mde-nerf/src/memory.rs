//! The memory of a field and its fit.

use crate::config::{FieldConfig, NerfConfig};
use crate::encoding::{Frequency, HashLayout};
use crate::train::{GROUPS, TILE_POINTS};

/// Copies of a network's parameters: itself, its transpose, two moments, an average, a sum of gradients, two for what vectors hold in
/// reserve; and a gradient per group of rays.
const NETWORK_COPIES: f64 = (8 + GROUPS) as f64;
/// Bytes of a sample's position, kept with its gradients until the end of a step.
const POSITION: f64 = 12.0;

impl FieldConfig {
    /// Inputs, hidden layers and their width of the network.
    pub(crate) fn shape(&self) -> [usize; 3] {
        match self {
            Self::Mlp(f) => [Frequency { frequencies: f.frequencies }.width(), f.layers, f.width],
            Self::Hash(f) => [f.levels * f.features, f.layers, f.width],
        }
    }

    /// Numbers of the network, and of the table of a hash grid.
    fn numbers(&self) -> [f64; 2] {
        let [inputs, layers, width] = self.shape().map(|n| n as f64);
        let table = match self {
            Self::Mlp(_) => 0.0,
            Self::Hash(f) => HashLayout::new(f).table_len() as f64,
        };
        [inputs * width + (layers - 1.0).max(0.0) * width.powi(2) + 4.0 * width, table]
    }

    /// Bytes of the field's numbers.
    pub fn bytes(&self) -> f64 {
        4.0 * self.numbers().iter().sum::<f64>()
    }
}

impl NerfConfig {
    /// Bytes of a field and its fit, which depend on the rays of a step and not on the images.
    pub fn fit_bytes(&self) -> f64 {
        let per_ray = (self.sampling.coarse + self.sampling.band + self.sampling.fine) as f64;
        let (rays, groups) = (self.train.rays as f64, GROUPS as f64);
        let [network, table] = self.field.numbers();
        let [inputs, layers, width] = self.field.shape().map(|n| n as f64);
        let activations = 2.0 * inputs + (layers + 2.0) * width;
        // A tile is at least one ray.
        let points = per_ray.max(TILE_POINTS as f64).min((rays / groups).ceil() * per_ray);
        let of_network = 4.0 * (NETWORK_COPIES * network + groups * points * activations);
        let FieldConfig::Hash(hash) = &self.field else { return of_network };
        // The grid, its average, and one second moment a row.
        let kept = 2.0 * table + table / hash.features as f64;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let scratch = (HashLayout::new(hash).largest_level() * threads.min(hash.levels)) as f64;
        of_network + 4.0 * (kept + scratch) + rays * per_ray * (POSITION + 4.0 * inputs)
    }
}
