//! The whole chain, from every parameter of both fields to the loss, against central differences in `f64`.
//!
//! What is perturbed: single parameters of the table and of the networks, sampled over each. Sample positions are fixed by
//! a seed (no importance samples: their positions would move with the parameters, and the gradient holds them fixed). The
//! seeds keep the rays away from the kinks of the ReLU and of the losses' absolute values and gates.

use crate::config::{DepthLoss, FieldConfig, HashFieldConfig, MlpFieldConfig, SamplingConfig, Spacing};
use crate::frustum::{Frustum, Ray};
use crate::loss::{DepthTerm, Target};
use crate::march::{Budget, March, Marcher};
use crate::network::{Encoding, Network};
use crate::train::tile_gradients;
use mde_uncertainty::GaussianDepth;
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::termination::InBinVariance;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Translation3, UnitQuaternion};
use ndarray::{Array2, Array3};
use rand::RngExt;

const RAYS: usize = 5;

struct Case {
    frustum: Frustum,
    targets: Vec<Target>,
    budget: Budget,
    term: DepthTerm,
}

impl Case {
    fn new(depth_loss: DepthLoss, spacing: Spacing) -> Self {
        let camera = PinholeCamera::from_fov(60.0, 8, 6).unwrap();
        let depth = Array2::from_shape_fn((6, 8), |(y, x)| 1.5 + 0.2 * x as f32 + 0.1 * y as f32);
        let hypothesis = GaussianDepth::new(depth, Array2::from_elem((6, 8), 1e-3)).unwrap();
        let view = PosedView::new(
            Array3::from_elem((6, 8, 3), 0.5),
            camera,
            Pose::identity(),
            Array2::from_elem((6, 8), true),
            vec![hypothesis],
        )
        .unwrap();
        let frustum = Frustum::of_views(&[view], &SamplingConfig::default()).unwrap();
        let targets = (0..RAYS)
            .map(|i| Target {
                colour: [0.2, 0.5, 0.1 * i as f64],
                depths: vec![(1.9 + 0.13 * i as f64, 1e-3), (2.3 - 0.07 * i as f64, 2e-2)],
                alike: if i % 2 == 1 { 0.4 } else { 0.0 },
            })
            .collect();
        let budget = Budget {
            coarse: 7,
            band: 0,
            band_width: 0.25,
            fine: 0,
            spacing,
            in_bin: InBinVariance::Midpoint,
        };
        Self { frustum, targets, budget, term: DepthTerm::at(depth_loss, 0.25) }
    }

    fn rays(&self) -> Vec<March> {
        let camera = PinholeCamera::from_fov(60.0, 8, 6).unwrap();
        let pose = Pose::from_parts(
            Translation3::new(0.03, -0.02, 0.01),
            UnitQuaternion::from_euler_angles(0.01, -0.02, 0.015),
        );
        (0..RAYS)
            .map(|i| March {
                ray: Ray::new(&camera, &pose, 1.0 + i as f64, 0.7 * i as f64),
                guess: None,
                background: [0.1, 0.6, 0.3],
                rng: Some(CounterRng::new(11, "gradient-check", 0, i as u64)),
            })
            .collect()
    }

    fn loss(&self, network: &Network<f64>) -> f64 {
        let mut gradients = network.gradients();
        let batch = (self.term, 1.0);
        let mut rays = self.rays();
        let tile = (rays.as_mut_slice(), self.targets.as_slice());
        tile_gradients(
            network,
            &self.frustum,
            &mut Marcher::default(),
            tile,
            &self.budget,
            batch,
            &mut gradients,
        )
        .total
    }

