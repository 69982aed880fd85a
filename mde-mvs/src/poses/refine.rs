use super::bundle::{Bundle, Observed, PosePrior};
use super::tracks::{self, Track};
use super::{Photograph, PosesConfig, Shot, all_pairs, config, in_order, pair, positive};
use crate::statistics::quantile;
use crate::{Error, Result};
use mde_uncertainty::random::CounterRng;
use mde_warp::Pose;
use nalgebra::{Matrix6, Point2, Vector2};
use rand::RngExt;

/// One of so many tracks is withheld.
const WITHHELD: f64 = 0.2;
/// Depths that are tried for a track, over the longest baseline: from once to a thousand times.
const DEPTHS: usize = 48;
/// Steps that improve the best of them.
const DEPTH_STEPS: usize = 8;

/// Settings of [`refine_poses`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields, rename_all = "kebab-case"))]
pub struct RefineConfig {
    /// Settings of the matches.
    pub matches: PosesConfig,
    /// Standard deviation of a given pose's rotation about each axis, degrees.
    pub rotation_sigma_degrees: f64,
    /// Standard deviation of a given camera's place along each axis, as a share of the median depth.
    pub centre_sigma: f64,
}

impl Default for RefineConfig {
    fn default() -> Self {
        Self { matches: PosesConfig::default(), rotation_sigma_degrees: 1.0, centre_sigma: 0.01 }
    }
}

impl RefineConfig {
    /// # Errors
    /// [`Error::Config`] with the first field out of its range.
    pub fn validate(&self) -> Result<()> {
        self.matches.validate()?;
        positive("rotation-sigma-degrees", self.rotation_sigma_degrees)?;
        positive("centre-sigma", self.centre_sigma)
    }
}

/// Given poses after refinement.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// One per photograph, in the order given. The reference's is unchanged; all are where [`accepted`](Self::accepted) is false.
    pub poses: Vec<Pose>,
    /// Whether withheld matches fit better with the refined poses.
    pub accepted: bool,
    /// Median distance of withheld matches from where they should be, with the given and with the refined poses, in pixels of a
    /// photograph of 640 on the longer side. Nothing without such matches.
    pub withheld: Option<[f64; 2]>,
    /// Covariance of each pose's left perturbation: translation, then rotation in radians.
    pub covariances: Vec<Option<Matrix6<f64>>>,
    /// Points seen by at least two photographs, with the poses that are returned.
    pub tracks: Vec<Track>,
}

/// Improves given poses (world to camera) by matches of the photographs: the adjustment of the module's front page with inverse
/// depths from the matches alone, the given poses as a prior, and the reference's pose kept.
///
/// A fifth of the tracks has no part in it; the refined poses are kept where those fit better.
///
/// # Errors
/// Those of [`estimate_poses`](super::estimate_poses), and [`Error::Config`] for another number of poses than of photographs.
pub fn refine_poses(
    photographs: &[Photograph],
    poses: &[Pose],
    reference: usize,
    settings: &RefineConfig,
    seed: u64,
) -> Result<Refined> {
    settings.validate()?;
    let order = in_order(photographs, reference)?;
    if poses.len() != photographs.len() {
        return Err(config("number of poses", poses.len(), "give one for each photograph"));
    }
    let finite = |pose: &Pose| {
        pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite())
    };
    if !poses.iter().all(finite) {
        return Err(Error::View(mde_warp::Error::Pose { which: "given" }));
    }
    let sorted: Vec<Photograph> = order.iter().map(|&i| photographs[i]).collect();
    let reference = order.iter().position(|&i| i == reference).unwrap_or_default();
    let given: Vec<Pose> = order.iter().map(|&i| poses[i]).collect();
    let shots = Shot::all(&sorted, &settings.matches.features)?;
    let pairs = all_pairs(&shots, &settings.matches, seed, pair::epipolar);

    let rank: Vec<usize> = (0..shots.len()).map(|v| if v == reference { 0 } else { v + 1 }).collect();
    let groups = tracks::join(&shots, &pairs.iter().collect::<Vec<_>>(), &rank);
    let mut bundle = Bundle {
        lenses: shots.iter().map(|shot| super::bundle::Lens { assumed: false, ..shot.lens }).collect(),
        poses: given.clone(),
        reference,
        log_focal: 0.0,
        focal_sigma: 1.0,
        log_scales: vec![0.0; shots.len()],
        keep_scale: false,
        prior_sigma: settings.matches.prior_sigma,
        pose_priors: vec![None; shots.len()],
        tracks: groups.into_iter().filter_map(observed).collect(),
    };
    let longest = longest_baseline(&given);
    bundle.triangulate(longest);

    let mut depths: Vec<f64> = bundle.tracks.iter().map(|track| track.log_depth).collect();
    let Some(depth) = quantile(&mut depths, 0.5).map(f64::exp).filter(|_| longest > 0.0) else {
        return Ok(unchanged(poses, bundle, &order));
    };
    for (v, prior) in bundle.pose_priors.iter_mut().enumerate() {
        *prior = (v != reference).then(|| PosePrior {
            pose: given[v],
            rotation_sigma: settings.rotation_sigma_degrees.to_radians(),
            centre_sigma: settings.centre_sigma * depth,
        });
    }
    let all = std::mem::take(&mut bundle.tracks);
    let (withheld, kept): (Vec<Observed>, Vec<Observed>) = all
        .into_iter()
        .enumerate()
        .map(|(i, track)| (CounterRng::new(seed, "withheld", 0, i as u64).random::<f64>() < WITHHELD, track))
        .fold((Vec::new(), Vec::new()), |(mut held, mut kept), (hold, track)| {
            if hold {
                held.push(track)
            } else {
                kept.push(track)
            }
            (held, kept)
        });
    let mut judge = Bundle { tracks: withheld, ..bundle.clone() };
    let before = judge.misfit();

    bundle.tracks = kept;
    bundle.adjust(super::estimate::STEPS);
    bundle.triangulate(longest);
    bundle.drop_outliers(settings.matches.outlier_pixels);
    bundle.adjust(super::estimate::STEPS);
    judge.poses.clone_from(&bundle.poses);
    judge.triangulate(longest);
    let after = judge.misfit();

    let (Some(before), Some(after)) = (before, after) else { return Ok(unchanged(poses, bundle, &order)) };
    if after.0 >= before.0 {
        bundle.poses = given;
        bundle.triangulate(longest);
        let mut same = unchanged(poses, bundle, &order);
        same.withheld = Some([before.1, after.1]);
        return Ok(same);
    }
    let (covariances, variances) =
        bundle.covariance(bundle.noise().max(1e-3)).unwrap_or((vec![None; order.len()], Vec::new()));
    let mut refined = Refined {
        poses: poses.to_vec(),
        accepted: true,
        withheld: Some([before.1, after.1]),
        covariances: vec![None; poses.len()],
        tracks: bundle.report_tracks(&variances, &order),
    };
    for (v, &place) in order.iter().enumerate() {
        refined.poses[place] = bundle.poses[v];
        refined.covariances[place] = covariances[v];
    }
    Ok(refined)
}

