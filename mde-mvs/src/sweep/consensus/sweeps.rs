//! The sweeps of a capture, each computed once.

use mde_uncertainty::GaussianDepth;
use mde_uncertainty::statistics::quantile;
use mde_warp::PosedView;
use ndarray::{ArcArray2, Array2, Zip};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::agreement::shown;
use super::chance::{TRUSTED, better, chances};
use super::fuse::{Fused, fuse, inflation};
use super::{Agreement, Reconstruction, ViewDepth, agreement, matches_of};
use crate::raster::{enlarge, small_map, small_view};
use crate::statistics::is_flat;
use crate::sweep::scale::{Gauge, Scale};
use crate::sweep::{Surfaces, Sweep, sweep, working_bytes};
use crate::{Callback, Error, Result, notify};

/// Longer side of the photographs on which scale, gauge and the smooth corrections are found.
const SMALL: usize = 160;
/// Factor by which a prior of unknown scale may be wrong.
const UNKNOWN: f64 = 32.0;
/// The factor about the scaled prior that the first sweeps cover.
const WIDE: f64 = 3.0;
/// The same towards the camera of a prior that is constant, where more than one in so many pixels match nearer than the other sweeps reach:
/// a wrong near match costs more than a wrong one among the rest. Of 13 captures with nothing so near it were at most .8 %.
const NEAREST: f64 = 12.0;
const NEAR_SHARE: usize = 100;
/// The factor about the corrected prior that the last sweeps cover.
const NARROW: f64 = 1.5;
/// Photographs whose last sweeps are kept: on a walk, those that the next photographs share.
const KEPT: usize = 22;

/// A view of a capture by its index; its pixels may be read from a file each time.
pub type ReadView<'r> = dyn Fn(usize) -> Result<PosedView> + Sync + 'r;
/// The prior of a view by its index: z-depth `[height, width]`, 0 where unknown, in one unit for all.
pub type ReadPrior<'r> = dyn Fn(usize) -> Array2<f32> + Sync + 'r;

/// Plane sweeps of a capture. Each photograph is swept against sources of its own, which alone confirm its depth, when a result first needs
/// that. Sweeps and depths of 22 photographs are kept for the results that follow. A result does not depend on those before it.
#[derive(Debug)]
pub struct Sweeps {
    sources: Vec<Vec<usize>>,
    small: Vec<PosedView>,
    priors: Vec<Array2<f32>>,
    /// The common factor of the priors.
    pub scale: Option<Scale>,
    coarse: BTreeMap<usize, Coarse>,
    fine: BTreeMap<usize, Fine>,
    maps: BTreeMap<usize, Map>,
    /// Those with a last sweep, the latest used at the end.
    used: Vec<usize>,
    /// Those of which there was a result.
    done: BTreeSet<usize>,
}

/// Sweeps of the small photograph: about the scaled prior, and over the whole range, where the prior is wrong by more.
#[derive(Debug)]
struct Coarse {
    wide: Sweep,
    whole: Sweep,
    /// The least depth of the whole range; of a constant prior also a sweep that begins nearer.
    least: f32,
    near: Option<Sweep>,
}

/// The sweep about the corrected prior.
#[derive(Debug)]
struct Fine {
    gauge: Gauge,
    /// The gauged and corrected prior.
    centre: Array2<f32>,
    sweep: Sweep,
}

/// The consensus of a photograph with its sources.
#[derive(Debug)]
pub(super) struct Map {
    pub(super) depth: GaussianDepth,
    /// Where the sweep is probably right and a source agrees.
    pub(super) sure: Array2<bool>,
    ambiguity: ArcArray2<f32>,
    pub(super) agreement: Arc<Agreement>,
    /// Share of the pixels on which at least one source agrees.
    verified: f32,
}

/// Bytes that [`Sweeps`] of that many views, of which a result has `members`, takes beside its inputs: the maps that are kept with the
/// working memory of one sweep or, later, those of a result.
pub fn sweeps_bytes(pixels: u64, views: u64, members: u64) -> u64 {
    // Of each photograph that is kept two means with variances, four maps of numbers and three of bytes; in the result two more means,
    // a photograph and its luma between pixels.
    let kept = views.min((KEPT as u64).max(2 * members)).saturating_mul(2 * 8 + 4 * 4 + 3);
    let of_result = members.saturating_mul(2 * 8 + 12 + 16);
    let working = working_bytes(pixels, members.saturating_sub(1));
    // All small photographs with their priors; three sweeps of those that are kept and of their sources.
    let swept = views.min(3 * KEPT as u64).saturating_mul(3 * 16);
    let small = views.saturating_mul(17).saturating_add(swept).saturating_mul((SMALL * SMALL) as u64);
    let later = working.max(pixels.saturating_mul(of_result));
    pixels.saturating_mul(kept).saturating_add(later).saturating_add(small)
}

