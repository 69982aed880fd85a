//! Vectors, and the shapes of solids.

use nalgebra::Vector3;

pub(super) type Vector = Vector3<f64>;

/// A solid in its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    /// A box about the origin, by its half sizes.
    Block(Vector),
    /// A capped cone along z from the origin; a cylinder where the radii agree.
    Frustum { length: f64, bottom: f64, top: f64 },
    /// An ellipsoid about the origin, by its radii.
    Ellipsoid(Vector),
}
