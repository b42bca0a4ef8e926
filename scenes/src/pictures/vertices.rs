//! Where elements meet: one place of a smooth surface for all their corners that belong together.

use std::collections::HashMap;

use farfield_radiosity::{Element, Occluders};
use glam::DVec3;
use rayon::prelude::*;

/// The cosine of the angle up to which the normals of two elements count as those of one curved
/// surface: 40°.
pub(crate) const SMOOTH_COSINE: f64 = 0.766;

/// A place on a surface where corners of elements meet; the centre of a disk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex {
    /// Where it is.
    pub(crate) position: DVec3,
    /// The mean unit normal of its elements.
    pub(crate) normal: DVec3,
    /// A point close by, but within its elements: off the foot of a wall that stands on an edge.
    pub(crate) inside: DVec3,
    /// The largest [`size`] of its elements.
    pub(crate) size: f64,
    /// The element of least index that it belongs to.
    pub(crate) element: usize,
}

/// All vertices, and which of them the corners of every element are.
#[derive(Clone, Debug)]
pub(crate) struct Vertices {
    /// The vertices.
    pub(crate) vertices: Vec<Vertex>,
    /// Indices of the vertices at every element's corners; a triangle's last one stands twice, a
    /// disk's only one four times.
    pub(crate) corners: Vec<[u32; 4]>,
}

impl Vertices {
    /// The vertices of `elements`. Corners at one place belong together if the elements' normals
    /// agree, one after the other, and none of the `occluders` stands between them.
    pub(crate) fn new(elements: &[Element], occluders: &Occluders) -> Self {
        let all: Vec<Corner> =
            elements.iter().enumerate().flat_map(|(k, element)| Corner::of(element, k)).collect();
        let belong = |i: usize, j: usize| together(&all[i], &all[j], elements, occluders);
        let groups: Vec<Vec<Vec<usize>>> =
            places(&all).par_iter().map(|place| groups(place, belong)).collect();

        let groups: Vec<Vec<usize>> = groups.into_iter().flatten().collect();
        let vertices = groups.iter().map(|group| vertex(group, &all, elements)).collect();
        let mut corners = vec![[0; 4]; elements.len()];
        for (vertex, group) in groups.iter().enumerate() {
            for corner in group.iter().map(|&k| &all[k]) {
                corners[corner.element][corner.number] = vertex as u32;
            }
        }
        for (corners, element) in corners.iter_mut().zip(elements) {
            let count = element.as_patch().map_or(1, |patch| patch.corners().len());
            let last = corners[count - 1];
            corners[count..].fill(last);
        }
        Self { vertices, corners }
    }
}

/// The edge of a square element, and about that of any other: what distances on its surface are
/// compared with.
pub(crate) fn size(element: &Element) -> f64 {
    std::f64::consts::SQRT_2 * element.radius()
}

/// How far the ends of a segment that tells whether two points of a surface see each other are lifted
/// off it, relative to the size of an element.
pub(crate) const LIFT: f64 = 0.02;
/// How far from an element's corner, on the way to its centroid, lies the point that stands for it.
const INSET: f64 = 0.05;
/// Corners are at one place if they are closer than this, relative to the whole scene.
const WELD: f64 = 1e-7;

/// A corner of an element's patch, or the centre of its disk.
#[derive(Clone, Copy, Debug)]
struct Corner {
    element: usize,
    number: usize,
    position: DVec3,
    /// A point near it within the element.
    inside: DVec3,
}

impl Corner {
    fn of(element: &Element, index: usize) -> Vec<Self> {
        let centre = element.surfel().position;
        let corners = element.as_patch().map_or(std::slice::from_ref(&centre), |p| p.corners());
        let corner = |(number, &position): (usize, &DVec3)| {
            let inside = position.lerp(centre, INSET);
            Self { element: index, number, position, inside }
        };
        corners.iter().enumerate().map(corner).collect()
    }
}

/// The corners at each place, in the order of the places' first corners.
fn places(corners: &[Corner]) -> Vec<Vec<usize>> {
    let [low, high] =
        corners.iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], c| {
            [low.min(c.position), high.max(c.position)]
        });
    let tolerance = (WELD * (high - low).max_element()).max(f64::MIN_POSITIVE);
    let mut numbers: HashMap<[i64; 3], usize> = HashMap::new();
    let mut places: Vec<Vec<usize>> = Vec::new();
    for (index, corner) in corners.iter().enumerate() {
        let key = ((corner.position - low) / tolerance).round().to_array().map(|c| c as i64);
        let number = *numbers.entry(key).or_insert(places.len());
        if number == places.len() {
            places.push(Vec::new());
        }
        places[number].push(index);
    }
    places
}

