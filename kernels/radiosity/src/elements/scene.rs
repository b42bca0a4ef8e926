//! Generated scenes: quadrilaterals cut into surfels, rooms, the inside of a sphere.

use std::f64::consts::PI;

use glam::DVec3;

use crate::elements::element::Element;
use crate::elements::patch::Patch;
use crate::elements::surfel::Surfel;
use crate::elements::triangle::Triangle;

/// Surfels and the faces that they lie on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// What exchanges light; each knows its face.
    pub elements: Vec<Element>,
    /// The surfels of the elements.
    pub surfels: Vec<Surfel>,
    /// What hides; each triangle knows its face.
    pub triangles: Vec<Triangle>,
    faces: u32,
}

impl Scene {
    /// A scene with nothing in it.
    pub fn new() -> Self {
        Self::default()
    }

    /// How many faces it has; they are numbered from 0 in the order in which they were added.
    pub fn faces(&self) -> usize {
        self.faces as usize
    }

    /// Adds a quadrilateral that hides and, on its front, exchanges light through `nu` × `nv`
    /// surfels; see [`quad_surfels`]. Returns its face. With `nu` or `nv` zero it only hides.
    pub fn add_quad(&mut self, corners: [DVec3; 4], nu: usize, nv: usize) -> u32 {
        let face = self.faces;
        self.faces += 1;
        let pieces = quad_pieces(corners, nu, nv).zip(quad_surfels(corners, nu, nv, face));
        for (piece, surfel) in pieces {
            let element = match Patch::new(&piece) {
                Ok(patch) => Element::patch(patch, face),
                // Twisted pieces are known by their vector area only.
                Err(_) => Element::disk(surfel),
            };
            // To the bit: masks find elements by their surfels.
            self.surfels.push(*element.surfel());
            self.elements.push(element);
        }
        self.triangles.extend(quad_triangles(corners, face));
        face
    }

    /// Adds a box seen from inside, `n` × `n` surfels on each of its walls. Returns the faces of the
    /// walls at low x, high x, low y, high y, low z and high z.
    pub fn add_room(&mut self, low: DVec3, high: DVec3, n: usize) -> [u32; 6] {
        std::array::from_fn(|wall| {
            let (axis, at_high) = (wall / 2, wall % 2 == 1);
            let (mut origin, mut u, mut v) = (low, DVec3::ZERO, DVec3::ZERO);
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            u[i] = high[i] - low[i];
            v[j] = high[j] - low[j];
            if at_high {
                // Inwards is the other way here: swap the two directions.
                origin[axis] = high[axis];
                (u, v) = (v, u);
            }
            self.add_quad([origin, origin + u, origin + u + v, origin + v], n, n)
        })
    }
}

/// The inside of the box [0, 1]³ with `n` × `n` surfels on each wall. With even emission and reflectance
/// it is the furnace of radiometry, which glows evenly.
pub fn furnace(n: usize) -> Scene {
    let mut scene = Scene::new();
    scene.add_room(DVec3::ZERO, DVec3::ONE, n);
    scene
}

/// Two cubic rooms, x in [0, 1] and x in [1, 2], that share a wall of no thickness. The surfels of the
/// first half of the list belong to the first room, the others to the second.
pub fn two_rooms(n: usize) -> Scene {
    let mut scene = Scene::new();
    scene.add_room(DVec3::ZERO, DVec3::ONE, n);
    scene.add_room(DVec3::X, DVec3::new(2.0, 1.0, 1.0), n);
    scene
}

/// `n` surfels of equal area on a sphere around `centre`, normals inwards, spread by golden-angle
/// steps. Between any two of them the clamped kernel is exactly 1/(4πR²).
pub fn sphere_interior(n: usize, centre: DVec3, radius: f64) -> Vec<Surfel> {
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    let area = 4.0 * PI * radius * radius / n as f64;
    let surfel = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let (sin, cos) = (golden_angle * i as f64).sin_cos();
        let rho = (1.0 - z * z).sqrt();
        let outwards = DVec3::new(rho * cos, rho * sin, z);
        let position = centre + outwards * radius;
        Surfel { position, normal: -outwards, area, face: Surfel::<f64>::NO_FACE }
    };
    (0..n).map(surfel).collect()
}

