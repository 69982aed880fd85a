//! Plane sweep: a depth of every pixel by comparing photographs on a set of surfaces.
//!
//! A surface is a multiple of a centre in inverse depth: of a constant, which gives the classical planes, or of a depth
//! map, such as the scaled prior, whose slants the windows and the smoothness then follow. A pixel on a surface is
//! compared with each source by zero-mean normalised cross-correlation over a box,
//!
//! \\[ c_s = \min\Bigl\{1,\; 1 - \frac{\operatorname{cov}(I, I_s)}{\sqrt{(\operatorname{var} I + \nu^2)(\operatorname{var} I_s + \nu^2)}}\Bigr\} , \\]
//!
//! with \\( \nu \\) the noise of a grey value, so that flat places cost the same everywhere. The lower half of the sources'
//! costs is averaged (a source that is occluded falls into the other half), aggregated by semi-global matching, and read
//! as a posterior \\( \propto e^{-S/T} \\) over surfaces: its lowest valley gives mean and variance, and the share of the
//! posterior in that valley is the inlier probability by this sweep alone. Beside the depth edges that were found, windows are moved onto
//! the surface of their pixel, and the costs aggregated once more.

mod aggregate;
pub mod consensus;
mod correction;
mod cost;
mod edge;
pub mod evidence;
pub mod exposure;
pub mod patches;
pub mod planes;
mod posterior;
pub mod scale;
pub mod sigma;
pub mod views;
pub mod withheld;

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::OutOfRange;
use mde_uncertainty::statistics::{median, quantile};
use mde_warp::PosedView;
use ndarray::{Array2, ArrayView2};
use pulp::Arch;
use rayon::prelude::*;

use crate::raster::luma;
use crate::{Error, Result};
use aggregate::{Penalties, aggregate};
use cost::{Setup, Volume, WORST};
use mde_warp::transfer::Transfer;
use posterior::{Estimate, EstimateRow};

/// Most sources that are compared with a reference: the nearest.
const MAX_SOURCES: usize = 32;
/// Pixels between two samples when the number of surfaces is chosen, along each axis.
const STRIDE: usize = 8;
/// Most surfaces over a wide range, and about a depth map. Fewer are taken where that many would lie nearer than [`STEP`].
const SURFACES: usize = 128;
const AROUND: usize = 64;
/// Pixels between neighbouring surfaces in the source of most parallax.
const STEP: f64 = 0.25;
/// Penalty for a change by one surface between neighbours, in units of cost; about a depth map, where a surface is a larger change, more.
const SMALL_PENALTY: f32 = 0.04;
const SMALL_PENALTY_AROUND: f32 = 0.06;
/// Penalty for a larger change, in units of cost, divided by 1 + difference of luma / [`EDGE`].
const LARGE_PENALTY: f32 = 0.4;
/// Difference of luma that halves the large penalty.
const EDGE: f32 = 0.05;
/// Temperature of the posterior, in units of cost.
const TEMPERATURE: f32 = 0.5;

/// The surfaces of a sweep.
#[derive(Debug, Clone, Copy)]
pub enum Surfaces<'a> {
    /// Planes parallel to the image, even in inverse depth.
    Planes {
        /// Depth of the nearest, positive.
        near: f64,
        /// Depth of the farthest, above `near`; may be infinite.
        far: f64,
    },
    /// Multiples of a depth map from 1 / `factor` to `factor`, even in inverse depth.
    Around {
        /// z-depth in the unit of the poses, `[height, width]`; where it is not positive its median is taken.
        depth: ArrayView2<'a, f32>,
        /// Above 1.
        factor: f64,
    },
    /// The same, evenly spaced in the logarithm: for a scale that is hardly known.
    Ladder {
        /// z-depth, as for `Around`.
        depth: ArrayView2<'a, f32>,
        /// Above 1.
        factor: f64,
    },
}

/// Depth of the reference by one sweep.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Sweep {
    /// z-depth and variance in the unit of the poses; missing where no source has the pixel.
    pub depth: GaussianDepth,
    /// Share of the posterior in the valley of the lowest cost, 0 to 1; 0 where it lies at either end of the surfaces.
    pub inlier: Array2<f32>,
    /// Cost before aggregation, 0 to 1, of the surface that passes at the depth or next beyond it.
    pub cost: Array2<f32>,
    /// Number of surfaces that were compared.
    pub surfaces: usize,
}

