//! Rendering of a tile of rays, and the backward pass to the parameters' gradients.

use crate::frustum::{CubeRay, Frustum, Interval, Ray};
use crate::network::{Gradients, Network, Tape};
use crate::points::Points;
use crate::sampling::{blurred, edges, importance, merge, stratified};
use crate::scalar::{Scalar, vectorized};
use crate::volume::{Bins, Rendered, Shade};
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::termination::InBinVariance;

/// Half width of the band about a known depth, as a fraction of the depth.
const BAND_WIDTH: f64 = 0.12;

/// Samples per ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Budget {
    /// Over the whole range.
    pub(crate) coarse: usize,
    /// In the band around a known depth.
    pub(crate) band: usize,
    /// Importance samples, drawn from the weights of the others.
    pub(crate) fine: usize,
    pub(crate) in_bin: InBinVariance,
}

/// A ray to be marched.
#[derive(Debug, Clone)]
pub(crate) struct March {
    pub(crate) ray: Ray,
    /// The sampled part; a ray without one misses the volume and renders to the background.
    pub(crate) interval: Option<Interval>,
    /// Centre of the band.
    pub(crate) guess: Option<f64>,
    pub(crate) background: [f64; 3],
    /// Jitters the samples; without one they lie in the middle of their strata.
    pub(crate) rng: Option<CounterRng>,
}

/// Samples of a ray.
#[derive(Debug, Default)]
struct Traced<T> {
    /// Positions of the first pass, sorted, and the row of the first of them.
    first: Vec<T>,
    first_row: usize,
    /// The same of the fine pass.
    fine: Vec<T>,
    fine_row: usize,
    /// Positions of both passes, sorted, and their sources (see [`merge`]).
    positions: Vec<T>,
    sources: Vec<u32>,
    edges: Vec<T>,
    shades: Vec<Shade<T>>,
}

/// Buffers for a tile of rays, reused from tile to tile.
#[derive(Debug, Default)]
pub(crate) struct Marcher<T> {
    /// The first and the fine pass.
    pub(crate) passes: [Tape<T>; 2],
    /// Samples evaluated in the last forward pass.
    pub(crate) samples: usize,
    traced: Vec<Traced<T>>,
    pub(crate) bins: Vec<Bins<T>>,
    pub(crate) rendered: Vec<Rendered<T>>,
    blurred: Vec<T>,
    band: Vec<T>,
    h: Vec<T>,
}

impl<T: Scalar> Marcher<T> {
    /// Samples, evaluates and composites `rays`; the results are in `bins` and `rendered`, one entry per ray. `evaluate` gives a
    /// tape's points their shades, as [`Network::forward`] does.
    pub(crate) fn forward(
        &mut self,
        evaluate: &dyn Fn(&mut Tape<T>),
        frustum: &Frustum,
        rays: &mut [March],
        budget: &Budget,
    ) {
        let count = rays.len();
        self.traced.resize_with(count, Traced::default);
        self.bins.resize_with(count, Bins::default);
        self.rendered.resize_with(count, Rendered::default);
        self.passes.iter_mut().for_each(|pass| pass.points.clear());

        vectorized!(T, || {
            for (index, march) in rays.iter_mut().enumerate() {
                self.place_first(index, march, frustum, budget);
            }
        });
        self.samples = self.passes[0].points.len();
        self.passes[0].points.pad();
        evaluate(&mut self.passes[0]);
        if budget.fine > 0 {
            vectorized!(T, || {
                for (index, march) in rays.iter_mut().enumerate() {
                    self.composite(index, march, frustum, budget);
                    self.place_fine(index, march, frustum, budget);
                }
            });
            self.samples += self.passes[1].points.len();
            self.passes[1].points.pad();
            evaluate(&mut self.passes[1]);
        }
        vectorized!(T, || {
            for (index, march) in rays.iter().enumerate() {
                self.composite(index, march, frustum, budget);
            }
        });
    }

    #[inline(always)]
    fn place_first(&mut self, index: usize, march: &mut March, frustum: &Frustum, budget: &Budget) {
        let traced = &mut self.traced[index];
        traced.first.clear();
        traced.fine.clear();
        traced.first_row = self.passes[0].points.len();
        if let Some(interval) = march.interval {
            let rng = &mut march.rng;
            match march.guess {
                Some(depth) if budget.band > 0 => {
                    let at = |z: f64| interval.fraction_at(z);
                    let band = (at(depth * (1.0 - BAND_WIDTH)), at(depth * (1.0 + BAND_WIDTH)));
                    // The merged list is sorted; its sources do not matter yet.
                    traced.positions.clear();
                    stratified(budget.coarse, 0.0, 1.0, rng.as_mut(), &mut traced.positions);
                    self.band.clear();
                    stratified(budget.band, band.0, band.1, rng.as_mut(), &mut self.band);
                    merge(&traced.positions, &self.band, &mut traced.first, &mut traced.sources);
                }
                _ => stratified(budget.coarse + budget.band, 0.0, 1.0, rng.as_mut(), &mut traced.first),
            }
            let points = &mut self.passes[0].points;
            Range::new(&interval).push(&traced.first, &frustum.cube_ray(&march.ray), points);
        }
        merge(&traced.first, &traced.fine, &mut traced.positions, &mut traced.sources);
    }

