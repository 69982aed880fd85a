//! Solids, and where a ray first meets them, in closed form.

use super::texture::Material;
use nalgebra::{Matrix3, Vector3};

pub(super) type Vector = Vector3<f64>;

/// Hits nearer than this (along a ray whose direction has length about 1) are the surface that the ray starts from.
pub(super) const NEAREST: f64 = 1e-6;

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

#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub(super) origin: Vector,
    pub(super) direction: Vector,
}

/// A solid in the room.
#[derive(Debug, Clone)]
pub(super) struct Body {
    pub(super) shape: Shape,
    pub(super) origin: Vector,
    /// Turns the room's directions into the solid's.
    pub(super) to_local: Matrix3<f64>,
    pub(super) material: Material,
}

/// Where a ray meets a body, in the body's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact {
    pub(super) t: f64,
    pub(super) point: Vector,
    pub(super) normal: Vector,
}

impl Body {
    /// The first contact with \\(t\\) between [`NEAREST`] and `limit`.
    pub(super) fn meet(&self, ray: &Ray, limit: f64) -> Option<Contact> {
        let origin = self.to_local * (ray.origin - self.origin);
        let direction = self.to_local * ray.direction;
        let (t, normal) = match self.shape {
            Shape::Block(half) => meet_block(origin, direction, half)?,
            Shape::Frustum { length, bottom, top } => meet_frustum(origin, direction, length, bottom, top)?,
            Shape::Ellipsoid(radii) => meet_ellipsoid(origin, direction, radii)?,
        };
        (t < limit).then(|| Contact { t, point: origin + direction * t, normal })
    }

    /// The axis-aligned bounds in the room: smallest and largest corner.
    pub(super) fn bounds(&self) -> (Vector, Vector) {
        let to_room = self.to_local.transpose();
        let about_origin = |reach: Vector| (self.origin - reach, self.origin + reach);
        match self.shape {
            Shape::Block(half) => about_origin(to_room.abs() * half),
            Shape::Ellipsoid(radii) => {
                let scaled = to_room * Matrix3::from_diagonal(&radii);
                about_origin(Vector::from_fn(|i, _| scaled.row(i).norm()))
            }
            Shape::Frustum { length, bottom, top } => {
                let axis: Vector = to_room.column(2).into();
                let across = axis.map(|a| (1.0 - a * a).max(0.0).sqrt());
                let end = self.origin + axis * length;
                let low = (self.origin - across * bottom).inf(&(end - across * top));
                (low, (self.origin + across * bottom).sup(&(end + across * top)))
            }
        }
    }
}

fn meet_block(origin: Vector, direction: Vector, half: Vector) -> Option<(f64, Vector)> {
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut near_axis, mut far_axis) = (0, 0);
    for axis in 0..3 {
        let inverse = direction[axis].recip();
        let (a, b) = ((-half[axis] - origin[axis]) * inverse, (half[axis] - origin[axis]) * inverse);
        let (enter, leave) = if a < b { (a, b) } else { (b, a) };
        // A ray that runs within a face gives NaN here, and the comparisons leave the other axes to decide.
        if enter > near {
            (near, near_axis) = (enter, axis);
        }
        if leave < far {
            (far, far_axis) = (leave, axis);
        }
    }
    if near > far {
        return None;
    }
    let face = |axis: usize, sign: f64| {
        let mut normal = Vector::zeros();
        normal[axis] = sign * direction[axis].signum();
        normal
    };
    if near > NEAREST {
        Some((near, face(near_axis, -1.0)))
    } else {
        (far > NEAREST).then(|| (far, face(far_axis, 1.0)))
    }
}

fn meet_ellipsoid(origin: Vector, direction: Vector, radii: Vector) -> Option<(f64, Vector)> {
    let (o, d) = (origin.component_div(&radii), direction.component_div(&radii));
    let roots = quadratic(d.norm_squared(), o.dot(&d), o.norm_squared() - 1.0)?;
    let t = roots.into_iter().find(|&t| t > NEAREST)?;
    Some((t, (o + d * t).component_div(&radii).normalize()))
}

/// Of a ray from `o` along `d`.
fn meet_frustum(o: Vector, d: Vector, length: f64, bottom: f64, top: f64) -> Option<(f64, Vector)> {
    let slope = (top - bottom) / length;
    let radius = bottom + slope * o.z;
    let a = d.x * d.x + d.y * d.y - slope * slope * d.z * d.z;
    let b = o.x * d.x + o.y * d.y - slope * d.z * radius;
    let c = o.x * o.x + o.y * o.y - radius * radius;
    let mut best: Option<(f64, Vector)> = None;
    let mut offer = |t: f64, normal: Vector| {
        if t > NEAREST && best.is_none_or(|(nearest, _)| t < nearest) {
            best = Some((t, normal));
        }
    };
    for t in quadratic(a, b, c).into_iter().flatten() {
        let p = o + d * t;
        if (0.0..=length).contains(&p.z) {
            offer(t, Vector::new(p.x, p.y, -slope * (bottom + slope * p.z)).normalize());
        }
    }
    for (height, radius, side) in [(0.0, bottom, -1.0), (length, top, 1.0)] {
        let t = (height - o.z) / d.z;
        let p = o + d * t;
        if p.x * p.x + p.y * p.y <= radius * radius {
            offer(t, Vector::new(0.0, 0.0, side));
        }
    }
    best
}