/// Sweeps `views[reference]` against `views[i]` for `i` in `sources`.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// [`Error::Reference`] for an index outside the views, [`Error::TooFewViews`] without sources, [`Error::Config`] for a range of depths out
/// of order, [`Error::View`] for a view that [`PosedView::validate`] refuses or a depth map of another size.
pub fn sweep(
    views: &[PosedView],
    reference: usize,
    sources: &[usize],
    surfaces: Surfaces<'_>,
) -> Result<Sweep> {
    let view = |i: usize| -> Result<&PosedView> {
        let view = views.get(i).ok_or(Error::Reference { reference: i, views: views.len() })?;
        view.validate()?;
        Ok(view)
    };
    let from = view(reference)?;
    let others = sources.iter().filter(|&&i| i != reference);
    let mut sources = others.map(|&i| view(i)).collect::<Result<Vec<_>>>()?;
    if sources.len() > MAX_SOURCES {
        sources.sort_by(|a, b| baseline(from, a).total_cmp(&baseline(from, b)));
        sources.truncate(MAX_SOURCES);
    }
    if sources.is_empty() {
        return Err(Error::TooFewViews { views: 1 });
    }
    let (height, width) = from.camera.dim();
    let (centre, [low, high], logarithmic) = centre(from, surfaces)?;
    let (most, small) = match surfaces {
        Surfaces::Around { .. } => (AROUND, SMALL_PENALTY_AROUND),
        Surfaces::Planes { .. } | Surfaces::Ladder { .. } => (SURFACES, SMALL_PENALTY),
    };
    let number = number_of_surfaces(from, &sources, &centre, [low, high], most);
    let multiple = |k: usize| {
        let share = k as f64 / (number - 1) as f64;
        (if logarithmic { low * (high / low).powf(share) } else { low + share * (high - low) }) as f32
    };
    let multiples: Vec<f32> = (0..number).map(multiple).collect();
    let setup = Setup { reference: from, sources: &sources, centre: &centre, multiples: &multiples };
    let mut volume = Volume::new(&setup);
    let mut found = estimates(&volume, from, small);
    // The multiple at a fraction of a surface, and how far apart the multiples beside it are.
    let multiple = |surface: f32| {
        let below = (surface.max(0.0) as usize).min(number - 2);
        let gap = multiples[below + 1] - multiples[below];
        (multiples[below] + (surface - below as f32) * gap, gap)
    };
    if !logarithmic {
        // The last surface of the least multiple may be at infinity, but no pixel's is.
        let log = |(found, centre): (&Estimate, &f32)| -(centre * multiple(found.surface).0).ln();
        let logs: Vec<f32> = found.iter().zip(&centre).map(log).collect();
        let moved = edge::moved(from, &logs);
        if !moved.is_empty() {
            edge::take(&mut volume, &moved, &centre, &multiples);
            found = estimates(&volume, from, small);
        }
    }
    let read = |pixel: usize| {
        let position = (pixel / width, pixel % width);
        if !(volume.seen[position] && from.mask[position]) {
            return None;
        }
        let found = found[pixel];
        let (multiple, gap) = multiple(found.surface);
        let z = 1.0 / (centre[pixel] * multiple);
        let variance = z * z * found.variance * (gap / multiple).powi(2);
        let ends = found.surface < 0.5 || found.surface > number as f32 - 1.5;
        let known = z.is_finite() && z > 0.0 && variance.is_finite();
        // The chance of a match was fitted to this one; with the nearest surface's, MSE is 1.006 and D3R 1.02 times as large.
        let beyond = (found.surface.max(0.0) as usize).min(number - 1);
        let cost = f32::from(volume.costs[pixel * number + beyond]) / WORST;
        known.then_some([z, variance, if ends { 0.0 } else { found.mass }, cost])
    };
    let pixels: Vec<Option<[f32; 4]>> = (0..width * height).into_par_iter().map(read).collect();
    let map = |part: usize, missing: f32| {
        Array2::from_shape_fn((height, width), |(y, x)| pixels[y * width + x].map_or(missing, |p| p[part]))
    };
    let depth = GaussianDepth::new(map(0, 0.0), map(1, f32::INFINITY))?;
    Ok(Sweep { depth, inlier: map(2, 0.0), cost: map(3, 1.0), surfaces: number })
}

/// The valley of every pixel's aggregated costs.
fn estimates(volume: &Volume, from: &PosedView, small: f32) -> Vec<Estimate> {
    let (width, surfaces) = (from.camera.width, volume.surfaces);
    let grey: Vec<f32> = luma(from.image.view()).iter().copied().collect();
    let units = |cost: f32| (cost * WORST).round() as u16;
    let penalties = Penalties { small: units(small), large: units(LARGE_PENALTY), edge: EDGE };
    let sums = aggregate(volume, &grey, width, &penalties);
    let mut found = vec![Estimate::default(); grey.len()];
    let arch = Arch::new();
    found.par_chunks_mut(width).zip(sums.par_chunks(width * surfaces)).for_each_init(
        || vec![0.0; surfaces],
        |weights, (found, costs)| {
            let temperature = TEMPERATURE * WORST;
            arch.dispatch(EstimateRow { costs, surfaces, temperature, weights, found });
        },
    );
    found
}

