//! Occluders: triangles in a bounding-volume hierarchy, and what rays ask of them.

use std::collections::HashMap;

use glam::DVec3;

use crate::elements::{Surfel, Triangle};
use crate::error::Error;
use crate::occlusion::bounds::{Bounds, Slabs};
use crate::occlusion::boxes::{Boxes, SmallNode};
use crate::occlusion::facet::{Facet, ordered};
use crate::occlusion::node::{MAX_DEPTH, Node, bounds_of, build};
use crate::occlusion::wall::{Wall, walls};

/// Where a ray first meets an occluder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle in the order given to [`Occluders::new`].
    pub triangle: usize,
    /// Its face.
    pub face: u32,
    /// Distance from the ray's origin, in scene units.
    pub distance: f64,
    /// Barycentric weights of the point among the triangle's vertices; they sum to 1.
    pub weights: [f64; 3],
}

/// Everything that can hide one point from another: triangles in a bounding-volume hierarchy.
///
/// One hierarchy serves a whole program. The mask [`Visibility`](crate::Visibility) and the
/// [`Corrections`](crate::Corrections) borrow it; shadow rays ask [`blocked`](Self::blocked); a camera
/// asks [`first_hit`](Self::first_hit). All queries take `&self` and may come from any number of threads,
/// so it can be shared by reference or in an [`Arc`](std::sync::Arc). A query takes O(log n) steps where
/// triangles don't overlap much, and no memory.
///
/// A camera needs no hierarchy of the elements that walls were cut into. [`Hit`] tells which triangle was
/// met, by its index among those given, and where on it. Keep a list of owners next to the triangles, and
/// look there whose it is:
///
/// ```
/// use farfield_radiosity::{Occluders, Surfel, Triangle, Visibility};
/// use glam::DVec3;
///
/// let [x, y, z] = DVec3::AXES;
/// let triangle = |height: f64, face| Triangle { vertices: [z * height, z * height + x, z * height + y], face };
/// let (triangles, owners) = ([triangle(0.0, 0), triangle(1.0, 1)], ["floor", "lamp"]);
/// let occluders = Occluders::new(&triangles)?;
/// let mask = Visibility::new(&occluders);
///
/// let (eye, below) = (DVec3::new(0.2, 0.2, 3.0), DVec3::new(0.2, 0.2, -1.0));
/// let hit = occluders.first_hit(eye, below - eye).expect("there is a lamp");
/// assert_eq!((owners[hit.triangle], hit.distance), ("lamp", 2.0));
/// assert!(occluders.blocked(eye, below, [Surfel::<f64>::NO_FACE; 2]));
/// # Ok::<(), farfield_radiosity::Error>(())
/// ```
///
/// A triangle hides the two ends of a segment from each other if they lie on opposite sides of its
/// plane, both further from it than [`margin`](Self::margin), and the segment meets the closed
/// triangle. Touching an end, grazing along the plane or passing a degenerate triangle therefore
/// never counts, and a segment through the common edge of two triangles doesn't slip between them, nor
/// where an edge ends within another.
#[derive(Clone, Debug)]
pub struct Occluders {
    margin: f64,
    nodes: Vec<Node>,
    boxes: Boxes,
    facets: Vec<Facet>,
    walls: HashMap<u32, Wall>,
}

impl Occluders {
    /// Builds the hierarchy, by the surface-area heuristic.
    ///
    /// # Errors
    /// [`Error::InvalidVertex`] if a coordinate is NaN or infinite, [`Error::TooManyTriangles`]
    /// from 2³² triangles on.
    pub fn new(triangles: &[Triangle]) -> Result<Self, Error> {
        if u32::try_from(triangles.len()).is_err() {
            return Err(Error::TooManyTriangles { found: triangles.len() });
        }
        for (index, triangle) in triangles.iter().enumerate() {
            for (vertex, position) in triangle.vertices.iter().enumerate() {
                if !position.is_finite() {
                    return Err(Error::InvalidVertex {
                        index,
                        vertex,
                        position: position.to_array(),
                    });
                }
            }
        }
        let mut facets: Vec<_> =
            triangles.iter().enumerate().map(|(i, t)| Facet::new(i, t)).collect();
        let margin = margin_of(&bounds_of(&facets));
        let mut nodes = Vec::with_capacity(2 * facets.len());
        if !facets.is_empty() {
            build(&mut nodes, &mut facets, 0, margin, 0);
        }
        let walls = walls(&facets);
        Ok(Self { margin, boxes: Boxes::new(&nodes), nodes, facets, walls })
    }

