//! The stages of a fit as separate calls with their operation counts, for benchmarks; the caller measures the time.

use crate::batch::Pixels;
use crate::config::{FieldConfig, HashFieldConfig, MlpFieldConfig, NerfConfig};
use crate::field::silent;
use crate::frustum::Frustum;
use crate::loss::LossTerms;
use crate::march::Marcher;
use crate::network::{Network, Tape};
use crate::optimiser::{AdamStep, step_rows};
use crate::render::render;
use crate::train::{Trainer, tile_gradients, tile_rays};
use crate::{Error, Result};
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView};
use ndarray::{Array2, Array3};
use pulp::{Arch, Simd, WithSimd};

/// Steps before the measurement, so that the field has surfaces as in most of a fit.
const WARM_UP: usize = 150;
/// Size of the image that is fitted and rendered.
const SIZE: (usize, usize) = (480, 640);
/// Rows rendered at a time.
const RENDERED_ROWS: usize = 48;

/// A stage of a fit.
#[derive(Debug, Clone, Copy)]
pub struct Stage {
    /// Name of the stage.
    pub name: &'static str,
    /// Whether it uses all of rayon's threads.
    pub parallel: bool,
    /// Samples per call.
    pub samples: u64,
    /// Floating-point operations of the matrix products per call, without padding; 0 where there are none.
    pub flops: u64,
}

