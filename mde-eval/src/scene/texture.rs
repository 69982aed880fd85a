//! What surfaces look like.

use super::noise::{fractal, lattice, value};
use super::solid::{Shape, Vector};

/// A linear colour.
pub(super) type Colour = Vector;

/// A colour as an image has it (sRGB, 0 to 1), made linear.
pub(super) fn rgb(red: f64, green: f64, blue: f64) -> Colour {
    Colour::new(red, green, blue).map(|c| c.powf(2.2))
}

/// How a surface takes light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Material {
    pub(super) texture: Texture,
    /// Strength of the highlight.
    pub(super) gloss: f64,
    /// Light of its own, in units of the texture's colour.
    pub(super) glow: f64,
    pub(super) casts_shadow: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Texture {
    Plain(Colour),
    /// Slightly uneven paint.
    Plaster(Colour),
    /// Light and dark grain along the longest side, and a seed.
    Wood([Colour; 2], f64),
    /// Light and dark floor boards along y, and their width.
    Planks([Colour; 2], f64),
    /// Squares of two colours, their joints, and their size.
    Tiles([Colour; 3], f64),
    /// Running bond of bricks, and their joints.
    Bricks([Colour; 2]),
    /// Woven or tufted cloth, and the width of its thread.
    Cloth(Colour, f64),
    /// Stripes of two colours across the first coordinate of a face, and their width.
    Stripes([Colour; 2], f64),
    /// A rug: ground, diamonds, border.
    Rug([Colour; 3]),
    /// A ground with flecks, and their size.
    Speckle([Colour; 2], f64),
    /// An abstract picture by a seed.
    Painting(f64),
    /// Sky over hills and trees, as seen through a window, by a seed.
    Outdoors(f64),
    /// A lit screen with windows and lines of text, by a seed.
    Screen(f64),
    /// A book's spine: cloth, two bands and a title, by a seed.
    Spine([Colour; 2], f64),
}

impl Material {
    pub(super) const fn new(texture: Texture) -> Self {
        Self { texture, gloss: 0.0, glow: 0.0, casts_shadow: true }
    }

    pub(super) fn plain(red: f64, green: f64, blue: f64) -> Self {
        Self::new(Texture::Plain(rgb(red, green, blue)))
    }

    pub(super) const fn gloss(self, gloss: f64) -> Self {
        Self { gloss, ..self }
    }

    /// Shines, and lets light pass.
    pub(super) const fn glow(self, glow: f64) -> Self {
        Self { glow, ..self.shadowless() }
    }

    /// Casts no shadow: what shines, and the walls, which all lights are within.
    pub(super) const fn shadowless(self) -> Self {
        Self { casts_shadow: false, ..self }
    }
}

impl Texture {
    /// The colour at a point of a solid, both in the solid's frame.
    pub(super) fn colour(&self, shape: &Shape, point: Vector, normal: Vector) -> Colour {
        let (u, v) = face(point, normal);
        match *self {
            Self::Plain(colour) => colour,
            Self::Plaster(colour) => {
                colour * (0.93 + 0.1 * fractal(point * 3.0) + 0.04 * value(point * 90.0))
            }
            Self::Wood([light, dark], seed) => light.lerp(&dark, grain(along_grain(shape, point), seed)),
            Self::Planks([light, dark], width) => planks(light, dark, width, u, v),
            Self::Tiles([first, second, joint], size) => tiles(first, second, joint, size, u, v),
            Self::Bricks([brick, joint]) => bricks(brick, joint, u, v),
            Self::Cloth(colour, thread) => {
                let weave = 0.5 + 0.25 * ((u / thread).sin() + (v / thread).sin());
                colour * (0.72 + 0.25 * weave + 0.3 * (fractal(point * 25.0) - 0.4))
            }
            Self::Stripes([first, second], width) => {
                let base = if (u / width).rem_euclid(2.0) < 1.0 { first } else { second };
                base * (0.94 + 0.1 * fractal(point * 6.0))
            }
            Self::Rug([ground, figure, border]) => rug(half_size(shape), ground, figure, border, u, v),
            Self::Speckle([ground, fleck], size) => {
                let spots = value(point / size);
                ground.lerp(&fleck, ((spots - 0.55) * 6.0).clamp(0.0, 1.0))
                    * (0.9 + 0.2 * fractal(point * 4.0))
            }
            Self::Painting(seed) => painting(point, seed),
            Self::Outdoors(seed) => outdoors(u, v, seed),
            Self::Screen(seed) => screen(u, v, seed),
            Self::Spine([cloth, band], seed) => spine(half_size(shape).z, cloth, band, seed, point),
        }
    }
}

