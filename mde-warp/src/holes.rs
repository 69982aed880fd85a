//! Pixels that a warp leaves empty, and the covered pixel that each continues from.

use ndarray::Array2;
use std::collections::VecDeque;

/// An empty pixel and the covered pixel that its background continues from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Hole {
    pub(crate) row: usize,
    pub(crate) column: usize,
    /// `(row, column)` of the background, or nothing where no pixel at all is covered.
    pub(crate) background: Option<(usize, usize)>,
}

/// Every pixel of `depth` that is 0, row by row.
///
/// The background is the deeper of the two covered pixels that end the pixel's empty run, along the row or the column,
/// whichever run is shorter: sideways motion opens gaps along the rows, vertical motion along the columns. A run that is
/// open at the frame counts only where both runs are; then its one end is taken, the closer where there are two. Where row
/// and column are both empty, the background of the closest hole that has one is used.
pub(crate) fn find(depth: &Array2<f32>) -> Vec<Hole> {
    let (height, width) = depth.dim();
    if depth.iter().all(|&d| d > 0.0) {
        return Vec::new();
    }
    let below = next_covered_below(depth);
    let mut above = vec![None; width];
    let mut holes = Vec::new();
    for row in 0..height {
        let (mut left, mut right) = (None, None);
        for column in 0..width {
            if depth[(row, column)] > 0.0 {
                left = Some(column);
                above[column] = Some(row);
                continue;
            }
            if right.is_none_or(|r| r < column) {
                right = Some((column..width).find(|&c| depth[(row, c)] > 0.0).unwrap_or(usize::MAX));
            }
            let right = right.filter(|&r| r != usize::MAX);
            let along_row = [left, right].map(|c| c.map(|c| (row, c)));
            let along_column = [above[column], below[(row, column)]].map(|r| r.map(|r| (r, column)));
            let background = background(depth, (row, column), along_row, along_column);
            holes.push(Hole { row, column, background });
        }
    }
    spread(&mut holes, depth.dim());
    holes
}

/// Gives a background to every hole that has none, from its neighbours outwards.
fn spread(holes: &mut [Hole], (height, width): (usize, usize)) {
    if holes.iter().all(|hole| hole.background.is_some()) {
        return;
    }
    let mut index = Array2::from_elem((height, width), None);
    for (i, hole) in holes.iter().enumerate() {
        index[(hole.row, hole.column)] = Some(i);
    }
    let mut queue: VecDeque<usize> = (0..holes.len()).filter(|&i| holes[i].background.is_some()).collect();
    while let Some(i) = queue.pop_front() {
        let Hole { row, column, background } = holes[i];
        let (up, left) = (row.wrapping_sub(1), column.wrapping_sub(1));
        for at in [(up, column), (row, left), (row, column + 1), (row + 1, column)] {
            if let Some(&Some(next)) = index.get(at)
                && holes[next].background.is_none()
            {
                holes[next].background = background;
                queue.push_back(next);
            }
        }
    }
}

/// For every pixel the first row from it downwards that is covered.
fn next_covered_below(depth: &Array2<f32>) -> Array2<Option<usize>> {
    let (height, width) = depth.dim();
    let mut below = Array2::from_elem((height, width), None);
    for row in (0..height).rev() {
        for column in 0..width {
            let next = if row + 1 < height { below[(row + 1, column)] } else { None };
            below[(row, column)] = if depth[(row, column)] > 0.0 { Some(row) } else { next };
        }
    }
    below
}

type Ends = [Option<(usize, usize)>; 2];

fn background(depth: &Array2<f32>, at: (usize, usize), row: Ends, column: Ends) -> Option<(usize, usize)> {
    let distance = |p: (usize, usize)| p.0.abs_diff(at.0) + p.1.abs_diff(at.1);
    let closed = |ends: Ends| Some((ends[0]?, ends[1]?));
    let span = |(a, b)| distance(a) + distance(b);
    let deeper = |(a, b)| {
        let (da, db) = (depth[a], depth[b]);
        if da > db || (da == db && distance(a) <= distance(b)) { a } else { b }
    };
    match (closed(row), closed(column)) {
        (Some(r), Some(c)) => Some(deeper(if span(r) <= span(c) { r } else { c })),
        (Some(ends), None) | (None, Some(ends)) => Some(deeper(ends)),
        (None, None) => row.into_iter().chain(column).flatten().min_by_key(|&p| distance(p)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn backgrounds(depth: Array2<f32>) -> Vec<Option<(usize, usize)>> {
        find(&depth).iter().map(|hole| hole.background).collect()
    }

    #[test]
    fn the_background_lies_along_the_shorter_run() {
        let depth = array![[2.0, 2.0, 2.0, 2.0], [9.0, 0.0, 0.0, 9.0], [3.0, 3.0, 3.0, 3.0]];
        assert_eq!(backgrounds(depth), [Some((2, 1)), Some((2, 2))]);
    }

    #[test]
    fn a_corner_between_an_empty_row_and_an_empty_column_takes_its_neighbours_background() {
        let corner = backgrounds(array![[0.0, 0.0, 0.0], [2.0, 2.0, 0.0]]);
        assert_eq!(corner, [Some((1, 0)), Some((1, 1)), Some((1, 1)), Some((1, 1))]);
    }
}