    #[inline(always)]
    fn place_fine(&mut self, index: usize, march: &mut March, frustum: &Frustum, budget: &Budget) {
        let traced = &mut self.traced[index];
        let Some(interval) = march.interval else { return };
        blurred(&self.rendered[index].weights, &mut self.blurred);
        importance(budget.fine, &traced.edges, &self.blurred, march.rng.as_mut(), &mut traced.fine);
        traced.fine_row = self.passes[1].points.len();
        let range = Range::new(&interval);
        range.push(&traced.fine, &frustum.cube_ray(&march.ray), &mut self.passes[1].points);
        merge(&traced.first, &traced.fine, &mut traced.positions, &mut traced.sources);
    }

    /// Bins and rendering of a ray from its samples so far.
    #[inline(always)]
    fn composite(&mut self, index: usize, march: &March, frustum: &Frustum, budget: &Budget) {
        let Self { traced, bins, rendered, passes, .. } = self;
        let (traced, bins) = (&mut traced[index], &mut bins[index]);
        bins.clear();
        if let Some(interval) = &march.interval {
            let range = Range::new(interval);
            edges(&traced.positions, &mut traced.edges);
            let stretch = T::from_f64(march.ray.direction.norm() / frustum.unit);
            bins.depth.extend(traced.positions.iter().map(|&x| T::ONE / range.inverse_depth(x)));
            bins.disparity.extend(traced.positions.iter().map(|&x| range.disparity(x)));
            bins.extent.extend(traced.edges.windows(2).map(|e| range.extent(e[0], e[1])));
            bins.path.extend(bins.extent.iter().map(|&e| e * stretch));
        }
        let firsts = traced.first.len();
        traced.shades.clear();
        traced.shades.extend(traced.sources.iter().map(|&source| {
            let source = source as usize;
            if source < firsts {
                passes[0].shades[traced.first_row + source]
            } else {
                passes[1].shades[traced.fine_row + source - firsts]
            }
        }));
        rendered[index].composite(bins, &traced.shades, march.background.map(T::from_f64), budget.in_bin);
    }

    /// Adds the parameters' gradients. `upstream(i, rendered, bins, h)` returns the gradient of ray `i`'s colour and writes
    /// the gradients of its weights, other than through the colour, to `h`.
    pub(crate) fn backward(
        &mut self,
        network: &Network<T>,
        rays: &[March],
        gradients: &mut Gradients<T>,
        mut upstream: impl FnMut(usize, &Rendered<T>, &Bins<T>, &mut [T]) -> [T; 3],
    ) {
        let Self { traced, bins, rendered, passes, h, .. } = self;
        for pass in passes.iter_mut() {
            pass.d_shades.clear();
            pass.d_shades.resize(pass.points.len(), [T::ZERO; 4]);
        }
        let [first_pass, fine_pass] = passes;
        vectorized!(T, || {
            for (index, march) in rays.iter().enumerate() {
                let (traced, bins, rendered) = (&traced[index], &bins[index], &rendered[index]);
                h.clear();
                h.resize(traced.sources.len(), T::ZERO);
                let d_colour = upstream(index, rendered, bins, h);
                let background = march.background.map(T::from_f64);
                let firsts = traced.first.len();
                rendered.backward(bins, &traced.shades, background, d_colour, h, |j, d| {
                    let source = traced.sources[j] as usize;
                    if source < firsts {
                        first_pass.d_shades[traced.first_row + source] = d;
                    } else {
                        fine_pass.d_shades[traced.fine_row + source - firsts] = d;
                    }
                });
            }
        });
        for pass in passes.iter_mut().filter(|pass| pass.points.len() > 0) {
            network.backward(pass, gradients);
        }
    }
}

/// From positions to depths, in the field's scalar type. Positions are uniform in disparity.
struct Range<T> {
    /// Inverse depth of the near end.
    near: T,
    /// \\(1 / near - 1 / far\\).
    width: T,
    /// Disparity at the near end.
    largest: T,
}

impl<T: Scalar> Range<T> {
    #[inline(always)]
    fn new(interval: &Interval) -> Self {
        Self {
            near: T::from_f64(1.0 / interval.near),
            width: T::from_f64(interval.width()),
            largest: T::from_f64(interval.largest_disparity()),
        }
    }

    #[inline(always)]
    fn inverse_depth(&self, x: T) -> T {
        self.near - x * self.width
    }

    /// The interval's disparity: 0 at its far end.
    #[inline(always)]
    fn disparity(&self, x: T) -> T {
        self.largest * (T::ONE - x)
    }

    /// Extent in depth between two positions, without the cancellation of a difference of depths.
    #[inline(always)]
    fn extent(&self, x: T, y: T) -> T {
        (y - x) * self.width / (self.inverse_depth(x) * self.inverse_depth(y))
    }

    #[inline(always)]
    fn push(&self, positions: &[T], ray: &CubeRay<T>, points: &mut Points<T>) {
        for &x in positions {
            points.push(ray.cube(self.inverse_depth(x)));
        }
    }
}
