//! The whole chain, from every parameter of both fields to the loss.
//!
//! Dual numbers run the same forward pass with an independent formula of the loss, central differences the loss that is optimised. Sample
//! positions are fixed by a seed, without importance samples: their positions would move with the parameters, and the gradient holds them
//! fixed. The seeds keep the rays away from the kinks of the ReLU and of the losses' absolute values.

use crate::config::{
    ColourLoss, FieldConfig, HashFieldConfig, MlpFieldConfig, SamplingConfig, TrainConfig, VolumeConfig,
};
use crate::dual::Dual;
use crate::encoding::HashGrid;
use crate::frustum::{Frustum, Ray};
use crate::loss::{LossTerms, Target};
use crate::march::{Budget, March, Marcher};
use crate::network::{Encoding, Gradients, Network};
use crate::scalar::Scalar;
use crate::train::tile_gradients;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::termination::InBinVariance;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use ndarray::{Array2, Array3};
use rand::RngExt;

const RAYS: usize = 5;
const BACKGROUND: [f64; 3] = [0.1, 0.6, 0.3];

struct Case {
    frustum: Frustum,
    targets: Vec<Target>,
    budget: Budget,
    losses: Losses,
    /// Of the camera whose rays are compared.
    pose: Pose,
}

/// The loss of the colours, and the weight of the hypotheses.
type Losses = (ColourLoss, f64);

fn camera() -> PinholeCamera {
    PinholeCamera::from_fov(60.0, 8, 6).unwrap()
}

impl Case {
    fn new(losses: Losses, volume: VolumeConfig) -> Self {
        let depth = Array2::from_shape_fn((6, 8), |(y, x)| 1.5 + 0.2 * x as f32 + 0.1 * y as f32);
        let hypothesis = GaussianDepth::new(depth, Array2::from_elem((6, 8), 1e-3)).unwrap();
        let (image, mask) = (Array3::from_elem((6, 8, 3), 0.5), Array2::from_elem((6, 8), true));
        let view = PosedView::new(image, camera(), Pose::identity(), mask, vec![hypothesis]).unwrap();
        let sampling = SamplingConfig { volume, ..SamplingConfig::default() };
        let frustum = Frustum::of_views(&[view], &sampling).unwrap();
        let target = |i: f64| Target {
            colour: [0.2, 0.5, 0.1 * i],
            depths: vec![(1.9 + 0.13 * i, 1e-5), (2.3 - 0.07 * i, 2e-2)],
        };
        let targets = (0..RAYS).map(|i| target(i as f64)).collect();
        let budget = Budget { coarse: 7, band: 0, fine: 0, in_bin: InBinVariance::Midpoint };
        let turn = UnitQuaternion::from_euler_angles(0.01, -0.02, 0.015);
        let pose = Pose::from_parts(Translation3::new(0.03, -0.02, 0.01), turn);
        Self { frustum, targets, budget, losses, pose }
    }

    fn rays(&self) -> Vec<March> {
        let march = |i: usize| {
            let ray = Ray::new(&camera(), &self.pose, 1.0 + i as f64, 0.7 * i as f64);
            let interval = self.frustum.interval(&ray, 0.0);
            let rng = Some(CounterRng::new(11, "gradient-check", 0, i as u64));
            March { ray, interval, guess: None, background: BACKGROUND, rng }
        };
        (0..RAYS).map(march).collect()
    }

    /// The loss by the function that training uses, with its gradients, and the rays' rendering.
    fn optimised<T: Scalar>(&self, network: &Network<T>, gradients: &mut Gradients<T>) -> (f64, Marcher<T>) {
        let (colour_loss, depth_weight) = self.losses;
        let config = TrainConfig { colour_loss, depth_weight, ..TrainConfig::default() };
        let terms = (LossTerms::at(&config, PROGRESS), 1.0);
        let (mut rays, mut marcher) = (self.rays(), Marcher::default());
        let tile = (rays.as_mut_slice(), self.targets.as_slice());
        let loss = tile_gradients(network, &self.frustum, &mut marcher, tile, &self.budget, terms, gradients);
        (loss.total, marcher)
    }