/// The bilinear patch over four `corners`, cut into `nu` × `nv` surfels along its edges 0→1 and 0→3,
/// v running fastest.
///
/// The corners go counter-clockwise around the front. A surfel sits at the middle of its piece of the
/// patch and has the vector area of that piece, ½ |diagonal × diagonal|: exact if the corners lie in
/// a plane, which they need not.
pub fn quad_surfels(corners: [DVec3; 4], nu: usize, nv: usize, face: u32) -> Vec<Surfel> {
    let surfel = |[a, b, c, d]: [DVec3; 4]| {
        let vector_area = (c - a).cross(d - b) * 0.5;
        Surfel {
            position: (a + b + c + d) * 0.25,
            normal: vector_area.normalize_or_zero(),
            area: vector_area.length(),
            face,
        }
    };
    quad_pieces(corners, nu, nv).map(surfel).collect()
}

/// The pieces of the same patch by their corners, in the same order.
pub fn quad_pieces(corners: [DVec3; 4], nu: usize, nv: usize) -> impl Iterator<Item = [DVec3; 4]> {
    let [a, b, c, d] = corners;
    let at = move |i: usize, j: usize| {
        let (u, v) = (i as f64 / nu as f64, j as f64 / nv as f64);
        a.lerp(b, u).lerp(d.lerp(c, u), v)
    };
    (0..nu)
        .flat_map(move |i| (0..nv).map(move |j| (i, j)))
        .map(move |(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
}

/// The two triangles of a quadrilateral, which share the diagonal 0→2, as occluders of one face.
pub fn quad_triangles([a, b, c, d]: [DVec3; 4], face: u32) -> [Triangle; 2] {
    [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::surfel::{Projections, check_surfels};
    use approx::assert_relative_eq;

    #[test]
    fn the_kernel_inside_a_sphere_is_constant() {
        let (centre, radius) = (DVec3::new(3.0, -1.0, 0.5), 2.5);
        let sphere = sphere_interior(200, centre, radius);
        check_surfels(&sphere).unwrap();
        let area: f64 = sphere.iter().map(|s| s.area).sum();
        let whole = 4.0 * PI * radius * radius;
        assert_relative_eq!(area, whole, max_relative = 1e-13);
        let mean = sphere.iter().map(|s| s.position).sum::<DVec3>() / 200.0;
        assert!((mean - centre).length() < 0.01 * radius, "evenly spread");
        for (i, x) in sphere.iter().enumerate() {
            for y in &sphere[..i] {
                let pair = Projections::new(x, y);
                assert!(pair.facing());
                assert_relative_eq!(pair.kernel(), 1.0 / whole, max_relative = 1e-12);
            }
        }
    }

    #[test]
    fn surfels_of_a_room_cover_its_walls_and_look_inwards() {
        let (low, high) = (DVec3::new(-1.0, 0.0, 2.0), DVec3::new(1.0, 3.0, 6.0));
        let mut scene = Scene::new();
        assert_eq!(scene.add_room(low, high, 3), [0, 1, 2, 3, 4, 5]);
        check_surfels(&scene.surfels).unwrap();
        let areas = [12.0, 12.0, 8.0, 8.0, 6.0, 6.0];
        for (face, area) in areas.into_iter().enumerate() {
            let wall = scene.surfels.iter().filter(|s| s.face as usize == face);
            let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
            assert_relative_eq!(
                wall.clone().map(|s| s.area).sum::<f64>(),
                area,
                max_relative = 1e-14
            );
            for surfel in wall {
                assert_eq!(surfel.normal, DVec3::AXES[axis] * sign);
                let border = if face % 2 == 0 { low } else { high };
                assert_eq!(surfel.position[axis], border[axis]);
            }
            let triangles = scene.triangles.iter().filter(|t| t.face as usize == face);
            assert_eq!(triangles.count(), 2);
        }
    }

    #[test]
    fn surfels_of_a_twisted_quad_add_up_to_its_vector_area() {
        let corners =
            [[0.0, 0.0, 0.0], [2.0, 0.0, 0.3], [2.1, 1.0, -0.2], [0.0, 1.2, 0.0]].map(DVec3::from);
        let [a, b, c, d] = corners;
        let surfels = quad_surfels(corners, 5, 7, 4);
        let vector_area: DVec3 = surfels.iter().map(|s| s.normal * s.area).sum();
        assert!(vector_area.distance((c - a).cross(d - b) * 0.5) < 1e-14);
        assert!(surfels.iter().all(|s| s.face == 4 && s.normal.z > 0.9));
        assert_eq!(
            surfels[0].position.x.total_cmp(&surfels[7].position.x),
            std::cmp::Ordering::Less
        );
        assert!(quad_surfels(corners, 0, 7, 4).is_empty());
    }
}