impl Sweeps {
    /// For views with these sources, each by index in order; a view may be among its own.
    ///
    /// # Errors
    /// [`Error::Reference`] for a source that is none of the views, [`Error::View`] for a map of another size than its camera, and the
    /// errors of `view`.
    pub fn new(view: &ReadView<'_>, prior: &ReadPrior<'_>, sources: Vec<Vec<usize>>) -> Result<Self> {
        let views = sources.len();
        if let Some(&reference) = sources.iter().flatten().find(|&&source| source >= views) {
            return Err(Error::Reference { reference, views });
        }
        let small = |i: usize| {
            let (view, prior) = (view(i)?, prior(i));
            view.validate()?;
            view.camera.check_map("prior", prior.dim())?;
            let small = small_view(&view, SMALL)?;
            let prior = small_map(&prior.view(), small.camera.dim());
            Ok((small, prior))
        };
        let (small, priors) = (0..views).into_par_iter().map(small).collect::<Result<(Vec<_>, Vec<_>)>>()?;
        let (coarse, fine, maps) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        let (used, done) = (Vec::new(), BTreeSet::new());
        Ok(Self { sources, small, priors, scale: None, coarse, fine, maps, used, done })
    }

    /// Finds the common factor of the priors by these photographs, which see the same, from sweeps over every scale.
    ///
    /// # Errors
    /// What [`sweep`] refuses.
    pub fn find_scale(&mut self, members: &[usize]) -> Result<()> {
        let views: Vec<PosedView> = members.iter().map(|&view| self.small[view].clone()).collect();
        let everyone: Vec<usize> = (0..views.len()).collect();
        let ladder = |i: usize| Surfaces::Ladder { depth: self.priors[members[i]].view(), factor: UNKNOWN };
        let swept = everyone.par_iter().map(|&i| sweep(&views, i, &everyone, ladder(i)));
        let swept = swept.collect::<Result<Vec<_>>>()?;
        let depths: Vec<&GaussianDepth> = swept.iter().map(|s| &s.depth).collect();
        let mut matches = Vec::new();
        for (i, swept) in swept.iter().enumerate() {
            let agreement = agreement(&views, &depths, i, &everyone)?;
            let chance = chances(swept, &agreement);
            matches.extend(matches_of(&self.priors[members[i]], swept, &chance, i));
        }
        self.scale = Scale::fit(&matches);
        Ok(())
    }

    /// Depth and variance of these photographs, with the inflation of their differences. `view` and `prior` are those of
    /// [`new`](Self::new). The callback counts the photographs that are swept, as many at once as are kept, as the last sweep of each ends.
    ///
    /// # Errors
    /// [`Error::Reference`] for an index that is none of the views, [`Error::Interrupted`], what [`sweep`] refuses, and the
    /// errors of `view`.
    pub fn reconstruct(
        &mut self,
        view: &ReadView<'_>,
        prior: &ReadPrior<'_>,
        members: &[usize],
        callback: &mut Callback<'_>,
    ) -> Result<Reconstruction> {
        let views = self.small.len();
        if let Some(&reference) = members.iter().find(|&&member| member >= views) {
            return Err(Error::Reference { reference, views });
        }
        self.done.extend(members.first());
        let mut unknown: Vec<usize> =
            members.iter().copied().filter(|i| !self.maps.contains_key(i)).collect();
        loop {
            // As many at once as the sweeps that are kept suffice for.
            let needed = |count: usize| -> BTreeSet<usize> {
                let sources = unknown[..count].iter().flat_map(|&i| &self.sources[i]);
                members.iter().chain(sources).copied().collect()
            };
            let count = (1..=unknown.len()).rev().find(|&count| needed(count).len() <= KEPT);
            let count = count.unwrap_or(unknown.len().min(1));
            let missing = self.keep(needed(count));
            self.sweep_coarsely(&missing)?;
            for (done, &i) in missing.iter().enumerate() {
                self.fine.insert(i, self.swept(view, i, prior(i))?);
                notify(callback, done + 1, missing.len())?;
            }
            let batch: Vec<_> = unknown.drain(..count).map(|i| (i, prior(i))).collect();
            let found = batch.into_par_iter().map(|(i, prior)| Ok((i, self.map(view, i, prior)?)));
            self.maps.extend(found.collect::<Result<Vec<_>>>()?);
            if unknown.is_empty() {
                break;
            }
        }
        let views = members.iter().map(|i| view(*i)).collect::<Result<Vec<_>>>()?;
        let maps: Vec<_> = views.iter().zip(members.iter().map(|i| &self.maps[i])).collect();
        let inflation = inflation(&maps);
        let of = |&i: &usize| -> Result<ViewDepth> {
            let map = &self.maps[&i];
            Ok(ViewDepth {
                prior: self.fine[&i].gauge.apply(prior(i).view())?,
                fused: map.depth.clone().map(|m, v| (m, inflation * v)),
                agreement: map.agreement.clone(),
                verified: map.verified,
                ambiguity: map.ambiguity.clone(),
            })
        };
        let views = members.iter().map(of).collect::<Result<_>>()?;
        Ok(Reconstruction { scale: self.scale, views, inflation })
    }

