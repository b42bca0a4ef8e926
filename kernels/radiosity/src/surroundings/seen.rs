//! What one element sees, by rays from all over it.

use glam::DVec3;

use crate::elements::{Element, Surfel};
use crate::numbers::in_cube;
use crate::occlusion::{Facet, Occluders, about};
use crate::surroundings::sides::Sides;

/// The shares of an element's light that go each way; they sum to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// To surfaces that receive it.
    pub fronts: f64,
    /// To backs, which take no part, and to what an element rests on.
    pub backs: f64,
    /// Out of the scene.
    pub sky: f64,
}

/// Where one ray ends.
pub(crate) enum End {
    Front(u32),
    Back,
    /// And in which direction.
    Sky(DVec3),
}

/// Sheets that lie on each other at one place; more are not told apart.
const SHEETS: usize = 2;

/// How parallel facets are that lie on each other.
const PARALLEL: f64 = 1e-6;

/// How many rays tell whether an element rests on something, and how many if none of them is sure.
const PROBES: usize = 16;
const MOST_PROBES: usize = 512;

/// Sends `rays` from all over an element, spread by the cosine law, and tells `end` where each ends. Rays of
/// another `turn` start elsewhere and go elsewhere.
pub(crate) fn look(
    element: &Element,
    sides: &Sides,
    occluders: &Occluders,
    [rays, turn]: [usize; 2],
    mut end: impl FnMut(End),
) {
    let look = Look { element, sides, occluders };
    let mut rests = None;
    for ray in 0..rays {
        let (point, direction) = look.ray(ray, turn);
        end(look.ending(point, direction, &mut rests));
    }
}

/// An element that looks about.
struct Look<'a> {
    element: &'a Element,
    sides: &'a Sides,
    occluders: &'a Occluders,
}

impl Look<'_> {
    /// Where a ray starts, and where it goes.
    fn ray(&self, ray: usize, turn: usize) -> (DVec3, DVec3) {
        let [u, v, r, angle] = in_cube(ray, turn as u64);
        let normal = self.element.surfel().normal;
        (self.element.point_at([u, v]), about(normal, [r, angle]))
    }

    /// Where a ray ends. `rests` is whether the element rests on something, once that is known.
    fn ending(&self, point: DVec3, direction: DVec3, rests: &mut Option<bool>) -> End {
        let Surfel { normal, face, .. } = *self.element.surfel();
        let margin = self.occluders.margin();
        let mut skip = [face; 2];
        for _ in 0..SHEETS {
            let Some((distance, facet)) = self.occluders.nearest(point, direction, skip, -margin)
            else {
                return End::Sky(direction);
            };
            let lies_on = distance * direction.dot(normal) <= margin
                && facet.normal.dot(normal).abs() >= 1.0 - PARALLEL;
            if !lies_on {
                // Of a wall whose two sides are faces of their own the ray sees one front.
                let front = self.sides.seen(&facet, direction);
                let front = front.or_else(|| {
                    let other = self.beside(point, direction, distance, facet.face)?;
                    self.sides.seen(&other, direction)
                });
                return front.map_or(End::Back, End::Front);
            }
            skip[1] = facet.face;
            let looks_here = self.sides.seen(&facet, direction).is_some();
            if looks_here && *rests.get_or_insert_with(|| self.rests_on(skip)) {
                return End::Back;
            }
        }
        End::Sky(direction)
    }

    /// Whether the element rests on a face that looks the other way, rather than with its back against the
    /// back of that: whatever the face looks into there are backs, those of the body that the element bounds.
    ///
    /// Where two faces lie on each other, back to back, the ray meets one of either kind: bodies that touch
    /// look like that from within one of them, and so does a wall of two faces from a room. Rays that meet
    /// nothing else take many more to find a front that is no back as well.
    fn rests_on(&self, skip: [u32; 2]) -> bool {
        let mut is_body = false;
        for probe in 0..MOST_PROBES {
            if probe == PROBES && is_body {
                break;
            }
            let (point, direction) = self.ray(probe, 0);
            let behind = -direction;
            let Some((distance, facet)) =
                self.occluders.nearest(point, behind, skip, -self.occluders.margin())
            else {
                return false;
            };
            let is_back = |facet: &Facet| self.sides.seen(facet, behind).is_none();
            let beside = self.beside(point, behind, distance, facet.face);
            let backs = [is_back(&facet), beside.as_ref().map_or(is_back(&facet), is_back)];
            if backs == [false; 2] {
                return false;
            }
            is_body |= backs == [true; 2];
        }
        true
    }

    /// What else a ray meets where it has met a face.
    fn beside(&self, point: DVec3, direction: DVec3, distance: f64, face: u32) -> Option<Facet> {
        let margin = self.occluders.margin();
        let skip = [face, self.element.surfel().face];
        let (other, facet) = self.occluders.nearest(point, direction, skip, distance - margin)?;
        (other <= distance + margin).then_some(facet)
    }
}
