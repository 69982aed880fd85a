//! The memory of a field and its fit.

use crate::config::{FieldConfig, NerfConfig};
use crate::encoding::HashLayout;
use crate::train::{GROUPS, TILE_POINTS};

/// Copies of a network's parameters: itself, its transpose, two moments, an average, a sum of gradients, two for what vectors hold in
/// reserve; and a gradient per group of rays.
const NETWORK_COPIES: f64 = (8 + GROUPS) as f64;
/// Bytes of a sample's position, kept with its gradients until the end of a step.
const POSITION: f64 = 12.0;

impl FieldConfig {
    /// Numbers of the network, and of the table of a hash grid.
    fn numbers(&self) -> [f64; 2] {
        let network = |inputs: usize, layers: usize, width: usize| {
            let width = width as f64;
            inputs as f64 * width + layers.saturating_sub(1) as f64 * width.powi(2) + 4.0 * width
        };
        match self {
            Self::Mlp(f) => [network(3 + 6 * f.frequencies, f.layers, f.width), 0.0],
            Self::Hash(f) => {
                let table = HashLayout::new(f).table_len() as f64;
                [network(f.levels * f.features, f.layers, f.width), table]
            }
        }
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
        let (inputs, layers, width) = match &self.field {
            FieldConfig::Mlp(f) => (3 + 6 * f.frequencies, f.layers, f.width),
            FieldConfig::Hash(f) => (f.levels * f.features, f.layers, f.width),
        };
        let activations = 2.0 * inputs as f64 + (layers as f64 + 2.0) * width as f64;
        // A tile is at least one ray.
        let points = per_ray.max(TILE_POINTS as f64).min((rays / groups).ceil() * per_ray);
        let of_network = 4.0 * (NETWORK_COPIES * network + groups * points * activations);
        let FieldConfig::Hash(hash) = &self.field else { return of_network };
        // The grid, its average, the first moment, and the second, one number a row.
        let kept = 3.0 * table + table / hash.features as f64;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let scratch = (HashLayout::new(hash).largest_level() * threads.min(hash.levels)) as f64;
        of_network + 4.0 * (kept + scratch) + rays * per_ray * (POSITION + 4.0 * inputs as f64)
    }
}
