//! From a tile of rays to rendered pixels, and back to the parameters' gradients.

use crate::config::Spacing;
use crate::frustum::{Frustum, Ray};
use crate::network::{Gradients, Network, Tape};
use crate::sampling::{blurred, edges, importance, stratified};
use crate::scalar::Scalar;
use crate::volume::{Bins, Rendered, Shade};
use mde_uncertainty::termination::InBinVariance;
use mde_warp::random::CounterRng;

/// How many samples a ray gets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Budget {
    /// Over the whole range.
    pub(crate) coarse: usize,
    /// In the band around a known depth.
    pub(crate) band: usize,
    /// Half width of the band, as a fraction of the depth.
    pub(crate) band_width: f64,
    /// Where the others found weight.
    pub(crate) fine: usize,
    pub(crate) spacing: Spacing,
    pub(crate) in_bin: InBinVariance,
}

/// A ray to be marched.
#[derive(Debug, Clone)]
pub(crate) struct March {
    pub(crate) ray: Ray,
    /// A depth to look around.
    pub(crate) guess: Option<f64>,
    pub(crate) background: [f64; 3],
    /// Jitters the samples; their strata's middles are taken without one.
    pub(crate) rng: Option<CounterRng>,
}

/// One sample of a ray: where, and which row of which pass holds its point.
#[derive(Debug, Clone, Copy)]
struct Sample {
    position: f64,
    pass: usize,
    row: usize,
}

/// Working memory of one tile of rays, kept from tile to tile.
#[derive(Debug, Default)]
pub(crate) struct Marcher<T> {
    /// The coarse and the fine pass.
    passes: [Tape<T>; 2],
    /// Samples of all rays of the tile, ray by ray, front to back.
    samples: Vec<Vec<Sample>>,
    pub(crate) bins: Vec<Bins<T>>,
    shades: Vec<Vec<Shade<T>>>,
    pub(crate) rendered: Vec<Rendered<T>>,
    d_shades: [Vec<Shade<T>>; 2],
    positions: Vec<f64>,
    edges: Vec<f64>,
    weights: Vec<f64>,
    blurred: Vec<f64>,
}

impl<T: Scalar> Marcher<T> {
    /// Samples, evaluates and composites `rays`; the results are in `bins` and `rendered`, a ray each.
    pub(crate) fn forward(
        &mut self,
        network: &Network<T>,
        frustum: &Frustum,
        rays: &mut [March],
        budget: &Budget,
    ) {
        let count = rays.len();
        self.samples.resize_with(count, Vec::new);
        self.bins.resize_with(count, Bins::default);
        self.shades.resize_with(count, Vec::new);
        self.rendered.resize_with(count, Rendered::default);
        self.passes.iter_mut().for_each(|pass| pass.points.clear());

        for (index, march) in rays.iter_mut().enumerate() {
            self.place_first(index, march, frustum, budget);
        }
        network.forward(&mut self.passes[0]);
        if budget.fine > 0 {
            for (index, march) in rays.iter_mut().enumerate() {
                self.composite(index, march, frustum, budget);
                self.place_fine(index, march, frustum, budget);
            }
            network.forward(&mut self.passes[1]);
        }
        for (index, march) in rays.iter().enumerate() {
            self.composite(index, march, frustum, budget);
        }
    }

    /// Rows evaluated in the last forward pass.
    pub(crate) fn evaluated(&self) -> usize {
        self.passes.iter().map(|pass| pass.points.len()).sum()
    }

    fn place_first(&mut self, index: usize, march: &mut March, frustum: &Frustum, budget: &Budget) {
        let Self { samples, positions, .. } = self;
        positions.clear();
        let rng = &mut march.rng;
        match march.guess {
            Some(depth) if budget.band > 0 => {
                stratified(budget.coarse, 0.0, 1.0, rng.as_mut(), positions);
                let at = |z: f64| frustum.fraction_at(z, budget.spacing);
                let band = (at(depth * (1.0 - budget.band_width)), at(depth * (1.0 + budget.band_width)));
                stratified(budget.band, band.0, band.1, rng.as_mut(), positions);
                positions.sort_unstable_by(f64::total_cmp);
            }
            _ => stratified(budget.coarse + budget.band, 0.0, 1.0, rng.as_mut(), positions),
        }
        samples[index].clear();
        for i in 0..self.positions.len() {
            self.push(index, 0, self.positions[i], march, frustum, budget);
        }
    }

