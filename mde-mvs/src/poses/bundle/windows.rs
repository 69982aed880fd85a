//! Adjustment of a long capture by windows of neighbours.

use super::{Bundle, Observed};
use crate::poses::estimate::STEPS;
use nalgebra::Matrix6;

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
            self.cameras.poses = part.cameras.poses;
            own.into_iter().zip(part.tracks).for_each(|(i, track)| self.tracks[i] = track);
        }
    }

    /// The bundle of a window, and the indices of its tracks.
    pub(in crate::poses) fn window(&self, window: &[usize]) -> (Self, Vec<usize>) {
        let shows = |track: &Observed| {
            window.contains(&track.anchor) || track.views.iter().any(|(v, _)| window.contains(v))
        };
        let own: Vec<usize> = (0..self.tracks.len()).filter(|&i| shows(&self.tracks[i])).collect();
        let tracks = own.iter().map(|&i| self.tracks[i].clone()).collect();
        let mut cameras = self.cameras.clone();
        cameras.fixed.iter_mut().enumerate().for_each(|(v, fixed)| *fixed |= !window.contains(&v));
        (Self { cameras, tracks }, own)
    }

    /// [`covariances`](Self::covariances) of each window with the other poses kept.
    pub(in crate::poses) fn covariances_of_windows(
        &self,
        windows: &[Vec<usize>],
        noise: f64,
    ) -> Vec<Option<Matrix6<f64>>> {
        let mut all = vec![None; self.cameras.poses.len()];
        for window in windows {
            let found = self.window(window).0.covariances(noise);
            window.iter().for_each(|&v| all[v] = found[v]);
        }
        all
    }
}
