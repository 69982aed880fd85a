//! Thinned edges matched one to one: the Berkeley benchmark's precision and recall.

use super::edges::harmonic;
use crate::raster::{Gradient, same_shape};
use crate::{Error, Result};
use ndarray::{Array2, ArrayView2};
use serde::{Deserialize, Serialize};

/// Largest distance of a match, as a fraction of the image's diagonal: 6 pixels at 640 x 480.
pub const MAX_DISTANCE: f64 = 0.0075;

/// Thresholds of the prediction at which [`BoundaryCounts`] counts, in metres of Sobel gradient (gain 8): a factor
/// \\(2^{1/4}\\) apart from 0.02 to 5.1.
pub const THRESHOLDS: [f64; 33] = {
    // Powers of two are exact; between them, the three quarter steps.
    const QUARTERS: [f64; 4] = [1.0, 1.189_207_115_002_721, std::f64::consts::SQRT_2, 1.681_792_830_507_429];
    let mut thresholds = [0.0; 33];
    let mut k = 0;
    while k < 33 {
        thresholds[k] = 0.02 * (1_u32 << (k / 4)) as f64 * QUARTERS[k % 4];
        k += 1;
    }
    thresholds
};

/// Matched boundary pixels of one image.
///
/// Predicted and true boundary pixels are local maxima of the gradient across the edge (thinned); a predicted one may be
/// matched to one true one within the largest distance. At each threshold the matching is as large as can be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct BoundaryCounts {
    /// True boundary pixels.
    pub truth: u32,
    /// Predicted boundary pixels at each of [`THRESHOLDS`].
    pub predicted: Vec<u32>,
    /// How many of them are matched.
    pub matched: Vec<u32>,
    /// The best \\(F_1\\) over every threshold of this image.
    pub best: f64,
    /// Area under precision over recall, as average precision over every threshold.
    pub average_precision: f64,
}

/// Boundary pixels of `prediction` matched to those of `truth` after Martin, Fowlkes and Malik (PAMI 2004), as MindTheEdge (Talker
/// et al., CVPR 2024) applies it to depth.
///
/// Maps are `[height, width]` in metres, aligned. The truth's boundary pixels have a Sobel gradient (gain 8) of at
/// least `threshold`; the prediction's threshold is swept, so that what is best over all of them does not see its contrast.
/// Nothing where the truth has no boundary.
///
/// # Errors
/// [`Error::Shape`] where the shapes differ.
pub fn boundary_counts(
    prediction: ArrayView2<'_, f32>,
    truth: ArrayView2<'_, f32>,
    mask: ArrayView2<'_, bool>,
    threshold: f64,
) -> Result<Option<BoundaryCounts>> {
    Ok(Thinned::new(prediction, mask)?.against(&Thinned::new(truth, mask)?, threshold))
}

/// A map's thinned gradient.
pub(crate) struct Thinned(Array2<f64>);

impl Thinned {
    pub(crate) fn new(map: ArrayView2<'_, f32>, mask: ArrayView2<'_, bool>) -> Result<Self> {
        same_shape("the mask", mask.dim(), map.dim())?;
        let mut values = map.mapv(f64::from);
        values.zip_mut_with(&mask, |value, keep| {
            *value = if *keep && value.is_finite() { *value } else { 0.0 }
        });
        Ok(Self(Gradient::sobel(&values).thin(mask, f64::MIN_POSITIVE)))
    }

    pub(crate) fn against(&self, truth: &Self, threshold: f64) -> Option<BoundaryCounts> {
        if self.0.dim() != truth.0.dim() {
            return None;
        }
        let mut matching = Matching::new(&truth.0, threshold);
        let total = matching.mates.len();
        if total == 0 {
            return None;
        }
        let mut predicted: Vec<(f64, (usize, usize))> =
            self.0.indexed_iter().filter(|(_, g)| **g > 0.0).map(|(at, g)| (*g, at)).collect();
        predicted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut counts = BoundaryCounts {
            truth: total as u32,
            predicted: vec![0; THRESHOLDS.len()],
            matched: vec![0; THRESHOLDS.len()],
            best: 0.0,
            average_precision: 0.0,
        };
        let (mut taken, mut matched, mut recall) = (0_u32, 0_u32, 0.0);
        for tied in predicted.chunk_by(|a, b| a.0 == b.0) {
            taken += tied.len() as u32;
            matched += tied.iter().filter(|(_, at)| matching.add(*at)).count() as u32;
            let precision = f64::from(matched) / f64::from(taken);
            let now = f64::from(matched) / total as f64;
            counts.best = counts.best.max(harmonic(precision, now));
            counts.average_precision += (now - recall) * precision;
            recall = now;
            let reached = THRESHOLDS.partition_point(|t| *t <= tied[0].0);
            for k in 0..reached {
                (counts.predicted[k], counts.matched[k]) = (taken, matched);
            }
        }
        Some(counts)
    }
}

