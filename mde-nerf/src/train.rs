//! The optimisation: steps over random rays, in a fixed order of sums whatever the number of threads.

use crate::batch::Pixels;
use crate::config::NerfConfig;
use crate::encoding::{HashGrid, HashLayout};
use crate::field::{FieldCallback, FieldEvent, FitReport};
use crate::frustum::Frustum;
use crate::loss::{LossTerms, RayLoss, Target, ray_loss};
use crate::march::{Budget, March, Marcher};
use crate::network::{Encoding, Gradients, Network};
use crate::optimiser::{AdamStep, Average, adam, step_rows};
use crate::scalar::Scalar;
use crate::{Error, Result};
use mde_uncertainty::termination::InBinVariance;
use rayon::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The batch is split into this many groups, each summed in order; their sums are added in order. It limits the number of
/// threads that a step can use, and does not depend on it.
pub(crate) const GROUPS: usize = 16;
/// Target number of points per tile, so that the activations stay in the second-level cache.
pub(crate) const TILE_POINTS: usize = 512;
/// [`Gradients::floor`] of a hash grid: AbsRel of 13 captures is that of the exact gradient, which a network alone gets.
const FLOOR: f64 = 0.5;
/// Steps between two events.
const REPORT_EVERY: usize = 20;

/// A group's working memory.
#[derive(Default)]
struct Group {
    marcher: Marcher<f32>,
    gradients: Gradients<f32>,
    loss: RayLoss,
}

/// The tile's gradients: marches `rays`, compares them to `targets` and adds the gradients of
/// `loss summed over the tile / batch`. Returns the summed loss.
pub(crate) fn tile_gradients<T: Scalar>(
    network: &Network<T>,
    frustum: &Frustum,
    marcher: &mut Marcher<T>,
    (rays, targets): (&mut [March], &[Target]),
    budget: &Budget,
    (terms, batch): (LossTerms, f64),
    gradients: &mut Gradients<T>,
) -> RayLoss {
    marcher.forward(&|tape| network.forward(tape), frustum, rays, budget);
    let mut sum = RayLoss::default();
    marcher.backward(network, rays, gradients, |index, rendered, bins, h| {
        // A ray that misses the volume depends on no parameter.
        let Some(interval) = &rays[index].interval else { return [T::ZERO; 3] };
        let (loss, d_colour) = ray_loss(&targets[index], rendered, bins, interval, terms, batch, h);
        sum += loss;
        d_colour
    });
    sum
}

impl NerfConfig {
    pub(crate) fn training_budget(&self) -> Budget {
        let s = &self.sampling;
        Budget { coarse: s.coarse, band: s.band, fine: s.fine, in_bin: InBinVariance::Midpoint }
    }

    pub(crate) fn render_budget(&self) -> Budget {
        let r = &self.render;
        Budget { coarse: r.coarse, band: 0, fine: r.fine, in_bin: r.in_bin }
    }
}

/// Rays per tile.
pub(crate) fn tile_rays(budget: &Budget) -> usize {
    (TILE_POINTS / (budget.coarse + budget.band + budget.fine).max(1)).max(1)
}

/// State of a fit.
pub(crate) struct Trainer<'a> {
    network: &'a mut Network<f32>,
    frustum: &'a Frustum,
    pixels: &'a Pixels<'a>,
    config: &'a NerfConfig,
    seed: u64,
    budget: Budget,
    groups: Vec<Group>,
    /// Second moments of the table's rows, and both moments of the network's parameters.
    of_rows: Vec<f32>,
    moments: [Vec<f32>; 2],
    /// Zeroed scratch buffers for a level's gradient, one per thread at a time: few enough to stay in the cache.
    scratch: Mutex<Vec<Vec<f32>>>,
    /// Steps made.
    step: usize,
}

impl<'a> Trainer<'a> {
    pub(crate) fn new(
        network: &'a mut Network<f32>,
        frustum: &'a Frustum,
        pixels: &'a Pixels<'a>,
        config: &'a NerfConfig,
        seed: u64,
    ) -> Self {
        let floor = if network.grid().is_some() { FLOOR } else { 0.0 };
        let group = |_| Group { gradients: Gradients { floor, ..network.gradients() }, ..Group::default() };
        let groups = (0..GROUPS).map(group).collect();
        let of_rows = vec![0.0; network.grid().map_or(0, |grid| grid.layout.rows())];
        let moments = [(); 2].map(|()| vec![0.0; network.mlp.parameters.len()]);
        let (budget, scratch) = (config.training_budget(), Mutex::default());
        Self { network, frustum, pixels, config, seed, budget, groups, of_rows, moments, scratch, step: 0 }
    }

