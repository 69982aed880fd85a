//! Value noise from an integer hash.

use super::solid::Vector;

/// A number in 0 to 1 for a lattice point.
pub(super) fn lattice(x: i64, y: i64, z: i64) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
        ^ (z as u64).wrapping_mul(0x1656_67b1_9e37_79f9);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    h = (h ^ (h >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    (h >> 40) as f64 / (1_u64 << 24) as f64
}

/// Smooth noise in 0 to 1 with features of about unit size.
pub(super) fn value(p: Vector) -> f64 {
    let cell = p.map(f64::floor);
    let f = (p - cell).map(|t| t * t * (3.0 - 2.0 * t));
    let (x, y, z) = (cell.x as i64, cell.y as i64, cell.z as i64);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let edge = |dy: i64, dz: i64| mix(lattice(x, y + dy, z + dz), lattice(x + 1, y + dy, z + dz), f.x);
    let face = |dz: i64| mix(edge(0, dz), edge(1, dz), f.y);
    mix(face(0), face(1), f.z)
}

/// Three octaves of [`value`], in 0 to 1.
pub(super) fn fractal(p: Vector) -> f64 {
    let shifted = |p: Vector, s: f64| p + Vector::new(s, 2.0 * s, -s);
    (4.0 * value(p) + 2.0 * value(shifted(p * 2.07, 17.3)) + value(shifted(p * 4.31, 41.9))) / 7.0
}
