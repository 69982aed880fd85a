//! Point clouds.

use rayon::prelude::*;
use serde::Serialize;
use std::collections::{HashMap, HashSet};

type Cell = [i64; 3];

/// Points by place: the first of each voxel, which is a quarter of the tolerance wide, so that no part of a surface counts more than another.
#[derive(Debug, Clone)]
pub struct Cloud {
    tolerance: f64,
    voxels: HashSet<Cell>,
    /// As wide as the tolerance.
    cells: HashMap<Cell, Vec<[f64; 3]>>,
}

/// A cloud against the true one (Knapitsch et al., "Tanks and Temples", 2017).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CloudScore {
    /// In the clouds' unit.
    pub tolerance: f64,
    /// Share of the points with a true one within the tolerance.
    pub accuracy: f64,
    /// Share of the true points with one within the tolerance.
    pub completeness: f64,
    /// Their harmonic mean.
    pub f: f64,
}

impl Cloud {
    /// An empty cloud, to be compared within that tolerance.
    pub fn new(tolerance: f64) -> Self {
        Self { tolerance, voxels: HashSet::new(), cells: HashMap::new() }
    }

    /// Adds a point, unless its voxel has one.
    pub fn add(&mut self, point: [f64; 3]) {
        let cell = |width: f64| point.map(|x| (x / width).floor() as i64);
        if self.voxels.insert(cell(0.25 * self.tolerance)) {
            self.cells.entry(cell(self.tolerance)).or_default().push(point);
        }
    }

    /// The score against the true cloud, which has the same tolerance; 0 where either is empty.
    pub fn score(&self, truth: &Self) -> CloudScore {
        let (accuracy, completeness) = (self.share_near(truth), truth.share_near(self));
        let f = 2.0 * accuracy * completeness / (accuracy + completeness).max(f64::MIN_POSITIVE);
        CloudScore { tolerance: self.tolerance, accuracy, completeness, f }
    }

    /// The share of the points that have one of the other cloud within the tolerance.
    fn share_near(&self, other: &Self) -> f64 {
        let limit = self.tolerance * self.tolerance;
        let near = |(cell, points): (&Cell, &Vec<[f64; 3]>)| {
            let beside = |i: i64| std::array::from_fn(|axis| cell[axis] + i / 3_i64.pow(axis as u32) % 3 - 1);
            let around = (0..27).filter_map(|i| other.cells.get::<Cell>(&beside(i)));
            let around: Vec<&[f64; 3]> = around.flatten().collect();
            let squared = |a: &[f64; 3], b: &[f64; 3]| -> f64 { (0..3).map(|i| (a[i] - b[i]).powi(2)).sum() };
            let is_near = |point: &&[f64; 3]| around.iter().any(|other| squared(point, other) <= limit);
            points.iter().filter(is_near).count()
        };
        self.cells.par_iter().map(near).sum::<usize>() as f64 / self.voxels.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane of 20 x 20 against its half, moved by most of the tolerance and a far point: counted by hand.
    #[test]
    fn half_a_plane_is_accurate_and_half_complete() {
        let cloud = |points: &[[f64; 3]]| {
            let mut cloud = Cloud::new(1.0);
            points.iter().chain(points).for_each(|point| cloud.add(*point));
            cloud
        };
        let at = |i: i32| [3.0 * f64::from(i % 20), 3.0 * f64::from(i / 20), -0.3];
        let plane: Vec<[f64; 3]> = (0..400).map(at).collect();
        let mut half: Vec<_> = plane[..200].iter().map(|[x, y, z]| [x - 0.9, *y, *z]).collect();
        half.push([0.0, 0.0, 40.0]);
        let found = cloud(&half).score(&cloud(&plane));
        let (accuracy, completeness) = (200.0 / 201.0, 0.5);
        assert_eq!([found.accuracy, found.completeness], [accuracy, completeness]);
        assert!((found.f - 2.0 / (1.0 / accuracy + 1.0 / completeness)).abs() < 1e-12);
        let apart = cloud(&half).score(&cloud(&[[0.0, 0.0, 42.0]]));
        assert_eq!([apart.accuracy, apart.f], [0.0; 2]);
    }
}