/// A place's corners in groups: any two that belong together are in one.
fn groups(place: &[usize], together: impl Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for &corner in place {
        let joins = |group: &Vec<usize>| group.iter().any(|&other| together(corner, other));
        let (joined, apart): (Vec<_>, Vec<_>) = groups.into_iter().partition(joins);
        groups = apart;
        groups.push(joined.into_iter().flatten().chain([corner]).collect());
    }
    groups
}

/// Whether two corners at one place are of one smooth surface, with nothing in between.
fn together(a: &Corner, b: &Corner, elements: &[Element], occluders: &Occluders) -> bool {
    let [one, other] = [a, b].map(|corner| &elements[corner.element]);
    let [m, n] = [one, other].map(|element| element.surfel().normal);
    if m.dot(n) < SMOOTH_COSINE {
        return false;
    }
    let lift = LIFT * size(one).min(size(other));
    let faces = [one, other].map(|element| element.surfel().face);
    !occluders.blocked(a.inside + lift * m, b.inside + lift * n, faces)
}

/// What a group of corners at one place is as a whole.
fn vertex(group: &[usize], corners: &[Corner], elements: &[Element]) -> Vertex {
    let members = || group.iter().map(|&k| (&corners[k], &elements[corners[k].element]));
    let first = &corners[group[0]];
    let sum: DVec3 = members().map(|(_, element)| element.surfel().normal).sum();
    let own = elements[first.element].surfel().normal;
    Vertex {
        position: first.position,
        normal: sum.try_normalize().unwrap_or(own),
        inside: members().map(|(corner, _)| corner.inside).sum::<DVec3>() / group.len() as f64,
        size: members().map(|(_, element)| size(element)).fold(0.0, f64::max),
        element: members().map(|(corner, _)| corner.element).min().unwrap_or(first.element),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::samples::{grid, sheet};
    use farfield_radiosity::Surfel;

    #[test]
    fn cells_of_a_plane_share_vertices_and_those_of_a_room_corner_do_not() {
        let mut elements = grid(DVec3::ZERO, DVec3::X, DVec3::Y, [3, 2], 0);
        elements.extend(grid(DVec3::ZERO, DVec3::Y, DVec3::Z, [2, 2], 1));
        let open = Occluders::new(&[]).expect("empty");
        let found = Vertices::new(&elements, &open);
        assert_eq!(found.vertices.len(), 4 * 3 + 3 * 3);
        for (element, corners) in elements.iter().zip(&found.corners) {
            let patch = element.as_patch().expect("a patch");
            for (corner, &vertex) in patch.corners().iter().zip(corners) {
                let vertex = &found.vertices[vertex as usize];
                assert!(vertex.position.abs_diff_eq(*corner, 1e-9));
                assert!(vertex.normal.abs_diff_eq(patch.normal(), 1e-12));
            }
        }
    }

    #[test]
    fn a_thin_wall_parts_the_vertices_at_its_foot() {
        let elements = grid(DVec3::ZERO, DVec3::X, DVec3::Y, [2, 1], 0);
        let wall = Occluders::new(&sheet(0.5 * DVec3::X, DVec3::Y, DVec3::Z, 7)).expect("finite");
        let found = Vertices::new(&elements, &wall);
        assert_eq!(found.vertices.len(), 8);
        for vertex in &found.vertices {
            let side = elements[vertex.element].surfel().position.x;
            assert!((vertex.inside.x - 0.5) * (side - 0.5) > 0.0);
        }
    }

    #[test]
    fn corners_of_triangles_and_disks_are_padded() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let patch = farfield_radiosity::Patch::new(&corners).expect("a triangle");
        let surfel = Surfel { position: DVec3::Z, normal: DVec3::Z, area: 1.0, face: 1 };
        let elements = [Element::patch(patch, 0), Element::disk(surfel)];
        let found = Vertices::new(&elements, &Occluders::new(&[]).expect("empty"));
        assert_eq!(found.corners, [[0, 1, 2, 2], [3; 4]]);
        assert!(Vertices::new(&[], &Occluders::new(&[]).expect("empty")).vertices.is_empty());
    }
}
