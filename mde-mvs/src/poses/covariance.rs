use mde_warp::Pose;
use nalgebra::{DMatrix, Matrix6};

/// Joint covariance of poses by their left perturbations \\( \xi \\), translation before rotation in radians, as of 30 independent matches
/// for every 12 photographs at most, since lens and shutter have errors that neighbours share.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PoseCovariance {
    /// The group of each pose and its first row there; nothing for a pose that is kept, or that too few matches determine.
    places: Vec<Option<(usize, usize)>>,
    /// Poses of different groups are independent.
    groups: Vec<DMatrix<f64>>,
}

impl PoseCovariance {
    /// Of poses with those first rows in a matrix; all exact without one.
    pub(super) fn new(starts: &[Option<usize>], matrix: Option<DMatrix<f64>>) -> Self {
        let group = |start: &Option<usize>| start.filter(|_| matrix.is_some()).map(|start| (0, start));
        Self { places: starts.iter().map(group).collect(), groups: matrix.into_iter().collect() }
    }

    /// Adds a group for the poses of which nothing is known so far.
    pub(super) fn append(&mut self, next: Self) {
        let before = self.groups.len();
        for (place, next) in self.places.iter_mut().zip(next.places) {
            *place = place.or(next.map(|(group, start)| (before + group, start)));
        }
        self.groups.extend(next.groups);
    }

    /// The first of so many places goes behind the others.
    pub(super) fn rotate_left(&mut self, count: usize) {
        self.places[..count].rotate_left(1);
    }

    /// Covariance of \\( \xi_v \\) (rows) and \\( \xi_w \\) (columns); nothing where one of them counts as exact.
    pub fn block(&self, v: usize, w: usize) -> Option<Matrix6<f64>> {
        let place = |index: usize| self.places.get(index).copied().flatten();
        let [(of_v, row), (of_w, column)] = [place(v)?, place(w)?];
        let found = || self.groups[of_v].fixed_view::<6, 6>(row, column).into_owned();
        Some(if of_v == of_w { found() } else { Matrix6::zeros() })
    }

    /// Covariance of the motions from the frame of the first of these photographs, each an index and a pose, to those of the others,
    /// six rows for each: a motion \\( T_v T_0^{-1} \\) has the left perturbation \\( \xi_v - \mathrm{Ad}(T_v T_0^{-1})\\, \xi_0 \\).
    pub fn of_motions(&self, poses: &[(usize, Pose)]) -> DMatrix<f64> {
        let Some((&(first, from), others)) = poses.split_first() else { return DMatrix::zeros(0, 0) };
        let back = from.inverse();
        let adjoints: Vec<Matrix6<f64>> = others.iter().map(|(_, pose)| adjoint(&(pose * back))).collect();
        let block = |v: usize, w: usize| self.block(v, w).unwrap_or_else(Matrix6::zeros);
        let mut joint = DMatrix::zeros(6 * others.len(), 6 * others.len());
        for (i, (&(v, _), of_v)) in others.iter().zip(&adjoints).enumerate() {
            for (j, (&(w, _), of_w)) in others.iter().zip(&adjoints).enumerate() {
                let crossed = of_v * block(first, w) + block(v, first) * of_w.transpose();
                let found = block(v, w) - crossed + of_v * block(first, first) * of_w.transpose();
                joint.fixed_view_mut::<6, 6>(6 * i, 6 * j).copy_from(&found);
            }
        }
        joint
    }
}

/// How a motion changes the frame of a perturbation: \\( T \exp(\xi) = \exp(\mathrm{Ad}(T)\\, \xi)\\, T \\).
fn adjoint(motion: &Pose) -> Matrix6<f64> {
    let rotation = motion.rotation.to_rotation_matrix().into_inner();
    let mut adjoint = Matrix6::zeros();
    adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    adjoint.fixed_view_mut::<3, 3>(0, 3).copy_from(&(motion.translation.vector.cross_matrix() * rotation));
    adjoint
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::poses::bundle::{exp, twist};
    use crate::synthetic::pose_at;
    use nalgebra::DVector;
    use proptest::prelude::*;

    proptest! {
        /// Poses that move together by one draw: the motions move by the root of their covariance.
        #[test]
        fn motions_move_as_the_poses_do(draw in prop::collection::vec(-1.0..1.0_f64, 18)) {
            let poses = [
                pose_at([0.1, 0.0, 0.0], [0.1, 0.2, 0.0]),
                pose_at([0.3, 0.1, 0.2], [0.0, -0.1, 0.3]),
                pose_at([-0.2, 0.3, 0.1], [0.2, 0.0, -0.1]),
            ];
            let by = DVector::from_vec(draw) * 1e-6;
            let covariance = PoseCovariance::new(&[Some(0), Some(6), Some(12)], Some(&by * by.transpose()));
            let order = [1, 0, 2];
            let found = covariance.of_motions(&order.map(|v| (v, poses[v])));
            let moved = |v: usize| exp(&by.fixed_rows::<6>(6 * v).into_owned()) * poses[v];
            let mut expected = DVector::zeros(12);
            for (i, v) in [0, 2].into_iter().enumerate() {
                let change = (moved(v) * moved(1).inverse()) * (poses[v] * poses[1].inverse()).inverse();
                let change = twist(&change.translation.vector, &change.rotation.scaled_axis());
                expected.fixed_rows_mut::<6>(6 * i).copy_from(&change);
            }
            let off = found - &expected * expected.transpose();
            prop_assert!(off.amax() < 1e-4 * 1e-12, "{}", off);
        }
    }
}
