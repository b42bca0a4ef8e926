//! Parts of a unit sphere seen from inside, where every two points exchange the same light.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3Swizzles};

use crate::scene::Scene;
use crate::scene::material::Material;
use crate::scene::surface::Surface;
use crate::scene::viewpoint::Viewpoint;
use crate::scene::weld::Weld;

/// The inside of a unit sphere around the origin, in 5120 triangles: a cap on top is a lamp, and what
/// arrives is the same everywhere.
pub(crate) fn sphere() -> Scene {
    let mut weld = Weld::default();
    let triangles = icosphere(SUBDIVISIONS, &mut weld);
    // Inwards.
    let triangles = triangles.into_iter().map(|[a, b, c]| [a, c, b]);
    let high = |corner: u32| weld.vertices[corner as usize].y;
    let lamp = |corners: [u32; 3]| corners.map(high).iter().sum::<f64>() > 3.0 * CAP;
    let surfaces = surfaces(triangles, |corners| usize::from(lamp(corners)));
    let materials = vec![
        Material::rgb("wall", [0.7, 0.6, 0.5], [0.0; 3]),
        Material::rgb("lamp", [0.2; 3], [10.0, 9.0, 8.0]),
    ];
    let camera = Viewpoint {
        eye: DVec3::new(0.0, -0.3, -0.8),
        target: DVec3::new(0.0, 0.3, 1.0),
        up: DVec3::Y,
        film_over_focal: 1.8,
    };
    let (vertices, camera) = (weld.vertices, Some(camera));
    Scene { materials, vertices, surfaces, camera, closed: true, ..Scene::default() }
}

/// A crater: a cap of a unit sphere, its opening five times as wide as it is deep, filled with nothing
/// and open to the sky. It glows evenly, and what arrives is the same everywhere.
pub(crate) fn bowl() -> Scene {
    let mut weld = Weld::default();
    let points = |ring: usize| {
        let count = if ring == 0 { 1 } else { 6 * ring };
        let polar = RIM * ring as f64 / RINGS as f64;
        let at = move |k: usize| {
            let azimuth = TAU * k as f64 / count as f64;
            let (sin, cos) = azimuth.sin_cos();
            DVec3::new(polar.sin() * sin, -polar.cos(), polar.sin() * cos)
        };
        (0..count).map(|k| weld.vertex(at(k))).collect::<Vec<_>>()
    };
    let rings: Vec<_> = (0..=RINGS).map(points).collect();
    let triangles = rings.windows(2).flat_map(|pair| ring(&pair[0], &pair[1]));
    let surfaces = surfaces(triangles, |_| 0);
    let rock = Material::rgb("rock", [0.3, 0.25, 0.2], [1.0; 3]);
    let materials = vec![Material { temperature: Some(300.0), ..rock }];
    let camera = Viewpoint {
        eye: DVec3::new(0.0, 0.2, -1.6),
        target: DVec3::new(0.0, -0.85, 0.0),
        up: DVec3::Y,
        film_over_focal: 0.9,
    };
    let (vertices, camera) = (weld.vertices, Some(camera));
    Scene { materials, vertices, surfaces, camera, ..Scene::default() }
}

/// How often the faces of the icosahedron are cut in four.
const SUBDIVISIONS: usize = 4;
/// Height above which the sphere is a lamp.
const CAP: f64 = 0.9;
/// Rings of triangles in the bowl.
const RINGS: usize = 16;
/// Polar angle of the bowl's rim: depth 1 − cos θ, width 2 sin θ, and tan θ/2 = 2 depth/width.
const RIM: f64 = 0.761_012_754_224_729_8;

/// Triangles as surfaces, each a face of its own.
fn surfaces(
    triangles: impl Iterator<Item = [u32; 3]>,
    material: impl Fn([u32; 3]) -> usize,
) -> Vec<Surface> {
    let surface = |(corners, face): ([u32; 3], u32)| Surface {
        corners: corners.to_vec(),
        material: material(corners),
        face,
    };
    triangles.zip(0..).map(surface).collect()
}

/// The unit icosphere, corners counter-clockwise as seen from outside.
fn icosphere(subdivisions: usize, weld: &mut Weld) -> Vec<[u32; 3]> {
    let mut triangles = icosahedron(weld);
    for _ in 0..subdivisions {
        // The same bits from both sides of an edge, so that it is one vertex.
        let mut middle = |a: u32, b: u32| {
            let [a, b] = [a, b].map(|k| weld.vertices[k as usize]);
            weld.vertex((a + b).normalize())
        };
        let parts = triangles.iter().flat_map(|&[a, b, c]| {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        });
        triangles = parts.collect();
    }
    triangles
}