fn observed(mut group: Vec<(usize, Point2<f64>)>) -> Option<Observed> {
    let (anchor, pixel) = (!group.is_empty()).then(|| group.remove(0))?;
    Some(Observed { anchor, pixel, log_depth: 0.0, prior: None, views: group })
}

fn unchanged(poses: &[Pose], bundle: Bundle, order: &[usize]) -> Refined {
    Refined {
        poses: poses.to_vec(),
        accepted: false,
        withheld: None,
        covariances: vec![None; poses.len()],
        tracks: bundle.report_tracks(&[], order),
    }
}

fn longest_baseline(poses: &[Pose]) -> f64 {
    let centre = |pose: &Pose| pose.inverse().translation.vector;
    poses.iter().flat_map(|a| poses.iter().map(move |b| (centre(a) - centre(b)).norm())).fold(0.0, f64::max)
}

impl Bundle {
    /// The depth of every track that fits its matches best with the poses as they are.
    fn triangulate(&mut self, longest_baseline: f64) {
        let start = longest_baseline.max(f64::MIN_POSITIVE).ln();
        let tracks = std::mem::take(&mut self.tracks);
        self.tracks = tracks.into_iter().map(|track| self.triangulated(track, start)).collect();
    }

    fn triangulated(&self, mut track: Observed, start: f64) -> Observed {
        let cost = |track: &Observed| -> f64 {
            let squares = track.views.iter().map(|(v, p)| {
                self.residual(track, *v, p).map_or(f64::MAX.sqrt(), |r: Vector2<f64>| r.norm())
            });
            squares.sum()
        };
        let span = 1000_f64.ln();
        let mut step = span / DEPTHS as f64;
        let at = |log_depth: f64| Observed { log_depth, ..track.clone() };
        let mut best = (0..=DEPTHS)
            .map(|i| start + step * i as f64)
            .map(|depth| (cost(&at(depth)), depth))
            .fold((f64::INFINITY, start), |a, b| if b.0 < a.0 { b } else { a });
        // Halving steps to either side: the sum of distances is smooth enough about its least.
        for _ in 0..2 * DEPTH_STEPS {
            step *= 0.5;
            for depth in [best.1 - step, best.1 + step] {
                let there = cost(&at(depth));
                if there < best.0 {
                    best = (there, depth);
                }
            }
        }
        track.log_depth = best.1;
        track
    }

    /// Mean of the distances cut off at ten units of noise, and their median.
    fn misfit(&self) -> Option<(f64, f64)> {
        let mut all: Vec<f64> = self
            .tracks
            .iter()
            .flat_map(|track| track.views.iter().map(move |(v, p)| self.residual(track, *v, p)))
            .map(|r| r.map_or(10.0, |r| r.norm().min(10.0)))
            .collect();
        let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
        Some((mean, quantile(&mut all, 0.5)?))
    }
}
