//! Features of several photographs that are one point of the scene.

use super::Prepared;
use super::bundle::Observed;
use super::two_view::Pair;
use nalgebra::Point2;
use std::collections::BTreeMap;

/// Features of one photograph closer than this are one.
const SAME_PIXELS: f64 = 1.0;

/// Joins matches that share features, as points at infinity without a prior. The anchor is the photograph of the least rank. A track
/// that has two places in one photograph is dropped: some match of it is wrong.
pub(super) fn join(shots: &[&Prepared], pairs: &[&Pair], rank: &[usize]) -> Vec<Observed> {
    let mut starts = Vec::with_capacity(shots.len());
    let mut total = 0;
    for shot in shots {
        starts.push(total);
        total += shot.features.keypoints.len();
    }
    let mut parent: Vec<usize> = (0..total).collect();
    for pair in pairs {
        for [a, b] in &pair.agreeing {
            let (a, b) =
                (root(&mut parent, starts[pair.first] + a), root(&mut parent, starts[pair.second] + b));
            // The smaller index is the root, whatever the order of the matches.
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut groups: BTreeMap<usize, Vec<(usize, Point2<f64>)>> = BTreeMap::new();
    for (shot, start) in starts.iter().enumerate() {
        for (i, keypoint) in shots[shot].features.keypoints.iter().enumerate() {
            groups.entry(root(&mut parent, start + i)).or_default().push((shot, keypoint.pixel));
        }
    }
    groups.into_values().filter_map(|group| track(group, rank)).collect()
}

/// Nothing for a single shot or one with two places.
fn track(mut views: Vec<(usize, Point2<f64>)>, rank: &[usize]) -> Option<Observed> {
    views.sort_by_key(|(shot, _)| rank[*shot]);
    if views.array_windows().any(|[a, b]| a.0 == b.0 && (a.1 - b.1).norm() > SAME_PIXELS) {
        return None;
    }
    views.dedup_by_key(|(shot, _)| *shot);
    let (anchor, pixel) = views.remove(0);
    (!views.is_empty()).then_some(Observed { anchor, pixel, inverse_depth: 0.0, prior: None, views })
}

fn root(parent: &mut [usize], mut index: usize) -> usize {
    while parent[index] != index {
        parent[index] = parent[parent[index]];
        index = parent[index];
    }
    index
}
