//! Adjustment of a long capture by windows of neighbours.

use super::{Bundle, Covariance, Observed};
use crate::poses::estimate::STEPS;

/// Rounds over the windows.
const ROUNDS: usize = 2;

impl Bundle {
    /// [`adjust`](Self::adjust) of each window's poses in turn, on the tracks that its photographs are part of, with the others
    /// kept. One window is all photographs.
    pub(in crate::poses) fn adjust_windows(&mut self, windows: &[Vec<usize>]) {
        let rounds = if windows.len() > 1 { ROUNDS } else { 1 };
        for window in std::iter::repeat_n(windows, rounds).flatten() {
            let (mut part, own) = self.window(window);
            part.adjust(STEPS);
            self.poses = part.poses;
            own.into_iter().zip(part.tracks).for_each(|(i, track)| self.tracks[i] = track);
        }
    }

    /// The bundle of a window, and the indices of its tracks.
    fn window(&self, window: &[usize]) -> (Self, Vec<usize>) {
        let shows = |track: &Observed| {
            window.contains(&track.anchor) || track.views.iter().any(|(v, _)| window.contains(v))
        };
        let own: Vec<usize> = (0..self.tracks.len()).filter(|&i| shows(&self.tracks[i])).collect();
        let tracks = own.iter().map(|&i| self.tracks[i].clone()).collect();
        let fixed = (0..self.poses.len()).map(|v| self.fixed[v] || !window.contains(&v)).collect();
        let part = Self {
            lenses: self.lenses.clone(),
            poses: self.poses.clone(),
            fixed,
            log_scales: self.log_scales.clone(),
            prior_sigmas: self.prior_sigmas.clone(),
            pose_priors: self.pose_priors.clone(),
            tracks,
            ..*self
        };
        (part, own)
    }

    /// The tracks of those photographs alone.
    pub(in crate::poses) fn of_views(&self, views: &[usize]) -> Self {
        self.window(views).0
    }

    /// [`covariance`](Self::covariance) of each window with the other poses kept.
    pub(in crate::poses) fn covariance_of_windows(
        &self,
        windows: &[Vec<usize>],
        noise: f64,
    ) -> Option<Covariance> {
        let mut all = Covariance {
            poses: vec![None; self.poses.len()],
            log_depths: vec![f64::INFINITY; self.tracks.len()],
            log_focal: None,
        };
        for window in windows {
            let (part, own) = self.window(window);
            let found = part.covariance(noise)?;
            window.iter().for_each(|&v| all.poses[v] = found.poses[v]);
            own.iter().zip(found.log_depths).for_each(|(&i, variance)| all.log_depths[i] = variance);
        }
        Some(all)
    }
}