    /// Worst disagreement over `count` parameters of each part, relative to the part's largest gradient.
    fn check(&self, config: &FieldConfig, count: usize) {
        let mut network = Network::<f64>::new(config, 4);
        let mut rng = CounterRng::new(8, "gradient-check", 1, 0);
        // A table near zero would leave the networks untested.
        if let Encoding::Hash(grid) = &mut network.encoding {
            grid.table.iter_mut().for_each(|t| *t = rng.random::<f64>() - 0.5);
        }
        for mlp in [Some(&mut network.density), network.colour.as_mut()].into_iter().flatten() {
            mlp.parameters
                .iter_mut()
                .filter(|p| **p != 0.0)
                .for_each(|p| *p += 0.2 * (rng.random::<f64>() - 0.5));
            mlp.refresh();
        }
        let mut gradients = network.gradients();
        let mut rays = self.rays();
        let tile = (rays.as_mut_slice(), self.targets.as_slice());
        let mut marcher = Marcher::default();
        tile_gradients(
            &network,
            &self.frustum,
            &mut marcher,
            tile,
            &self.budget,
            (self.term, 1.0),
            &mut gradients,
        );
        let table = match &network.encoding {
            Encoding::Frequency(_) => Vec::new(),
            Encoding::Hash(grid) => {
                let mut table = vec![0.0; grid.table.len()];
                for (level, rows) in grid.layout.split_levels(&mut table).into_iter().enumerate() {
                    grid.layout.scatter(level, &gradients.points, &gradients.features[level], rows);
                }
                table
            }
        };
        for (part, analytic) in [table, gradients.density, gradients.colour].into_iter().enumerate() {
            let touched: Vec<usize> = (0..analytic.len()).filter(|&i| analytic[i] != 0.0).collect();
            assert!(
                analytic.is_empty() || touched.len() > 10,
                "part {part} has next to no gradient to check"
            );
            let largest = analytic.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
            for _ in 0..count.min(touched.len()) {
                let i = touched[rng.random_range(0..touched.len())];
                let step = 1e-6;
                let nudged = |by: f64| {
                    let mut nudged = network.clone();
                    let parameters = match part {
                        0 => match &mut nudged.encoding {
                            Encoding::Hash(grid) => &mut grid.table,
                            Encoding::Frequency(_) => unreachable!("a frequency encoding has no table"),
                        },
                        1 => &mut nudged.density.parameters,
                        _ => &mut nudged.colour.as_mut().unwrap().parameters,
                    };
                    parameters[i] += by;
                    nudged.density.refresh();
                    nudged.colour.iter_mut().for_each(|c| c.refresh());
                    self.loss(&nudged)
                };
                let slope = (nudged(step) - nudged(-step)) / (2.0 * step);
                assert!(
                    (slope - analytic[i]).abs() < 1e-6 * largest,
                    "part {part}, parameter {i}: central difference {slope:e}, by hand {:e}",
                    analytic[i]
                );
            }
        }
    }
}

const LOSSES: [DepthLoss; 4] = [
    DepthLoss::None,
    DepthLoss::GaussianNll { weight: 0.3, relative_sigma: 0.05, decay: 0.5 },
    DepthLoss::Wasserstein { weight: 0.2, decay: 0.0 },
    DepthLoss::Distribution { weight: 0.2, relative_sigma: 0.05, decay: 0.0 },
];

#[test]
fn the_mlp_field_with_every_loss() {
    let config = FieldConfig::Mlp(MlpFieldConfig { layers: 2, width: 20, frequencies: 3 });
    for loss in LOSSES {
        Case::new(loss, Spacing::Disparity).check(&config, 60);
    }
}

#[test]
fn the_hash_field_with_every_loss() {
    for (geometry, density_levels) in [(0, 0), (7, 0), (0, 2), (0, 3)] {
        let config = FieldConfig::Hash(HashFieldConfig {
            levels: 3,
            features: 2,
            log2_rows: 8,
            coarsest: 3,
            finest: 12,
            layers: 1,
            width: 16,
            geometry,
            density_levels,
        });
        for loss in LOSSES {
            Case::new(loss, Spacing::Depth).check(&config, 60);
        }
    }
}

/// With importance samples, the gradient holds their positions fixed; the fast version must do as the reference does.
#[test]
fn the_fast_gradient_agrees_with_the_reference() {
    let config = FieldConfig::Hash(HashFieldConfig {
        log2_rows: 10,
        levels: 4,
        finest: 64,
        ..HashFieldConfig::default()
    });
    let mut case = Case::new(LOSSES[2], Spacing::Disparity);
    case.budget.fine = 9;
    let exact = Network::<f64>::new(&config, 2);
    let fast = Network::<f32>::new(&config, 2);
    let (mut exact_gradients, mut fast_gradients) = (exact.gradients(), fast.gradients());
    let (mut rays, mut same_rays) = (case.rays(), case.rays());
    let batch = (case.term, 1.0);
    let exact_loss = tile_gradients(
        &exact,
        &case.frustum,
        &mut Marcher::default(),
        (&mut rays, &case.targets),
        &case.budget,
        batch,
        &mut exact_gradients,
    );
    let fast_loss = tile_gradients(
        &fast,
        &case.frustum,
        &mut Marcher::default(),
        (&mut same_rays, &case.targets),
        &case.budget,
        batch,
        &mut fast_gradients,
    );
    assert!((exact_loss.total - fast_loss.total).abs() < 1e-5);
    let largest = exact_gradients.density.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
    for (e, f) in exact_gradients.density.iter().zip(&fast_gradients.density) {
        assert!((e - f64::from(*f)).abs() < 1e-4 * largest, "{e} {f}");
    }
}
