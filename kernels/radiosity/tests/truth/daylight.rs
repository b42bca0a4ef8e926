//! Sky, ground and sun in closed form.

use std::f64::consts::{FRAC_PI_4, PI};

use farfield_radiosity::{Element, Error, Occluders, Patch, Scene, Sky, Surroundings};
use glam::DVec3;

const RAYS: usize = 1 << 14;

/// A small square around a point, and what hides it.
fn small(scene: &mut Scene, at: DVec3, normal: DVec3) -> usize {
    let (u, v) = normal.any_orthonormal_pair();
    let [u, v] = [u, v].map(|edge| edge * 1e-4);
    let face = scene.faces() as u32 + 1000;
    let (u, v) = if u.cross(v).dot(normal) > 0.0 { (u, v) } else { (v, u) };
    let corners = [at - u - v, at + u - v, at + u + v, at - u + v];
    scene.elements.push(Element::patch(Patch::new(&corners).unwrap(), face));
    scene.elements.len() - 1
}

fn around<T>(scene: &Scene, test: impl FnOnce(Surroundings<'_>) -> T) -> T {
    let occluders = Occluders::new(&scene.triangles).unwrap();
    test(Surroundings::new(&scene.elements, &occluders, 8))
}

/// A street between walls that go on for ever, nearly: floor, and walls at x = ±1/2 of this height, in one
/// element each.
fn canyon(height: f64) -> Scene {
    let mut scene = Scene::new();
    let (x, y, z) = (DVec3::X * 0.5, DVec3::Y * 2000.0, DVec3::Z * height);
    scene.add_quad([-x - y, x - y, x + y, y - x], 1, 1);
    scene.add_quad([-x - y, y - x, y - x + z, z - x - y], 1, 1);
    scene.add_quad([x - y, x - y + z, x + y + z, x + y], 1, 1);
    scene
}

#[test]
fn a_canyon_sees_as_much_of_the_sky_as_strings_across_it_say() {
    for height in [0.3, 1.0, 3.0] {
        let mut scene = canyon(height);
        let centre = small(&mut scene, DVec3::Z * 1e-9, DVec3::Z);
        let up = 7.0 * DVec3::Z;
        let (uniform, overcast) = (Sky::uniform(up).unwrap(), Sky::overcast(up).unwrap());
        around(&scene, |around| {
            let sky = |i: usize, sky: &Sky| around.daylight(i, sky, RAYS).sky;
            let floor = height.hypot(1.0) - height;
            assert!((sky(0, &uniform) - floor).abs() < 3e-3, "{height} {}", sky(0, &uniform));
            let wall = 0.5 * (1.0 + 1.0 / height - (1.0 + height.powi(-2)).sqrt());
            for i in [1, 2] {
                assert!((sky(i, &uniform) - wall).abs() < 3e-3, "{height} {}", sky(i, &uniform));
            }
            // In the middle of the floor, up to the angle φ from the zenith on either side.
            let angle = (0.5 / height).atan();
            let (sin, cos) = angle.sin_cos();
            assert!((sky(centre, &uniform) - sin).abs() < 3e-3, "{height}");
            let exact = 3.0 / (7.0 * PI) * (PI * sin + 8.0 / 3.0 * (angle + sin * cos));
            assert!((sky(centre, &overcast) - exact).abs() < 3e-3, "{height}");
            assert!((exact - sin).abs() > 1e-2, "the two skies differ");
            assert_eq!(around.daylight(0, &uniform, RAYS).ground, 0.0);
        });
    }
}

#[test]
fn a_courtyard_and_a_tilted_plane_see_the_sky_and_the_ground() {
    // Four walls of the height 1 around a unit square, whose opening the middle of the floor sees.
    let [x, y, z] = DVec3::AXES;
    let mut scene = Scene::new();
    let corners = [DVec3::ZERO, x, x + y, y];
    for k in 0..4 {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        scene.add_quad([a, a + z, b + z, b], 1, 1);
    }
    let floor = small(&mut scene, 0.5 * (x + y) + 1e-9 * z, z);
    let uniform = Sky::uniform(z).unwrap();
    around(&scene, |around| {
        let found = around.daylight(floor, &uniform, RAYS);
        assert!((found.sky - 0.239_456_470_460_773_5).abs() < 3e-3, "{found:?}");
    });
    // An open plane, tilted by β, sees (1 + cos β)/2 of a uniform sky, and the ground beyond.
    for tilt in [0.0, FRAC_PI_4, 1.2, PI] {
        let mut scene = Scene::new();
        small(&mut scene, DVec3::ZERO, DVec3::new(tilt.sin(), 0.0, tilt.cos()));
        let open = around(&scene, |around| around.daylight(0, &uniform, RAYS));
        let exact = 0.5 * (1.0 + tilt.cos());
        assert!((open.sky - exact).abs() < 2e-3 && (open.sky + open.ground - 1.0).abs() < 1e-12);
        let overcast = Sky::overcast(z).unwrap();
        let found = around(&scene, |around| around.daylight(0, &overcast, RAYS)).sky;
        // 3/(7π) ∫ (1 + 2 sin γ) cos θ over the part of the sky that is above the plane.
        let sine = 4.0 / (3.0 * PI) * (tilt.sin() + (PI - tilt) * tilt.cos());
        let exact = 3.0 / 7.0 * (exact + sine);
        assert!((found - exact).abs() < 2e-3, "{tilt}: {found} {exact}");
    }
}

#[test]
fn the_sun_shines_past_what_stands_in_its_way() {
    // A roof of the slope 3:4 in one element, and a panel above that hides a part of it.
    let up = DVec3::new(-0.6, 0.0, 0.8);
    let [along, y] = [DVec3::new(0.8, 0.0, 0.6), DVec3::Y];
    let mut scene = Scene::new();
    scene.add_quad([DVec3::ZERO, along, along + y, y], 1, 1);
    let to_sun = DVec3::new(-0.3, 0.2, 0.9);
    // Its shadow is from 0.25 to 0.75 along the slope and from 0.5 on across.
    let lifted = to_sun * 3.0;
    let at = |u: f64, v: f64| along * u + y * v + lifted;
    scene.add_quad([at(0.25, 0.5), at(0.75, 0.5), at(0.75, 2.0), at(0.25, 2.0)], 0, 0);
    let cosine = up.dot(to_sun.normalize());
    around(&scene, |around| {
        let beam = around.sunlight(to_sun * 1e200, RAYS).unwrap();
        assert!((beam[0] / cosine - 0.75).abs() < 2e-3, "{beam:?}");
        assert_eq!(around.sunlight(-to_sun, RAYS).unwrap(), [0.0], "from below");
        // From where the panel hides nothing.
        let beam = around.sunlight(up, 64).unwrap();
        assert!((beam[0] - 1.0).abs() < 1e-12, "{beam:?}");
        for found in [DVec3::ZERO, DVec3::new(f64::NAN, 0.0, 1.0), DVec3::X * f64::INFINITY] {
            let error = around.sunlight(found, 4).unwrap_err();
            assert!(matches!(error, Error::InvalidDirection { what: "direction to the sun", .. }));
            assert!(Sky::uniform(found).is_err() && Sky::overcast(found).is_err());
        }
    });
}
