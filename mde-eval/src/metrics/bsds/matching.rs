use super::MAX_DISTANCE;
use ndarray::Array2;

/// A largest matching that grows with each predicted pixel.
///
/// The sweep over thresholds needs its size after every pixel. The matchings of `pathfinding` (weighted, on a dense matrix) and
/// `petgraph` (of a whole graph) would start over at each threshold: thousands of matchings per map where this makes one.
pub(super) struct Matching {
    /// Index of each true pixel, `[height, width]`; `NONE` elsewhere.
    index: Array2<u32>,
    /// Offsets within the largest distance, nearest first.
    offsets: Vec<(isize, isize)>,
    /// The predicted pixel of each true one; `NONE` while it has none.
    mates: Vec<u32>,
    /// The true pixels near each predicted one, nearest first: a search passes the same pixels many times.
    near: Vec<Box<[u32]>>,
    /// True pixels that no further predicted pixel can free: every way from them was tried in vain.
    closed: Vec<bool>,
    /// When a true pixel was last looked at, by search.
    seen: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Matching {
    /// With every pixel of `thinned` that is at least `threshold`.
    pub(super) fn new(thinned: &Array2<f64>, threshold: f64) -> Self {
        let (height, width) = thinned.dim();
        let mut count = 0;
        let index = thinned.mapv(|g| {
            if g > 0.0 && g >= threshold {
                count += 1;
                count - 1
            } else {
                NONE
            }
        });
        let reach = MAX_DISTANCE * ((height * height + width * width) as f64).sqrt();
        let span = reach as isize;
        let mut offsets: Vec<(isize, isize)> =
            (-span..=span).flat_map(|dy| (-span..=span).map(move |dx| (dy, dx))).collect();
        offsets.retain(|(dy, dx)| ((dy * dy + dx * dx) as f64) <= reach * reach);
        offsets.sort_by_key(|(dy, dx)| dy * dy + dx * dx);
        let all = count as usize;
        Self {
            index,
            offsets,
            mates: vec![NONE; all],
            near: Vec::new(),
            closed: vec![false; all],
            seen: vec![NONE; all],
        }
    }

    /// Adds a predicted pixel; true if the matching grew: Kuhn's augmenting paths, breadth first. True pixels of a search in
    /// vain are closed for ever: all pixels that they can be exchanged for lie among them.
    pub(super) fn add(&mut self, place: (usize, usize)) -> bool {
        let search = self.near.len() as u32;
        self.near.push(self.near(place));
        // Each step: a predicted pixel, and the true pixel that it would give up.
        let mut queue: Vec<(u32, u32)> = vec![(search, NONE)];
        let mut came_from: Vec<u32> = vec![NONE];
        let mut visited: Vec<u32> = Vec::new();
        let mut head = 0;
        while head < queue.len() {
            let (predicted, _) = queue[head];
            for &truth in &self.near[predicted as usize] {
                if self.closed[truth as usize] || self.seen[truth as usize] == search {
                    continue;
                }
                self.seen[truth as usize] = search;
                visited.push(truth);
                let mate = self.mates[truth as usize];
                if mate == NONE {
                    self.augment(&queue, &came_from, head, truth);
                    return true;
                }
                queue.push((mate, truth));
                came_from.push(head as u32);
            }
            head += 1;
        }
        for truth in visited {
            self.closed[truth as usize] = true;
        }
        false
    }

    fn near(&self, (y, x): (usize, usize)) -> Box<[u32]> {
        let at = |&(dy, dx): &(isize, isize)| y.checked_add_signed(dy).zip(x.checked_add_signed(dx));
        let truths = self.offsets.iter().filter_map(at).filter_map(|at| self.index.get(at));
        truths.copied().filter(|&truth| truth != NONE && !self.closed[truth as usize]).collect()
    }

    /// True pixels.
    pub(super) fn truth(&self) -> usize {
        self.mates.len()
    }

    /// Gives `free` to the pixel at `step`, the one that it gives up to the step before, and so on.
    fn augment(&mut self, queue: &[(u32, u32)], came_from: &[u32], step: usize, free: u32) {
        let (mut step, mut free) = (step, free);
        loop {
            let (predicted, gives_up) = queue[step];
            self.mates[free as usize] = predicted;
            if gives_up == NONE {
                return;
            }
            free = gives_up;
            step = came_from[step] as usize;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The size of a largest matching by trying everything.
    fn brute_force(edges: &[Vec<usize>], used: &mut Vec<bool>) -> usize {
        let Some((first, rest)) = edges.split_first() else { return 0 };
        let mut best = brute_force(rest, used);
        for &truth in first {
            if !used[truth] {
                used[truth] = true;
                best = best.max(1 + brute_force(rest, used));
                used[truth] = false;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn the_matching_is_the_largest_after_every_pixel(
            truth in proptest::collection::btree_set((0..9_usize, 0..9_usize), 1..7),
            predicted in proptest::collection::vec((0..9_usize, 0..9_usize), 1..8)
        ) {
            // 9 x 400 pixels: the largest distance is 3.0006 pixels.
            let mut thinned = Array2::zeros((9, 400));
            truth.iter().for_each(|&at| thinned[at] = 1.0);
            let mut matching = Matching::new(&thinned, 0.5);
            let order: Vec<(usize, usize)> = thinned.indexed_iter().filter(|(_, g)| **g > 0.0).map(|(at, _)| at).collect();
            let mut edges = Vec::new();
            let mut size = 0;
            for at in predicted {
                size += usize::from(matching.add(at));
                let near = |t: &(usize, usize)| t.0.abs_diff(at.0).pow(2) + t.1.abs_diff(at.1).pow(2) <= 9;
                edges.push((0..order.len()).filter(|&t| near(&order[t])).collect::<Vec<_>>());
                prop_assert_eq!(size, brute_force(&edges, &mut vec![false; order.len()]));
            }
        }
    }
}
