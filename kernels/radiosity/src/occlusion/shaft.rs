//! The shaft between two cells: everything that a segment from one to the other can pass.

use farfield::Real;
use glam::DVec3;

use crate::elements::{Element, Surfel};
use crate::occlusion::bounds::Bounds;
use crate::occlusion::facet::Facet;
use crate::occlusion::occluders::Occluders;
use crate::occlusion::shapes::Shape;

impl Occluders {
    /// Whether certainly nothing hides any point of one element from any point of another; false says nothing. O(log n)
    /// steps through the hierarchy, and some for each facet near the two.
    pub fn are_clear(&self, elements: [&Element; 2]) -> bool {
        let surfels = elements.map(|element| [*element.surfel()]);
        let shapes = elements.map(|element| [Shape::new(0, element)]);
        Shaft::new((&surfels[0], &shapes[0]), (&surfels[1], &shapes[1])).is_clear(self)
    }
}

/// The convex hull of the bounding boxes of two groups of surfels, all of their shapes included.
///
/// The hull of two axis-aligned boxes is bounded by the sides of the box around both and by planes
/// through an edge of each, parallel to an axis (Haines and Wallace 1994).
pub(crate) struct Shaft<'a> {
    /// The shapes of the surfels at both ends.
    ends: [&'a [Shape]; 2],
    bounds: [Bounds<f64>; 2],
    /// Faces on which all surfels of an end lie: no occluder to any of the segments.
    own_faces: [Option<u32>; 2],
    hull: Bounds<f64>,
    edges: Vec<Plane>,
}

/// Where more facets are in the way, they are too small for one to hide a cell.
const MOST_FACETS: usize = 16;

/// The half-space normal·x ≤ offset.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: DVec3,
    offset: f64,
}

