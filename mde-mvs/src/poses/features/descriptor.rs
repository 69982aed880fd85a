//! Histograms of gradients about an extremum.

use super::extrema::{Extremum, gradient};
use super::scale_space::ScaleSpace;
use std::f32::consts::{SQRT_2, TAU};

/// Cells along a side.
const CELLS: usize = 4;
/// Directions of a cell.
const DIRECTIONS: usize = 8;
/// A cell's side in standard deviations of the extremum.
const CELL_SIGMAS: f32 = 3.0;
/// Largest share of the norm that one entry keeps.
const CLIP: f32 = 0.2;

pub(super) const LENGTH: usize = CELLS * CELLS * DIRECTIONS;

/// Angle of (x, y) as a share of a full turn, in [0, 1], within 3e-5 (a minimax polynomial of the arc tangent).
pub(super) fn turns(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let ratio = ax.min(ay) / (ax.max(ay) + f32::MIN_POSITIVE);
    let s = ratio * ratio;
    let arc = ratio * (0.999_866 + s * (-0.330_299_5 + s * (0.180_141 + s * (-0.085_133 + s * 0.020_835_1))));
    let mut turn = arc / TAU;
    if ay > ax {
        turn = 0.25 - turn;
    }
    if x < 0.0 {
        turn = 0.5 - turn;
    }
    if y < 0.0 { 1.0 - turn } else { turn }
}

/// The RootSIFT descriptor: the square root of the clipped histogram over its sum.
pub(super) fn describe(space: &ScaleSpace, extremum: &Extremum) -> [f32; LENGTH] {
    let plane = &space.octaves[extremum.octave][extremum.layer];
    let (height, width) = (plane.nrows() as isize, plane.ncols() as isize);
    let (column, row) = (extremum.x.round() as isize, extremum.y.round() as isize);
    let cell = CELL_SIGMAS * extremum.sigma as f32;
    let diagonal = ((width * width + height * height) as f32).sqrt();
    let radius = (cell * SQRT_2 * (CELLS as f32 + 1.0) * 0.5).round().min(diagonal) as isize;
    let (sin, cos) = (extremum.angle as f32).sin_cos();
    let (sin, cos) = (sin / cell, cos / cell);
    let start = extremum.angle as f32 / TAU;
    let fall = -2.0 / (CELLS * CELLS) as f32;

    // One more cell on every side and one more direction take what the interpolation spreads beyond.
    const PADDED: usize = CELLS + 2;
    const WRAPPED: usize = DIRECTIONS + 1;
    let mut histogram = [0f32; PADDED * PADDED * WRAPPED];
    for dy in (-radius).max(1 - row)..=radius.min(height - 2 - row) {
        for dx in (-radius).max(1 - column)..=radius.min(width - 2 - column) {
            let across = dx as f32 * cos + dy as f32 * sin;
            let along = dy as f32 * cos - dx as f32 * sin;
            let (u, v) = (across + 0.5 * CELLS as f32 + 0.5, along + 0.5 * CELLS as f32 + 0.5);
            let reach = 0.0..CELLS as f32 + 1.0;
            if !(reach.contains(&u) && reach.contains(&v)) {
                continue;
            }
            let (gx, gy) = gradient(plane, (column + dx) as usize, (row + dy) as usize);
            let weight = (gx * gx + gy * gy).sqrt() * ((across * across + along * along) * fall).exp();
            let turn = turns(gy, gx) - start;
            let direction = (turn - turn.floor()) * DIRECTIONS as f32;
            let (iu, iv, id) = (u as usize, v as usize, (direction as usize).min(DIRECTIONS - 1));
            let (fu, fv, fd) = (u - iu as f32, v - iv as f32, direction - id as f32);
            for (jv, wv) in [(iv, 1.0 - fv), (iv + 1, fv)] {
                for (ju, wu) in [(iu, 1.0 - fu), (iu + 1, fu)] {
                    let base = (jv * PADDED + ju) * WRAPPED + id;
                    let share = weight * wv * wu;
                    histogram[base] += share * (1.0 - fd);
                    histogram[base + 1] += share * fd;
                }
            }
        }
    }
    let mut out = [0f32; LENGTH];
    for v in 0..CELLS {
        for u in 0..CELLS {
            let base = ((v + 1) * PADDED + u + 1) * WRAPPED;
            let cell = &mut out[(v * CELLS + u) * DIRECTIONS..][..DIRECTIONS];
            cell.copy_from_slice(&histogram[base..base + DIRECTIONS]);
            cell[0] += histogram[base + DIRECTIONS];
        }
    }
    let clip = CLIP * out.iter().map(|v| v * v).sum::<f32>().sqrt();
    out.iter_mut().for_each(|v| *v = v.min(clip));
    let sum = out.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    out.map(|v| (v / sum).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_polynomial_is_the_angle() {
        for i in 0..1000 {
            let angle = (i as f32 + 0.3) / 1000.0 * TAU;
            let turn = turns(2.0 * angle.sin(), 2.0 * angle.cos());
            assert!((turn - angle / TAU).abs() < 3e-5, "{angle}");
        }
        assert_eq!(turns(0.0, 0.0), 0.0);
    }
}