    /// Makes room for the last sweeps of those photographs: what no result to come needs goes first. Those that are missing come back.
    fn keep(&mut self, needed: BTreeSet<usize>) -> Vec<usize> {
        let left = (0..self.sources.len()).filter(|view| !self.done.contains(view));
        let later: BTreeSet<usize> = left.flat_map(|view| &self.sources[view]).copied().collect();
        self.used.retain(|view| !needed.contains(view));
        self.used.sort_by_key(|view| later.contains(view));
        let surplus = (self.used.len() + needed.len()).saturating_sub(KEPT).min(self.used.len());
        for view in self.used.drain(..surplus) {
            self.fine.remove(&view);
            self.maps.remove(&view);
        }
        let missing = needed.iter().copied().filter(|i| !self.fine.contains_key(i)).collect();
        self.used.extend(needed);
        let is_near = |view: &usize| self.used.iter().any(|i| i == view || self.sources[*i].contains(view));
        self.coarse.retain(|view, _| is_near(view));
        missing
    }

    /// The photograph `i`, then its sources.
    fn group(&self, i: usize) -> Vec<usize> {
        let others = self.sources[i].iter().copied().filter(|&source| source != i);
        std::iter::once(i).chain(others).collect()
    }

    /// The consensus of a photograph with its sources, all of which are swept.
    fn map(&self, view: &ReadView<'_>, i: usize, prior: Array2<f32>) -> Result<Map> {
        let group = self.group(i);
        let views = group.iter().map(|&i| view(i)).collect::<Result<Vec<_>>>()?;
        let fine: Vec<&Fine> = group.iter().map(|i| &self.fine[i]).collect();
        let depths: Vec<&GaussianDepth> = fine.iter().map(|fine| &fine.sweep.depth).collect();
        let agreement = agreement(&views, &depths, 0, &(1..group.len()).collect::<Vec<_>>())?;
        let Fine { gauge, centre, sweep } = fine[0];
        let chance = chances(sweep, &agreement);
        let centres: Vec<_> = fine.iter().map(|fine| fine.centre.view()).collect();
        let seen = shown(&views, &centres);
        let seen = Zip::from(&seen).and(sweep.depth.mean()).map_collect(|&seen, &z| seen && z > 0.0);
        let prior = gauge.apply(prior.view())?;
        let variance = Zip::from(centre)
            .and(prior.mean())
            .and(prior.variance())
            .map_collect(|&z, &p, &v| if p > 0.0 { v * (z / p).powi(2) } else { v });
        let prior = GaussianDepth::new(centre.clone(), variance)?;
        let Fused { depth, inlier, ambiguity, .. } =
            fuse(&views[0], &prior, sweep, &chance, NARROW)?.without_unseen(&seen, &prior)?;
        let sure =
            Zip::from(&inlier).and(&agreement.agree).map_collect(|&p, &agree| p > TRUSTED && agree > 0);
        let confirmed = agreement.agree.iter().filter(|a| **a > 0).count();
        let verified = confirmed as f32 / agreement.agree.len() as f32;
        let (ambiguity, agreement) = (ambiguity.into_shared(), Arc::new(agreement));
        Ok(Map { depth, sure, ambiguity, agreement, verified })
    }