/// Distance between two optical centres.
fn baseline(a: &PosedView, b: &PosedView) -> f64 {
    (crate::centre(&a.pose) - crate::centre(&b.pose)).norm()
}

/// Bytes that [`sweep`] about a depth map takes beside its inputs and its result for a photograph of that many pixels: costs and their sums
/// on all surfaces, and the samples of the sources.
pub fn working_bytes(pixels: u64, sources: u64) -> u64 {
    let volume = (size_of::<u8>() + size_of::<u16>()) as u64 * AROUND as u64;
    let sources = sources.min(MAX_SOURCES as u64).saturating_mul(size_of::<[f32; 4]>() as u64);
    // Luma, its windows and the centre of the reference; what is read from the sums.
    let reference = 12 * size_of::<f32>() as u64;
    pixels.saturating_mul(volume.saturating_add(sources).saturating_add(reference))
}

/// Inverse depth of every pixel, the least and the greatest multiple of it, and whether they are spaced by logarithm.
fn centre(from: &PosedView, surfaces: Surfaces<'_>) -> Result<(Vec<f32>, [f64; 2], bool)> {
    let pixels = from.camera.width * from.camera.height;
    match surfaces {
        Surfaces::Planes { near, far } => {
            OutOfRange::check(near > 0.0 && near.is_finite(), "near", &near, "give a positive depth")?;
            OutOfRange::check(far > near, "far", &far, "give a depth beyond near")?;
            // Infinity itself has no depth: the farthest plane is then at a thousand times the nearest.
            let least = if far.is_finite() { far.recip() } else { 1e-3 / near };
            Ok((vec![1.0; pixels], [least, near.recip()], false))
        }
        Surfaces::Around { depth, factor } | Surfaces::Ladder { depth, factor } => {
            from.camera.check_map("depth", depth.dim())?;
            let sound = factor > 1.0 && factor.is_finite();
            OutOfRange::check(sound, "factor", &factor, "give a number above 1")?;
            let good = |z: f32| z > 0.0 && z.is_finite();
            let middle =
                median(depth.iter().filter(|z| good(**z)).map(|&z| f64::from(z))).ok_or_else(|| {
                    OutOfRange::new("depth", "nowhere positive", "give a depth map with values")
                })?;
            let inverse = |&z: &f32| if good(z) { z.recip() } else { middle.recip() as f32 };
            let logarithmic = matches!(surfaces, Surfaces::Ladder { .. });
            Ok((depth.iter().map(inverse).collect(), [factor.recip(), factor], logarithmic))
        }
    }
}