/// The regular icosahedron with its corners on the unit sphere.
fn icosahedron(weld: &mut Weld) -> Vec<[u32; 3]> {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let corner = |k: usize| {
        let sign = |bit: usize| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let p = DVec3::new(0.0, sign(0), sign(1) * golden).normalize();
        [p, p.zxy(), p.yzx()][k / 4]
    };
    let corners: Vec<_> = (0..12).map(corner).collect();
    let edge = 2.0 / (1.0 + golden * golden).sqrt();
    let near = |a: DVec3, b: DVec3| (a.distance(b) - edge).abs() < 1e-9;
    let mut triangles = Vec::with_capacity(20);
    for (i, &a) in corners.iter().enumerate() {
        for (j, &b) in corners.iter().enumerate().skip(i + 1) {
            for &c in corners.iter().skip(j + 1) {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outwards = (b - a).cross(c - a).dot(a) > 0.0;
                    let corners = if outwards { [a, b, c] } else { [a, c, b] };
                    triangles.push(corners.map(|corner| weld.vertex(corner)));
                }
            }
        }
    }
    triangles
}

/// The triangles between a ring of vertices and the next one outwards, which has six more, or
/// six around a single one. They look to the axis.
fn ring(inner: &[u32], outer: &[u32]) -> Vec<[u32; 3]> {
    let (sectors, steps) = (6, outer.len() / 6);
    let mut triangles = Vec::new();
    for sector in 0..sectors {
        let inner_at = |k: usize| inner[(sector * (steps - 1) + k) % inner.len()];
        let outer_at = |k: usize| outer[(sector * steps + k) % outer.len()];
        for k in 0..steps {
            triangles.push([inner_at(k), outer_at(k), outer_at(k + 1)]);
        }
        for k in 1..steps {
            triangles.push([inner_at(k - 1), outer_at(k), inner_at(k)]);
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::{centroid, is_watertight, vector_area};
    use std::f64::consts::PI;

    #[test]
    fn the_sphere_is_closed_and_looks_inwards() {
        let scene = sphere();
        assert!(scene.check().is_ok() && scene.closed);
        assert_eq!(scene.surfaces.len(), 5120);
        assert!(is_watertight(&scene.surfaces));
        let area: f64 = scene.surfaces.iter().map(|s| scene.area(s)).sum();
        let volume = scene.volume();
        assert!((area / (4.0 * PI) - 1.0).abs() < 2e-3, "{area}");
        assert!((-volume / (4.0 / 3.0 * PI) - 1.0).abs() < 3e-3, "{volume}");
        assert_eq!(scene.vertices.len(), 2562);
        assert!(scene.vertices.iter().all(|p| (p.length() - 1.0).abs() < 1e-15));
        let mut faces: Vec<_> = scene.surfaces.iter().map(|s| s.face).collect();
        faces.dedup();
        assert_eq!(faces.len(), scene.surfaces.len());
    }

    #[test]
    fn the_sphere_has_a_lamp_on_top() {
        let scene = sphere();
        let lamp: Vec<_> = scene.surfaces.iter().filter(|s| s.material == 1).collect();
        let share = lamp.iter().map(|s| scene.area(s)).sum::<f64>() / (4.0 * PI);
        assert!((share - 0.5 * (1.0 - CAP)).abs() < 2e-3, "{share}");
        assert!(lamp.iter().all(|s| centroid(&scene.corners(s)).y > 0.85));
    }

    #[test]
    fn the_bowl_is_five_times_as_wide_as_deep() {
        let scene = bowl();
        assert!(scene.check().is_ok() && !scene.closed);
        assert_eq!(scene.surfaces.len(), 6 * RINGS * RINGS);
        let (rim, bottom) = (scene.vertices.iter())
            .map(|p| p.y)
            .fold((f64::MIN, f64::MAX), |(high, low), y| (high.max(y), low.min(y)));
        let radius = scene.vertices.iter().map(|p| p.x.hypot(p.z)).fold(0.0, f64::max);
        assert!((2.0 * radius / (rim - bottom) - 5.0).abs() < 1e-13);
        // A cap's area is 2π R times its depth.
        let total: f64 = scene.surfaces.iter().map(|s| scene.area(s)).sum();
        assert!((total / (TAU * (rim - bottom)) - 1.0).abs() < 2e-3);
        // The hole is as large, seen from above, as the polygon of the rim.
        let open = scene.open_area();
        let sides = (6 * RINGS) as f64;
        let rim_area = 0.5 * sides * radius * radius * (TAU / sides).sin();
        assert!(open.distance(DVec3::Y * rim_area) < 1e-12, "{open}");
        assert!(scene.surfaces.iter().all(|s| {
            let corners = scene.corners(s);
            let normal = vector_area(&corners);
            normal.y > 0.0 && normal.dot(centroid(&corners)) < 0.0
        }));
    }
}
