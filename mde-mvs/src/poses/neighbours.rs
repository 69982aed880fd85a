//! Which photographs of a capture are compared with which.

use super::centre;
use super::features::Features;
use super::matching::match_features;
use mde_warp::Pose;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

/// Ranks, by distance, of the photographs that one is compared with: the nearest for their matches, some of the further for their baseline.
const RANKS: [usize; 6] = [0, 1, 2, 4, 7, 12];
/// Photographs up to this number are all compared with each other.
pub(super) const FEW: usize = 12;
/// Photographs with which one of unknown pose is matched by all its features.
const PARTNERS: usize = 10;
/// Coarsest features of a photograph, by which those are chosen.
const PREVIEW: usize = 200;
/// Largest angle between optical axes at which photographs are neighbours, degrees.
const MOST_TURNED: f64 = 60.0;

/// The other photographs that look the same way to 60 degrees, by the distance of their centres, the nearest first; all others where none
/// does.
pub fn nearest(poses: &[Pose], photograph: usize) -> Vec<usize> {
    let axis = |pose: &Pose| pose.inverse().rotation * Vector3::z();
    let (here, own) = (centre(&poses[photograph]), axis(&poses[photograph]));
    let distance = |other: usize| (centre(&poses[other]) - here).norm();
    let others = (0..poses.len()).filter(|&other| other != photograph);
    let mut others: Vec<(f64, usize)> = others.map(|other| (distance(other), other)).collect();
    others.sort_by(|a, b| a.0.total_cmp(&b.0));
    let looks_there = |&&(_, i): &&(f64, usize)| axis(&poses[i]).dot(&own) >= MOST_TURNED.to_radians().cos();
    let same: Vec<usize> = others.iter().filter(looks_there).map(|(_, i)| *i).collect();
    if same.is_empty() { others.into_iter().map(|(_, i)| i).collect() } else { same }
}

fn pair(a: usize, b: usize) -> [usize; 2] {
    [a.min(b), a.max(b)]
}

/// The pairs to be matched, each once, in order. Their number grows with that of the photographs, not with its square.
pub(super) fn pairs(poses: &[Pose]) -> Vec<[usize; 2]> {
    if poses.len() <= FEW {
        return all(poses.len());
    }
    pairs_with(poses.len(), |photograph| {
        let others = nearest(poses, photograph);
        RANKS.into_iter().filter_map(move |rank| others.get(rank).copied())
    })
}

/// Every photograph with the `others` of it, each pair once, in order.
fn pairs_with<I: Iterator<Item = usize>>(count: usize, others: impl Fn(usize) -> I) -> Vec<[usize; 2]> {
    let found =
        (0..count).flat_map(|photograph| others(photograph).map(move |other| pair(photograph, other)));
    found.collect::<BTreeSet<_>>().into_iter().collect()
}

/// The pairs to be matched where no pose is known, each once, in order: every photograph with the next two, since most captures are a walk,
/// and with the [`PARTNERS`] of which most of the coarsest features are matched (Wu, 2013). Their number grows with that of the photographs.
pub(super) fn likely(features: &[&Features]) -> Vec<[usize; 2]> {
    let count = features.len();
    if count <= FEW {
        return all(count);
    }
    let coarsest: Vec<Features> = features.par_iter().map(|features| features.coarsest(PREVIEW)).collect();
    let matches = |pair @ [i, j]: [usize; 2]| (pair, match_features(&coarsest[i], &coarsest[j]).len());
    let matches: BTreeMap<[usize; 2], usize> = all(count).into_par_iter().map(matches).collect();
    pairs_with(count, |photograph| {
        let mut others: Vec<usize> = (0..count).filter(|&other| other != photograph).collect();
        others.sort_by_key(|&other| (Reverse(matches[&pair(photograph, other)]), photograph.abs_diff(other)));
        others.into_iter().take(PARTNERS).chain((photograph + 1..count).take(2))
    })
}

