//! The optimisation: steps over random rays, in a fixed order of sums whatever the number of threads.

use crate::batch::Pixels;
use crate::config::NerfConfig;
use crate::field::{Event, FitReport, Observer};
use crate::frustum::Frustum;
use crate::loss::{DepthTerm, RayLoss, Target, ray_loss};
use crate::march::{Budget, March, Marcher};
use crate::network::{Encoding, Gradients, Network};
use crate::optimiser::{Adam, AdamStep, Average, adam};
use crate::scalar::Scalar;
use crate::{Error, Result};
use mde_uncertainty::termination::InBinVariance;
use rayon::prelude::*;

/// The batch is cut into this many groups, each summed in order; their sums are added in order. It bounds how many
/// threads a step can use, and is the same for any number of them.
const GROUPS: usize = 16;
/// Points a tile aims at: its activations stay in the second-level cache.
const TILE_POINTS: usize = 512;
/// Steps between two events.
const REPORT_EVERY: usize = 20;
/// Pixels a view on which the PSNR of the fit is measured.
const PSNR_PIXELS: usize = 8192;

/// A group's working memory.
struct Group<T> {
    marcher: Marcher<T>,
    gradients: Gradients<T>,
    loss: RayLoss,
    samples: u64,
}

/// The tile's gradients: marches `rays`, compares them to `targets` and adds the gradients of
/// `loss summed over the tile / batch`. Returns the summed loss.
pub(crate) fn tile_gradients<T: Scalar>(
    network: &Network<T>,
    frustum: &Frustum,
    marcher: &mut Marcher<T>,
    (rays, targets): (&mut [March], &[Target]),
    budget: &Budget,
    (term, batch): (DepthTerm, f64),
    gradients: &mut Gradients<T>,
) -> RayLoss {
    marcher.forward(network, frustum, rays, budget);
    // The pass back borrows the marcher; what the losses read is taken out first.
    let rendered = std::mem::take(&mut marcher.rendered);
    let bins = std::mem::take(&mut marcher.bins);
    let mut sum = RayLoss::default();
    let mut upstream = Vec::with_capacity(rays.len());
    for ((target, rendered), bins) in targets.iter().zip(&rendered).zip(&bins) {
        let mut h = vec![T::ZERO; bins.depth.len()];
        let (loss, d_colour) = ray_loss(target, rendered, bins, frustum, term, batch, &mut h);
        sum.squared_error += loss.squared_error;
        sum.total += loss.total;
        upstream.push((h, d_colour));
    }
    marcher.rendered = rendered;
    marcher.bins = bins;
    marcher.backward(network, rays, gradients, |index, h| {
        h.copy_from_slice(&upstream[index].0);
        upstream[index].1
    });
    sum
}

impl NerfConfig {
    fn training_budget(&self) -> Budget {
        let s = &self.sampling;
        Budget {
            coarse: s.coarse,
            band: s.band,
            band_width: s.band_width,
            fine: s.fine,
            spacing: s.spacing,
            in_bin: InBinVariance::Midpoint,
        }
    }

    pub(crate) fn render_budget(&self) -> Budget {
        let r = &self.render;
        Budget {
            coarse: r.coarse,
            band: 0,
            band_width: self.sampling.band_width,
            fine: r.fine,
            spacing: self.sampling.spacing,
            in_bin: r.in_bin,
        }
    }
}

/// Rays of a tile with so many samples each.
pub(crate) fn tile_rays(budget: &Budget) -> usize {
    (TILE_POINTS / (budget.coarse + budget.band + budget.fine).max(1)).max(1)
}

/// Adam's state of a whole network.
struct Optimiser {
    table: Adam,
    density: Adam,
    colour: Adam,
}