/// Fields to compare, by name: the hash grid of the presets, and the light MLP.
pub fn fields() -> [(&'static str, FieldConfig); 2] {
    [
        ("hash-8x4", FieldConfig::Hash(HashFieldConfig::default())),
        ("mlp-4x128", FieldConfig::Mlp(MlpFieldConfig::default())),
    ]
}

/// Calls `visit` with every stage of a field and a function that runs it once, on a synthetic 640 x 480 view of a curved wall behind a box.
///
/// # Errors
/// [`Error::Config`] where a value is out of range, [`Error::Diverged`] where the warm-up diverges.
pub fn stages(config: &NerfConfig, visit: &mut dyn FnMut(Stage, &mut dyn FnMut())) -> Result<()> {
    config.validate()?;
    let views = [view()?];
    let frustum = Frustum::of_views(&views, &config.sampling)?;
    let pixels = Pixels::new(&views, &frustum, &config.train)?;
    let mut network = Network::<f32>::new(&config.field, 0);
    let mut trainer = Trainer::new(&mut network, &frustum, &pixels, config, 0);
    for step in 0..WARM_UP {
        if !trainer.gradients().total.is_finite() {
            return Err(Error::Diverged { step });
        }
        trainer.update();
    }
    drop(trainer);
    let stage = |name, samples, flops| Stage { name, parallel: false, samples, flops };

    // One tile of the batch.
    let budget = config.training_budget();
    let batch = config.train.rays;
    let (mut rays, targets): (Vec<_>, Vec<_>) =
        (0..tile_rays(&budget).min(batch)).map(|i| pixels.draw(0, 0, i)).unzip();
    let fresh = rays.clone();
    let terms = LossTerms::at(&config.train, 0.0);
    let mut marcher = Marcher::default();
    marcher.forward(&|tape| network.forward(tape), &frustum, &mut rays, &budget);
    let points = marcher.samples as u64;
    let forward = 2 * network.mlp.multiply_adds() as u64;

    let mut tape = Tape::default();
    tape.points.extend(&marcher.passes[0].points);
    let in_tape = tape.points.len() as u64;
    visit(stage("encoding", in_tape, 0), &mut || network.encode(&mut tape));
    visit(stage("network forward", in_tape, forward * in_tape), &mut || network.evaluate(&mut tape));
    let mut gradients = network.gradients();
    visit(stage("network forward and backward", in_tape, 3 * forward * in_tape), &mut || {
        network.evaluate(&mut tape);
        tape.d_shades = vec![[1e-3; 4]; tape.points.len()];
        network.backward(&mut tape, &mut gradients);
        gradients.clear();
    });
    visit(stage("sampling and compositing", points, 0), &mut || {
        rays.clone_from_slice(&fresh);
        // The shades of the last pass are kept.
        marcher.forward(&|_| {}, &frustum, &mut rays, &budget);
    });
    let tile = stage("one tile, forward and backward", points, 3 * forward * points);
    visit(tile, &mut || {
        rays.clone_from_slice(&fresh);
        let tile = (rays.as_mut_slice(), targets.as_slice());
        let terms = (terms, batch as f64);
        tile_gradients(&network, &frustum, &mut marcher, tile, &budget, terms, &mut gradients);
        gradients.clear();
    });
    let every = (batch * (budget.coarse + budget.band + budget.fine)) as u64;
    if let Some(grid) = network.grid() {
        let layout = &grid.layout;
        let d_features = vec![1e-3; tape.points.len() * layout.features];
        let mut gradient = vec![0.0; grid.table.len()];
        visit(stage("scatter", in_tape, 0), &mut || {
            for (level, rows) in layout.split(&mut gradient, layout.features).into_iter().enumerate() {
                layout.scatter(level, &tape.points, &d_features, rows);
            }
        });
        let mut values = grid.table.clone();
        let mut second = vec![0.0; layout.rows()];
        let step = AdamStep::new(&config.train, WARM_UP);
        visit(stage("optimiser", every, 0), &mut || {
            gradient.fill(1e-3);
            step_rows(&mut values, &mut second, &mut gradient, layout.features, step);
        });
    }
    let mut trained = network.clone();
    let mut trainer = Trainer::new(&mut trained, &frustum, &pixels, config, 0);
    // The backward pass of a hash grid samples the points.
    let operations = if network.grid().is_some() { 0 } else { 3 * forward * every };
    let step = stage("training step", every, operations);
    visit(Stage { parallel: true, ..step }, &mut || {
        trainer.gradients();
        trainer.update();
    });
    let camera = PinholeCamera { height: RENDERED_ROWS, ..views[0].camera };
    let every = (camera.width * camera.height * (config.render.coarse + config.render.fine)) as u64;
    let rows = stage("render", every, forward * every);
    visit(Stage { parallel: true, ..rows }, &mut || {
        // The callback never breaks, and the camera is valid.
        let _ = render(&network, &frustum, config, &camera, &Pose::identity(), &mut silent);
    });
    Ok(())
}

fn view() -> Result<PosedView> {
    let (height, width) = SIZE;
    let fault = |error: mde_warp::Error| Error::External(Box::new(error));
    let camera = PinholeCamera::from_fov(60.0, width, height).map_err(fault)?;
    let image = Array3::from_shape_fn((height, width, 3), |(y, x, c)| {
        0.5 + 0.3 * (0.11 * x as f32 + 0.07 * y as f32 + c as f32).sin() + 0.2 * (0.5 * x as f32).sin()
    });
    let depth = Array2::from_shape_fn(SIZE, |(y, x)| {
        let before = x > width / 3 && x < width / 2 && y > height / 4;
        if before { 1.6 } else { 2.0 + 2.0 * (x as f32 / width as f32) + (y as f32 / 90.0).sin() * 0.1 }
    });
    let hypothesis = GaussianDepth::new(depth, Array2::zeros(SIZE))?;
    let mask = Array2::from_elem(SIZE, true);
    PosedView::new(image, camera, Pose::identity(), mask, vec![hypothesis]).map_err(fault)
}

/// Independent vector multiply-adds at the processor's peak, `rounds` times, on one thread; returns their floating-point
/// operations and a number that depends on all of them.
pub fn multiply_adds(rounds: u64) -> (u64, f32) {
    Arch::new().dispatch(Peak(rounds))
}

struct Peak(u64);

/// Enough chains to hide the latency of two pipes; they stay in registers.
const CHAINS: usize = 12;

impl WithSimd for Peak {
    type Output = (u64, f32);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (u64, f32) {
        // Opaque to the compiler, which would fold the sums otherwise.
        let [start, scale, offset] = std::hint::black_box([1.0, 0.75, 0.5]).map(|x| simd.splat_f32s(x));
        let mut sums = [start; CHAINS];
        for _ in 0..self.0 {
            for sum in &mut sums {
                *sum = simd.mul_add_f32s(*sum, scale, offset);
            }
        }
        let total = sums.into_iter().fold(simd.splat_f32s(0.0), |total, sum| simd.add_f32s(total, sum));
        (2 * self.0 * (CHAINS * S::F32_LANES) as u64, simd.reduce_sum_f32s(total))
    }
}