    fn place_fine(&mut self, index: usize, march: &mut March, frustum: &Frustum, budget: &Budget) {
        self.positions.clear();
        self.positions.extend(self.samples[index].iter().map(|s| s.position));
        edges(&self.positions, &mut self.edges);
        self.weights.clear();
        self.weights.extend(self.rendered[index].weights.iter().map(|w| w.to_f64()));
        blurred(&self.weights, &mut self.blurred);
        self.positions.clear();
        importance(budget.fine, &self.edges, &self.blurred, march.rng.as_mut(), &mut self.positions);
        for i in 0..self.positions.len() {
            self.push(index, 1, self.positions[i], march, frustum, budget);
        }
        self.samples[index].sort_by(|a, b| a.position.total_cmp(&b.position));
    }

    fn push(
        &mut self,
        index: usize,
        pass: usize,
        position: f64,
        march: &March,
        frustum: &Frustum,
        budget: &Budget,
    ) {
        let points = &mut self.passes[pass].points;
        self.samples[index].push(Sample { position, pass, row: points.len() });
        let z = frustum.depth_at(position, budget.spacing);
        points.push(frustum.cube(&(march.ray.origin + z * march.ray.direction)));
    }

    /// Bins and rendering of a ray from the samples it has so far.
    fn composite(&mut self, index: usize, march: &March, frustum: &Frustum, budget: &Budget) {
        let Self { samples, bins, shades, rendered, passes, edges: bounds, positions, .. } = self;
        let (samples, bins, shades) = (&samples[index], &mut bins[index], &mut shades[index]);
        positions.clear();
        positions.extend(samples.iter().map(|s| s.position));
        edges(positions, bounds);
        let stretch = march.ray.direction.norm() / frustum.unit;
        let depth = |x: f64| frustum.depth_at(x, budget.spacing);
        bins.depth.clear();
        bins.extent.clear();
        bins.path.clear();
        shades.clear();
        for (sample, edge) in samples.iter().zip(bounds.windows(2)) {
            let extent = depth(edge[1]) - depth(edge[0]);
            bins.depth.push(T::from_f64(depth(sample.position)));
            bins.extent.push(T::from_f64(extent));
            bins.path.push(T::from_f64(extent * stretch));
            shades.push(passes[sample.pass].shades[sample.row]);
        }
        rendered[index].composite(bins, shades, march.background.map(T::from_f64), budget.in_bin);
    }

    /// Adds the parameters' gradients. `upstream(i, h)` is asked for ray `i`'s colour gradient and writes the
    /// gradients of its weights, other than through the colour, to `h`.
    pub(crate) fn backward(
        &mut self,
        network: &Network<T>,
        rays: &[March],
        gradients: &mut Gradients<T>,
        mut upstream: impl FnMut(usize, &mut [T]) -> [T; 3],
    ) {
        for (d, pass) in self.d_shades.iter_mut().zip(&self.passes) {
            d.clear();
            d.resize(pass.points.len(), [T::ZERO; 4]);
        }
        let mut h = Vec::new();
        for (index, march) in rays.iter().enumerate() {
            let samples = &self.samples[index];
            h.clear();
            h.resize(samples.len(), T::ZERO);
            let d_colour = upstream(index, &mut h);
            let background = march.background.map(T::from_f64);
            let d_shades = &mut self.d_shades;
            self.rendered[index].backward(
                &self.bins[index],
                &self.shades[index],
                background,
                d_colour,
                &mut h,
                |j, d| {
                    d_shades[samples[j].pass][samples[j].row] = d;
                },
            );
        }
        for (pass, d) in self.passes.iter_mut().zip(&self.d_shades) {
            if !pass.points.is_empty() {
                network.backward(pass, d, gradients);
            }
        }
    }
}
