//! Depth of every photograph from all of them, without a field.
//!
//! [`reconstruct`] runs the whole stage: scale, gauge, sweeps of every photograph, their agreement, the fusion with the
//! gauged prior, and the median over photographs.

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::quantile;
use mde_warp::PosedView;
use ndarray::{Array2, ArrayView2, Zip};
use rayon::prelude::*;

use crate::correction::{Guide, correct};
use crate::gauge::{Gauge, Match, PATCHES, Scale};
use crate::geometry::Transfer;
use crate::raster::{enlarge, luma, small_map, small_view};
use crate::statistics::{robust_deviation, weighted_quantile};
use crate::sweep::{Surfaces, Sweep, SweepConfig, sweep};
use crate::{Error, Result, check_map};

/// Longer side of the photographs on which scale and gauge are found.
const SMALL: usize = 160;
/// A prior without any gauge may be wrong by this factor.
const UNKNOWN: f64 = 32.0;
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
    /// The factor about the corrected prior that the last sweeps cover; 1.5.
    pub narrow: f64,
    /// Distance in pixels, there and back, within which two photographs agree; 1.
    pub pixels: f32,
    /// Difference of log depth within which they agree; .1.
    pub log_depth: f32,
    /// Least verified share of a photograph for its depths to be used in others, or to be replaced by a median; .15.
    pub min_verified: f32,
}

impl Default for ConsensusConfig {
    fn default() -> Self {
        Self {
            sweep: SweepConfig::default(),
            wide: 3.0,
            narrow: 1.5,
            pixels: 1.0,
            log_depth: 0.1,
            min_verified: 0.15,
        }
    }
}

impl ConsensusConfig {
    /// Checks the settings.
    ///
    /// # Errors
    /// [`Error::Config`] that names the first field at fault.
    pub fn validate(&self) -> Result<()> {
        self.sweep.validate()?;
        for (field, value) in [("wide", self.wide), ("narrow", self.narrow)] {
            if !(value > 1.0 && value.is_finite()) {
                return Err(Error::config(field, value, "give a factor above 1"));
            }
        }
        for (field, value) in [("pixels", self.pixels), ("log-depth", self.log_depth)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::config(field, value, "give a positive number"));
            }
        }
        if !(0.0..=1.0).contains(&self.min_verified) {
            return Err(Error::config("min-verified", self.min_verified, "give a share between 0 and 1"));
        }
        Ok(())
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
    let of = |i: usize| -> Result<(&PosedView, &GaussianDepth)> {
        Ok((views.get(i).ok_or(missing(i))?, *depths.get(i).ok_or(missing(i))?))
    };
    let (from, depth) = of(reference)?;
    check_map("depth", depth.dim(), &from.camera)?;
    let mut agree = Array2::zeros(depth.dim());
    let mut against: Array2<u8> = Array2::zeros(depth.dim());
    let mut visible: Array2<u8> = Array2::zeros(depth.dim());
    for &other in others.iter().filter(|&&i| i != reference) {
        let (to, there) = of(other)?;
        check_map("depth", there.dim(), &to.camera)?;
        let (forth, back) = (Transfer::new(from, to), Transfer::new(to, from));
        let mut rows: Vec<_> = agree
            .outer_iter_mut()
            .zip(against.outer_iter_mut())
            .zip(visible.outer_iter_mut())
            .enumerate()
            .collect();
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
    let weight = Array2::from_shape_fn(shape, |(y, x)| known(y, x).map_or(0.0, |_| trusted(chance[(y, x)])));
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
    let mut chance =
        Zip::from(&sweep.inlier).and(&sweep.cost).and(&agreement.agree).and(&agreement.visible).map_collect(
            |&mass, &cost, &agree, &visible| {
                let odds = (mass.max(1e-3) / (1.0 - mass).max(0.02)).ln();
                let none = if agree == 0 { 1.0 } else { 0.0 };
                let terms = [1.0, odds, f32::from(visible - agree), none, cost];
                let logit: f32 = CHANCE.iter().zip(terms).map(|(c, t)| c * t).sum();
                1.0 / (1.0 + (-logit).exp())
            },
        );
    // The best surface at either end is no match.
    Zip::from(&mut chance).and(&sweep.inlier).for_each(|c, &mass| {
        if mass == 0.0 {
            *c = 0.0;
        }
    });
    chance
}

