use ndarray::{Array2, ArrayViewMut1, Axis};

/// Sums over a square of side `2 * radius + 1` about each pixel, cut off at the border; linear in the pixels.
pub(super) fn box_sums(mut map: Array2<f64>, radius: usize) -> Array2<f64> {
    let mut running = Vec::new();
    for axis in [Axis(1), Axis(0)] {
        for line in map.lanes_mut(axis) {
            sums(line, radius, &mut running);
        }
    }
    map
}

fn sums(mut line: ArrayViewMut1<'_, f64>, radius: usize, running: &mut Vec<f64>) {
    running.clear();
    running.push(0.0);
    let mut total = 0.0;
    running.extend(line.iter().map(|value| {
        total += value;
        total
    }));
    let n = line.len();
    for (x, out) in line.iter_mut().enumerate() {
        *out = running[(x + radius + 1).min(n)] - running[x.saturating_sub(radius)];
    }
}
