//! From a tile of rays to rendered pixels, and back to the parameters' gradients.

use crate::config::Spacing;
use crate::frustum::{Frustum, Line, Ray};
use crate::network::{Gradients, Network, Tape};
use crate::points::Points;
use crate::sampling::{blurred, edges, importance, merge, stratified};
use crate::scalar::Scalar;
use crate::volume::{Bins, Rendered, Shade};
use mde_uncertainty::random::CounterRng;
use mde_uncertainty::termination::InBinVariance;

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

/// A ray on its way through the tile.
#[derive(Debug, Default)]
struct Traced<T> {
    /// Positions of the first pass, sorted, and the row of its first one.
    first: Vec<T>,
    first_row: usize,
    /// The same of the fine pass.
    fine: Vec<T>,
    fine_row: usize,
    /// All of them, sorted, and where each comes from (see [`merge`]).
    positions: Vec<T>,
    places: Vec<u32>,
    edges: Vec<T>,
    shades: Vec<Shade<T>>,
}

/// Working memory of one tile of rays, kept from tile to tile.
#[derive(Debug, Default)]
pub(crate) struct Marcher<T> {
    /// The first and the fine pass.
    passes: [Tape<T>; 2],
    /// Samples of the last forward pass.
    samples: usize,
    traced: Vec<Traced<T>>,
    pub(crate) bins: Vec<Bins<T>>,
    pub(crate) rendered: Vec<Rendered<T>>,
    blurred: Vec<T>,
    band: Vec<T>,
    h: Vec<T>,
    /// Slopes of the loss in the rays' mean depths, for whom that loss asks.
    pub(crate) slopes: Vec<f64>,
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
        self.forward_with(&|tape| network.forward(tape), frustum, rays, budget);
    }

    /// The same with another way from a tape's points to its shades.
    pub(crate) fn forward_with(
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
        let range = Range::new(frustum, budget.spacing);

        T::vectorized(
            #[inline(always)]
            || {
                for (index, march) in rays.iter_mut().enumerate() {
                    self.place_first(index, march, frustum, budget, &range);
                }
            },
        );
        self.samples = self.passes[0].points.len();
        self.passes[0].points.pad();
        evaluate(&mut self.passes[0]);
        if budget.fine > 0 {
            T::vectorized(
                #[inline(always)]
                || {
                    for (index, march) in rays.iter_mut().enumerate() {
                        self.composite(index, march, frustum, budget, &range);
                        self.place_fine(index, march, frustum, budget, &range);
                    }
                },
            );
            self.samples += self.passes[1].points.len();
            self.passes[1].points.pad();
            evaluate(&mut self.passes[1]);
        }
        T::vectorized(
            #[inline(always)]
            || {
                for (index, march) in rays.iter().enumerate() {
                    self.composite(index, march, frustum, budget, &range);
                }
            },
        );
    }

    /// Points of the first pass.
    pub(crate) fn points(&self) -> &Points<T> {
        &self.passes[0].points
    }

    /// Samples evaluated in the last forward pass.
    pub(crate) fn evaluated(&self) -> usize {
        self.samples
    }

    #[inline(always)]
    fn place_first(
        &mut self,
        index: usize,
        march: &mut March,
        frustum: &Frustum,
        budget: &Budget,
        range: &Range<T>,
    ) {
        let traced = &mut self.traced[index];
        traced.first.clear();
        traced.fine.clear();
        let rng = &mut march.rng;
        match march.guess {
            Some(depth) if budget.band > 0 => {
                let at = |z: f64| frustum.fraction_at(z, budget.spacing);
                let band = (at(depth * (1.0 - budget.band_width)), at(depth * (1.0 + budget.band_width)));
                // The merged list is sorted; where its parts came from does not matter yet.
                traced.positions.clear();
                stratified(budget.coarse, 0.0, 1.0, rng.as_mut(), &mut traced.positions);
                self.band.clear();
                stratified(budget.band, band.0, band.1, rng.as_mut(), &mut self.band);
                merge(&traced.positions, &self.band, &mut traced.first, &mut traced.places);
            }
            _ => stratified(budget.coarse + budget.band, 0.0, 1.0, rng.as_mut(), &mut traced.first),
        }
        traced.first_row = self.passes[0].points.len();
        range.push(&traced.first, &frustum.line(&march.ray), &mut self.passes[0].points);
        merge(&traced.first, &traced.fine, &mut traced.positions, &mut traced.places);
    }

    #[inline(always)]
    fn place_fine(
        &mut self,
        index: usize,
        march: &mut March,
        frustum: &Frustum,
        budget: &Budget,
        range: &Range<T>,
    ) {
        let traced = &mut self.traced[index];
        blurred(&self.rendered[index].weights, &mut self.blurred);
        importance(budget.fine, &traced.edges, &self.blurred, march.rng.as_mut(), &mut traced.fine);
        traced.fine_row = self.passes[1].points.len();
        range.push(&traced.fine, &frustum.line(&march.ray), &mut self.passes[1].points);
        merge(&traced.first, &traced.fine, &mut traced.positions, &mut traced.places);
    }

    /// Bins and rendering of a ray from the samples it has so far.
    #[inline(always)]
    fn composite(
        &mut self,
        index: usize,
        march: &March,
        frustum: &Frustum,
        budget: &Budget,
        range: &Range<T>,
    ) {
        let Self { traced, bins, rendered, passes, .. } = self;
        let (traced, bins) = (&mut traced[index], &mut bins[index]);
        edges(&traced.positions, &mut traced.edges);
        let stretch = T::from_f64(march.ray.direction.norm() / frustum.unit);
        bins.clear();
        bins.depth.extend(traced.positions.iter().map(|&x| T::ONE / range.inverse_depth(x)));
        bins.disparity.extend(traced.positions.iter().map(|&x| range.disparity(x)));
        bins.extent.extend(traced.edges.windows(2).map(|e| range.extent(e[0], e[1])));
        bins.path.extend(bins.extent.iter().map(|&e| e * stretch));
        let firsts = traced.first.len();
        traced.shades.clear();
        traced.shades.extend(traced.places.iter().map(|&place| {
            let place = place as usize;
            if place < firsts {
                passes[0].shades[traced.first_row + place]
            } else {
                passes[1].shades[traced.fine_row + place - firsts]
            }
        }));
        rendered[index].composite(bins, &traced.shades, march.background.map(T::from_f64), budget.in_bin);
    }

    /// Adds the parameters' gradients. `upstream(i, rendered, bins, h)` is asked for ray `i`'s colour gradient and writes
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
        T::vectorized(
            #[inline(always)]
            || {
                for (index, march) in rays.iter().enumerate() {
                    let (traced, bins, rendered) = (&traced[index], &bins[index], &rendered[index]);
                    h.clear();
                    h.resize(traced.places.len(), T::ZERO);
                    let d_colour = upstream(index, rendered, bins, h);
                    let background = march.background.map(T::from_f64);
                    let firsts = traced.first.len();
                    rendered.backward(bins, &traced.shades, background, d_colour, h, |j, d| {
                        let place = traced.places[j] as usize;
                        if place < firsts {
                            first_pass.d_shades[traced.first_row + place] = d;
                        } else {
                            fine_pass.d_shades[traced.fine_row + place - firsts] = d;
                        }
                    });
                }
            },
        );
        for pass in passes.iter_mut().filter(|pass| pass.points.len() > 0) {
            network.backward(pass, gradients);
        }
    }
}

