use crate::raster::Mask;
use ndarray::{Array2, ArrayViewMut1};

/// Exact Euclidean distance in pixels from each pixel to the nearest true one, `[height, width]`; infinite without one.
///
/// Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions" (Theory of Computing, 2012): the lower
/// envelope of parabolas, one dimension after the other, linear in the number of pixels.
pub(crate) fn distance_to(features: Mask<'_>) -> Array2<f64> {
    let mut squared = features.mapv(|set| if set { 0.0 } else { f64::INFINITY });
    squared.columns_mut().into_iter().for_each(transform);
    squared.rows_mut().into_iter().for_each(transform);
    squared.mapv_into(f64::sqrt)
}

/// The one-dimensional transform \\(d(x) = \min_q (x - q)^2 + f(q)\\).
fn transform(mut line: ArrayViewMut1<'_, f64>) {
    let samples = line.to_vec();
    // Vertices of the parabolas in the envelope, each with the place from which on it is the lowest.
    let mut parabolas: Vec<(usize, f64)> = Vec::new();
    for (q, &f) in samples.iter().enumerate().filter(|(_, f)| f.is_finite()) {
        let mut start = f64::NEG_INFINITY;
        while let Some(&(p, from)) = parabolas.last() {
            let (p_f, q_f) = (p as f64, q as f64);
            start = ((f + q_f * q_f) - (samples[p] + p_f * p_f)) / (2.0 * (q_f - p_f));
            if start > from {
                break;
            }
            parabolas.pop();
            start = f64::NEG_INFINITY;
        }
        parabolas.push((q, start));
    }
    let mut current = parabolas.into_iter().peekable();
    let Some(mut lowest) = current.next() else { return };
    for (x, out) in line.iter_mut().enumerate() {
        while let Some(next) = current.next_if(|next| next.1 <= x as f64) {
            lowest = next;
        }
        let offset = x as f64 - lowest.0 as f64;
        *out = offset * offset + samples[lowest.0];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_distance_to_the_nearest_feature(
            (height, width, bits) in (1..14_usize, 1..14_usize)
                .prop_flat_map(|(h, w)| (Just(h), Just(w), proptest::collection::vec(0..12_u8, h * w)))
        ) {
            let features = Array2::from_shape_vec((height, width), bits.iter().map(|&b| b == 0).collect()).unwrap();
            let set: Vec<_> = features.indexed_iter().filter(|(_, v)| **v).map(|(at, _)| at).collect();
            for ((y, x), found) in distance_to(features.view()).indexed_iter() {
                let squared = |&(v, u): &(usize, usize)| (y.abs_diff(v).pow(2) + x.abs_diff(u).pow(2)) as f64;
                prop_assert_eq!(*found, set.iter().map(squared).fold(f64::INFINITY, f64::min).sqrt());
            }
        }
    }
}
