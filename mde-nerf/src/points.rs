use crate::scalar::Scalar;

/// Points per block of the kernels: one AVX-512 register of `f32`.
pub(crate) const BLOCK: usize = 16;

/// Points of the unit cube, axis by axis, so that a block of them fills a register.
#[derive(Debug, Default, Clone)]
pub(crate) struct Points<T> {
    pub(crate) axes: [Vec<T>; 3],
}

impl<T: Scalar> Points<T> {
    pub(crate) fn clear(&mut self) {
        self.axes.iter_mut().for_each(Vec::clear);
    }

    pub(crate) fn len(&self) -> usize {
        self.axes[0].len()
    }

    #[inline(always)]
    pub(crate) fn push(&mut self, point: [T; 3]) {
        for (axis, q) in self.axes.iter_mut().zip(point) {
            axis.push(q);
        }
    }

    /// Pads the last block with the cube's corner.
    pub(crate) fn pad(&mut self) {
        let padded = self.len().next_multiple_of(BLOCK);
        self.axes.iter_mut().for_each(|axis| axis.resize(padded, T::ZERO));
    }

    /// Appends the points of another padded list.
    pub(crate) fn extend(&mut self, other: &Self) {
        for (axis, more) in self.axes.iter_mut().zip(&other.axes) {
            axis.extend_from_slice(more);
        }
    }

    /// The blocks of a padded list.
    #[inline(always)]
    pub(crate) fn blocks(&self) -> impl Iterator<Item = [&[T; BLOCK]; 3]> {
        let [u, v, s] = &self.axes;
        let blocks = |axis| <[T]>::as_chunks::<BLOCK>(axis).0.iter();
        blocks(u).zip(blocks(v)).zip(blocks(s)).map(|((u, v), s)| [u, v, s])
    }
}