/// Coordinates within the face that a normal points out of.
fn face(p: Vector, normal: Vector) -> (f64, f64) {
    match normal.iamax() {
        0 => (p.y, p.z),
        1 => (p.x, p.z),
        _ => (p.x, p.y),
    }
}

/// From the origin of a solid's frame to its sides; of a cone, to its mantle and its end.
fn half_size(shape: &Shape) -> Vector {
    match *shape {
        Shape::Block(half) | Shape::Ellipsoid(half) => half,
        Shape::Frustum { length, bottom, .. } => Vector::new(bottom, bottom, length),
    }
}

/// The point with its first coordinate along the solid's longest side.
fn along_grain(shape: &Shape, p: Vector) -> Vector {
    let longest = match shape {
        Shape::Block(half) | Shape::Ellipsoid(half) => half.imax(),
        Shape::Frustum { .. } => 2,
    };
    Vector::new(p[longest], p[(longest + 1) % 3], p[(longest + 2) % 3])
}

/// How dark the wood is, in 0 to 1: warped rings drawn out along the grain, with fine pores.
fn grain(p: Vector, seed: f64) -> f64 {
    let shifted = p + Vector::new(seed * 7.1, seed * 3.7, seed * 5.3);
    let warp = fractal(Vector::new(shifted.x * 1.5, shifted.y * 6.0, shifted.z * 6.0));
    let rings = (0.5 + 0.5 * (shifted.y * 50.0 + shifted.z * 34.0 + warp * 14.0).sin()).powi(2);
    let pores = value(Vector::new(shifted.x * 12.0, shifted.y * 260.0, shifted.z * 260.0));
    (0.55 * rings + 0.25 * pores + 0.3 * warp).clamp(0.0, 1.0)
}

fn planks(light: Colour, dark: Colour, width: f64, u: f64, v: f64) -> Colour {
    const LENGTH: f64 = 1.3;
    let row = (u / width).floor();
    let shifted = v + LENGTH * lattice(row as i64, 7, 1);
    let board = (shifted / LENGTH).floor();
    let tone = lattice(row as i64, board as i64, 2);
    let within = (u / width - row, shifted / LENGTH - board);
    let joint = within.0.min(1.0 - within.0) * width < 0.002 || within.1.min(1.0 - within.1) * LENGTH < 0.002;
    let wood = grain(Vector::new(shifted, u, 0.0), row * 1.3 + board * 0.7);
    light.lerp(&dark, 0.75 * wood) * (0.72 + 0.45 * tone) * if joint { 0.35 } else { 1.0 }
}

fn tiles(first: Colour, second: Colour, joint: Colour, size: f64, u: f64, v: f64) -> Colour {
    let (x, y) = ((u / size).floor(), (v / size).floor());
    let (fu, fv) = (u / size - x, v / size - y);
    if fu.min(1.0 - fu).min(fv).min(1.0 - fv) * size < 0.003 {
        return joint;
    }
    let base = if (x + y).rem_euclid(2.0) < 1.0 { first } else { second };
    base * (0.9
        + 0.12 * lattice(x as i64, y as i64, 5)
        + 0.1 * (fractal(Vector::new(u * 9.0, v * 9.0, x)) - 0.5))
}

fn bricks(brick: Colour, joint: Colour, u: f64, v: f64) -> Colour {
    let (length, height) = (0.22, 0.075);
    let row = (v / height).floor();
    let shifted = u / length + 0.5 * row.rem_euclid(2.0);
    let column = shifted.floor();
    let (fu, fv) = ((shifted - column) * length, (v / height - row) * height);
    let rough = 0.003 * value(Vector::new(u * 60.0, v * 60.0, 3.0));
    let edge = fu.min(length - fu).min(fv).min(height - fv);
    let noise = fractal(Vector::new(u * 40.0, v * 40.0, 1.0));
    if edge < 0.004 + rough {
        return joint * (0.8 + 0.3 * noise);
    }
    brick * (0.6 + 0.5 * lattice(column as i64, row as i64, 9) + 0.35 * (noise - 0.4))
}