    /// Computes the gradients of the next step's batch in the groups; returns the batch's loss.
    pub(crate) fn gradients(&mut self) -> RayLoss {
        let Self { network, frustum, pixels, config, seed, budget, groups, step, .. } = self;
        let train = &config.train;
        let progress = *step as f64 / (train.steps as f64 - 1.0).max(1.0);
        let terms = (LossTerms::at(train, progress), train.rays as f64);
        let network: &Network<f32> = network;
        groups.par_iter_mut().enumerate().for_each(|(index, group)| {
            let Group { marcher, gradients, loss } = group;
            *loss = RayLoss::default();
            let (first, last) = (train.rays * index / GROUPS, train.rays * (index + 1) / GROUPS);
            // Tiles of equal size: a small last one would cost as much as a whole one.
            let tiles = ((last - first) as f64 / tile_rays(budget) as f64).round().max(1.0) as usize;
            let at = |tile: usize| first + (last - first) * tile / tiles;
            for tile in 0..tiles {
                let draws = (at(tile)..at(tile + 1)).map(|i| pixels.draw(*seed, *step, i));
                let (mut marches, targets): (Vec<_>, Vec<_>) = draws.unzip();
                let tile = (marches.as_mut_slice(), targets.as_slice());
                *loss += tile_gradients(network, frustum, marcher, tile, budget, terms, gradients);
            }
        });
        let mut sum = RayLoss::default();
        groups.iter().for_each(|group| sum += group.loss);
        sum
    }

    /// Makes an optimiser step along the groups' gradients, summed in the groups' order, and clears them.
    pub(crate) fn update(&mut self) {
        let Self { network, config, groups, of_rows, moments: [first, second], scratch, .. } = self;
        let step = AdamStep::new(&config.train, self.step);
        if let Encoding::Hash(HashGrid { layout, table }) = &mut network.encoding {
            let layout: &HashLayout = layout;
            let levels = layout.split(table, layout.features).into_par_iter().zip(layout.split(of_rows, 1));
            let (groups, scratch): (&[Group], &Mutex<_>) = (groups, scratch);
            levels.enumerate().for_each(|(level, (table, second))| {
                let mut buffer = lock(scratch).pop().unwrap_or_default();
                buffer.resize(buffer.len().max(table.len()), 0.0);
                let gradient = &mut buffer[..table.len()];
                for Group { gradients: g, .. } in groups {
                    layout.scatter(level, &g.points, &g.features[level], gradient);
                }
                step_rows(table, second, gradient, layout.features, step);
                lock(scratch).push(buffer);
            });
        }
        let mut sum = std::mem::take(&mut groups[0].gradients.mlp);
        for group in &mut groups[1..] {
            for (sum, g) in sum.iter_mut().zip(&mut group.gradients.mlp) {
                *sum += *g;
                *g = 0.0;
            }
        }
        adam(&mut network.mlp.parameters, [first, second], &mut sum, step);
        // Zeroed by the step.
        groups[0].gradients.mlp = sum;
        network.mlp.refresh();
        groups.iter_mut().for_each(|group| group.gradients.clear());
        self.step += 1;
    }
}

pub(crate) fn train(
    network: &mut Network<f32>,
    frustum: &Frustum,
    pixels: &Pixels<'_>,
    config: &NerfConfig,
    seed: u64,
    callback: &mut FieldCallback<'_>,
) -> Result<FitReport> {
    let train = &config.train;
    let mut trainer = Trainer::new(network, frustum, pixels, config, seed);
    let mut averages = [Average::default(), Average::default()];
    let averaged_from = train.steps.saturating_sub(Average::span());
    let mut since_report = RayLoss::default();
    let mut report = FitReport { steps: train.steps, ..FitReport::default() };

    for step in 0..train.steps {
        let sum = trainer.gradients();
        if !sum.total.is_finite() {
            return Err(Error::Diverged { step });
        }
        trainer.update();
        since_report.squared_error += sum.squared_error / train.rays as f64;
        since_report.total += sum.total / train.rays as f64;
        if step >= averaged_from {
            parameters(trainer.network).into_iter().zip(&mut averages).for_each(|(p, a)| a.add(p));
        }
        let done = step + 1;
        if done % REPORT_EVERY == 0 || done == train.steps {
            let count = (if done % REPORT_EVERY == 0 { REPORT_EVERY } else { done % REPORT_EVERY }) as f64;
            report.loss = since_report.total / count;
            let psnr = decibels(since_report.squared_error / count);
            since_report = RayLoss::default();
            let event = FieldEvent::Fit { step: done, steps: train.steps, loss: report.loss, psnr };
            if callback(&event).is_break() {
                return Err(Error::Interrupted);
            }
        }
    }
    for (p, average) in parameters(trainer.network).into_iter().zip(&averages) {
        average.write(p);
    }
    trainer.network.mlp.refresh();
    // Of the last update.
    let sum = trainer.gradients();
    report.psnr = decibels(sum.squared_error / train.rays as f64);
    let mut numbers = parameters(trainer.network).into_iter().flat_map(|values| values.iter());
    if !(sum.total.is_finite() && numbers.all(|value| value.is_finite())) {
        return Err(Error::Diverged { step: train.steps.saturating_sub(1) });
    }
    Ok(report)
}

/// Locks a mutex; a poisoned one is usable, since a panicking thread holds no buffer in it.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The parameters: table, empty where there is none, and network.
fn parameters(network: &mut Network<f32>) -> [&mut [f32]; 2] {
    let table = match &mut network.encoding {
        Encoding::Hash(grid) => grid.table.as_mut_slice(),
        Encoding::Frequency(_) => &mut [],
    };
    [table, network.mlp.parameters.as_mut_slice()]
}

/// \\(-10 \log_{10}\\) of a mean squared error of colours in 0 to 1.
fn decibels(squared_error: f64) -> f64 {
    // NaN stays NaN.
    -10.0 * squared_error.clamp(1e-12, f64::INFINITY).log10()
}