impl<'a> Shaft<'a> {
    /// The shaft between surfels of these shapes.
    pub(crate) fn new<T: Real>(
        (targets, target_shapes): (&[Surfel<T>], &'a [Shape]),
        (sources, source_shapes): (&[Surfel<T>], &'a [Shape]),
    ) -> Self {
        let ends = [target_shapes, source_shapes];
        let bounds = ends.map(|end| Bounds::of(corners_of(end).map(|p| p.to_array())));
        let hull = bounds[0].union(&bounds[1]);
        // The hull grows by the rounding of its own planes; the margin of the occluders comes on top.
        let slack = 32.0 * f64::EPSILON * hull.farthest();
        Self {
            ends,
            bounds,
            own_faces: [targets, sources].map(common_face),
            hull: hull.grown(slack),
            edges: edge_planes(&bounds[0], &bounds[1], slack),
        }
    }

    /// Whether certainly no occluder hides any of the sources from any of the targets.
    pub(crate) fn is_clear(&self, occluders: &Occluders) -> bool {
        let margin = occluders.margin();
        occluders.visit(|node| self.meets(node), |facet| self.may_block(facet, margin)).is_none()
    }

    /// Whether certainly all sources are hidden from all targets, by one convex wall.
    pub(crate) fn is_blocked(&self, occluders: &Occluders) -> bool {
        let margin = occluders.margin();
        let mut asked = Surfel::<f64>::NO_FACE;
        let (mut hidden, mut facets) = (false, 0);
        let [a, b] = &self.bounds;
        occluders.visit(
            |node| self.meets(node),
            |facet| {
                facets += 1;
                // The triangles of a face often come one after the other.
                if facet.face != asked {
                    asked = facet.face;
                    let wall = occluders.wall(facet.face);
                    hidden = wall.is_some_and(|wall| wall.hides([a, b], margin));
                }
                hidden || facets == MOST_FACETS
            },
        );
        hidden
    }

    /// Whether a box may have a point in common with the hull.
    fn meets(&self, node: &Bounds<f64>) -> bool {
        let reaches = |plane: &Plane| {
            let (least, _) = node.extent_along(plane.normal.to_array(), [0.0; 3]);
            least <= plane.offset
        };
        self.hull.overlaps(node) && self.edges.iter().all(reaches)
    }

    /// Whether a facet may hide some source from some target.
    fn may_block(&self, facet: &Facet, margin: f64) -> bool {
        let own = self.own_faces.contains(&Some(facet.face));
        !own && !self.is_on_one_side(facet, margin) && self.cuts(facet, margin)
    }

    /// Whether all surfels lie on one closed side of a facet's plane, as do the surfels of a convex
    /// room with respect to its walls: the very condition under which no segment is blocked.
    fn is_on_one_side(&self, facet: &Facet, margin: f64) -> bool {
        let anchor = facet.vertices[0].to_array();
        let extents = self.bounds.map(|b| b.extent_along(facet.normal.to_array(), anchor));
        let (low, high) = (extents[0].0.min(extents[1].0), extents[0].1.max(extents[1].1));
        if low >= -margin || high <= margin {
            return true;
        }
        let corners = || self.ends.into_iter().flat_map(corners_of);
        let heights = || corners().map(|corner| facet.height(corner));
        heights().all(|h| h >= -margin) || heights().all(|h| h <= margin)
    }

    /// Whether a facet comes within the margin of the hull: what the planes leave of it isn't empty.
    fn cuts(&self, facet: &Facet, margin: f64) -> bool {
        let sides = (0..3).flat_map(|k| {
            let axis = DVec3::AXES[k];
            let low = Plane { normal: -axis, offset: -self.hull.low[k] };
            [low, Plane { normal: axis, offset: self.hull.high[k] }]
        });
        let planes = sides.chain(self.edges.iter().copied());
        let mut polygon = Polygon::from(facet.vertices);
        for Plane { normal, offset } in planes {
            polygon.clip(normal, offset + margin);
            if polygon.count == 0 {
                return false;
            }
        }
        true
    }
}

/// The planes through an edge of each box that bound the hull of both: seen along each axis, the
/// hull of two rectangles has at most one slanted side per quadrant.
fn edge_planes(a: &Bounds<f64>, b: &Bounds<f64>, slack: f64) -> Vec<Plane> {
    let corner =
        |bounds: &Bounds<f64>, k: usize, up: bool| if up { bounds.high[k] } else { bounds.low[k] };
    let mut planes = Vec::with_capacity(12);
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        for (up_i, up_j) in [(false, false), (false, true), (true, false), (true, true)] {
            // The outermost corners in this quadrant's direction: a side joins them if each of them
            // is further out along one of the two axes.
            let (a_i, a_j) = (corner(a, i, up_i), corner(a, j, up_j));
            let (b_i, b_j) = (corner(b, i, up_i), corner(b, j, up_j));
            let sign = |up: bool| if up { 1.0 } else { -1.0 };
            let (gain_i, gain_j) = ((a_i - b_i) * sign(up_i), (a_j - b_j) * sign(up_j));
            if gain_i * gain_j < 0.0 {
                let mut normal = DVec3::ZERO;
                normal[i] = gain_j.abs() * sign(up_i);
                normal[j] = gain_i.abs() * sign(up_j);
                let normal = normal.normalize();
                let offset =
                    (normal[i] * a_i + normal[j] * a_j).max(normal[i] * b_i + normal[j] * b_j);
                planes.push(Plane { normal, offset: offset + slack });
            }
        }
    }
    planes
}

/// A convex polygon. Each of the 18 planes of a shaft adds one corner at most.
struct Polygon {
    corners: [DVec3; 3 + 18],
    count: usize,
}

impl From<[DVec3; 3]> for Polygon {
    fn from(vertices: [DVec3; 3]) -> Self {
        let mut corners = [DVec3::ZERO; 21];
        corners[..3].copy_from_slice(&vertices);
        Self { corners, count: 3 }
    }
}

impl Polygon {
    /// Leaves what lies in the half-space normal·x ≤ offset (Sutherland and Hodgman 1974).
    fn clip(&mut self, normal: DVec3, offset: f64) {
        let excess = |p: DVec3| normal.dot(p) - offset;
        let Self { corners, count } = *self;
        let corners = &corners[..count];
        if corners.iter().all(|&p| excess(p) <= 0.0) {
            return;
        }
        self.count = 0;
        let mut keep = |p| {
            self.corners[self.count] = p;
            self.count += 1;
        };
        for (k, &p) in corners.iter().enumerate() {
            let next = corners[(k + 1) % count];
            let (here, there) = (excess(p), excess(next));
            if here <= 0.0 {
                keep(p);
            }
            if (here < 0.0 && there > 0.0) || (here > 0.0 && there < 0.0) {
                keep(p + (next - p) * (here / (here - there)));
            }
        }
    }
}

fn corners_of(shapes: &[Shape]) -> impl Iterator<Item = DVec3> {
    shapes.iter().flat_map(Shape::corners)
}

/// The face that all surfels lie on, if it is one and the same.
fn common_face<T: Real>(surfels: &[Surfel<T>]) -> Option<u32> {
    let face = surfels.first()?.face;
    let common = face != Surfel::<T>::NO_FACE && surfels.iter().all(|s| s.face == face);
    common.then_some(face)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::{Patch, Triangle};
    use crate::occlusion::occluders::tests::triangles;
    use farfield_testing::clouds::Random;

    const NO_FACE: u32 = Surfel::<f64>::NO_FACE;

    fn surfel(position: DVec3, face: u32) -> Surfel {
        Surfel { position, normal: DVec3::Z, area: 1.0, face }
    }

    fn corners(low: DVec3, high: DVec3, face: u32) -> Vec<Surfel> {
        let pick =
            |k: usize| DVec3::select(glam::BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), high, low);
        (0..8).map(|k| surfel(pick(k), face)).collect()
    }

