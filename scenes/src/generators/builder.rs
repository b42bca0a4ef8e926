//! Building scenes out of flat walls: y is up, and a plan is a polygon in (z, x).

use glam::{DVec2, DVec3};

use crate::generators::polygon::quads;
use crate::scene::Scene;
use crate::scene::material::Material;
use crate::scene::surface::Surface;
use crate::scene::viewpoint::Viewpoint;
use crate::scene::weld::Weld;

/// How far a corner may lie off a plane, relative to the scene, to count as on it.
const TOLERANCE: f64 = 1e-9;

/// A scene in the making. Surfaces of one plane get one face.
#[derive(Clone, Debug, Default)]
pub(crate) struct Builder {
    scene: Scene,
    weld: Weld,
    planes: Vec<Plane>,
}

/// The plane n·p = offset.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: DVec3,
    offset: f64,
}

impl Builder {
    /// A scene of these materials, with nothing in it.
    pub(crate) fn new(materials: Vec<Material>) -> Self {
        Self { scene: Scene { materials, ..Scene::default() }, ..Self::default() }
    }

    /// Adds a flat convex surface of three or four corners, in either order, whose front is on the
    /// side that `front` points to.
    pub(crate) fn add(&mut self, corners: &[DVec3], front: DVec3, material: usize) {
        let mut corners = corners.to_vec();
        let mut normal = normal(&corners);
        if normal.dot(front) < 0.0 {
            corners.reverse();
            normal = -normal;
        }
        let face = self.face(&corners, normal);
        let corners = corners.into_iter().map(|place| self.weld.vertex(place)).collect();
        self.scene.surfaces.push(Surface { corners, material, face });
    }

    /// Adds level convex polygons at height `y`, given by their plans; `front` is up or down.
    pub(crate) fn add_level(
        &mut self,
        plans: &[Vec<DVec2>],
        y: f64,
        front: DVec3,
        material: usize,
    ) {
        self.add_flat(plans, |p| at(p, y), front, material);
    }

    /// Adds convex polygons of a plane, which `place` takes to where they are.
    pub(crate) fn add_flat(
        &mut self,
        polygons: &[Vec<DVec2>],
        place: impl Fn(DVec2) -> DVec3,
        front: DVec3,
        material: usize,
    ) {
        for piece in polygons.iter().flat_map(|polygon| quads(polygon)) {
            let corners: Vec<_> = piece.into_iter().map(&place).collect();
            self.add(&corners, front, material);
        }
    }

    /// Adds the upright walls over the sides of a convex plan, between two heights, with their fronts
    /// outwards.
    pub(crate) fn add_sides(&mut self, plan: &[DVec2], [low, high]: [f64; 2], material: usize) {
        let centre = plan.iter().sum::<DVec2>() / plan.len() as f64;
        for (&p, &q) in plan.iter().zip(plan.iter().cycle().skip(1)) {
            let outwards = at(0.5 * (p + q) - centre, 0.0);
            self.add(&[at(p, low), at(q, low), at(q, high), at(p, high)], outwards, material);
        }
    }

    /// The finished scene, seen from `camera`.
    pub(crate) fn finish(self, camera: Viewpoint, closed: bool) -> Scene {
        Scene { vertices: self.weld.vertices, camera: Some(camera), closed, ..self.scene }
    }

    /// The face of the plane that these corners lie in.
    fn face(&mut self, corners: &[DVec3], normal: DVec3) -> u32 {
        let size = corners.iter().map(|p| p.length()).fold(0.0, f64::max);
        let holds = |plane: &Plane| {
            let off = |p: &DVec3| (plane.normal.dot(*p) - plane.offset).abs();
            corners.iter().all(|p| off(p) <= TOLERANCE * size)
        };
        let known = self.planes.iter().position(holds);
        let face = known.unwrap_or_else(|| {
            self.planes.push(Plane { normal, offset: normal.dot(corners[0]) });
            self.planes.len() - 1
        });
        face as u32
    }
}

/// The point over a point of the plan, at height `y`.
pub(crate) fn at(plan: DVec2, y: f64) -> DVec3 {
    DVec3::new(plan.y, y, plan.x)
}

/// The plan of a point.
pub(crate) fn plan(p: DVec3) -> DVec2 {
    DVec2::new(p.z, p.x)
}

/// Unit normal of a polygon with three or four corners, on the side where they run counter-clockwise.
fn normal(corners: &[DVec3]) -> DVec3 {
    let [first, second, third] = [0, 1, 2].map(|k| corners[k]);
    let last = corners[corners.len() - 1];
    // For a triangle the second diagonal is its side from the second corner to the third.
    (third - first).cross(last - second).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::polygon::rectangle;

    fn camera() -> Viewpoint {
        Viewpoint { eye: DVec3::Z, target: DVec3::ZERO, up: DVec3::Y, film_over_focal: 1.0 }
    }

    #[test]
    fn surfaces_of_a_plane_share_a_face_whichever_way_they_look() {
        let mut builder = Builder::new(vec![Material::grey()]);
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        builder.add(&triangle, DVec3::Z, 0);
        builder.add(&triangle.map(|p| p + DVec3::X * 7.0), DVec3::NEG_Z, 0);
        builder.add(&triangle.map(|p| p + DVec3::Z * 1e-3), DVec3::Z, 0);
        let scene = builder.finish(camera(), false);
        let faces: Vec<_> = scene.surfaces.iter().map(|s| s.face).collect();
        assert_eq!(faces, [0, 0, 1]);
        let looks = scene.surfaces.iter().map(|s| normal(&scene.corners(s)).z);
        assert!(looks.eq([1.0, -1.0, 1.0]));
        assert!(scene.check().is_ok());
    }

    #[test]
    fn a_prism_looks_outwards() {
        let mut builder = Builder::new(vec![Material::grey()]);
        let footprint = rectangle(DVec2::new(1.0, 2.0), DVec2::new(3.0, 5.0));
        builder.add_sides(&footprint, [0.0, 2.0], 0);
        builder.add_level(std::slice::from_ref(&footprint), 2.0, DVec3::Y, 0);
        let scene = builder.finish(camera(), false);
        let centre = DVec3::new(3.5, 1.0, 2.0);
        assert_eq!((scene.surfaces.len(), scene.vertices.len()), (5, 8));
        for surface in &scene.surfaces {
            let corners = scene.corners(surface);
            assert!(normal(&corners).dot(corners[0] - centre) > 0.9);
        }
        assert_eq!(plan(at(footprint[0], 7.0)), footprint[0]);
    }
}