fn rug(half: Vector, ground: Colour, figure: Colour, border: Colour, u: f64, v: f64) -> Colour {
    let edge = (half.x - u.abs()).min(half.y - v.abs());
    let pile = 0.75 + 0.45 * value(Vector::new(u * 220.0, v * 220.0, 0.0));
    let lines = (0.10..0.13).contains(&edge) || (0.20..0.215).contains(&edge);
    let diamond = ((u * 3.6).rem_euclid(1.0) - 0.5).abs() + ((v * 3.6).rem_euclid(1.0) - 0.5).abs();
    let base = if lines {
        figure
    } else if edge < 0.2 {
        border
    } else if diamond < 0.18 || (0.3..0.38).contains(&diamond) {
        figure
    } else {
        ground
    };
    base * pile
}

fn painting(p: Vector, seed: f64) -> Colour {
    let q = Vector::new(p.x * 3.0 + seed * 13.0, p.y * 3.0 - seed * 5.0, p.z * 3.0 + seed * 9.0);
    let (a, b) = (fractal(q * 1.4), fractal(q * 1.4 + Vector::repeat(31.0)));
    let hue = |k: f64| 0.5 + 0.5 * (6.3 * (seed * 0.37 + a * 1.3 + k)).cos();
    let paint = Colour::new(hue(0.0), hue(0.33), hue(0.67)) * 0.5;
    let bands = if (b * 9.0).rem_euclid(1.0) < 0.5 { 1.0 } else { 0.55 };
    (paint * bands).lerp(&rgb(0.92, 0.88, 0.78), 0.35 * (p.z * 7.0 + a * 6.0).sin().max(0.0))
}

fn outdoors(u: f64, v: f64, seed: f64) -> Colour {
    let cloud = fractal(Vector::new(u * 1.6 + seed, v * 3.0, seed));
    let sky = rgb(0.62, 0.78, 0.95).lerp(&rgb(0.98, 0.98, 0.98), ((cloud - 0.35) * 3.0).clamp(0.0, 1.0));
    let hill = -0.05 + 0.35 * fractal(Vector::new(u * 1.1, seed * 3.0, 0.5)) - 0.2;
    let trees = -0.35 + 0.5 * fractal(Vector::new(u * 5.0, seed, 8.5)) - 0.15;
    let leaf = fractal(Vector::new(u * 30.0, v * 30.0, seed));
    if v < trees {
        rgb(0.22, 0.36, 0.16) * (0.5 + leaf)
    } else if v < hill {
        rgb(0.46, 0.57, 0.40) * (0.75 + 0.4 * leaf)
    } else {
        sky
    }
}

fn screen(u: f64, v: f64, seed: f64) -> Colour {
    let column = ((u + 0.3) / 0.14).floor();
    let row = (v / 0.012).floor();
    let start = 0.02 * (4.0 * lattice(row as i64, column as i64, seed as i64)).floor();
    let frame = (u + 0.3).rem_euclid(0.14);
    let long = frame > 0.012 + start && frame < 0.03 + 0.1 * lattice(column as i64, row as i64, 3);
    let letter = lattice((u / 0.004).floor() as i64, row as i64, 11) > 0.3;
    if v > 0.125 {
        rgb(0.25, 0.42, 0.62)
    } else if long && letter && (v / 0.012).rem_euclid(1.0) < 0.5 {
        rgb(0.75, 0.86, 0.70)
    } else {
        rgb(0.10, 0.12, 0.17)
    }
}

fn spine(half: f64, cloth: Colour, band: Colour, seed: f64, p: Vector) -> Colour {
    let height = p.z / half;
    let ring = (0.62..0.70).contains(&height.abs()) && seed > 0.35;
    let letter = lattice((p.z / 0.006).floor() as i64, (seed * 1e4) as i64, 4) > 0.35;
    let title = height.abs() < 0.4 && p.x.abs() < 0.005 && letter;
    let base = if ring || title { band } else { cloth };
    base * (0.85 + 0.25 * fractal(p * 40.0 + Vector::repeat(seed * 50.0)))
}
