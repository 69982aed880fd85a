//! A bounding-volume hierarchy over the bodies of a room.

use super::solid::{Body, Contact, NEAREST, Ray, Vector};

/// Bodies a leaf holds at most.
const LEAF: usize = 3;

#[derive(Debug, Clone)]
pub(super) struct Hierarchy {
    pub(super) bodies: Vec<Body>,
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    low: Vector,
    high: Vector,
    content: Content,
}

#[derive(Debug, Clone, Copy)]
enum Content {
    /// A run of bodies.
    Leaf { first: usize, count: usize },
    /// The left child comes right behind its parent.
    Branch { right: usize },
}

impl Hierarchy {
    pub(super) fn new(mut bodies: Vec<Body>) -> Self {
        let mut nodes = Vec::with_capacity(bodies.len());
        build(&mut bodies, 0, &mut nodes);
        Self { bodies, nodes }
    }

    /// The nearest body that a ray meets before `limit`.
    pub(super) fn nearest(&self, ray: &Ray, limit: f64) -> Option<(&Body, Contact)> {
        let mut best: Option<(&Body, Contact)> = None;
        self.visit(ray, limit, |body, limit| {
            let contact = body.meet(ray, limit)?;
            best = Some((body, contact));
            Some(contact.t)
        });
        best
    }

    /// Whether anything casts a shadow from before `limit`.
    pub(super) fn blocked(&self, ray: &Ray, limit: f64) -> bool {
        let mut hit = false;
        self.visit(ray, limit, |body, limit| {
            if body.material.casts_shadow && body.meet(ray, limit).is_some() {
                hit = true;
                // Nothing lies before 0: the search ends.
                return Some(0.0);
            }
            None
        });
        hit
    }

    /// Calls `see` for the bodies whose bounds the ray enters before the limit; `see` returns a nearer limit.
    fn visit<'a>(&'a self, ray: &Ray, mut limit: f64, mut see: impl FnMut(&'a Body, f64) -> Option<f64>) {
        let inverse = ray.direction.map(f64::recip);
        let mut stack = [0_u32; 48];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let at = stack[depth] as usize;
            let node = &self.nodes[at];
            if !enters(node, ray, &inverse, limit) {
                continue;
            }
            match node.content {
                Content::Leaf { first, count } => {
                    for body in &self.bodies[first..first + count] {
                        limit = see(body, limit).unwrap_or(limit);
                    }
                }
                // A cut leaves at most 7/8 of the bodies on a side: a room's thousands never get deeper than the stack.
                Content::Branch { right } if depth + 2 <= stack.len() => {
                    // Where the middle of a child's bounds lies along the ray, up to a constant.
                    let place = |at: usize| (self.nodes[at].low + self.nodes[at].high).dot(&ray.direction);
                    let left = at + 1;
                    let (near, far) = if place(left) <= place(right) { (left, right) } else { (right, left) };
                    stack[depth] = far as u32;
                    stack[depth + 1] = near as u32;
                    depth += 2;
                }
                Content::Branch { .. } => {}
            }
        }
    }
}

/// Whether the ray passes through the node's bounds before `limit`. Written with comparisons that NaN fails, which compile to
/// single instructions; a ray within a bounding plane is then let through.
fn enters(node: &Node, ray: &Ray, inverse: &Vector, limit: f64) -> bool {
    let (mut near, mut far) = (NEAREST, limit);
    for axis in 0..3 {
        let a = (node.low[axis] - ray.origin[axis]) * inverse[axis];
        let b = (node.high[axis] - ray.origin[axis]) * inverse[axis];
        let (enter, leave) = if inverse[axis] < 0.0 { (b, a) } else { (a, b) };
        near = if enter > near { enter } else { near };
        far = if leave < far { leave } else { far };
    }
    near <= far
}

/// Appends the tree over `bodies` (a slice that starts at index `first`), split by the surface-area heuristic.
fn build(bodies: &mut [Body], first: usize, nodes: &mut Vec<Node>) {
    let (low, high) = bounds_of(bodies);
    // A hair of room, so that rounding never hides a face that lies in its own bounds.
    let slack = Vector::repeat(1e-9);
    let at = nodes.len();
    nodes.push(Node {
        low: low - slack,
        high: high + slack,
        content: Content::Leaf { first, count: bodies.len() },
    });
    if bodies.len() <= LEAF {
        return;
    }
    let (axis, cut) = cheapest_cut(bodies);
    bodies.sort_by(|a, b| middle(a, axis).total_cmp(&middle(b, axis)));
    let (left, right) = bodies.split_at_mut(cut);
    build(left, first, nodes);
    let right_at = nodes.len();
    build(right, first + cut, nodes);
    nodes[at].content = Content::Branch { right: right_at };
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
