use mde_warp::PosedView;
use ndarray::{Array2, Array3, ArrayView2, ArrayView3, Axis, NdFloat, Zip};
use rayon::prelude::*;

use crate::Result;

/// Rows or columns that a task of a filter takes together.
const STRIP: usize = 64;

/// Luma of sRGB colours (Rec. 601), `[height, width]`.
pub(crate) fn luma(image: ArrayView3<'_, f32>) -> Array2<f32> {
    image.map_axis(Axis(2), |c| 0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2])
}

/// Bilinear colour at column `x` and row `y`, which lie between the outermost pixel centres.
pub(crate) fn bilinear(image: ArrayView3<'_, f32>, x: f64, y: f64) -> [f32; 3] {
    let (h, w, _) = image.dim();
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
    let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    std::array::from_fn(|c| {
        let along = |y: usize| image[(y, x0, c)] + fx * (image[(y, x1, c)] - image[(y, x0, c)]);
        let (top, bottom) = (along(y0), along(y1));
        top + fy * (bottom - top)
    })
}

/// For each of `to` samples the first of `from` samples that it covers, and their weights, which sum to 1.
fn area_weights(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let ratio = from as f64 / to as f64;
    (0..to)
        .map(|i| {
            let (start, end) = (i as f64 * ratio, (i as f64 + 1.0) * ratio);
            let first = (start as usize).min(from - 1);
            let last = ((end - 1e-9).ceil() as usize).clamp(first + 1, from);
            let share = |j: usize| ((j as f64 + 1.0).min(end) - (j as f64).max(start)).max(0.0) / ratio;
            (first, (first..last).map(|j| share(j) as f32).collect())
        })
        .collect()
}

/// Means over pixel areas: `image` made smaller, to `height` x `width`.
pub(crate) fn shrink(image: ArrayView3<'_, f32>, height: usize, width: usize) -> Array3<f32> {
    let (h, w, channels) = image.dim();
    let columns = area_weights(w, width);
    let mut wide = Array3::zeros((h, width, channels));
    for row in 0..h {
        for (x, (first, weights)) in columns.iter().enumerate() {
            for (j, weight) in weights.iter().enumerate() {
                for c in 0..channels {
                    wide[(row, x, c)] += weight * image[(row, first + j, c)];
                }
            }
        }
    }
    let mut small = Array3::zeros((height, width, channels));
    for (y, (first, weights)) in area_weights(h, height).iter().enumerate() {
        let mut into = small.index_axis_mut(Axis(0), y);
        for (j, &weight) in weights.iter().enumerate() {
            into.scaled_add(weight, &wide.index_axis(Axis(0), first + j));
        }
    }
    small
}

/// The same of a single channel.
pub(crate) fn shrink_map(map: ArrayView2<'_, f32>, height: usize, width: usize) -> Array2<f32> {
    shrink(map.insert_axis(Axis(2)), height, width).remove_axis(Axis(2))
}

/// The index of the source sample nearest to the middle of each of `to` target samples.
fn nearest(from: usize, to: usize) -> Vec<usize> {
    (0..to).map(|i| (((i as f64 + 0.5) * from as f64 / to as f64) as usize).min(from - 1)).collect()
}

/// Nearest samples of a map at another size.
pub(crate) fn pick<T: Copy>(map: ArrayView2<'_, T>, height: usize, width: usize) -> Array2<T> {
    let (rows, columns) = (nearest(map.nrows(), height), nearest(map.ncols(), width));
    Array2::from_shape_fn((height, width), |(y, x)| map[(rows[y], columns[x])])
}

