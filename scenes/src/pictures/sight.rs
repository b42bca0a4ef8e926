//! What a ray sees of a mesh.

use std::collections::HashMap;

use farfield_radiosity::{Element, Error, Occluders, Surfel, Triangle};
use glam::{DVec2, DVec3};

use crate::scene::geometry::{fan, regular_polygon};
use crate::scene::weld::Weld;

/// The elements of a mesh as rays meet them.
#[derive(Clone, Debug)]
pub(crate) struct Sight<'a> {
    elements: &'a [Element],
    triangles: Occluders,
    /// The element of each triangle.
    owners: Vec<u32>,
    /// For each element, the one that has the same corners and looks the other way.
    backs: Vec<Option<u32>>,
}

/// A point of an element's front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// The element.
    pub(crate) element: usize,
    /// Where it was hit.
    pub(crate) position: DVec3,
    /// Where that is on the element: its patch's corners 0, 1, 2, 3 are at (0, 0), (1, 0), (1, 1),
    /// (0, 1). A triangle's corner 2 is the whole edge v = 1, so that what is bilinear in these is
    /// linear on it. The centre if it is a disk.
    pub(crate) parameters: DVec2,
}

/// What becomes of rays that meet the back of an element which has no other side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Backs {
    /// They end there.
    Opaque,
    /// They go on, as if it weren't there: from outside into a room without doors, say.
    Transparent,
}

impl<'a> Sight<'a> {
    /// The elements, patches as they are and disks as octagons of their area.
    ///
    /// # Errors
    /// Those of [`Occluders::new`].
    pub(crate) fn new(elements: &'a [Element]) -> Result<Self, Error> {
        let backs = backs(elements);
        let (mut triangles, mut owners) = (Vec::new(), Vec::new());
        for (index, element) in elements.iter().enumerate() {
            // Of a sheet's two sides, either stands for both.
            if backs[index].is_some_and(|other| (other as usize) < index) {
                continue;
            }
            for vertices in fan(&outline(element)) {
                triangles.push(Triangle { vertices, face: index as u32 });
                owners.push(index as u32);
            }
        }
        Ok(Self { elements, triangles: Occluders::new(&triangles)?, owners, backs })
    }

    /// The first point of an element's front that a ray meets; none if it meets nothing, or a back at
    /// which it ends. The direction may have any length but zero.
    pub(crate) fn first(&self, origin: DVec3, direction: DVec3, through: Backs) -> Option<Seen> {
        let direction = direction.try_normalize()?;
        let mut start = origin;
        for _ in 0..MOST_BACKS {
            let (element, position) = self.meet(start, direction)?;
            if let Some(element) = element {
                let parameters = parameters(&self.elements[element], position);
                return Some(Seen { element, position, parameters });
            }
            if through == Backs::Opaque {
                return None;
            }
            start = position;
        }
        None
    }

    /// Whether a point on a surface of this unit normal lies within a solid that stands on it: wherever
    /// it looks, it sees backs.
    pub(crate) fn is_buried(&self, point: DVec3, normal: DVec3) -> bool {
        let (u, v) = normal.any_orthonormal_pair();
        let aside = [DVec3::ZERO, u, v, -u, -v];
        aside.into_iter().all(|aside| self.meets_back(point, (normal + SLANT * aside).normalize()))
    }

    /// Whether a ray of unit direction first meets the back of an element which has no other side.
    pub(crate) fn meets_back(&self, origin: DVec3, direction: DVec3) -> bool {
        matches!(self.meet(origin, direction), Some((None, _)))
    }

    /// Where a ray of unit direction first meets an element, and which one if it is the front.
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<(Option<usize>, DVec3)> {
        let hit = self.triangles.first_hit(origin, direction)?;
        let one = self.owners[hit.triangle] as usize;
        let sides = [Some(one), self.backs[one].map(|other| other as usize)];
        let faces = |&side: &usize| self.elements[side].surfel().normal.dot(direction) < 0.0;
        let front = sides.into_iter().flatten().find(faces);
        Some((front, origin + hit.distance * direction))
    }
}

/// The corners of what an element is drawn as, counter-clockwise around its front: its patch, or an
/// octagon of its disk's area.
pub(crate) fn outline(element: &Element) -> Vec<DVec3> {
    match element.as_patch() {
        Some(patch) => patch.corners().to_vec(),
        None => {
            let Surfel { position, normal, area, .. } = *element.surfel();
            regular_polygon::<8>(position, normal, area).to_vec()
        }
    }
}

/// How far aside a point looks for a way out, relative to straight ahead.
const SLANT: f64 = 2.0;
/// How many backs a ray goes through before it counts as lost.
const MOST_BACKS: usize = 1000;

/// For each element, the first with the same corners and the opposite normal.
fn backs(elements: &[Element]) -> Vec<Option<u32>> {
    let mut weld = Weld::default();
    let mut places: HashMap<_, Vec<u32>> = HashMap::with_capacity(elements.len());
    for (index, element) in elements.iter().enumerate() {
        let centre = [element.surfel().position];
        let corners = element.as_patch().map_or(&centre[..], |patch| patch.corners());
        let mut key: Vec<_> = corners.iter().map(|&corner| weld.vertex(corner)).collect();
        key.sort_unstable();
        places.entry(key).or_default().push(index as u32);
    }
    let mut backs = vec![None; elements.len()];
    for place in places.values() {
        for &index in place {
            let normal = |index: u32| elements[index as usize].surfel().normal;
            let opposite = |&&other: &&u32| normal(other).dot(normal(index)) < -0.5;
            backs[index as usize] = place.iter().find(opposite).copied();
        }
    }
    backs
}