    /// The loss as its documentation defines it, with derivatives where `T` has them.
    fn defined<T: Scalar>(&self, network: &Network<T>) -> T {
        let (mut rays, mut marcher) = (self.rays(), Marcher::default());
        marcher.forward(&|tape| network.forward(tape), &self.frustum, &mut rays, &self.budget);
        let n = T::from_f64;
        let mut loss = T::ZERO;
        for (index, (march, target)) in rays.iter().zip(&self.targets).enumerate() {
            let Some(interval) = march.interval else { continue };
            let (rendered, bins) = (&marcher.rendered[index], &marcher.bins[index]);
            let colour: T = (0..3)
                .map(|axis| {
                    let error = rendered.colour[axis] - n(target.colour[axis]);
                    match self.losses.0 {
                        ColourLoss::Squared => error * error * n(1.0 / 3.0),
                        ColourLoss::Charbonnier => {
                            let weight = 1.0 + 5.0 * PROGRESS;
                            let root = (T::ONE + error * error / n(0.01)).sqrt();
                            (root - T::ONE) * n(weight * 2.0 * 0.01 / 3.0)
                        }
                    }
                })
                .sum();
            let unit = 1.0 / self.frustum.near - 1.0 / self.frustum.far;
            let clamped = |z: f64| z.clamp(interval.near, interval.far);
            let r = |z: f64| (1.0 / clamped(z) - 1.0 / interval.far) / unit;
            let mixture = |at: f64| {
                let logistic = |&(z, variance): &(f64, f64)| {
                    let sigma = variance.sqrt().max(0.005 * z) / (clamped(z).powi(2) * unit);
                    let scale = sigma * 3.0_f64.sqrt() / std::f64::consts::PI;
                    1.0 / (1.0 + ((at - r(z)) / scale).exp())
                };
                target.depths.iter().map(logistic).sum::<f64>() / target.depths.len() as f64
            };
            let samples: Vec<f64> = bins.disparity.iter().map(|d| d.to_f64()).collect();
            let edges = [vec![r(interval.near)], samples, vec![0.0]].concat();
            let (mut ended, mut integral) = (T::ZERO, T::ZERO);
            for (index, edge) in edges.windows(2).enumerate() {
                if index > 0 {
                    ended += rendered.weights[index - 1];
                }
                let middle = mixture(0.5 * (edge[0] + edge[1]));
                integral += (ended - n(middle)).abs() * n(edge[0] - edge[1]);
            }
            // Between a fifth and four fifths of the steps the weight falls to a fiftieth.
            let fade = 1.0 - 0.98 * (PROGRESS - 0.2) / 0.6;
            let depth = integral * n(fade * self.losses.1);
            loss += colour + depth;
        }
        loss
    }

    /// Compares `count` parameters of each part: errors are relative to the part's largest gradient.
    fn check(&self, config: &FieldConfig, count: usize) {
        let mut network = Network::<f64>::new(config, 4);
        let mut rng = CounterRng::new(8, "gradient-check", 1, 0);
        // A table near zero would leave the networks untested.
        if let Encoding::Hash(grid) = &mut network.encoding {
            grid.table.iter_mut().for_each(|t| *t = rng.random::<f64>() - 0.5);
        }
        let used = network.mlp.parameters.iter_mut().filter(|p| **p != 0.0);
        used.for_each(|p| *p += 0.2 * (rng.random::<f64>() - 0.5));
        network.mlp.refresh();
        let mut gradients = network.gradients();
        let (loss, _) = self.optimised(&network, &mut gradients);
        assert!((loss - self.defined(&network)).abs() < 1e-12 * (1.0 + loss.abs()));
        let mut table = Vec::new();
        if let Some(HashGrid { layout, table: values }) = network.grid() {
            table.resize(values.len(), 0.0);
            for (level, rows) in layout.split(&mut table, layout.features).into_iter().enumerate() {
                layout.scatter(level, &gradients.points, &gradients.features[level], rows);
            }
        }
        for (part, analytic) in [table, gradients.mlp].into_iter().enumerate() {
            let touched: Vec<usize> = (0..analytic.len()).filter(|&i| analytic[i] != 0.0).collect();
            assert!(analytic.is_empty() || touched.len() > 10, "part {part} has almost no gradient to check");
            let largest = analytic.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
            for _ in 0..count.min(touched.len()) {
                let i = touched[rng.random_range(0..touched.len())];
                let exact = self.defined(&with_parameter(&network, config, part, i, Dual::variable)).slope;
                let step = 1e-6;
                let nudged = |by: f64| {
                    let nudged = with_parameter(&network, config, part, i, |p: f64| p + by);
                    self.optimised(&nudged, &mut nudged.gradients()).0
                };
                let difference = (nudged(step) - nudged(-step)) / (2.0 * step);
                for (slope, tolerance) in [(exact, 1e-11), (difference, 1e-6)] {
                    let error = (slope - analytic[i]).abs();
                    assert!(
                        error < tolerance * largest,
                        "part {part}, parameter {i}: {slope:e}, by hand {:e}, within {tolerance:e}",
                        analytic[i]
                    );
                }
            }
        }
    }
}