    fn shapes(surfels: &[Surfel]) -> Vec<Shape> {
        surfels.iter().map(Shape::point).collect()
    }

    fn is_clear(t: &[Surfel], s: &[Surfel], occluders: &Occluders) -> bool {
        let shapes = [shapes(t), shapes(s)];
        Shaft::new((t, &shapes[0]), (s, &shapes[1])).is_clear(occluders)
    }

    fn single(vertices: [DVec3; 3]) -> Occluders {
        Occluders::new(&[Triangle { vertices, face: 5 }]).unwrap()
    }

    #[test]
    fn a_facet_in_the_corner_of_the_common_box_is_outside_the_shaft() {
        let a = corners(DVec3::ZERO, DVec3::ONE, NO_FACE);
        let b = corners(DVec3::splat(4.0), DVec3::splat(5.0), NO_FACE);
        let facet_at = |p: DVec3| single([p, p + DVec3::X * 0.3, p + DVec3::Y * 0.3]);
        assert!(is_clear(&a, &b, &facet_at(DVec3::new(4.5, 0.2, 2.0))));
        assert!(!is_clear(&a, &b, &facet_at(DVec3::splat(2.5))));
    }

    #[test]
    fn patches_are_clear_of_what_is_beside_them() {
        let square = |z: f64| {
            let at = |x: f64, y: f64| DVec3::new(x, y, z);
            let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
            Element::patch(Patch::new(&corners).unwrap(), NO_FACE)
        };
        let (low, high) = (square(0.0), square(1.0));
        for (x, clear) in [(1.1, true), (0.9, false)] {
            let corner = DVec3::new(x, 0.5, 0.5);
            let beside = single([corner, corner + DVec3::X, corner + DVec3::X + DVec3::Z * 0.1]);
            assert_eq!(beside.are_clear([&low, &high]), clear);
        }
    }

    #[test]
    fn a_large_facet_beside_the_shaft_is_outside_although_no_plane_has_it_whole() {
        let a = corners(DVec3::ZERO, DVec3::ONE, NO_FACE);
        let b = corners(DVec3::new(0.0, 0.0, 9.0), DVec3::new(1.0, 1.0, 10.0), NO_FACE);
        let diagonal = |shift: f64| {
            let edge = DVec3::new(shift, shift, 0.0);
            let apex = DVec3::new(30.0, 30.0, 31.0);
            single([edge + DVec3::new(40.0, -40.0, 5.0), edge + DVec3::new(-40.0, 40.0, 5.0), apex])
        };
        assert!(is_clear(&a, &b, &diagonal(1.1)));
        assert!(!is_clear(&a, &b, &diagonal(0.9)));
    }