/// Every pair of that many photographs.
pub(super) fn all(count: usize) -> Vec<[usize; 2]> {
    (0..count).flat_map(|i| (i + 1..count).map(move |j| [i, j])).collect()
}

/// Groups of neighbours, by which refinements are judged and covariances found; all but the first, the reference, are in one.
pub(super) fn windows(poses: &[Pose]) -> Vec<Vec<usize>> {
    let mut open: BTreeSet<usize> = (1..poses.len()).collect();
    let mut windows = Vec::new();
    while let Some(&first) = open.first() {
        let near = nearest(poses, first).into_iter().filter(|other| open.contains(other));
        let window: Vec<usize> = std::iter::once(first).chain(near).take(FEW).collect();
        open.retain(|photograph| !window.contains(photograph));
        windows.push(window);
    }
    windows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::poses::features::Keypoint;
    use crate::synthetic::pose_at;
    use mde_uncertainty::random::CounterRng;
    use nalgebra::Point2;
    use ndarray::Array2;
    use proptest::prelude::*;
    use rand::RngExt;

    /// A photograph that shows some of so many points, each with a descriptor of its own; half of its features are of nothing else.
    fn photograph(points: std::ops::Range<usize>, own: usize) -> Features {
        let descriptor = |&seed: &usize| {
            let mut draw = CounterRng::new(0, "descriptor", 0, seed as u64);
            let values = [(); 128].map(|()| draw.random::<f32>());
            let norm = values.iter().map(|value| value * value).sum::<f32>().sqrt();
            values.map(|value| value / norm)
        };
        let seeds: Vec<usize> = points.clone().chain(points.map(|i| 100_000 + 1000 * own + i)).collect();
        let keypoint = |scale| Keypoint { pixel: Point2::origin(), scale, angle: 0.0, response: 1.0 };
        let keypoints = (0..seeds.len()).map(|scale| keypoint(scale as f64)).collect();
        Features { keypoints, descriptors: Array2::from(seeds.iter().map(descriptor).collect::<Vec<_>>()) }
    }

    /// A ring about a table, its photographs in no order: each is compared with those that show the same, and the pairs grow linearly.
    #[test]
    fn photographs_without_poses_are_compared_with_those_that_show_the_same() {
        let count = 40;
        let place = |i: usize| i * 17 % count;
        let ring: Vec<_> = (0..count).map(|i| photograph(6 * place(i)..6 * place(i) + 30, i)).collect();
        let pairs = likely(&ring.iter().collect::<Vec<_>>());
        assert!(pairs.len() <= (PARTNERS + 2) * count, "{}", pairs.len());
        for i in 0..count {
            for j in i + 1..count {
                let beside = place(i).abs_diff(place(j)) <= 2;
                assert!(!beside || pairs.contains(&[i, j]), "{i} {j}");
            }
        }
    }

    proptest! {
        /// A walk, a third of it the way back: pairs grow linearly, every photograph is in one window, none is matched with one behind.
        #[test]
        fn pairs_are_near_and_few(count in 13..80_usize) {
            let turned = |i: usize| i > 2 * count / 3;
            let pose = |i: usize| {
                let at = if turned(i) { 2 * (2 * count / 3) - i } else { i };
                pose_at([0.2 * at as f64, 0.0, 0.0], [0.0, if turned(i) { 3.0 } else { 0.0 }, 0.0])
            };
            let poses: Vec<Pose> = (0..count).map(pose).collect();
            let pairs = pairs(&poses);
            prop_assert!(pairs.len() <= 6 * count);
            let across = pairs.iter().filter(|[i, j]| turned(*i) != turned(*j)).count();
            prop_assert_eq!(across, 0);
            let mut all: Vec<usize> = windows(&poses).concat();
            all.sort_unstable();
            prop_assert_eq!(all, (1..count).collect::<Vec<_>>());
        }
    }
}