/// \\(F_1\\) at the one threshold that is best for all images together (BSDS's "ODS"), of counts pooled over images; nothing without
/// images.
///
/// # Errors
/// [`Error::Length`] where an image was counted at other thresholds.
pub fn ods<'c>(images: impl IntoIterator<Item = &'c BoundaryCounts>) -> Result<Option<f64>> {
    let mut pooled = [[0_u64; 3]; THRESHOLDS.len()];
    let mut any = false;
    for image in images {
        any = true;
        for (what, list) in
            [("the predicted counts", &image.predicted), ("the matched counts", &image.matched)]
        {
            if list.len() != THRESHOLDS.len() {
                return Err(Error::Length { what, found: list.len(), expected: THRESHOLDS.len() });
            }
        }
        for (k, sums) in pooled.iter_mut().enumerate() {
            let counts = [image.truth, image.predicted[k], image.matched[k]];
            sums.iter_mut().zip(counts).for_each(|(sum, count)| *sum += u64::from(count));
        }
    }
    let score = |&[truth, predicted, matched]: &[u64; 3]| {
        let share = |of: u64| if of == 0 { 0.0 } else { matched as f64 / of as f64 };
        harmonic(share(predicted), share(truth))
    };
    Ok(any.then(|| pooled.iter().map(score).fold(0.0, f64::max)))
}

/// A largest matching that grows with each predicted pixel.
struct Matching {
    /// Index of each true pixel, `[height, width]`; `NONE` elsewhere.
    index: Array2<u32>,
    /// Offsets within the largest distance, nearest first.
    offsets: Vec<(isize, isize)>,
    /// The predicted pixel of each true one; `NONE` while it has none.
    mates: Vec<u32>,
    /// Where the predicted pixels are.
    places: Vec<(usize, usize)>,
    /// True pixels that no further predicted pixel can free: every way from them was tried in vain.
    closed: Vec<bool>,
    /// When a true pixel was last looked at, by search.
    seen: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Matching {
    fn new(thinned: &Array2<f64>, threshold: f64) -> Self {
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
            places: Vec::new(),
            closed: vec![false; all],
            seen: vec![NONE; all],
        }
    }

    /// Adds a predicted pixel; true if the matching grew: Kuhn's augmenting paths, breadth first. True pixels of a search in
    /// vain are closed for ever: all pixels that they can be exchanged for lie among them.
    fn add(&mut self, place: (usize, usize)) -> bool {
        let search = self.places.len() as u32;
        self.places.push(place);
        // Each step: a predicted pixel, and the true pixel that it would give up.
        let mut queue: Vec<(u32, u32)> = vec![(search, NONE)];
        let mut came_from: Vec<u32> = vec![NONE];
        let mut visited: Vec<u32> = Vec::new();
        let mut head = 0;
        while head < queue.len() {
            let (predicted, _) = queue[head];
            let (y, x) = self.places[predicted as usize];
            for &(dy, dx) in &self.offsets {
                let at = y.checked_add_signed(dy).zip(x.checked_add_signed(dx));
                let Some(&truth) = at.and_then(|at| self.index.get(at)) else { continue };
                if truth == NONE || self.closed[truth as usize] || self.seen[truth as usize] == search {
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

        #[test]
        fn what_is_best_does_not_see_contrast(
            depths in proptest::collection::vec(1..6_u8, 12 * 16), gain in -4..5_i32
        ) {
            let truth = Array2::from_shape_vec((12, 16), depths.iter().map(|d| f32::from(*d)).collect()).unwrap();
            let prediction = Array2::from_shape_fn((12, 16), |(y, x)| truth[(11 - y, x)]);
            let mask = Array2::from_elem((12, 16), true);
            let counts = |p: &Array2<f32>| boundary_counts(p.view(), truth.view(), mask.view(), 0.5).unwrap();
            let (plain, scaled) = (counts(&prediction), counts(&prediction.mapv(|d| d * 2_f32.powi(gain))));
            prop_assert_eq!(plain.as_ref().map(|c| c.best), scaled.as_ref().map(|c| c.best));
            prop_assert_eq!(plain.map(|c| c.average_precision), scaled.map(|c| c.average_precision));
        }
    }

    #[test]
    fn a_perfect_map_is_perfect() {
        let truth =
            Array2::from_shape_fn((40, 60), |(y, x)| if (x / 20 + y / 15) % 2 == 0 { 1.0 } else { 3.0 });
        let mask = Array2::from_elem((40, 60), true);
        let counts = boundary_counts(truth.view(), truth.view(), mask.view(), 0.25).unwrap().unwrap();
        assert_eq!((counts.best, counts.average_precision), (1.0, 1.0));
        assert_eq!(ods([&counts, &counts]).unwrap(), Some(1.0));
        assert_eq!(ods([]).unwrap(), None);
        let flat = Array2::from_elem((40, 60), 2.0);
        assert!(boundary_counts(truth.view(), flat.view(), mask.view(), 0.25).unwrap().is_none());
        let none = boundary_counts(flat.view(), truth.view(), mask.view(), 0.25).unwrap().unwrap();
        assert_eq!((none.best, none.predicted[0]), (0.0, 0));
    }
}
