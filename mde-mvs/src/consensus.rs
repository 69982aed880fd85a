//! Depth of every photograph from all of them, without a field.
//!
//! [`reconstruct`] runs the whole stage: scale, gauge, sweeps of every photograph, their agreement, the fusion with the
//! gauged prior, and the median over photographs.

use mde_uncertainty::GaussianDepth;
use mde_warp::PosedView;
use ndarray::{Array2, ArrayView2, Zip};
use rayon::prelude::*;

use crate::correction::{Guide, correct};
use crate::gauge::{Gauge, Match, Scale};
use crate::geometry::Transfer;
use crate::raster::{enlarge, luma, pick, shrink, small_view};
use crate::statistics::{robust_deviation, weighted_quantile};
use crate::sweep::{Surfaces, Sweep, SweepConfig, sweep};
use crate::{Error, Result, check_map};

/// Longer side of the photographs on which scale and gauge are found.
const SMALL: usize = 160;
/// A prior without any gauge may be wrong by this factor.
const UNKNOWN: f64 = 32.0;
/// Side of a patch whose residuals are taken as one, as a share of the longer side.
const PATCHES: usize = 10;
/// Matches below this probability correct no prior.
const TRUSTED: f32 = 0.5;
/// The differences of luma and of log depth at which a correction stops.
const EDGES: [f32; 2] = [0.1, 0.1];

/// Settings of [`reconstruct`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields, default, rename_all = "kebab-case"))]
#[non_exhaustive]
pub struct ConsensusConfig {
    /// The sweeps.
    pub sweep: SweepConfig,
    /// The factor about the gauged prior that the first sweeps cover; 3.
    pub wide: f64,
    /// The factor about the corrected prior that the last sweeps cover.
    pub narrow: f64,
    /// Distance in pixels, there and back, within which two photographs agree; 1.
    pub pixels: f32,
    /// Difference of log depth within which they agree.
    pub log_depth: f32,
    /// Least verified share of a photograph for its depths to be used in others, or to be replaced by a median; .15.
    pub min_verified: f32,
}

impl Default for ConsensusConfig {
    fn default() -> Self {
        Self {
            sweep: SweepConfig::default(),
            wide: 3.0,
            narrow: 2.0,
            pixels: 1.0,
            log_depth: 0.1,
            min_verified: 0.15,
        }
    }
}

/// What all photographs say about one.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ViewDepth {
    /// From the prior's depths to the unit of the poses.
    pub gauge: Gauge,
    /// The gauged prior with its variance.
    pub prior: GaussianDepth,
    /// The gauged prior after the smooth correction by the first sweeps: the centre of the last.
    pub centre: Array2<f32>,
    /// Its own sweep.
    pub sweep: Sweep,
    /// The sweep fused with the prior.
    pub fused: GaussianDepth,
    /// The consensus: depth and variance in the unit of the poses.
    pub depth: GaussianDepth,
    /// Number of other photographs whose sweeps agree.
    pub support: Array2<u8>,
    /// Those and all others.
    pub agreement: Agreement,
    /// Probability that the sweep's match is right, 0 to 1.
    pub inlier: Array2<f32>,
    /// Share of the pixels on which at least one other photograph agrees.
    pub verified: f32,
}

/// How many other views agree with each pixel's depth, and how many see past it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Agreement {
    /// Views whose depth, carried back, lands on the pixel.
    pub agree: Array2<u8>,
    /// Views that see something behind the point, where it would hide it.
    pub against: Array2<u8>,
    /// Views on whose image the point lands, where their depth is known.
    pub visible: Array2<u8>,
}