/// Bilinear samples of a map at another size, pixels being areas.
pub(crate) fn enlarge(map: &Array2<f32>, height: usize, width: usize) -> Array2<f32> {
    let (h, w) = map.dim();
    let places = |from: usize, to: usize| -> Vec<(usize, usize, f32)> {
        let place = |i: usize| {
            let at = ((i as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, (from - 1) as f64);
            let below = at as usize;
            (below, (below + 1).min(from - 1), (at - below as f64) as f32)
        };
        (0..to).map(place).collect()
    };
    let (rows, columns) = (places(h, height), places(w, width));
    Array2::from_shape_fn((height, width), |(y, x)| {
        let ((y0, y1, fy), (x0, x1, fx)) = (rows[y], columns[x]);
        let along = |y: usize| map[(y, x0)] + fx * (map[(y, x1)] - map[(y, x0)]);
        let (top, bottom) = (along(y0), along(y1));
        top + fy * (bottom - top)
    })
}

/// A depth map at another size: area means where it is complete, else nearest samples.
pub(crate) fn small_map(map: &ArrayView2<'_, f32>, (h, w): (usize, usize)) -> Array2<f32> {
    if map.dim() == (h, w) {
        return map.to_owned();
    }
    let whole = map.iter().all(|z| *z > 0.0 && z.is_finite());
    if whole { shrink_map(*map, h, w) } else { pick(*map, h, w) }
}

/// The domain transform's recursive filter (Gastal and Oliveira, 2011) of `N` maps at once, both ways along rows, then along columns. By the
/// shares that `feedback` has across and down, a pixel moves towards the one on its left and above it; on the way back, that one towards it.
pub(crate) fn recursive_filter<T: NdFloat, const N: usize>(
    maps: &mut Array2<[T; N]>,
    feedback: &[Array2<T>; 2],
) {
    let towards = |from: &[T; N], share: T, here: &mut [T; N]| {
        here.iter_mut().zip(from).for_each(|(here, from)| *here += share * (*from - *here));
    };
    for (along, beside, shares) in [(Axis(1), Axis(0), &feedback[0]), (Axis(0), Axis(1), &feedback[1])] {
        let strips = maps.axis_chunks_iter_mut(beside, STRIP).zip(shares.axis_chunks_iter(beside, STRIP));
        let mut strips: Vec<_> = strips.collect();
        strips.par_iter_mut().for_each(|(maps, shares)| {
            let mut between = |i: usize, back: bool| {
                let (before, after) = maps.view_mut().split_at(along, i);
                let lines = (before.index_axis_move(along, i - 1), after.index_axis_move(along, 0));
                Zip::from(lines.0).and(lines.1).and(shares.index_axis(along, i)).for_each(
                    |before, here, &share| {
                        if back { towards(here, share, before) } else { towards(before, share, here) }
                    },
                );
            };
            (1..shares.len_of(along)).for_each(|i| between(i, false));
            (1..shares.len_of(along)).rev().for_each(|i| between(i, true));
        });
    }
}

/// A view of at most `side` pixels along its longer side; hypotheses are left out.
pub(crate) fn small_view(view: &PosedView, side: usize) -> Result<PosedView> {
    let (h, w) = view.camera.dim();
    let factor = (side as f64 / h.max(w) as f64).min(1.0);
    let size = |n: usize| ((n as f64 * factor).round() as usize).max(1);
    let camera = view.camera.resized(size(w), size(h))?;
    let (image, mask) = if factor < 1.0 {
        let mask = pick(view.mask.view(), size(h), size(w));
        (shrink(view.image.view(), size(h), size(w)).into_shared(), mask.into_shared())
    } else {
        (view.image.clone(), view.mask.clone())
    };
    Ok(PosedView::new(image, camera, view.pose, mask, Vec::new())?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn area_weights_are_a_partition(from in 1..50_usize, share in 0.01..=1.0_f64) {
            let to = ((from as f64 * share).ceil() as usize).max(1);
            let mut covered = vec![0.0_f64; from];
            for (first, weights) in area_weights(from, to) {
                prop_assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
                for (j, w) in weights.iter().enumerate() {
                    covered[first + j] += f64::from(*w) * from as f64 / to as f64;
                }
            }
            prop_assert!(covered.iter().all(|c| (c - 1.0).abs() < 1e-4));
        }
    }
}