const PROGRESS: f64 = 0.25;

/// The network in another scalar type, with parameter `index` of `part` (table, network) replaced by `value` of it.
fn with_parameter<T: Scalar>(
    network: &Network<f64>,
    config: &FieldConfig,
    part: usize,
    index: usize,
    value: impl Fn(f64) -> T,
) -> Network<T> {
    let table = network.grid().map_or(&[][..], |grid| &grid.table);
    let mut parts: [Vec<T>; 2] = [table, &network.mlp.parameters]
        .map(|parameters| parameters.iter().map(|&p| T::from_f64(p)).collect());
    parts[part][index] = value(parts[part][index].to_f64());
    let [table, mlp] = parts;
    Network::from_parameters(config, table, mlp).unwrap()
}

const LOSSES: [Losses; 3] =
    [(ColourLoss::Squared, 0.0), (ColourLoss::Squared, 0.2), (ColourLoss::Charbonnier, 0.2)];

fn small_hash() -> FieldConfig {
    FieldConfig::Hash(HashFieldConfig {
        levels: 3,
        features: 2,
        log2_rows: 8,
        coarsest: 3,
        finest: 12,
        layers: 1,
        width: 16,
    })
}

#[test]
fn the_gradient_of_both_fields_is_exact_with_every_loss() {
    let mlp = FieldConfig::Mlp(MlpFieldConfig { layers: 2, width: 20, frequencies: 3 });
    for field in [mlp, small_hash()] {
        for losses in LOSSES {
            for volume in [VolumeConfig::Hull, VolumeConfig::Reference] {
                Case::new(losses, volume).check(&field, 40);
            }
        }
    }
}

/// With importance samples, the gradient holds their positions fixed, in `f32` as in the `f64` reference.
#[test]
fn the_fast_gradient_agrees_with_the_reference() {
    let config = FieldConfig::Hash(HashFieldConfig {
        log2_rows: 10,
        levels: 4,
        finest: 64,
        ..HashFieldConfig::default()
    });
    let mut case = Case::new(LOSSES[1], VolumeConfig::Hull);
    case.budget.fine = 9;
    let exact = Network::<f64>::new(&config, 2);
    let fast = Network::<f32>::new(&config, 2);
    let (mut exact_gradients, mut fast_gradients) = (exact.gradients(), fast.gradients());
    let (exact_loss, _) = case.optimised(&exact, &mut exact_gradients);
    let (fast_loss, _) = case.optimised(&fast, &mut fast_gradients);
    assert!((exact_loss - fast_loss).abs() < 1e-5);
    let largest = exact_gradients.mlp.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    for (e, f) in exact_gradients.mlp.iter().zip(&fast_gradients.mlp) {
        assert!((e - f64::from(*f)).abs() < 1e-4 * largest, "{e} {f}");
    }
}

/// A ray that misses the volume renders to the background, has opacity 0, and no gradient.
#[test]
fn rays_outside_the_volume_are_empty() {
    let mut case = Case::new(LOSSES[2], VolumeConfig::Reference);
    let network = Network::<f64>::new(&small_hash(), 4);
    case.pose = Pose::rotation(Vector3::new(0.0, std::f64::consts::PI, 0.0));
    assert!(case.rays().iter().all(|march| march.interval.is_none()));
    let mut gradients = network.gradients();
    for fine in [0, 6] {
        case.budget.fine = fine;
        let (_, marcher) = case.optimised(&network, &mut gradients);
        assert_eq!(marcher.samples, 0);
        for rendered in &marcher.rendered {
            assert_eq!((rendered.depth.opacity, rendered.colour), (0.0, BACKGROUND));
        }
        assert!(gradients.mlp.iter().all(|&g| g == 0.0));
        assert!(gradients.features.iter().all(Vec::is_empty) && gradients.points.len() == 0);
    }
}