    /// Sweeps of small photographs: of those and of their sources, whose depths confirm theirs.
    fn sweep_coarsely(&mut self, members: &[usize]) -> Result<()> {
        let needed: BTreeSet<usize> =
            members.iter().chain(members.iter().flat_map(|&i| &self.sources[i])).copied().collect();
        let factor = self.scale.map_or(0.0, |s| s.log_scale).exp() as f32;
        let of = |i: usize| -> Result<Coarse> {
            let scaled = self.priors[i].mapv(|z| factor * z);
            let around = Surfaces::Around { depth: scaled.view(), factor: WIDE };
            let wide = sweep(&self.small, i, &self.sources[i], around)?;
            // From the nearest that the prior may mean to infinity.
            let mut known: Vec<f64> = scaled.iter().filter(|z| **z > 0.0).map(|z| f64::from(*z)).collect();
            let least = quantile(&mut known, 0.01).unwrap_or(1.0) / WIDE;
            let beyond = |near: f64| {
                sweep(&self.small, i, &self.sources[i], Surfaces::Planes { near, far: f64::INFINITY })
            };
            let flat = is_flat(known.iter().map(|z| z.ln()));
            let near = flat.then(|| beyond(least * WIDE / NEAREST)).transpose()?;
            Ok(Coarse { wide, whole: beyond(least)?, least: least as f32, near })
        };
        let missing: Vec<usize> = needed.into_iter().filter(|i| !self.coarse.contains_key(i)).collect();
        let found = missing.into_par_iter().map(|i| Ok((i, of(i)?))).collect::<Result<Vec<_>>>()?;
        self.coarse.extend(found);
        Ok(())
    }

    /// Gauge and smooth correction of a prior by the small photographs, and the sweep about it.
    fn swept(&self, view: &ReadView<'_>, i: usize, prior: Array2<f32>) -> Result<Fine> {
        let group = self.group(i);
        let views = group.iter().map(|&i| view(i)).collect::<Result<Vec<_>>>()?;
        views[0].camera.check_map("prior", prior.dim())?;
        let coarse: Vec<&Coarse> = group.iter().map(|i| &self.coarse[i]).collect();
        let small: Vec<&PosedView> = group.iter().map(|&i| &self.small[i]).collect();
        let everyone: Vec<usize> = (0..group.len()).collect();
        let judged = |of: fn(&Coarse) -> &Sweep| -> Result<Array2<f32>> {
            let depths: Vec<&GaussianDepth> = coarse.iter().map(|coarse| &of(coarse).depth).collect();
            Ok(chances(of(coarse[0]), &agreement(&small, &depths, 0, &everyone)?))
        };
        let wide = judged(|coarse| &coarse.wide)?;
        let (mut range, mut whole) = (&coarse[0].whole, judged(|coarse| &coarse.whole)?);
        if let Some(near) = &coarse[0].near {
            let chance = judged(|coarse| coarse.near.as_ref().unwrap_or(&coarse.whole))?;
            let is_near = |z: f32, chance: f32| z > 0.0 && z < coarse[0].least && chance > TRUSTED;
            let count = near.depth.mean().iter().zip(&chance).filter(|(z, c)| is_near(**z, **c)).count();
            if NEAR_SHARE * count > chance.len() {
                (range, whole) = (near, chance);
            }
        }
        let (best, chance) = better(&coarse[0].wide, &wide, range, &whole)?;
        // A network's unknown shift of disparity bends the depth; one factor cannot follow it.
        let small_prior = &self.priors[i];
        let unknown = Scale { log_scale: 0.0, variance: 1.0, spread: 0.3, matches: 0 };
        let gauge = Gauge::fit(&matches_of(small_prior, &best, &chance, i))
            .unwrap_or_else(|| Gauge::from_scale(&self.scale.unwrap_or(unknown)));
        let gauged = gauge.apply(small_prior.view())?;
        let fused = fuse(small[0], &gauged, &best, &chance, WIDE)?;
        // The correction is smooth, so it may be enlarged; the prior keeps its own details.
        let ratio = Zip::from(&fused.corrected).and(gauged.mean()).map_collect(|&c, &p| {
            let r = (c / p).ln();
            if r.is_finite() { r } else { 0.0 }
        });
        let (h, w) = views[0].camera.dim();
        let ratio = enlarge(&ratio, h, w);
        let prior = gauge.apply(prior.view())?;
        let centre = Zip::from(&ratio).and(prior.mean()).map_collect(|&r, &p| p * r.exp());
        let around = Surfaces::Around { depth: centre.view(), factor: NARROW };
        let sweep = sweep(&views, 0, &everyone, around)?;
        Ok(Fine { gauge, centre, sweep })
    }
}