/// As many surfaces as keep neighbours within [`STEP`] for three quarters of the pixels, in every source, at most `most`.
fn number_of_surfaces(
    from: &PosedView,
    sources: &[&PosedView],
    centre: &[f32],
    [low, high]: [f64; 2],
    most: usize,
) -> usize {
    let (height, width) = from.camera.dim();
    let mut longest = 0.0_f64;
    for source in sources {
        let transfer = Transfer::new(from, source);
        let mut paths = Vec::new();
        for y in (0..height).step_by(STRIDE) {
            for x in (0..width).step_by(STRIDE) {
                let w = f64::from(centre[y * width + x]);
                let at = |multiple: f64| transfer.at(x as f64, y as f64, w * multiple);
                if let (Some(a), Some(b)) = (at(low), at(high)) {
                    paths.push((a.x - b.x).hypot(a.y - b.y));
                }
            }
        }
        longest = longest.max(quantile(&mut paths, 0.75).unwrap_or(f64::INFINITY));
    }
    let wanted = (longest / STEP).ceil() + 1.0;
    if wanted < most as f64 { (wanted as usize).max(16) } else { most }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};
    use proptest::prelude::*;

    fn errors(sweep: &Sweep, truth: &Array2<f32>, border: usize) -> Vec<f64> {
        let (h, w) = truth.dim();
        let error = |at: (usize, usize)| Some((sweep.depth.get(at.0, at.1)?.0 / truth[at]).ln().abs());
        let inside = (border..h - border).flat_map(|y| (border..w - border).map(move |x| (y, x)));
        let mut all: Vec<f64> = inside.filter_map(error).map(f64::from).collect();
        all.sort_by(f64::total_cmp);
        all
    }

    const CENTRES: [[f64; 3]; 4] = [[0.0; 3], [0.25, 0.0, 0.0], [-0.2, 0.1, 0.0], [0.0, -0.2, 0.15]];

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(6))]
        /// Slanted planes are found to a fraction of a surface, from planes and from a wrong prior alike.
        #[test]
        fn slanted_planes_are_found(a in -0.5..0.5_f64, b in -0.5..0.5_f64, wrong in 0.8..1.25_f32) {
            let (views, depths) = scene(&[Plane::slanted(2.0, a, b)], (60, 80), &CENTRES);
            let planes = Surfaces::Planes { near: 1.0, far: 6.0 };
            let prior = depths[0].mapv(|z| wrong * z);
            let around = Surfaces::Around { depth: prior.view(), factor: 1.6 };
            for surfaces in [planes, around] {
                let found = sweep(&views, 0, &[1, 2, 3], surfaces).unwrap();
                let errors = errors(&found, &depths[0], 10);
                // Half a pixel is 6 % of the depth here.
                prop_assert!(errors[errors.len() / 2] < 0.02, "median {}", errors[errors.len() / 2]);
                prop_assert!(errors[errors.len() * 9 / 10] < 0.05, "9 in 10 {}", errors[errors.len() * 9 / 10]);
            }
        }
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_number_of_threads() {
        let (views, depths) = scene(&[Plane::slanted(2.0, 0.3, 0.1)], (50, 70), &CENTRES);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let around = Surfaces::Around { depth: depths[0].view(), factor: 2.0 };
            pool.install(|| sweep(&views, 0, &[1, 2, 3], around).unwrap())
        };
        assert_eq!(run(1), run(3));
    }

    /// An unrelated photograph changes little, since only the better half of the sources counts.
    #[test]
    fn the_better_half_of_the_sources_decides() {
        let (mut views, depths) = scene(&[Plane::slanted(2.0, 0.2, 0.0)], (60, 80), &CENTRES);
        views[3].image.invert_axis(ndarray::Axis(1));
        let planes = Surfaces::Planes { near: 1.0, far: 6.0 };
        let found = sweep(&views, 0, &[1, 2, 3], planes).unwrap();
        let errors = errors(&found, &depths[0], 10);
        assert!(errors[errors.len() / 2] < 0.01);
    }

    #[test]
    fn exposure_changes_nothing() {
        let (mut views, _) = scene(&[Plane::slanted(2.0, 0.2, 0.0)], (60, 80), &CENTRES);
        let planes = Surfaces::Planes { near: 1.0, far: 6.0 };
        let before = sweep(&views, 0, &[1, 2], planes).unwrap();
        views[1].image.mapv_inplace(|x| 0.7 * x + 0.1);
        let after = sweep(&views, 0, &[1, 2], planes).unwrap();
        let (before, after) = (before.depth.mean(), after.depth.mean());
        let moved = before.iter().zip(after).filter(|(a, b)| ((*a - *b) / *a).abs() > 0.01);
        assert!(moved.count() < 60 * 80 / 100);
    }

    #[test]
    fn what_cannot_be_swept_is_named() {
        let (views, depths) = scene(&[Plane::slanted(2.0, 0.0, 0.0)], (8, 8), &CENTRES[..2]);
        let planes = Surfaces::Planes { near: 2.0, far: 1.0 };
        assert!(matches!(sweep(&views, 0, &[1], planes), Err(Error::Config(at)) if at.field == "far"));
        let planes = Surfaces::Planes { near: 1.0, far: 2.0 };
        assert!(matches!(sweep(&views, 0, &[0], planes), Err(Error::TooFewViews { .. })));
        assert!(matches!(sweep(&views, 0, &[9], planes), Err(Error::Reference { .. })));
        let around = Surfaces::Around { depth: depths[0].view(), factor: 1.0 };
        assert!(matches!(sweep(&views, 0, &[1], around), Err(Error::Config(at)) if at.field == "factor"));
        let mut views = views;
        views[1].mask = Array2::from_elem((3, 4), true).into_shared();
        assert!(matches!(sweep(&views, 0, &[1], planes), Err(Error::View(_))));
    }

    /// A plane beyond a thousand times the nearest depth, which has next to no parallax.
    #[test]
    fn the_farthest_plane_is_where_it_was_asked_for() {
        let (views, _) = scene(&[Plane::slanted(50.0, 0.0, 0.0)], (8, 8), &CENTRES[..2]);
        let ends = |far| centre(&views[0], Surfaces::Planes { near: 0.01, far }).unwrap().1;
        assert_eq!(ends(100.0), [0.01, 100.0]);
        assert_eq!(ends(f64::INFINITY), [0.1, 100.0]);
    }
}