/// Pixel by pixel the match that is more probably right: the second only where the first is not trusted.
fn better(
    first: &Sweep,
    first_chance: &Array2<f32>,
    second: &Sweep,
    second_chance: &Array2<f32>,
) -> Result<(Sweep, Array2<f32>)> {
    let mut best = first.clone();
    let mut chance = first_chance.clone();
    let (mut mean, mut variance) = best.depth.into_parts();
    for (at, c) in chance.indexed_iter_mut() {
        if *c <= TRUSTED && second_chance[at] > TRUSTED {
            *c = second_chance[at];
            mean[at] = second.depth.mean()[at];
            variance[at] = second.depth.variance()[at];
            best.inlier[at] = second.inlier[at];
            best.cost[at] = second.cost[at];
        }
    }
    best.depth = GaussianDepth::new(mean, variance)?;
    Ok((best, chance))
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
/// the unit of the poses. `scale`, where it is known (from sparse points, say), saves the search for it; without it
/// any factor between 1/32 and 32 is found.
///
/// # Errors
/// [`Error::TooFewViews`] for fewer than two views, [`Error::View`] for a map of another size than its camera, and what
/// [`sweep`] refuses.
pub fn reconstruct(
    views: &[PosedView],
    priors: &[ArrayView2<'_, f32>],
    scale: Option<Scale>,
    config: &ConsensusConfig,
) -> Result<Reconstruction> {
    config.validate()?;
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

    let scale = match scale {
        Some(known) => Some(known),
        None => common_scale(&small, &small_priors, config)?,
    };
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
    // The whole range, from the nearest that the prior may mean to infinity: where the prior is wrong by more.
    let whole = everyone
        .iter()
        .map(|&i| {
            let mut known: Vec<f64> = scaled[i].iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)).collect();
            let near = quantile(&mut known, 0.01).unwrap_or(1.0) / config.wide;
            sweep(&small, i, &everyone, Surfaces::Planes { near, far: f64::INFINITY }, &config.sweep)
        })
        .collect::<Result<Vec<_>>>()?;
    let whole_depths: Vec<&GaussianDepth> = whole.iter().map(|s| &s.depth).collect();
    let fallback = scale.unwrap_or(Scale { log_scale: 0.0, variance: 1.0, spread: 0.3, matches: 0 });
    let mut gauges = Vec::new();
    let mut centres = Vec::new();
    for i in 0..views.len() {
        let agreement = agreement(&small, &depths, i, &everyone, [config.pixels, config.log_depth])?;
        let chance = chances(&wide[i], &agreement);
        let agreement =
            self::agreement(&small, &whole_depths, i, &everyone, [config.pixels, config.log_depth])?;
        let whole_chance = chances(&whole[i], &agreement);
        let (best, chance) = better(&wide[i], &chance, &whole[i], &whole_chance)?;
        let matches = matches_of(&small_priors[i], &best, &chance, i);
        let gauge = Gauge::fit(&matches).unwrap_or_else(|| Gauge::from_scale(&fallback));
        let prior = gauge.apply(small_priors[i].view())?;
        let fused = fuse(&small[i], &prior, &best, &chance, config.wide)?;
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
    let inflation = inflation(views, &fused);
    for (map, _, _) in &mut fused {
        map.depth = map.depth.clone().map(|m, v| (m, inflation * v));
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

/// One factor for all priors, from sweeps over every scale.
fn common_scale(
    views: &[PosedView],
    priors: &[Array2<f32>],
    config: &ConsensusConfig,
) -> Result<Option<Scale>> {
    let everyone: Vec<usize> = (0..views.len()).collect();
    let sweeps = everyone
        .iter()
        .map(|&i| {
            let surfaces = Surfaces::Ladder { depth: priors[i].view(), factor: UNKNOWN };
            sweep(views, i, &everyone, surfaces, &config.sweep)
        })
        .collect::<Result<Vec<_>>>()?;
    let depths: Vec<&GaussianDepth> = sweeps.iter().map(|s| &s.depth).collect();
    let mut matches = Vec::new();
    for i in 0..views.len() {
        let agreement = agreement(views, &depths, i, &everyone, [config.pixels, config.log_depth])?;
        matches.extend(matches_of(&priors[i], &sweeps[i], &chances(&sweeps[i], &agreement), i));
    }
    Ok(Scale::fit(&matches))
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
    for (i, (map, agreement, verified)) in maps.iter().enumerate() {
        if i != reference && *verified >= config.min_verified {
            carried.push(splat(&views[i], map, agreement, &views[reference]));
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
            // Maps of one scene share their errors: the (harmonic) mean of the variances, and the spread of the maps.
            variance[(y, x)] = z * z * (candidates.len() as f32 / total + spread);
        }
    }
    Ok(GaussianDepth::new(mean, variance)?)
}

/// What variances must be multiplied by for the maps of different photographs to differ as they say, at least 1.
///
/// Matches of neighbours share their errors, so that variances which take them as independent are too small. Where two
/// verified maps meet, 90 % of the differences should lie within 1.645 standard deviations.
fn inflation(views: &[PosedView], maps: &[(Fused, Agreement, f32)]) -> f32 {
    let pairs: Vec<(usize, usize)> = (0..views.len())
        .flat_map(|i| (0..views.len()).map(move |j| (i, j)))
        .filter(|(i, j)| i != j)
        .collect();
    let mut scores: Vec<f64> = pairs
        .par_iter()
        .flat_map_iter(|&(i, j)| {
            let carried = splat(&views[j], &maps[j].0, &maps[j].1, &views[i]);
            let (own, agreement) = (&maps[i].0.depth, &maps[i].1.agree);
            let score = |((y, x), &(log, v)): ((usize, usize), &(f32, f32))| {
                let (z, variance) = own.get(y, x).filter(|(z, _)| *z > 0.0)?;
                let seen = v.is_finite() && agreement[(y, x)] > 0;
                let total = v + variance / (z * z);
                (seen && total > 0.0).then(|| f64::from((log - z.ln()).powi(2) / total))
            };
            carried.indexed_iter().step_by(7).filter_map(score).collect::<Vec<_>>()
        })
        .collect();
    let high = quantile(&mut scores, 0.9).unwrap_or(1.0);
    (high / 1.645_f64.powi(2)).clamp(1.0, 1e4) as f32
}

/// Log depth and its variance of one view's verified pixels seen from another, the nearest where several land.
fn splat(from: &PosedView, map: &Fused, agreement: &Agreement, to: &PosedView) -> Array2<(f32, f32)> {
    let transfer = Transfer::new(from, to);
    let mut out = Array2::from_elem(to.camera.dim(), (f32::INFINITY, f32::INFINITY));
    for ((y, x), &z) in map.depth.mean().indexed_iter() {
        let v = map.depth.variance()[(y, x)];
        let verified = agreement.agree[(y, x)] > 0 && map.inlier[(y, x)] > TRUSTED;
        if !(verified && z > 0.0 && v.is_finite()) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{Plane, scene};

    const CENTRES: [[f64; 3]; 4] = [[0.0; 3], [0.25, 0.0, 0.0], [-0.2, 0.1, 0.0], [0.0, -0.2, 0.1]];

    /// Two slanted walls that meet, and priors of them in a unit of their own, with a smooth error of 20 %.
    fn room(unit: f32) -> (Vec<PosedView>, Vec<Array2<f32>>, Vec<Array2<f32>>) {
        let planes = [Plane::slanted(2.0, 0.5, 0.1), Plane::slanted(2.1, -0.6, 0.0)];
        let (views, depths) = scene(&planes, (72, 96), &CENTRES);
        let bend = |x: usize| 1.0 + 0.2 * (x as f32 / 15.0).sin();
        let priors = depths
            .iter()
            .map(|d| Array2::from_shape_fn(d.dim(), |(y, x)| unit * bend(x + y / 2) * d[(y, x)]));
        let priors = priors.collect();
        (views, depths, priors)
    }

    fn error(map: ArrayView2<'_, f32>, truth: &Array2<f32>) -> f64 {
        let sum: f64 = map.iter().zip(truth).map(|(z, t)| f64::from((z / t - 1.0).abs())).sum();
        sum / truth.len() as f64
    }

    #[test]
    fn the_scale_is_found_and_the_prior_corrected() {
        let (views, depths, priors) = room(0.13);
        let maps: Vec<_> = priors.iter().map(|p| p.view()).collect();
        let found = reconstruct(&views, &maps, None, &ConsensusConfig::default()).unwrap();
        let scale = found.scale.unwrap().log_scale.exp();
        assert!((scale * 0.13 - 1.0).abs() < 0.15, "scale {scale}");
        for (view, truth) in found.views.iter().zip(&depths) {
            let (gauged, fused) = (error(view.prior.mean(), truth), error(view.fused.mean(), truth));
            let after = error(view.depth.mean(), truth);
            assert!(
                gauged > 0.05 && fused < 0.5 * gauged && after < 0.5 * gauged,
                "{gauged} {fused} {after}"
            );
            assert!(view.verified > 0.5);
        }
        // The same unit given from outside saves the search and changes little.
        let known = reconstruct(&views, &maps, found.scale, &ConsensusConfig::default()).unwrap();
        assert!(error(known.views[0].depth.mean(), &depths[0]) < 0.04);
    }

    /// Nothing in common, nothing gained: the gauged prior comes back, and no median of foreign maps.
    #[test]
    fn photographs_of_nothing_in_common_leave_the_prior() {
        let (mut views, _, priors) = room(1.0);
        for (i, view) in views.iter_mut().enumerate() {
            let mut state = i as u32 + 1;
            view.image.mapv_inplace(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 24) as f32
            });
        }
        let maps: Vec<_> = priors.iter().map(|p| p.view()).collect();
        let found = reconstruct(&views, &maps, None, &ConsensusConfig::default()).unwrap();
        let view = &found.views[0];
        assert!(view.verified < 0.3, "{}", view.verified);
        let ratio = Zip::from(view.depth.mean()).and(&priors[0]).map_collect(|z, p| f64::from((z / p).ln()));
        let spread = robust_deviation(ratio.iter().map(|r| r - ratio.mean().unwrap()));
        assert!(spread.unwrap() < 0.2, "{spread:?}");
    }

    #[test]
    fn agreement_is_counted_there_and_back() {
        let (views, depths, _) = room(1.0);
        let exact =
            |d: &Array2<f32>| GaussianDepth::new(d.clone(), Array2::from_elem(d.dim(), 1e-4)).unwrap();
        let mut maps: Vec<GaussianDepth> = depths.iter().map(exact).collect();
        let count = |maps: &[GaussianDepth]| {
            let maps: Vec<&GaussianDepth> = maps.iter().collect();
            agreement(&views, &maps, 0, &[0, 1, 2, 3], [1.0, 0.1]).unwrap()
        };
        let before = count(&maps);
        let middle = (36, 48);
        assert_eq!((before.agree[middle], before.against[middle], before.visible[middle]), (3, 0, 3));
        // Too near: all others see past it. Too far: it may be hidden from them.
        maps[0] = exact(&depths[0].mapv(|z| 0.7 * z));
        let near = count(&maps);
        assert_eq!((near.agree[middle], near.against[middle]), (0, 3));
        maps[0] = exact(&depths[0].mapv(|z| 1.4 * z));
        let far = count(&maps);
        assert_eq!((far.agree[middle], far.against[middle]), (0, 0));
    }

    #[test]
    fn too_few_views_are_named() {
        let (views, _, priors) = room(1.0);
        let found = reconstruct(&views[..1], &[priors[0].view()], None, &ConsensusConfig::default());
        assert_eq!(found, Err(Error::TooFewViews { views: 1 }));
    }
}
