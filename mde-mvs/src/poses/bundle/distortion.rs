//! Whether a lens with distortion fits the matches better.

use super::Bundle;
use crate::poses::FOCAL_SIGMA;
use crate::poses::estimate::STEPS;

/// Least share of its distance from the centre by which a corner is moved, and least number of standard deviations.
const LEAST: f64 = 0.03;
const DEVIATIONS: f64 = 3.0;

impl Bundle {
    /// The radial distortion with which the matches fit better beyond chance, as the share of its distance from the centre by which a corner
    /// moves. So does it with a principal point that is off, and with poses in a wrong minimum.
    pub(in crate::poses) fn distortion(&self) -> Option<f64> {
        let mut bent = self.clone();
        bent.cameras.radial = Some(0.0);
        bent.cameras.focal_sigma = FOCAL_SIGMA / self.shared_noise();
        bent.adjust(STEPS);
        let layout = bent.layout();
        let normal = bent.normal(&layout, bent.shared_noise());
        let inverse = normal.reduced(0.0).0.cholesky()?.inverse();
        let (at, found) = (layout.radial?, bent.cameras.radial?);
        (found.abs() > LEAST.max(DEVIATIONS * inverse[(at, at)].sqrt())).then_some(found)
    }
}