/// Compares the depth of `views[reference]` with those of `others`: there and back within `pixels` and `log_depth`.
///
/// A view that sees something nearer says nothing: the point may be hidden there.
///
/// # Errors
/// [`Error::Reference`] for an index outside the views, [`Error::View`] for a map of another size.
pub fn agreement(
    views: &[PosedView],
    depths: &[&GaussianDepth],
    reference: usize,
    others: &[usize],
    [pixels, log_depth]: [f32; 2],
) -> Result<Agreement> {
    let missing = |i: usize| Error::Reference { reference: i, views: views.len().min(depths.len()) };
    let of = |i: usize| -> Result<(&PosedView, &GaussianDepth)> { Ok((views.get(i).ok_or(missing(i))?, *depths.get(i).ok_or(missing(i))?)) };
    let (from, depth) = of(reference)?;
    check_map("depth", depth.dim(), &from.camera)?;
    let mut agree = Array2::zeros(depth.dim());
    let mut against: Array2<u8> = Array2::zeros(depth.dim());
    let mut visible: Array2<u8> = Array2::zeros(depth.dim());
    for &other in others.iter().filter(|&&i| i != reference) {
        let (to, there) = of(other)?;
        check_map("depth", there.dim(), &to.camera)?;
        let (forth, back) = (Transfer::new(from, to), Transfer::new(to, from));
        let mut rows: Vec<_> = agree.outer_iter_mut().zip(against.outer_iter_mut()).zip(visible.outer_iter_mut()).enumerate().collect();
        rows.par_iter_mut().for_each(|(y, ((agree, against), visible))| {
            for x in 0..agree.len() {
                let Some((z, _)) = depth.get(*y, x).filter(|(z, _)| *z > 0.0) else { continue };
                let Some(seen) = forth.at(x as f64, *y as f64, 1.0 / f64::from(z)) else { continue };
                let Some((v, u)) = forth.nearest(&seen) else { continue };
                let Some((z_there, _)) = there.get(v, u).filter(|(z, _)| *z > 0.0) else { continue };
                visible[x] += 1;
                let expected = f64::from(z) * seen.ratio;
                let difference = (f64::from(z_there) / expected).ln();
                let distance = back
                    .at(seen.x, seen.y, 1.0 / f64::from(z_there))
                    .map_or(f64::INFINITY, |b| (b.x - x as f64).hypot(b.y - *y as f64));
                if distance <= f64::from(pixels) && difference.abs() <= f64::from(log_depth) {
                    agree[x] += 1;
                } else if difference > 0.0 {
                    against[x] += 1;
                }
            }
        });
    }
    Ok(Agreement { agree, against, visible })
}

/// The sweep of a photograph and its gauged prior as one map: the prior's smooth error is corrected by the sweep, then
/// both are fused by precision, the sweep being right with a probability only.
struct Fused {
    depth: GaussianDepth,
    /// Probability that the sweep is right.
    inlier: Array2<f32>,
    /// The prior after the correction.
    corrected: Array2<f32>,
}

fn fuse(
    view: &PosedView,
    prior: &GaussianDepth,
    sweep: &Sweep,
    chance: &Array2<f32>,
    factor: f64,
) -> Result<Fused> {
    let shape = prior.dim();
    let log_prior = prior.mean().mapv(|z| if z > 0.0 { z.ln() } else { f32::NAN });
    let residual = Zip::from(&log_prior).and(sweep.depth.mean()).map_collect(|&p, &z| {
        let r = if z > 0.0 { z.ln() - p } else { 0.0 };
        if r.is_finite() { r } else { 0.0 }
    });
    let known =
        |y: usize, x: usize| sweep.depth.get(y, x).filter(|(z, _)| *z > 0.0 && log_prior[(y, x)].is_finite());
    let trusted = |c: f32| if c > TRUSTED { c } else { 0.0 };
    let weight =
        Array2::from_shape_fn(shape, |(y, x)| known(y, x).map_or(0.0, |_| trusted(chance[(y, x)])));
    let spread =
        robust_deviation(residual.iter().zip(&weight).filter(|(_, w)| **w > 0.0).map(|(r, _)| f64::from(*r)));
    let spread = spread.unwrap_or(0.2).clamp(0.02, 1.0) as f32;
    let filled = log_prior.mapv(|p| if p.is_finite() { p } else { 0.0 });
    let guide = Guide::new(luma(view.image.view()).view(), filled.view(), EDGES);
    let field = correct(&residual, &weight, &guide, spread);
    // A wrong match lies anywhere among the surfaces.
    let anywhere = 1.0 / (2.0 * factor.ln()) as f32;
    let (mut mean, mut variance) = (Array2::zeros(shape), Array2::from_elem(shape, f32::INFINITY));
    let mut inlier = Array2::zeros(shape);
    let mut corrected = Array2::zeros(shape);
    for (at, &p) in log_prior.indexed_iter() {
        if !p.is_finite() {
            if let Some((z, v)) = sweep.depth.get(at.0, at.1) {
                (mean[at], variance[at], inlier[at]) = (z, v, chance[at]);
            }
            continue;
        }
        let (u, s) = (field.mean[at], field.variance[at]);
        let (mut m, mut v) = (u, s);
        if let Some((z, var)) = known(at.0, at.1) {
            let (r, var) = (residual[at], var / (z * z));
            let total = s + var;
            let density = (-0.5 * (r - u).powi(2) / total).exp() / (std::f32::consts::TAU * total).sqrt();
            let good = chance[at] * density;
            let probability = good / (good + (1.0 - chance[at]) * anywhere).max(1e-20);
            let gain = s / total;
            let (m1, v1) = (u + gain * (r - u), gain * var);
            m = probability * m1 + (1.0 - probability) * u;
            v = probability * (v1 + (m1 - m).powi(2)) + (1.0 - probability) * (s + (u - m).powi(2));
            inlier[at] = probability;
        }
        let z = (p + m).exp();
        (mean[at], variance[at]) = (z, z * z * v);
        corrected[at] = (p + u).exp();
    }
    Ok(Fused { depth: GaussianDepth::new(mean, variance)?, inlier, corrected })
}