pub(crate) fn train(
    network: &mut Network<f32>,
    frustum: &Frustum,
    pixels: &Pixels<'_>,
    config: &NerfConfig,
    seed: u64,
    observer: &mut dyn Observer,
) -> Result<FitReport> {
    let train = &config.train;
    let budget = config.training_budget();
    let mut groups: Vec<Group<f32>> = (0..GROUPS)
        .map(|_| Group {
            marcher: Marcher::default(),
            gradients: network.gradients(),
            loss: RayLoss::default(),
            samples: 0,
        })
        .collect();
    let mut optimiser = Optimiser {
        table: Adam::new(if let Encoding::Hash(grid) = &network.encoding { grid.table.len() } else { 0 }),
        density: Adam::new(network.density.parameters.len()),
        colour: Adam::new(network.colour.as_ref().map_or(0, |c| c.parameters.len())),
    };
    let mut averages: [Average; 3] = std::array::from_fn(|_| Average::new(train.average));
    let averaged_from = train.steps.saturating_sub(Average::span(train.average));
    let mut since_report = RayLoss::default();
    let mut report = FitReport { steps: train.steps, ..FitReport::default() };

    for step in 0..train.steps {
        let progress = step as f64 / (train.steps as f64 - 1.0).max(1.0);
        let term = DepthTerm::at(train.depth_loss, progress);
        let shared: &Network<f32> = network;
        groups.par_iter_mut().enumerate().for_each(|(index, group)| {
            group.run(index, shared, frustum, pixels, &budget, (seed, step), (term, train.rays));
        });
        let sum = groups.iter().fold(RayLoss::default(), |sum, g| RayLoss {
            squared_error: sum.squared_error + g.loss.squared_error,
            total: sum.total + g.loss.total,
        });
        if !sum.total.is_finite() {
            return Err(Error::Diverged { step });
        }
        since_report.squared_error += sum.squared_error / train.rays as f64;
        since_report.total += sum.total / train.rays as f64;
        optimiser.step(network, &mut groups, AdamStep::new(train, step));
        if train.average > 0.0 && step >= averaged_from {
            let [table, density, colour] = &mut averages;
            parameters(network).into_iter().zip([table, density, colour]).for_each(|(p, a)| a.add(p));
        }
        let done = step + 1;
        if done % REPORT_EVERY == 0 || done == train.steps {
            let count = (if done % REPORT_EVERY == 0 { REPORT_EVERY } else { done % REPORT_EVERY }) as f64;
            report.loss = since_report.total / count;
            let psnr = decibels(since_report.squared_error / count);
            since_report = RayLoss::default();
            let event = Event::Fit { step: done, steps: train.steps, loss: report.loss, psnr };
            if observer.observe(&event).is_break() {
                return Err(Error::Interrupted);
            }
        }
    }
    for (p, average) in parameters(network).into_iter().zip(&averages) {
        average.write(p);
    }
    network.density.refresh();
    if let Some(colour) = &mut network.colour {
        colour.refresh();
    }
    report.samples = groups.iter().map(|g| g.samples).sum();
    report.psnr = psnr(network, frustum, pixels, &config.render_budget(), seed);
    Ok(report)
}

impl Group<f32> {
    #[allow(clippy::too_many_arguments, reason = "one step's context, passed once")]
    fn run(
        &mut self,
        index: usize,
        network: &Network<f32>,
        frustum: &Frustum,
        pixels: &Pixels<'_>,
        budget: &Budget,
        (seed, step): (u64, usize),
        (term, rays): (DepthTerm, usize),
    ) {
        self.loss = RayLoss::default();
        let (first, last) = (rays * index / GROUPS, rays * (index + 1) / GROUPS);
        let mut ray = first;
        while ray < last {
            let tile = ray..last.min(ray + tile_rays(budget));
            ray = tile.end;
            let (mut marches, targets): (Vec<_>, Vec<_>) = tile.map(|i| pixels.draw(seed, step, i)).unzip();
            let loss = tile_gradients(
                network,
                frustum,
                &mut self.marcher,
                (&mut marches, &targets),
                budget,
                (term, rays as f64),
                &mut self.gradients,
            );
            self.loss.squared_error += loss.squared_error;
            self.loss.total += loss.total;
            self.samples += self.marcher.evaluated() as u64;
        }
    }
}

