//! A bounding-volume hierarchy over the bodies of a room.

use super::solid::{Body, Contact, NEAREST, Ray, Vector};

/// Bodies a leaf holds at most.
const LEAF: usize = 3;

/// Bounds of some bodies, with the bodies or their two halves.
#[derive(Debug, Clone)]
pub(super) struct Hierarchy {
    low: Vector,
    high: Vector,
    content: Content,
}

#[derive(Debug, Clone)]
enum Content {
    Leaf(Vec<Body>),
    Branch(Box<[Hierarchy; 2]>),
}

impl Hierarchy {
    /// The tree over the bodies, split by the surface-area heuristic.
    pub(super) fn new(mut bodies: Vec<Body>) -> Self {
        let (low, high) = bounds_of(&bodies);
        // A hair of room, so that rounding never hides a face that lies in its own bounds.
        let slack = Vector::repeat(1e-9);
        let content = if bodies.len() <= LEAF {
            Content::Leaf(bodies)
        } else {
            let (axis, cut) = cheapest_cut(&bodies);
            bodies.sort_by(|a, b| middle(a, axis).total_cmp(&middle(b, axis)));
            let upper = bodies.split_off(cut);
            Content::Branch(Box::new([bodies, upper].map(Self::new)))
        };
        Self { low: low - slack, high: high + slack, content }
    }

    /// The nearest body that a ray meets before `limit`.
    pub(super) fn nearest(&self, ray: &Ray, mut limit: f64) -> Option<(&Body, Contact)> {
        let mut best = None;
        self.visit(ray, &ray.direction.map(f64::recip), &mut limit, &mut |body, limit| {
            if let Some(contact) = body.meet(ray, *limit) {
                *limit = contact.t;
                best = Some((body, contact));
            }
        });
        best
    }

    /// Whether anything casts a shadow from before `limit`.
    pub(super) fn blocked(&self, ray: &Ray, mut limit: f64) -> bool {
        let mut hit = false;
        self.visit(ray, &ray.direction.map(f64::recip), &mut limit, &mut |body, limit| {
            if body.material.casts_shadow && body.meet(ray, *limit).is_some() {
                hit = true;
                // Nothing lies before 0: the search ends.
                *limit = 0.0;
            }
        });
        hit
    }

    /// Calls `see`, which may bring the limit nearer, for the bodies in all bounds that the ray enters before the limit.
    fn visit<'a>(
        &'a self,
        ray: &Ray,
        inverse: &Vector,
        limit: &mut f64,
        see: &mut impl FnMut(&'a Body, &mut f64),
    ) {
        if !self.is_entered(ray, inverse, *limit) {
            return;
        }
        match &self.content {
            Content::Leaf(bodies) => bodies.iter().for_each(|body| see(body, limit)),
            Content::Branch(halves) => {
                let [lower, upper] = &**halves;
                // Where the middle of a half's bounds lies along the ray, up to a constant.
                let place = |half: &Self| (half.low + half.high).dot(&ray.direction);
                let nearest_first =
                    if place(lower) <= place(upper) { [lower, upper] } else { [upper, lower] };
                nearest_first.into_iter().for_each(|half| half.visit(ray, inverse, limit, see));
            }
        }
    }

    /// Whether the ray passes through the bounds before `limit`. Written with comparisons that NaN fails, which compile to
    /// single instructions; a ray within a bounding plane is then let through.
    fn is_entered(&self, ray: &Ray, inverse: &Vector, limit: f64) -> bool {
        let (mut near, mut far) = (NEAREST, limit);
        for axis in 0..3 {
            let a = (self.low[axis] - ray.origin[axis]) * inverse[axis];
            let b = (self.high[axis] - ray.origin[axis]) * inverse[axis];
            let (enter, leave) = if inverse[axis] < 0.0 { (b, a) } else { (a, b) };
            near = if enter > near { enter } else { near };
            far = if leave < far { leave } else { far };
        }
        near <= far
    }
}

/// The axis and number of bodies on its lower side that minimise \\(A_l n_l + A_r n_r\\) over all cuts between the bodies'
/// middles (Goldsmith and Salmon, 1987). Neither side gets less than an eighth, which bounds the tree's depth.
fn cheapest_cut(bodies: &[Body]) -> (usize, usize) {
    let n = bodies.len();
    let margin = (n / 8).max(1);
    let mut best = (f64::INFINITY, 0, n / 2);
    for axis in 0..3 {
        let mut sorted: Vec<&Body> = bodies.iter().collect();
        sorted.sort_by(|a, b| middle(a, axis).total_cmp(&middle(b, axis)));
        let boxes: Vec<_> = sorted.iter().map(|body| body.bounds()).collect();
        let lower = areas(boxes.iter());
        let upper = areas(boxes.iter().rev());
        for cut in margin..=n - margin {
            let cost = lower[cut - 1] * cut as f64 + upper[n - cut - 1] * (n - cut) as f64;
            if cost < best.0 {
                best = (cost, axis, cut);
            }
        }
    }
    (best.1, best.2)
}

/// Surface of the box about the first 1, 2, ... boxes, up to a factor.
fn areas<'a>(boxes: impl Iterator<Item = &'a (Vector, Vector)>) -> Vec<f64> {
    let (mut low, mut high) = EMPTY;
    boxes
        .map(|(a, b)| {
            (low, high) = (low.inf(a), high.sup(b));
            let size = high - low;
            size.x * size.y + size.y * size.z + size.z * size.x
        })
        .collect()
}

const EMPTY: (Vector, Vector) = (
    Vector::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
    Vector::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
);

fn bounds_of(bodies: &[Body]) -> (Vector, Vector) {
    bodies.iter().map(Body::bounds).fold(EMPTY, |(low, high), (a, b)| (low.inf(&a), high.sup(&b)))
}

fn middle(body: &Body, axis: usize) -> f64 {
    let (a, b) = body.bounds();
    a[axis] + b[axis]
}
