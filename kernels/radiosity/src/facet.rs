//! One triangle against one segment or ray.

use glam::DVec3;

use crate::bounds::Bounds;
use crate::surfel::Surfel;

/// A triangle that light does not pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Its corners, in either orientation: both sides block.
    pub vertices: [DVec3; 3],
    /// The face it belongs to, which may consist of any number of triangles that don't hide each
    /// other (a planar wall, say); [`Surfel::NO_FACE`] if none.
    pub face: u32,
}

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
    fn is_one_of(&self, faces: [u32; 2]) -> bool {
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
        opposite && !self.is_one_of(skip) && same_sign(self.volumes(from, to - from))
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
        (slope != 0.0 && total != 0.0 && same_sign(volumes))
            .then(|| (-self.height(origin) / slope, volumes.map(|v| v / total)))
    }
}

/// Whether a line of these [`volumes`](Facet::volumes) passes the triangle, borders included.
#[inline(always)]
fn same_sign([u, v, w]: [f64; 3]) -> bool {
    (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0)
}

/// The ends of a segment in an order that doesn't depend on how they are given.
pub(crate) fn ordered(a: DVec3, b: DVec3) -> (DVec3, DVec3) {
    if a.to_array() <= b.to_array() { (a, b) } else { (b, a) }
}