impl Optimiser {
    /// Sums the groups' gradients in their order, steps, and clears them.
    fn step(&mut self, network: &mut Network<f32>, groups: &mut [Group<f32>], step: AdamStep) {
        if let Encoding::Hash(grid) = &mut network.encoding {
            let layout = grid.layout.clone();
            let [first, second, gradient] = self.table.parts().map(|part| layout.split_levels(part));
            let levels =
                layout.split_levels(&mut grid.table).into_par_iter().zip(first).zip(second).zip(gradient);
            let groups: &[Group<f32>] = groups;
            levels.enumerate().for_each(|(level, (((table, first), second), gradient))| {
                for group in groups {
                    layout.scatter(
                        level,
                        &group.gradients.points,
                        &group.gradients.features[level],
                        gradient,
                    );
                }
                adam(table, [first, second, gradient], step);
            });
        }
        let networks = [Some(&mut network.density), network.colour.as_mut()];
        for (which, (mlp, state)) in
            networks.into_iter().zip([&mut self.density, &mut self.colour]).enumerate()
        {
            let Some(mlp) = mlp else { continue };
            for group in groups.iter_mut() {
                let part =
                    if which == 0 { &mut group.gradients.density } else { &mut group.gradients.colour };
                for (sum, g) in state.gradient.iter_mut().zip(part.iter_mut()) {
                    *sum += *g;
                    *g = 0.0;
                }
            }
            adam(&mut mlp.parameters, state.parts(), step);
            mlp.refresh();
        }
        for group in groups {
            group.gradients.features.iter_mut().for_each(Vec::clear);
            group.gradients.points.clear();
        }
    }
}

/// The parameters: table, density network, colour network; empty where there is none.
fn parameters(network: &mut Network<f32>) -> [&mut [f32]; 3] {
    let table = match &mut network.encoding {
        Encoding::Hash(grid) => grid.table.as_mut_slice(),
        Encoding::Frequency(_) => &mut [],
    };
    let colour = network.colour.as_mut().map_or(&mut [][..], |c| c.parameters.as_mut_slice());
    [table, network.density.parameters.as_mut_slice(), colour]
}

/// PSNR a view on a random sample of its trainable pixels; NaN-free: a view without one has 0.
fn psnr(
    network: &Network<f32>,
    frustum: &Frustum,
    pixels: &Pixels<'_>,
    budget: &Budget,
    seed: u64,
) -> Vec<f64> {
    let tile = tile_rays(budget);
    (0..pixels.view_count())
        .map(|view| {
            let errors: Vec<f64> = (0..PSNR_PIXELS.div_ceil(tile))
                .into_par_iter()
                .map_init(Marcher::default, |marcher, chunk| {
                    let probes = (0..tile).filter_map(|i| pixels.probe(seed, view, chunk * tile + i));
                    let (mut rays, targets): (Vec<_>, Vec<Target>) = probes.unzip();
                    marcher.forward(network, frustum, &mut rays, budget);
                    let error = |(target, rendered): (&Target, &crate::volume::Rendered<f32>)| {
                        (0..3)
                            .map(|a| (f64::from(rendered.colour[a]) - target.colour[a]).powi(2) / 3.0)
                            .sum::<f64>()
                    };
                    let rendered = &marcher.rendered[..rays.len()];
                    targets.iter().zip(rendered).map(error).sum::<f64>() / rays.len().max(1) as f64
                })
                .collect();
            decibels(errors.iter().sum::<f64>() / errors.len() as f64)
        })
        .collect()
}

/// \\(-10 \log_{10}\\) of a mean squared error of colours in 0 to 1.
fn decibels(squared_error: f64) -> f64 {
    -10.0 * squared_error.max(1e-12).log10()
}