/// Roots of \\(a t^2 + 2 b t + c\\) in rising order, without cancellation.
fn quadratic(a: f64, b: f64, c: f64) -> Option<[f64; 2]> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let q = -(b + discriminant.sqrt().copysign(b));
    let (first, second) = (q / a, c / q);
    // A ray along the mantle has one root only; the other is not finite.
    let (first, second) =
        (if first.is_finite() { first } else { second }, if second.is_finite() { second } else { first });
    Some(if first < second { [first, second] } else { [second, first] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Unit};
    use proptest::prelude::*;

    impl Body {
        /// Signed measure of a room point: negative inside, positive outside, at most the distance in size for blocks
        /// and cones; for ellipsoids only its sign counts. Shares nothing with the ray formulas.
        fn outside(&self, point: Vector) -> f64 {
            let p = self.to_local * (point - self.origin);
            match self.shape {
                Shape::Block(half) => (p.abs() - half).max(),
                Shape::Ellipsoid(radii) => (p.component_div(&radii).norm() - 1.0) * radii.min(),
                Shape::Frustum { length, bottom, top } => {
                    let radius = bottom + (top - bottom) * (p.z / length).clamp(0.0, 1.0);
                    (p.x.hypot(p.y) - radius).max(p.z - length).max(-p.z)
                }
            }
        }
    }

    fn vector(reach: f64) -> impl Strategy<Value = Vector> {
        [-reach..reach, -reach..reach, -reach..reach].prop_map(|[x, y, z]| Vector::new(x, y, z))
    }

    fn body() -> impl Strategy<Value = Body> {
        let size = || 0.05..1.5_f64;
        let shape = prop_oneof![
            (size(), size(), size()).prop_map(|(x, y, z)| Shape::Block(Vector::new(x, y, z))),
            (size(), size(), size()).prop_map(|(x, y, z)| Shape::Ellipsoid(Vector::new(x, y, z))),
            (size(), size(), size()).prop_map(|(length, bottom, top)| Shape::Frustum { length, bottom, top }),
            (size(), size()).prop_map(|(length, r)| Shape::Frustum { length, bottom: r, top: r }),
        ];
        (shape, vector(1.0), vector(1.0), 0.0..6.0_f64).prop_map(|(shape, origin, axis, angle)| {
            let axis = Unit::try_new(axis, 1e-6).unwrap_or(Vector::z_axis());
            let to_local = Rotation3::from_axis_angle(&axis, angle).into_inner();
            Body { shape, origin, to_local, material: Material::plain(0.5, 0.5, 0.5) }
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(512))]
        #[test]
        fn a_ray_stops_at_the_surface_and_not_before(body in body(), origin in vector(4.0), aim in vector(1.2)) {
            let direction = aim - origin;
            let ray = Ray { origin, direction };
            let contact = body.meet(&ray, f64::INFINITY);
            let reach = contact.map_or(2.0, |c| c.t);
            let started_inside = body.outside(origin) < 0.0;
            for k in 1..200 {
                let at = body.outside(origin + direction * (reach * f64::from(k) / 200.0));
                prop_assert!(if started_inside { at < 1e-9 } else { at > -1e-9 }, "{} at {}", at, k);
            }
            if let Some(contact) = contact {
                let point = origin + direction * contact.t;
                prop_assert!(body.outside(point).abs() < 1e-9);
                prop_assert!((contact.normal.norm() - 1.0).abs() < 1e-9);
                let normal = body.to_local.transpose() * contact.normal;
                // Within a step of an edge two faces meet, and the normal is that of one.
                let aside = normal.cross(&if normal.x.abs() < 0.7 { Vector::x() } else { Vector::y() }).normalize();
                let tangents = [aside, -aside, normal.cross(&aside), -normal.cross(&aside)];
                if tangents.iter().all(|t| body.outside(point + t * 1e-3).abs() < 5e-5) {
                    let (out, inside) = (point + normal * 1e-4, point - normal * 1e-4);
                    prop_assert!(body.outside(out) > 0.0 && body.outside(inside) < 0.0);
                }
                let (low, high) = body.bounds();
                prop_assert!((0..3).all(|i| low[i] - 1e-9 <= point[i] && point[i] <= high[i] + 1e-9));
            }
        }
    }
}
