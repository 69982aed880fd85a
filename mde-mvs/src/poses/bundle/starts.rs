//! Other starts of an adjustment, for poses without a prior's shape.

use super::{Bundle, Observed};
use crate::poses::estimate::STEPS;
use crate::poses::{MIN_MATCHES, OUTLIER_PIXELS};
use mde_uncertainty::statistics::median;
use mde_warp::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

impl Bundle {
    /// The same with every camera on the other side of the reference, and near points far: over a short baseline \\( R d + w t \\) is nearly
    /// \\( R' d - (2 \bar w - w)\, t \\) with \\( R' d = R d + 2 \bar w\, t \\), so an adjustment may end in either. Depths are those of the
    /// matches.
    pub(in crate::poses) fn reversed(&self) -> Self {
        let mut other = self.clone();
        let inverse = median(self.tracks.iter().map(|track| track.inverse_depth)).unwrap_or(0.0);
        for pose in other.cameras.poses.iter_mut().skip(1) {
            let aside = Vector3::z() + 2.0 * inverse * pose.translation.vector;
            let turn = UnitQuaternion::rotation_between(&Vector3::z(), &aside).unwrap_or_default();
            *pose = Pose::from_parts(Translation3::from(-pose.translation.vector), turn * pose.rotation);
        }
        other.triangulate();
        other
    }

    /// Poses each photograph but the first two anew, in the order of `rank`, by the points of those before it. Its adjustment starts at the
    /// place of the photograph that it is attached to, `from`, with its rotation towards that one.
    pub(in crate::poses) fn regrown(&self, rank: &[usize], from: &[usize]) -> Self {
        let mut cameras = self.cameras.clone();
        let mut order: Vec<usize> = (0..rank.len()).filter(|&v| rank[v] != usize::MAX).collect();
        order.sort_unstable_by_key(|&v| rank[v]);
        for &v in order.iter().skip(2) {
            let known = |track: &Observed| {
                let seen = *track.views.iter().find(|(view, _)| *view == v)?;
                let mut track = track.clone();
                track.views.retain(|(view, _)| rank[*view] < rank[v]);
                cameras.triangulate(&mut track);
                let (view, pixel) = *track.views.first()?;
                track.views.push(seen);
                cameras.fits(&track, view, &pixel, OUTLIER_PIXELS).then_some(track)
            };
            let tracks: Vec<Observed> = self.tracks.iter().filter_map(known).collect();
            if tracks.len() < MIN_MATCHES {
                continue;
            }
            let mut part = Self { cameras: cameras.clone(), tracks };
            let turn = self.cameras.poses[v].rotation * self.cameras.poses[from[v]].rotation.inverse();
            let beside = Pose::from_parts(Translation3::identity(), turn);
            part.cameras.poses[v] = beside * cameras.poses[from[v]];
            part.cameras.fixed = (0..rank.len()).map(|view| view != v).collect();
            part.adjust(STEPS);
            cameras.poses[v] = part.cameras.poses[v];
        }
        let mut grown = Self { cameras, tracks: self.tracks.clone() };
        grown.triangulate();
        grown
    }
}
