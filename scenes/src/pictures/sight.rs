//! What a ray sees of a mesh.

use std::collections::HashMap;

use farfield_radiosity::{Element, Error, Occluders, Surfel};
use glam::{DVec2, DVec3};

use crate::cutting::mesh::{Mesh, Whole};
use crate::cutting::pieces::{parameters, piece_at, piece_count};
use crate::scene::Scene;
use crate::scene::geometry::{regular_polygon, vector_area};
use crate::scene::weld::Weld;

/// A mesh as rays meet it, with the one tree of its occluders that serves sums and pictures alike.
#[derive(Clone, Debug)]
pub struct Sight<'a> {
    /// The scene.
    pub(crate) scene: &'a Scene,
    /// What it is cut into.
    pub(crate) mesh: &'a Mesh,
    occluders: Occluders,
    /// For each surface and point, the one that has the same corners and looks the other way.
    backs: Vec<Option<usize>>,
}

/// A point of an element's front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    /// The element.
    pub(crate) element: usize,
    /// Where it was hit.
    pub(crate) position: DVec3,
    /// Where that is on the element, as [`parameters`] says; the centre if it is a disk.
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
    /// The occluders of a scene and of its mesh: surfaces as wholes, not in their elements, and hexagons
    /// for points.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless the mesh is of this scene, or those of [`Occluders::new`].
    pub fn new(scene: &'a Scene, mesh: &'a Mesh) -> Result<Self, Error> {
        let elements = mesh.origin.len();
        for (what, expected, found) in [
            ("surfaces and points", scene.surfaces.len() + scene.points.len(), mesh.wholes.len()),
            ("elements", elements, mesh.elements.len()),
            ("materials of elements", elements, mesh.material.len()),
            ("triangles", mesh.owners.len(), mesh.triangles.len()),
        ] {
            if found != expected {
                return Err(Error::LengthMismatch { what, expected, found });
            }
        }
        Ok(Self { scene, mesh, occluders: Occluders::new(&mesh.triangles)?, backs: backs(scene) })
    }

    /// Everything that can hide one point from another.
    pub fn occluders(&self) -> &Occluders {
        &self.occluders
    }

    /// The first point of an element's front that a ray meets; none if it meets nothing, or a back at
    /// which it ends. The direction may have any length but zero.
    pub(crate) fn first(&self, origin: DVec3, direction: DVec3, through: Backs) -> Option<Seen> {
        let direction = direction.try_normalize()?;
        let mut start = origin;
        for _ in 0..MOST_BACKS {
            let (element, position) = self.meet(start, direction)?;
            if let Some(element) = element {
                let patch = self.mesh.elements[element].as_patch();
                let parameters = parameters(patch.map_or(&[], |patch| patch.corners()), position);
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
    pub fn is_buried(&self, point: DVec3, normal: DVec3) -> bool {
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
        let hit = self.occluders.first_hit(origin, direction)?;
        let position = origin + hit.distance * direction;
        let one = self.mesh.owners[hit.triangle] as usize;
        let mut wholes = [Some(one), self.backs[one]].into_iter().flatten();
        let front = wholes.find_map(|whole| self.front(whole, position, direction));
        Some((front, position))
    }

    /// The element of a surface or a point at a position on it, if a ray of this direction meets its
    /// front there.
    fn front(&self, whole: usize, position: DVec3, direction: DVec3) -> Option<usize> {
        let Whole { first, cuts } = self.mesh.wholes[whole];
        let (number, count) = match self.scene.surfaces.get(whole) {
            Some(surface) if cuts != [1, 1] => {
                let corners = self.scene.corners(surface);
                let at = parameters(&corners, position);
                (piece_at(corners.len(), cuts, at)?, piece_count(corners.len(), cuts))
            }
            _ => (0, 1),
        };
        // The backs of a surface of two sides follow its fronts.
        let faces = |&side: &usize| {
            let own = self.mesh.origin.get(side).is_some_and(|&origin| origin as usize == whole);
            own && self.mesh.elements[side].surfel().normal.dot(direction) < 0.0
        };
        [first + number, first + count + number].into_iter().find(faces)
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

/// For each surface and point, the first with the same corners and the opposite normal.
fn backs(scene: &Scene) -> Vec<Option<usize>> {
    let mut weld = Weld::default();
    let mut places: HashMap<_, Vec<usize>> = HashMap::with_capacity(scene.surfaces.len());
    let mut normals = Vec::with_capacity(scene.surfaces.len());
    let surfaces = scene.surfaces.iter().map(|surface| {
        let corners = scene.corners(surface);
        let normal = vector_area(&corners).normalize_or_zero();
        (corners, normal)
    });
    let points = scene.points.iter().map(|point| (vec![point.position], point.normal));
    for (index, (corners, normal)) in surfaces.chain(points).enumerate() {
        let mut key: Vec<_> = corners.into_iter().map(|corner| weld.vertex(corner)).collect();
        key.sort_unstable();
        places.entry(key).or_default().push(index);
        normals.push(normal);
    }
    let mut backs = vec![None; normals.len()];
    for place in places.values() {
        for &index in place {
            let opposite = |&&other: &&usize| normals[other].dot(normals[index]) < -0.5;
            backs[index] = place.iter().find(opposite).copied();
        }
    }
    backs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::{GENERATORS, generate};
    use crate::pictures::samples::{grid, scene_of};
    use farfield_radiosity::Patch;

    #[test]
    fn every_element_of_every_scene_is_seen_at_its_centre() {
        for name in GENERATORS {
            let scene = generate(name).expect("listed");
            let mesh = Mesh::new(&scene, 10_000).expect("valid");
            let sight = Sight::new(&scene, &mesh).expect("its own mesh");
            for (index, element) in mesh.elements.iter().enumerate() {
                let surfel = element.surfel();
                let above = surfel.position + 1e-3 * element.radius() * surfel.normal;
                let seen = sight.first(above, -surfel.normal, Backs::Opaque).expect("hit");
                assert_eq!(seen.element, index, "{name}");
                assert!(seen.parameters.distance(DVec2::splat(0.5)) < 0.2, "{name} {seen:?}");
            }
        }
    }

    #[test]
    fn meshes_of_other_scenes_are_refused() {
        let [scene, other] = ["furnace", "cornell"].map(|name| generate(name).expect("listed"));
        let mesh = Mesh::new(&scene, 100).expect("valid");
        assert!(Sight::new(&other, &mesh).is_err());
        let short = Mesh { elements: Vec::new(), ..mesh.clone() };
        assert!(Sight::new(&scene, &short).is_err() && Sight::new(&scene, &mesh).is_ok());
    }

    #[test]
    fn every_cell_is_hit_at_its_own_parameters() {
        let (u, v) = (DVec3::new(3.0, 0.0, 1.0), DVec3::new(1.0, 2.0, 0.0));
        let elements = grid(DVec3::ZERO, u, v, [4, 3], 0);
        let (scene, mesh) = scene_of(&elements);
        let sight = Sight::new(&scene, &mesh).expect("finite");
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
            let (scene, mesh) = scene_of(elements);
            let sight = Sight::new(&scene, &mesh).expect("finite");
            let seen = sight.first(origin, -from * up, through);
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
            let (scene, mesh) = scene_of(&parts.concat());
            Sight::new(&scene, &mesh).expect("finite").is_buried(point, z)
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
        let (scene, mesh) = scene_of(&[Element::disk(disk)]);
        let sight = Sight::new(&scene, &mesh).expect("finite");
        let seen = sight.first(DVec3::ONE + normal, -normal, Backs::Opaque).expect("hit");
        assert_eq!((seen.element, seen.parameters), (0, DVec2::splat(0.5)));
    }
}
