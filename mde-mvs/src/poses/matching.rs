//! Pairs of features of two photographs that look alike.

use super::features::Features;
use ndarray::s;
use rayon::prelude::*;

/// Rows of the table of similarities that a task fills.
const ROWS: usize = 128;
/// A match's distance over the second best at most (Lowe, 2004).
const RATIO: f32 = 0.8;

/// The nearest of the others and the squared distances to it and to the second nearest.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    index: usize,
    best: f32,
    second: f32,
}

impl Nearest {
    const NONE: Self = Self { index: usize::MAX, best: f32::INFINITY, second: f32::INFINITY };

    fn offer(&mut self, index: usize, distance: f32) {
        if distance < self.best {
            *self = Self { index, best: distance, second: self.best };
        } else if distance < self.second {
            self.second = distance;
        }
    }

    fn merge(&mut self, later: &Self) {
        self.offer(later.index, later.best);
        self.second = self.second.min(later.second);
    }

    fn distinct(&self) -> bool {
        self.best <= RATIO * RATIO * self.second
    }
}

/// Mutual nearest neighbours, each nearer than .8 times the second nearest, in the order of the first photograph's features.
///
/// A photograph with a single feature has no second nearest, and no match.
pub(super) fn match_features(first: &Features, second: &Features) -> Vec<[usize; 2]> {
    let (rows, columns) = (first.descriptors.nrows(), second.descriptors.nrows());
    if rows < 2 || columns < 2 {
        return Vec::new();
    }
    let other = second.descriptors.t();
    let blocks: Vec<(Vec<Nearest>, Vec<Nearest>)> = (0..rows.div_ceil(ROWS))
        .into_par_iter()
        .map(|block| {
            let from = block * ROWS;
            // Descriptors have norm 1: the squared distance is 2 - 2 of the product.
            let similarity = first.descriptors.slice(s![from..(from + ROWS).min(rows), ..]).dot(&other);
            let mut across = vec![Nearest::NONE; similarity.nrows()];
            let mut down = vec![Nearest::NONE; columns];
            for (i, row) in similarity.outer_iter().enumerate() {
                for (j, (&product, down)) in row.iter().zip(&mut down).enumerate() {
                    let distance = 2.0 - 2.0 * product;
                    across[i].offer(j, distance);
                    down.offer(from + i, distance);
                }
            }
            (across, down)
        })
        .collect();
    let mut nearest_first = vec![Nearest::NONE; columns];
    for (_, down) in &blocks {
        nearest_first.iter_mut().zip(down).for_each(|(all, part)| all.merge(part));
    }
    let nearest_second = blocks.iter().flat_map(|(across, _)| across);
    let mutual = |(i, there): (usize, &Nearest)| {
        let back = nearest_first.get(there.index).filter(|back| back.index == i)?;
        (there.distinct() && back.distinct()).then_some([i, there.index])
    };
    nearest_second.enumerate().filter_map(mutual).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    fn features(rows: &[[f32; 3]]) -> Features {
        let mut descriptors = Array2::zeros((rows.len(), 128));
        for (i, row) in rows.iter().enumerate() {
            let norm = row.iter().map(|v| v * v).sum::<f32>().sqrt();
            row.iter().enumerate().for_each(|(j, v)| descriptors[(i, j)] = v / norm);
        }
        Features { keypoints: Vec::new(), descriptors }
    }

    #[test]
    fn a_match_is_mutual_and_distinct() {
        let first = features(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.01], [0.0, 0.0, 1.0]]);
        let second = features(&[[0.0, 0.1, 1.0], [1.0, 0.1, 0.0], [0.0, 1.0, 0.005]]);
        // The third of the second photograph is as near to two of the first.
        assert_eq!(match_features(&first, &second), [[0, 1], [3, 0]]);
        assert_eq!(match_features(&second, &first), [[0, 3], [1, 0]]);
    }

    /// Blocks merge to what one pass over all rows gives.
    #[test]
    fn many_blocks_are_as_one() {
        let row = |i: f32| [(i * 0.37).sin(), (i * 0.11).cos(), (i * 0.71).sin() + 0.3];
        let first = features(&(0..700).map(|i| row(i as f32)).collect::<Vec<_>>());
        let second = features(&(0..300).map(|i| row((2 * i + 1) as f32)).collect::<Vec<_>>());
        let matches = match_features(&first, &second);
        for &[a, b] in &matches {
            let distance = |i, j| 2.0 - 2.0 * first.descriptors.row(i).dot(&second.descriptors.row(j));
            let here = distance(a, b);
            assert!((0..700).all(|i| distance(i, b) >= here - 1e-6));
            assert!((0..300).all(|j| distance(a, j) >= here - 1e-6));
        }
        assert!(!matches.is_empty());
    }
}