/// Coefficients of [`chances`]: constant, log odds of the posterior mass, per visible photograph that does not agree, none
/// agrees, cost. A logistic regression of "within 10 % of the truth" over 11 indoor captures.
const CHANCE: [f32; 5] = [1.2, 0.3, -0.4, -1.4, -1.3];

/// Probability that a match is right, from its posterior mass, its cost and the other photographs.
fn chances(sweep: &Sweep, agreement: &Agreement) -> Array2<f32> {
    let mut chance = Zip::from(&sweep.inlier)
        .and(&sweep.cost)
        .and(&agreement.agree)
        .and(&agreement.visible)
        .map_collect(|&mass, &cost, &agree, &visible| {
            let odds = (mass.max(1e-3) / (1.0 - mass).max(0.02)).ln();
            let none = if agree == 0 { 1.0 } else { 0.0 };
            let terms = [1.0, odds, f32::from(visible - agree), none, cost];
            let logit: f32 = CHANCE.iter().zip(terms).map(|(c, t)| c * t).sum();
            1.0 / (1.0 + (-logit).exp())
        });
    // The best surface at either end is no match.
    Zip::from(&mut chance).and(&sweep.inlier).for_each(|c, &mass| {
        if mass == 0.0 {
            *c = 0.0;
        }
    });
    chance
}

/// Everything of one scene.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Reconstruction {
    /// The common factor of the priors; nothing where the photographs agree on none.
    pub scale: Option<Scale>,
    /// One for each view.
    pub views: Vec<ViewDepth>,
}