    #[test]
    fn walls_that_the_surfels_lie_on_do_not_block() {
        // A floor and a wall that meet in an edge, both bent backwards a little: not convex.
        let floor = [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.1), DVec3::new(0.0, 2.0, 0.1)];
        let occluders = single(floor);
        let on_floor = |face| {
            vec![surfel(DVec3::new(0.5, 0.5, 0.06), face), surfel(DVec3::new(0.2, 0.5, 0.02), face)]
        };
        let wall = corners(DVec3::new(0.0, 0.0, 0.5), DVec3::new(0.0, 1.0, 1.0), NO_FACE);
        assert!(!is_clear(&on_floor(NO_FACE), &wall, &occluders));
        assert!(is_clear(&on_floor(5), &wall, &occluders));
        assert!(is_clear(&wall, &on_floor(5), &occluders));
        // Exactly on the plane, without a word about faces.
        let flat = single([DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0]);
        let touching = corners(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), NO_FACE);
        assert!(is_clear(&touching, &wall, &flat));
    }

    /// Surfels of one cell: mostly of one face, on a lattice that the triangles share or not.
    fn end(random: &mut Random) -> Vec<Surfel> {
        let (centre, size) = (2.0 * random.in_cube() - 1.0, 0.25 * random.in_cube());
        let (face, lattice) = (random.below(5), random.below(2) == 0);
        let one = |random: &mut Random| {
            let p = centre + (2.0 * random.in_cube() - 1.0) * size;
            let stray = usize::from(random.unit() < 0.1);
            let face = [0, 1, 2, 3, NO_FACE][(face + stray) % 5];
            surfel(if lattice { (p * 4.0).round() / 4.0 } else { p }, face)
        };
        (0..1 + random.below(5)).map(|_| one(random)).collect()
    }

    #[test]
    fn no_segment_of_a_clear_shaft_is_blocked() {
        let mut clear = 0;
        for seed in 0..2000 {
            let random = &mut Random::new(seed);
            let (triangles, t, s) = (triangles(random), end(random), end(random));
            let occluders = Occluders::new(&triangles).unwrap();
            if is_clear(&t, &s, &occluders) {
                clear += 1;
                for (x, y) in t.iter().flat_map(|x| s.iter().map(move |y| (x, y))) {
                    let blocked = occluders.blocked(x.position, y.position, [x.face, y.face]);
                    assert!(!blocked, "{seed}");
                }
            }
        }
        assert!(clear > 100, "{clear}");
    }

    #[test]
    fn the_planes_hold_every_segment_and_nothing_else() {
        for seed in 0..2000 {
            let random = &mut Random::new(seed);
            let (t, s, along) = (end(random), end(random), random.unit());
            let p = 3.0 * random.in_cube() - 1.5;
            let shapes = [shapes(&t), shapes(&s)];
            let shaft = Shaft::new((&t, &shapes[0]), (&s, &shapes[1]));
            let holds = |p: DVec3| shaft.meets(&Bounds::of([p.to_array()]));
            for (x, y) in t.iter().flat_map(|x| s.iter().map(move |y| (x, y))) {
                assert!(holds(x.position.lerp(y.position, along)), "{seed}");
            }
            // p lies in the hull iff some τ puts it into the box (1−τ)a + τb: linear in τ, so the
            // interval of good τ can be written down per axis.
            let [a, b] = &shaft.bounds;
            let (mut low, mut high) = (0.0f64, 1.0f64);
            for k in 0..3 {
                for (a, b, sign) in [(a.low[k], b.low[k], 1.0), (a.high[k], b.high[k], -1.0)] {
                    let (value, slope) = (sign * (p[k] - a), sign * (a - b));
                    // value + slope·τ ≥ 0
                    if slope > 0.0 {
                        low = low.max(-value / slope);
                    } else if slope < 0.0 {
                        high = high.min(-value / slope);
                    } else if value < 0.0 {
                        high = -1.0;
                    }
                }
            }
            assert_eq!(holds(p), low <= high, "{seed}");
        }
    }
}
