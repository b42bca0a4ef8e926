//! One triangle against one segment or ray.

use glam::DVec3;

use crate::elements::{Surfel, Triangle};
use crate::occlusion::bounds::Bounds;

/// A triangle as the queries want it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facet {
    pub(crate) vertices: [DVec3; 3],
    /// Unit normal of its plane; zero if the triangle is degenerate.
    pub(crate) normal: DVec3,
    pub(crate) face: u32,
    /// Index of the triangle in the caller's order.
    pub(crate) index: u32,
}

impl Facet {
    pub(crate) fn new(index: usize, &Triangle { vertices, face }: &Triangle) -> Self {
        let [a, b, c] = vertices;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        Self { vertices, normal, face, index: index as u32 }
    }

    /// The box around it.
    pub(crate) fn bounds(&self) -> Bounds<f64> {
        Bounds::of(self.vertices.map(|v| v.to_array()))
    }

    /// Where it counts as being when nodes are split.
    pub(crate) fn centroid(&self) -> [f64; 3] {
        let [a, b, c] = self.vertices;
        ((a + b + c) / 3.0).to_array()
    }

    /// Whether it belongs to one of two faces.
    #[inline(always)]
    pub(crate) fn is_one_of(&self, faces: [u32; 2]) -> bool {
        self.face != Surfel::<f64>::NO_FACE && (self.face == faces[0] || self.face == faces[1])
    }

    /// Signed distance of `p` from its plane.
    #[inline(always)]
    pub(crate) fn height(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.vertices[0])
    }

    /// Whether it hides the two [`ordered`] ends of a segment, which lie on the faces `skip`, from
    /// each other.
    #[inline(always)]
    pub(crate) fn blocks(&self, from: DVec3, to: DVec3, skip: [u32; 2], margin: f64) -> bool {
        let (start, end) = (self.height(from), self.height(to));
        let opposite = (start > margin && end < -margin) || (start < -margin && end > margin);
        opposite && !self.is_one_of(skip) && self.is_met(from, to - from)
    }

    /// Whether a line meets the triangle or passes so close to its border that rounding can't tell: where
    /// the edge of one wall ends within that of another, neither may leave the other's lines to it.
    #[inline(always)]
    fn is_met(&self, origin: DVec3, direction: DVec3) -> bool {
        let squares = self.vertices.map(|vertex| vertex.distance_squared(origin));
        let farthest_squared = squares[0].max(squares[1]).max(squares[2]);
        let slack = ROUNDING * direction.length() * farthest_squared;
        same_sign(self.volumes(origin, direction), slack)
    }

    /// direction·(edge start × edge end), six times the signed volume of each edge with the line;
    /// the k-th belongs to the edge opposite vertex k. Exactly opposite for an edge run through the
    /// other way, so that lines don't slip between neighbours.
    #[inline(always)]
    fn volumes(&self, origin: DVec3, direction: DVec3) -> [f64; 3] {
        let [a, b, c] = self.vertices.map(|vertex| vertex - origin);
        [direction.dot(b.cross(c)), direction.dot(c.cross(a)), direction.dot(a.cross(b))]
    }

    /// Distance along a ray of unit direction, of either sign, and barycentric weights.
    pub(crate) fn intersect(&self, origin: DVec3, direction: DVec3) -> Option<(f64, [f64; 3])> {
        let slope = self.normal.dot(direction);
        let volumes = self.volumes(origin, direction);
        let total: f64 = volumes.iter().sum();
        (slope != 0.0 && total != 0.0 && same_sign(volumes, 0.0))
            .then(|| (-self.height(origin) / slope, volumes.map(|v| v / total)))
    }
}

/// By how much [`volumes`](Facet::volumes) may be rounded, relative to the lengths that enter them.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Whether a line of these [`volumes`](Facet::volumes) passes the triangle, borders included; none counts
/// as negative or as positive that is within `slack` of zero.
#[inline(always)]
fn same_sign([u, v, w]: [f64; 3], slack: f64) -> bool {
    (u >= -slack && v >= -slack && w >= -slack) || (u <= slack && v <= slack && w <= slack)
}

/// The ends of a segment in an order that doesn't depend on how they are given.
pub(crate) fn ordered(a: DVec3, b: DVec3) -> (DVec3, DVec3) {
    if a.to_array() <= b.to_array() { (a, b) } else { (b, a) }
}