    /// How far beyond a triangle's plane a point must lie to count as behind it: a billionth of the
    /// diagonal of the occluders' bounding box, or the rounding of its coordinates if that is more.
    pub fn margin(&self) -> f64 {
        self.margin
    }

    /// Whether a triangle hides the two ends of a segment from each other. Triangles of the two faces in
    /// `skip`, on which the ends lie, are left out; [`NO_FACE`](crate::Surfel::NO_FACE) leaves none out. The
    /// answer doesn't depend on the order of the ends.
    pub fn blocked(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> bool {
        let (from, to) = ordered(from, to);
        self.blocker(from, to, skip).is_some()
    }

    /// What hides the two [`ordered`] ends of a segment from each other; see [`blocked`](Self::blocked).
    pub(crate) fn blocker(&self, from: DVec3, to: DVec3, skip: [u32; 2]) -> Option<&Facet> {
        let segment = Slabs::new(from, to - from);
        self.visit(
            |bounds| segment.meets(bounds, 1.0),
            |facet| facet.blocks(from, to, skip, self.margin),
        )
    }

    /// The first triangle that the ray from `origin` along `direction` meets further away than the
    /// [`margin`](Self::margin). The direction may have any length but zero.
    pub fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let direction = direction.try_normalize()?;
        let (distance, facet) = self.nearest(origin, direction, NO_FACES, self.margin)?;
        let (_, weights) = facet.intersect(origin, direction)?;
        Some(Hit { triangle: facet.index as usize, face: facet.face, distance, weights })
    }

    /// The first facet that the ray from `origin` along a unit vector meets further away than `beyond`, which
    /// may be negative, and how far away. Those of the faces in `skip` are left out.
    pub(crate) fn nearest(
        &self,
        origin: DVec3,
        direction: DVec3,
        skip: [u32; 2],
        beyond: f64,
    ) -> Option<(f64, Facet)> {
        let slabs = Slabs::new(origin + direction * beyond.min(0.0), direction);
        let nearest = std::cell::Cell::new(f64::INFINITY);
        let mut hit = None;
        self.visit(
            |bounds| slabs.meets(bounds, nearest.get() - beyond.min(0.0)),
            |facet| {
                if !facet.is_one_of(skip)
                    && let Some((distance, _)) = facet.intersect(origin, direction)
                    && distance > beyond
                    && distance < nearest.get()
                {
                    nearest.set(distance);
                    hit = Some(*facet);
                }
                false
            },
        );
        hit.map(|facet| (nearest.get(), facet))
    }

    /// The nodes in single precision.
    pub(crate) fn boxes(&self) -> &Boxes {
        &self.boxes
    }

    /// The facets of a leaf.
    #[inline(always)]
    pub(crate) fn facets_of(&self, leaf: &SmallNode) -> &[Facet] {
        &self.facets[leaf.first as usize..][..leaf.count as usize]
    }

    /// The face of this number, if it is a convex polygon.
    pub(crate) fn wall(&self, face: u32) -> Option<&Wall> {
        self.walls.get(&face)
    }

    /// Walks depth first through the nodes that `enter` and returns the first facet that `stop`s it.
    #[inline]
    pub(crate) fn visit(
        &self,
        enter: impl Fn(&Bounds<f64>) -> bool,
        mut stop: impl FnMut(&Facet) -> bool,
    ) -> Option<&Facet> {
        let mut stack = [0u32; MAX_DEPTH + 1];
        let mut height = usize::from(!self.nodes.is_empty());
        while height > 0 {
            height -= 1;
            let mut at = stack[height];
            loop {
                let node = &self.nodes[at as usize];
                if !enter(&node.bounds) {
                    break;
                }
                if node.count > 0 {
                    let facets = &self.facets[node.first as usize..][..node.count as usize];
                    if let Some(facet) = facets.iter().find(|facet| stop(facet)) {
                        return Some(facet);
                    }
                    break;
                }
                stack[height] = node.first;
                height += 1;
                at += 1;
            }
        }
        None
    }
}

