//! Triangles onto pixel centres, with perspective-correct interpolation.

use crate::mesh::Patch;
use crate::transfer::{Seen, Transfer};
use crate::zbuffer::Hit;

/// A barycentric weight below this is zero. A pixel centre that a vertex hits but for rounding then gets exactly that
/// vertex, and two triangles that share an edge leave no gap between them.
pub(crate) const SNAP: f64 = 1e-7;

/// A source point in the target: pixel, inverse depth, and source depth over target depth, which are 0 where it is not in front.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Projected {
    x: f64,
    y: f64,
    inverse_depth: f64,
    ratio: f64,
}

impl Projected {
    /// Source column `u`, row `v` at an inverse depth.
    pub(crate) fn new(transfer: &Transfer, u: f64, v: f64, disparity: f64) -> Self {
        let Some(Seen { x, y, ratio }) = transfer.at(u, v, disparity) else { return Self::default() };
        Self { x, y, inverse_depth: disparity / ratio, ratio: ratio.recip() }
    }
}

/// A corner of a triangle: its projection in the target and its source pixel (column, row).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    pub(crate) projected: Projected,
    pub(crate) u: f64,
    pub(crate) v: f64,
}

/// Emits the triangle, a part of `patch`, at every pixel centre `(row, column)` that it covers, edges included. A triangle with its back to the camera, or
/// with a corner behind the camera, covers nothing.
///
/// Inverse depth is affine in target pixels. The source pixel is affine in source pixels: with \\( \lambda_i \\) the
/// barycentric weights in the target, those in the source are \\( \propto \lambda_i z_i / z'_i \\).
#[inline]
pub(crate) fn triangle(
    [a, b, c]: &[Corner; 3],
    (height, width): (usize, usize),
    patch: Patch,
    mut emit: impl FnMut((usize, usize), Hit),
) {
    let [pa, pb, pc] = [&a.projected, &b.projected, &c.projected];
    if pa.ratio <= 0.0 || pb.ratio <= 0.0 || pc.ratio <= 0.0 {
        return;
    }
    let (Some((left, right)), Some((top, bottom))) =
        (centres([pa.x, pb.x, pc.x], width), centres([pa.y, pb.y, pc.y], height))
    else {
        return;
    };
    let (bx, by, cx, cy) = (pb.x - pa.x, pb.y - pa.y, pc.x - pa.x, pc.y - pa.y);
    let area = bx * cy - by * cx;
    if area.is_nan() || area <= 1e-12 {
        return;
    }
    let scale = area.recip();
    for row in top..=bottom {
        let y = row as f64 - pa.y;
        for column in left..=right {
            let x = column as f64 - pa.x;
            let (lb, lc) = ((x * cy - y * cx) * scale, (bx * y - by * x) * scale);
            let la = 1.0 - lb - lc;
            if la < -SNAP || lb < -SNAP || lc < -SNAP {
                continue;
            }
            let (la, lb, lc) = (snap(la), snap(lb), snap(lc));
            let inverse_depth =
                (la * pa.inverse_depth + lb * pb.inverse_depth + lc * pc.inverse_depth) / (la + lb + lc);
            let (ma, mb, mc) = (la * pa.ratio, lb * pb.ratio, lc * pc.ratio);
            let total = (ma + mb + mc).recip();
            let u = (ma * a.u + mb * b.u + mc * c.u) * total;
            let v = (ma * a.v + mb * b.v + mc * c.v) * total;
            emit((row, column), Hit { inverse_depth, u, v, patch });
        }
    }
}

pub(crate) fn snap(weight: f64) -> f64 {
    if weight < SNAP { 0.0 } else { weight }
}

/// First and last integer in `0..size` between the least and the greatest of three coordinates, or nothing.
#[inline]
fn centres([a, b, c]: [f64; 3], size: usize) -> Option<(usize, usize)> {
    let low = (a.min(b).min(c) - SNAP).max(0.0);
    let high = (a.max(b).max(c) + SNAP).min(size as f64 - 1.0);
    if low > high {
        return None;
    }
    // Casts truncate, which is floor from 0 on; `f64::ceil` is a call on baseline x86-64.
    let floor = low as usize;
    let first = floor + usize::from((floor as f64) < low);
    let last = high as usize;
    (first <= last).then_some((first, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(x: f64, y: f64, depth: f64) -> Corner {
        let projected = Projected { x, y, inverse_depth: depth.recip(), ratio: 1.0 };
        Corner { projected, u: x, v: y }
    }

    fn covered(corners: [Corner; 3]) -> Vec<(usize, usize)> {
        let mut pixels = Vec::new();
        triangle(&corners, (5, 5), Patch::default(), |pixel, _| pixels.push(pixel));
        pixels
    }

    #[test]
    fn edges_and_corners_are_covered_and_the_back_is_not() {
        let front = [corner(1.0, 1.0, 2.0), corner(3.0, 1.0, 2.0), corner(1.0, 3.0, 2.0)];
        assert_eq!(covered(front), [(1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (3, 1)]);
        assert!(covered([front[0], front[2], front[1]]).is_empty());
    }
}