/// See [`Seen::parameters`]: the inverse of p = a + u e + v f + uv g, in which a triangle's last corner
/// stands twice.
fn parameters(element: &Element, position: DVec3) -> DVec2 {
    let Some(patch) = element.as_patch() else { return DVec2::splat(0.5) };
    let (a, b, c) = (patch.corners()[0], patch.corners()[1], patch.corners()[2]);
    let d = patch.corners().get(3).copied().unwrap_or(c);
    let (e, f, g, h) = (b - a, d - a, a - b + c - d, position - a);
    // (h - v f) × (e + v g) = 0 is quadratic in v.
    let cross = |p: DVec3, q: DVec3| patch.normal().dot(p.cross(q));
    let [constant, linear, square] = [cross(h, e), cross(h, g) + cross(e, f), cross(g, f)];
    let root = (linear * linear - 4.0 * constant * square).max(0.0).sqrt();
    let v = unit(-2.0 * constant / (linear + root));
    let along = e + v * g;
    DVec2::new(unit((h - v * f).dot(along) / along.length_squared()), v)
}

/// Within [0, 1]; 0 if the corner is one where any value will do.
fn unit(x: f64) -> f64 {
    if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::samples::grid;
    use farfield_radiosity::Patch;

    #[test]
    fn every_cell_is_hit_at_its_own_parameters() {
        let (u, v) = (DVec3::new(3.0, 0.0, 1.0), DVec3::new(1.0, 2.0, 0.0));
        let elements = grid(DVec3::ZERO, u, v, [4, 3], 0);
        let sight = Sight::new(&elements).expect("finite");
        for (index, element) in elements.iter().enumerate() {
            let corners = element.as_patch().expect("a patch").corners();
            for (s, t) in [(0.5, 0.5), (0.2, 0.9), (0.9, 0.2), (0.01, 0.02)] {
                let point =
                    corners[0] + s * (corners[1] - corners[0]) + t * (corners[3] - corners[0]);
                let normal = element.surfel().normal;
                let seen = sight.first(point + 3.0 * normal, -normal, Backs::Opaque).expect("hit");
                assert_eq!(seen.element, index);
                assert!(seen.position.abs_diff_eq(point, 1e-12));
                assert!(seen.parameters.abs_diff_eq(DVec2::new(s, t), 1e-12));
            }
        }
    }

    #[test]
    fn backs_end_rays_or_let_them_through_and_sheets_have_two_sides() {
        let patch = |corners: [DVec3; 3]| Patch::new(&corners).expect("a triangle");
        let [a, b, c] = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let up = DVec3::Z;
        let lower = Element::patch(patch([a - up, b - up, c - up]), 0);
        let front = Element::patch(patch([a, b, c]), 1);
        let back = Element::patch(patch([b, a, c]), 1);
        let first = |elements: &[Element], from: f64, through| {
            let origin = DVec3::new(0.2, 0.3, from);
            let seen = Sight::new(elements).expect("finite").first(origin, -from * up, through);
            seen.map(|seen| (seen.element, seen.parameters))
        };
        let sheet = [lower, front, back];
        let (above, below) =
            (first(&sheet, 1.0, Backs::Opaque), first(&sheet, -0.5, Backs::Opaque));
        let expected = DVec2::new(0.2 / 0.7, 0.3);
        assert!(above.is_some_and(|(element, at)| element == 1 && at.abs_diff_eq(expected, 1e-12)));
        // From below, corners 0 and 1 have changed places.
        assert_eq!(below.map(|(element, _)| element), Some(2));
        assert!(below.expect("seen").1.abs_diff_eq(DVec2::new(0.5 / 0.7, 0.3), 1e-12));
        let hidden = [lower, back];
        assert_eq!(first(&hidden, 1.0, Backs::Opaque), None);
        assert_eq!(first(&hidden, 1.0, Backs::Transparent).map(|seen| seen.0), Some(0));
        assert_eq!(first(&hidden[..1], 0.5, Backs::Opaque).map(|seen| seen.0), Some(0));
        assert_eq!(first(&[], 1.0, Backs::Transparent), None);
    }

    #[test]
    fn a_floor_is_buried_under_a_solid_and_not_under_a_sheet_or_a_roof() {
        let [x, y, z] = DVec3::AXES;
        let floor = grid(DVec3::new(-1.0, -1.0, 0.0), 3.0 * x, 3.0 * y, [1, 1], 0);
        let roof = grid(z, x, y, [1, 1], 1);
        let sides = [
            grid(DVec3::ZERO, x, z, [1, 1], 2),
            grid(x, y, z, [1, 1], 3),
            grid(x + y, -x, z, [1, 1], 4),
            grid(y, -y, z, [1, 1], 5),
        ];
        let below = grid(z, y, x, [1, 1], 1);
        let buried = |parts: &[Vec<Element>], point: DVec3| {
            let elements = parts.concat();
            Sight::new(&elements).expect("finite").is_buried(point, z)
        };
        let block = [vec![floor.clone(), roof.clone()], sides.to_vec()].concat();
        let (under, beside) = (0.5 * (x + y), 1.5 * x);
        assert!(buried(&block, under) && !buried(&block, beside));
        assert!(!buried(&[floor.clone(), roof.clone()], under));
        assert!(!buried(&[floor, roof, below], under));
    }

    #[test]
    fn a_disk_is_hit_at_its_centre() {
        let normal = DVec3::new(1.0, 2.0, 2.0) / 3.0;
        let disk = Surfel { position: DVec3::ONE, normal, area: 2.0, face: 0 };
        let elements = [Element::disk(disk)];
        let sight = Sight::new(&elements).expect("finite");
        let seen = sight.first(DVec3::ONE + normal, -normal, Backs::Opaque).expect("hit");
        assert_eq!((seen.element, seen.parameters), (0, DVec2::splat(0.5)));
    }
}