/// No face is left out.
const NO_FACES: [u32; 2] = [Surfel::<f64>::NO_FACE; 2];

/// See [`Occluders::margin`].
fn margin_of(bounds: &Bounds<f64>) -> f64 {
    if bounds.is_empty() {
        0.0
    } else {
        (1e-9 * bounds.diagonal()).max(16.0 * f64::EPSILON * bounds.farthest())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::elements::Surfel;
    use farfield_testing::clouds::Random;

    const NO_FACE: u32 = Surfel::<f64>::NO_FACE;

    fn unit_square(z: f64, face: u32) -> [Triangle; 2] {
        let [a, b, c, d] =
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, z));
        [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face })
    }

    #[test]
    fn a_square_blocks_through_its_inside_its_diagonal_and_its_border() {
        let square = Occluders::new(&unit_square(0.0, 3)).unwrap();
        for (x, y) in [(0.3, 0.7), (0.5, 0.5), (0.25, 0.25), (0.0, 0.5), (1.0, 1.0)] {
            let (from, to) = (DVec3::new(x, y, -1.0), DVec3::new(x, y, 2.0));
            assert!(square.blocked(from, to, [NO_FACE; 2]), "at ({x}, {y})");
            assert!(!square.blocked(from, to, [3, 7]) && !square.blocked(from, to, [7, 3]));
            assert!(!square.blocked(from, DVec3::new(x, y, 0.0), [NO_FACE; 2]), "ends on it");
        }
        let beside =
            |x: f64| square.blocked(DVec3::new(x, 0.5, -1.0), DVec3::new(x, 0.5, 1.0), [0; 2]);
        assert!(beside(1.0 - 1e-12) && !beside(1.0 + 1e-12));
        assert!(!square.blocked(DVec3::new(-1.0, 0.5, 0.0), DVec3::new(2.0, 0.5, 0.0), [0; 2]));
    }

    #[test]
    fn triangles_without_a_face_are_never_skipped() {
        let square = Occluders::new(&unit_square(0.0, NO_FACE)).unwrap();
        assert!(square.blocked(
            DVec3::new(0.4, 0.5, -1.0),
            DVec3::new(0.4, 0.5, 1.0),
            [NO_FACE; 2]
        ));
    }

    #[test]
    fn nothing_and_degenerate_triangles_block_nothing() {
        let flat = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        let point = [DVec3::ONE; 3];
        let degenerate = [flat, point].map(|vertices| Triangle { vertices, face: 0 });
        for triangles in [&[][..], &degenerate[..]] {
            let occluders = Occluders::new(triangles).unwrap();
            assert!(!occluders.blocked(
                DVec3::new(0.5, 0.0, -1.0),
                DVec3::new(0.5, 0.0, 1.0),
                [9; 2]
            ));
            assert_eq!(occluders.first_hit(DVec3::NEG_Z, DVec3::Z), None);
        }
    }

    #[test]
    fn vertices_must_be_finite() {
        let mut triangles = unit_square(0.0, 0);
        triangles[1].vertices[2].y = f64::NAN;
        let error = Occluders::new(&triangles).unwrap_err();
        assert!(matches!(error, Error::InvalidVertex { index: 1, vertex: 2, .. }));
    }

    #[test]
    fn the_first_hit_is_the_nearest() {
        let triangles = [unit_square(2.0, 1), unit_square(1.0, 5), unit_square(-1.0, 2)].concat();
        let occluders = Occluders::new(&triangles).unwrap();
        let hit = occluders.first_hit(DVec3::new(0.75, 0.25, 0.0), DVec3::Z * 7.0).unwrap();
        assert_eq!((hit.triangle, hit.face, hit.distance), (2, 5, 1.0));
        assert_eq!(hit.weights, [0.25, 0.5, 0.25]);
        assert_eq!(occluders.first_hit(DVec3::new(1.5, 0.5, 0.0), DVec3::Z), None);
        assert_eq!(occluders.first_hit(DVec3::ZERO, DVec3::ZERO), None);
    }

    #[test]
    fn many_equal_triangles_end_up_in_a_shallow_tree() {
        let occluders = Occluders::new(&vec![unit_square(0.0, 0)[0]; 3000]).unwrap();
        assert!(occluders.blocked(DVec3::new(0.7, 0.2, -1.0), DVec3::new(0.7, 0.2, 1.0), [9; 2]));
    }

    /// A point within 1 of the origin along every axis, half of the time on a lattice of this spacing.
    pub(crate) fn perhaps_on_lattice(random: &mut Random, spacing: f64) -> DVec3 {
        let point = 2.0 * random.in_cube() - 1.0;
        if random.below(2) == 0 { (point / spacing).round() * spacing } else { point }
    }

    /// Up to 59 triangles of all sizes and four faces; some with vertices on a coarse lattice, so that
    /// they share edges.
    pub(crate) fn triangles(random: &mut Random) -> Vec<Triangle> {
        let triangle = |random: &mut Random| {
            let [a, b, c] = std::array::from_fn(|_| perhaps_on_lattice(random, 0.5));
            let size = random.between(0.05, 1.0);
            let vertices = [a, a + (b - a) * size, a + (c - a) * size];
            Triangle { vertices, face: random.below(4) as u32 }
        };
        (0..random.below(60)).map(|_| triangle(random)).collect()
    }

    fn point(random: &mut Random) -> DVec3 {
        2.0 * random.in_cube() - 1.0
    }

    /// The same rule by the parameter of the crossing and barycentric coordinates, one by one.
    fn blocked_by_hand(triangle: &Triangle, from: DVec3, to: DVec3) -> Option<bool> {
        let [a, b, c] = triangle.vertices;
        let system = glam::DMat3::from_cols(b - a, c - a, from - to);
        if system.determinant().abs() < 1e-6 {
            return None;
        }
        let solution = system.inverse() * (from - a);
        let (u, v, t) = (solution.x, solution.y, solution.z);
        let slack = [u, v, 1.0 - u - v, t, 1.0 - t].into_iter().fold(f64::INFINITY, f64::min);
        (slack.abs() > 1e-6).then_some(slack > 0.0)
    }

    #[test]
    fn the_hierarchy_finds_what_every_triangle_alone_finds() {
        for seed in 0..256 {
            let random = &mut Random::new(seed);
            let triangles = triangles(random);
            let [from, to] = std::array::from_fn(|_| point(random));
            let skip = random.below(4) as u32;
            let occluders = Occluders::new(&triangles).unwrap();
            let blocked = occluders.blocked(from, to, [skip, NO_FACE]);
            assert_eq!(blocked, occluders.blocked(to, from, [skip, NO_FACE]), "{seed}");
            let others = triangles.iter().filter(|t| t.face != skip);
            let verdicts: Vec<_> = others.map(|t| blocked_by_hand(t, from, to)).collect();
            if verdicts.contains(&Some(true)) {
                assert!(blocked, "{seed}");
            } else if !verdicts.contains(&None) {
                assert!(!blocked, "{seed}");
            }
        }
    }

    #[test]
    fn the_ends_may_be_swapped_even_where_rounding_decides() {
        for seed in 0..256 {
            let random = &mut Random::new(seed);
            let vertices = std::array::from_fn(|_| point(random));
            let border = vertices[0].lerp(vertices[1], random.unit());
            let half = point(random);
            let occluders = Occluders::new(&[Triangle { vertices, face: 0 }]).unwrap();
            let (from, to) = (border - half, border + half);
            let blocked = occluders.blocked(from, to, [NO_FACE; 2]);
            assert_eq!(blocked, occluders.blocked(to, from, [NO_FACE; 2]), "{seed}");
        }
    }

    #[test]
    fn first_hits_agree_with_blocking() {
        for seed in 0..256 {
            let random = &mut Random::new(seed);
            let triangles = triangles(random);
            let [from, to] = std::array::from_fn(|_| point(random));
            let occluders = Occluders::new(&triangles).unwrap();
            let hit = occluders.first_hit(from, to - from);
            if let Some(hit) = hit {
                let [a, b, c] = triangles[hit.triangle].vertices;
                let [u, v, w] = hit.weights;
                let at = from + (to - from).normalize() * hit.distance;
                assert!(at.distance(a * u + b * v + c * w) < 1e-6, "{seed}");
            }
            if occluders.blocked(from, to, [NO_FACE; 2]) {
                assert!(hit.is_some_and(|hit| hit.distance <= from.distance(to)), "{seed}");
            }
        }
    }
}
