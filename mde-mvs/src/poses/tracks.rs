//! Features of several photographs that are one point of the scene.

use super::FeatureImage;
use super::two_view::Pair;
use nalgebra::Point2;
use std::collections::BTreeMap;

/// Features of one photograph closer than this are one.
const SAME_PIXELS: f64 = 1.0;

/// A pixel at which a track was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPixel {
    /// Index of the photograph.
    pub photograph: usize,
    /// Column and row.
    pub pixel: Point2<f64>,
    /// Distance to where the track's point is projected, in pixels of a photograph of 640 on the longer side. 0 at the anchor.
    pub residual: f64,
}

/// A point of the scene that several photographs show.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Where it was found: the anchor first.
    pub pixels: Vec<TrackPixel>,
    /// Depth in the anchor, in the unit of the poses.
    pub depth: f64,
    /// Standard deviation of the depth's logarithm, poses included.
    pub log_depth_sigma: f64,
    /// Pixels by which the baseline moves it at most, of a photograph of 640 on the longer side.
    pub parallax: f64,
}

/// Joins matches that share features. A track that has two places in one photograph is dropped: some match of it is wrong.
///
/// Each is a list of `(shot, pixel)`, by the rank of the shots; the first is the anchor.
pub(super) fn join(
    shots: &[FeatureImage],
    pairs: &[&Pair],
    rank: &[usize],
) -> Vec<Vec<(usize, Point2<f64>)>> {
    let starts: Vec<usize> = shots
        .iter()
        .scan(0, |sum, shot| {
            let start = *sum;
            *sum += shot.features.keypoints.len();
            Some(start)
        })
        .collect();
    let total = shots.iter().map(|shot| shot.features.keypoints.len()).sum();
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
    groups.into_values().filter_map(|group| distinct(group, rank)).collect()
}

/// One pixel per shot, by rank; nothing for a single shot or one with two places.
fn distinct(mut group: Vec<(usize, Point2<f64>)>, rank: &[usize]) -> Option<Vec<(usize, Point2<f64>)>> {
    group.sort_by_key(|(shot, _)| rank[*shot]);
    let apart = |pair: &[(usize, Point2<f64>)]| {
        pair[0].0 == pair[1].0 && (pair[0].1 - pair[1].1).norm() > SAME_PIXELS
    };
    if group.windows(2).any(apart) {
        return None;
    }
    group.dedup_by_key(|(shot, _)| *shot);
    (group.len() > 1).then_some(group)
}

fn root(parent: &mut [usize], mut index: usize) -> usize {
    while parent[index] != index {
        parent[index] = parent[parent[index]];
        index = parent[index];
    }
    index
}