/// Depth and variance of every photograph, from poses, sweeps and priors.
///
/// `priors` are z-depths `[height, width]`, one for each view, in any unit (one for all); 0 where unknown. Depths come in
/// the unit of the poses.
///
/// # Errors
/// [`Error::TooFewViews`] for fewer than two views, [`Error::View`] for a map of another size than its camera, and what
/// [`sweep`] refuses.
pub fn reconstruct(
    views: &[PosedView],
    priors: &[ArrayView2<'_, f32>],
    config: &ConsensusConfig,
) -> Result<Reconstruction> {
    if views.len() < 2 || priors.len() != views.len() {
        return Err(Error::TooFewViews { views: views.len().min(priors.len()) });
    }
    for (view, prior) in views.iter().zip(priors) {
        view.validate()?;
        check_map("prior", prior.dim(), &view.camera)?;
    }
    let everyone: Vec<usize> = (0..views.len()).collect();
    let small = views.iter().map(|v| small_view(v, SMALL)).collect::<Result<Vec<_>>>()?;
    let small_priors: Vec<Array2<f32>> =
        priors.iter().zip(&small).map(|(p, v)| small_map(p, v.camera.dim())).collect();

    // One factor for all, from sweeps over every scale.
    let ladders = everyone
        .iter()
        .map(|&i| {
            let surfaces = Surfaces::Ladder { depth: small_priors[i].view(), factor: UNKNOWN };
            sweep(&small, i, &everyone, surfaces, &config.sweep)
        })
        .collect::<Result<Vec<_>>>()?;
    let depths: Vec<&GaussianDepth> = ladders.iter().map(|s| &s.depth).collect();
    let mut all = Vec::new();
    for i in 0..views.len() {
        let agreement = agreement(&small, &depths, i, &everyone, [config.pixels, config.log_depth])?;
        all.extend(matches_of(&small_priors[i], &ladders[i], &chances(&ladders[i], &agreement), i));
    }
    let scale = Scale::fit(&all);
    let factor = scale.map_or(0.0, |s| s.log_scale).exp() as f32;

    // Gauge and smooth correction of each prior, from sweeps around the scaled prior.
    let scaled: Vec<Array2<f32>> = small_priors.iter().map(|p| p.mapv(|z| factor * z)).collect();
    let wide = everyone
        .iter()
        .map(|&i| {
            let surfaces = Surfaces::Around { depth: scaled[i].view(), factor: config.wide };
            sweep(&small, i, &everyone, surfaces, &config.sweep)
        })
        .collect::<Result<Vec<_>>>()?;
    let depths: Vec<&GaussianDepth> = wide.iter().map(|s| &s.depth).collect();
    let fallback = scale.unwrap_or(Scale { log_scale: 0.0, variance: 1.0, spread: 0.3, matches: 0 });
    let mut gauges = Vec::new();
    let mut centres = Vec::new();
    for i in 0..views.len() {
        let agreement = agreement(&small, &depths, i, &everyone, [config.pixels, config.log_depth])?;
        let chance = chances(&wide[i], &agreement);
        let matches = matches_of(&small_priors[i], &wide[i], &chance, i);
        let gauge = Gauge::fit(&matches).unwrap_or_else(|| Gauge::from_scale(&fallback));
        let prior = gauge.apply(small_priors[i].view())?;
        let fused = fuse(&small[i], &prior, &wide[i], &chance, config.wide)?;
        // The correction is smooth, so it may be enlarged; the prior keeps its own details.
        let ratio = Zip::from(&fused.corrected).and(prior.mean()).map_collect(|&c, &p| {
            let r = (c / p).ln();
            if r.is_finite() { r } else { 0.0 }
        });
        let (h, w) = views[i].camera.dim();
        let ratio = enlarge(&ratio, h, w);
        let full = gauge.apply(priors[i])?;
        centres.push(Zip::from(&ratio).and(full.mean()).map_collect(|&r, &p| p * r.exp()));
        gauges.push((gauge, full));
    }

    // The last sweeps.
    let fine = everyone
        .iter()
        .map(|&i| {
            let surfaces = Surfaces::Around { depth: centres[i].view(), factor: config.narrow };
            sweep(views, i, &everyone, surfaces, &config.sweep)
        })
        .collect::<Result<Vec<_>>>()?;
    let depths: Vec<&GaussianDepth> = fine.iter().map(|s| &s.depth).collect();
    let mut fused = Vec::new();
    for i in 0..views.len() {
        let agreement = agreement(views, &depths, i, &everyone, [config.pixels, config.log_depth])?;
        let chance = chances(&fine[i], &agreement);
        let shape = chance.dim();
        let variance = Zip::from(&centres[i]).and(gauges[i].1.variance()).map_collect(|_, &v| v);
        let centre = GaussianDepth::new(centres[i].clone(), variance)?;
        let map = fuse(&views[i], &centre, &fine[i], &chance, config.narrow)?;
        let verified = agreement.agree.iter().filter(|a| **a > 0).count() as f32 / (shape.0 * shape.1) as f32;
        fused.push((map, agreement, verified));
    }
    let results: Vec<GaussianDepth> =
        (0..views.len()).into_par_iter().map(|i| median(views, &fused, i, config)).collect::<Result<_>>()?;
    let views = fused
        .into_iter()
        .zip(results)
        .zip(gauges)
        .zip(fine.into_iter().zip(centres))
        .map(|(((f, depth), (gauge, prior)), (sweep, centre))| ViewDepth {
            centre,
            gauge,
            prior,
            sweep,
            fused: f.0.depth,
            depth,
            support: f.1.agree.clone(),
            agreement: f.1,
            inlier: f.0.inlier,
            verified: f.2,
        })
        .collect();
    Ok(Reconstruction { scale, views })
}

/// Weighted median in log depth over a photograph's own map and the others' carried into it.
fn median(
    views: &[PosedView],
    maps: &[(Fused, Agreement, f32)],
    reference: usize,
    config: &ConsensusConfig,
) -> Result<GaussianDepth> {
    let own = &maps[reference].0.depth;
    if maps[reference].2 < config.min_verified {
        return Ok(own.clone());
    }
    let shape = own.dim();
    let mut carried = Vec::new();
    for (i, (map, _, verified)) in maps.iter().enumerate() {
        if i != reference && *verified >= config.min_verified {
            carried.push(splat(&views[i], &map.depth, &views[reference], shape));
        }
    }
    let (mut mean, mut variance) = (own.mean().to_owned(), own.variance().to_owned());
    let mut candidates = Vec::new();
    for y in 0..shape.0 {
        for x in 0..shape.1 {
            let Some((z, v)) = own.get(y, x).filter(|(z, _)| *z > 0.0) else { continue };
            candidates.clear();
            let floor = 1e-4;
            let mine = v / (z * z);
            candidates.push((z.ln(), 1.0 / (mine + floor)));
            for map in &carried {
                let (log, v) = map[(y, x)];
                if v.is_finite() {
                    candidates.push((log, 1.0 / (v + floor)));
                }
            }
            let Some(log) = weighted_quantile(&mut candidates, 0.5) else { continue };
            let total: f32 = candidates.iter().map(|c| c.1).sum();
            let spread: f32 =
                candidates.iter().map(|c| c.1 * (c.0 - log).powi(2).min(1.0)).sum::<f32>() / total;
            let z = log.exp();
            mean[(y, x)] = z;
            // Maps of one scene share their errors: the mean of the variances, and the spread between maps.
            variance[(y, x)] = z * z * (candidates.len() as f32 / total + spread);
        }
    }
    Ok(GaussianDepth::new(mean, variance)?)
}

/// Log depth and its variance of one view's map seen from another, the nearest where several land.
fn splat(
    from: &PosedView,
    depth: &GaussianDepth,
    to: &PosedView,
    shape: (usize, usize),
) -> Array2<(f32, f32)> {
    let transfer = Transfer::new(from, to);
    let mut out = Array2::from_elem(shape, (f32::INFINITY, f32::INFINITY));
    for ((y, x), &z) in depth.mean().indexed_iter() {
        let v = depth.variance()[(y, x)];
        if !(z > 0.0 && v.is_finite()) {
            continue;
        }
        let Some(seen) = transfer.at(x as f64, y as f64, 1.0 / f64::from(z)) else { continue };
        let Some(at) = transfer.nearest(&seen) else { continue };
        let there = (f64::from(z) * seen.ratio).ln() as f32;
        if there < out[at].0 {
            out[at] = (there, v / (z * z));
        }
    }
    out
}

fn small_map(map: &ArrayView2<'_, f32>, (h, w): (usize, usize)) -> Array2<f32> {
    if map.dim() == (h, w) {
        return map.to_owned();
    }
    let whole = map.iter().all(|z| *z > 0.0 && z.is_finite());
    if whole {
        let cube = map.insert_axis(ndarray::Axis(2));
        shrink(cube, h, w).index_axis_move(ndarray::Axis(2), 0)
    } else {
        pick(&map.to_owned(), h, w)
    }
}

/// Pixels of one photograph that are probably right, each in its patch of the image.
fn matches_of(prior: &Array2<f32>, sweep: &Sweep, chance: &Array2<f32>, photograph: usize) -> Vec<Match> {
    let (h, w) = prior.dim();
    let side = (h.max(w) / PATCHES).max(1);
    prior
        .indexed_iter()
        .filter_map(|((y, x), &prior)| {
            let (depth, _) = sweep.depth.get(y, x)?;
            let weight = chance[(y, x)];
            let patch = ((photograph * 1024 + y / side) * 1024 + x / side) as u32;
            (weight > TRUSTED).then_some(Match { prior, depth, weight, patch })
        })
        .collect()
}
