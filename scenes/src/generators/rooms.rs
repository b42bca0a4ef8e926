//! Cubic rooms: the furnace, and two neighbours of which only one has a lamp.

use glam::{DVec2, DVec3};

use crate::generators::builder::Builder;
use crate::generators::polygon::{rectangle, subtract};
use crate::scene::Scene;
use crate::scene::material::Material;
use crate::scene::viewpoint::Viewpoint;

/// The inside of the unit cube: every wall emits 1 W/m² and reflects half of what it receives, so that
/// the radiosity is 2 W/m² everywhere.
pub(crate) fn furnace() -> Scene {
    let mut builder = Builder::new(vec![Material::rgb("wall", [0.5; 3], [1.0; 3])]);
    add_walls(&mut builder, 0.0, [Some(0); 4]);
    for (y, front) in [(0.0, DVec3::Y), (1.0, DVec3::NEG_Y)] {
        builder.add_level(&[floor_plan(0.0)], y, front, 0);
    }
    builder.finish(inside(), true)
}

/// Two cubic rooms, x in [0, 1] and x in [1, 2], that share a wall of no thickness. The lamp is in the
/// ceiling of the first; the second stays dark.
pub(crate) fn two_rooms() -> Scene {
    let shared = Material::rgb("shared wall", [0.7, 0.4, 0.2], [0.0; 3]);
    let mut builder = Builder::new(vec![
        Material::rgb("white", [0.7; 3], [0.0; 3]),
        Material { two_sided: true, ..shared },
        Material::rgb("lamp", [0.0; 3], [30.0, 28.0, 25.0]),
    ]);
    let [white, shared, lamp] = [0, 1, 2];
    let light = rectangle(DVec2::splat(0.35), DVec2::splat(0.65));
    let white_wall = Some(white);
    add_walls(&mut builder, 0.0, [white_wall, white_wall, white_wall, Some(shared)]);
    builder.add_level(&[floor_plan(0.0)], 0.0, DVec3::Y, white);
    let ceiling = subtract(vec![floor_plan(0.0)], &light);
    builder.add_level(&ceiling, 1.0, DVec3::NEG_Y, white);
    builder.add_level(&[light], 1.0, DVec3::NEG_Y, lamp);
    add_walls(&mut builder, 1.0, [white_wall, white_wall, None, white_wall]);
    for (y, front) in [(0.0, DVec3::Y), (1.0, DVec3::NEG_Y)] {
        builder.add_level(&[floor_plan(1.0)], y, front, white);
    }
    builder.finish(inside(), true)
}

/// A view from within the first room.
fn inside() -> Viewpoint {
    let eye = DVec3::new(0.1, 0.5, 0.05);
    Viewpoint { eye, target: DVec3::new(0.75, 0.45, 1.0), up: DVec3::Y, film_over_focal: 1.6 }
}

/// The floor of the room that begins at `x`.
fn floor_plan(x: f64) -> Vec<DVec2> {
    rectangle(DVec2::new(0.0, x), DVec2::new(1.0, x + 1.0))
}

/// The upright walls of the room that begins at `x`, as far as they have a material: those at low z,
/// high z, low x and high x.
fn add_walls(builder: &mut Builder, x: f64, materials: [Option<usize>; 4]) {
    let walls = [
        (DVec3::ZERO, DVec3::X, DVec3::Z),
        (DVec3::Z, DVec3::X, DVec3::NEG_Z),
        (DVec3::ZERO, DVec3::Z, DVec3::X),
        (DVec3::X, DVec3::Z, DVec3::NEG_X),
    ];
    for ((corner, along, front), material) in walls.into_iter().zip(materials) {
        let Some(material) = material else { continue };
        let start = x * DVec3::X + corner;
        let end = start + along;
        builder.add(&[start, end, end + DVec3::Y, start + DVec3::Y], front, material);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::{centroid, is_watertight, vector_area};

    #[test]
    fn the_furnace_is_a_closed_cube_seen_from_inside() {
        let scene = furnace();
        assert!(scene.check().is_ok() && scene.closed);
        assert_eq!(scene.surfaces.len(), 6);
        assert!(is_watertight(&scene.surfaces));
        assert!((scene.volume() + 1.0).abs() < 1e-15);
        let faces: Vec<_> = scene.surfaces.iter().map(|s| s.face).collect();
        assert_eq!(faces, [0, 1, 2, 3, 4, 5]);
    }

    #[test]
    fn two_rooms_share_a_wall_with_two_sides() {
        let scene = two_rooms();
        assert!(scene.check().is_ok() && scene.closed);
        let (shared, surfaces): (Vec<_>, Vec<_>) =
            scene.surfaces.iter().cloned().partition(|s| s.material == 1);
        assert_eq!((shared.len(), scene.materials[1].two_sided), (1, true));
        assert!(scene.corners(&shared[0]).iter().all(|p| p.x == 1.0));
        assert_eq!(scene.area(&shared[0]), 1.0);
        // All other walls together are those of one room, twice as long.
        let others = Scene { surfaces, ..scene };
        assert!(others.open_area().length() < 1e-14);
        assert!((others.volume() + 2.0).abs() < 1e-14);
        let area = |s: &_| others.area(s);
        assert!((others.surfaces.iter().map(area).sum::<f64>() - 10.0).abs() < 1e-14);
        // The light is in the first room.
        let lamps: Vec<_> = others.surfaces.iter().filter(|s| s.material == 2).collect();
        let corners = |s: &_| others.corners(s);
        assert!(lamps.iter().all(|s| centroid(&corners(s)).x < 1.0));
        assert!(lamps.iter().all(|s| vector_area(&corners(s)).y < 0.0));
        assert!((lamps.iter().map(|s| area(s)).sum::<f64>() - 0.09).abs() < 1e-15);
    }
}