/// From positions to depths, in the field's own numbers.
struct Range<T> {
    spacing: Spacing,
    near: T,
    far: T,
    /// Inverse depths of both ends.
    inverse: [T; 2],
    /// \\(1 / near - 1 / far\\).
    width: T,
}

impl<T: Scalar> Range<T> {
    fn new(frustum: &Frustum, spacing: Spacing) -> Self {
        let (near, far) = (frustum.near, frustum.far);
        Self {
            spacing,
            near: T::from_f64(near),
            far: T::from_f64(far),
            inverse: [T::from_f64(1.0 / near), T::from_f64(1.0 / far)],
            width: T::from_f64(1.0 / near - 1.0 / far),
        }
    }

    #[inline(always)]
    fn inverse_depth(&self, x: T) -> T {
        match self.spacing {
            Spacing::Depth => T::ONE / (self.near + x * (self.far - self.near)),
            Spacing::Disparity => self.inverse[0] - x * self.width,
        }
    }

    /// Disparity scaled to 0 at far and 1 at near.
    #[inline(always)]
    fn disparity(&self, x: T) -> T {
        match self.spacing {
            Spacing::Depth => (self.inverse_depth(x) - self.inverse[1]) / self.width,
            Spacing::Disparity => T::ONE - x,
        }
    }

    /// Extent in depth between two positions, without the cancellation of a difference of depths.
    #[inline(always)]
    fn extent(&self, x: T, y: T) -> T {
        match self.spacing {
            Spacing::Depth => (y - x) * (self.far - self.near),
            Spacing::Disparity => (y - x) * self.width / (self.inverse_depth(x) * self.inverse_depth(y)),
        }
    }

    #[inline(always)]
    fn push(&self, positions: &[T], line: &Line<T>, points: &mut Points<T>) {
        for &x in positions {
            points.push(line.cube(self.inverse_depth(x)));
        }
    }
}
