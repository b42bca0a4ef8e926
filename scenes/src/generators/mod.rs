//! Generated scenes by name.

pub(crate) mod builder;
pub(crate) mod city;
pub(crate) mod cornell_box;
pub(crate) mod hall;
pub(crate) mod polygon;
pub(crate) mod rooms;
pub(crate) mod round;

use crate::generators::city::canyon;
use crate::generators::cornell_box::cornell;
use crate::generators::hall::columns;
use crate::generators::rooms::{furnace, two_rooms};
use crate::generators::round::{bowl, sphere};
use crate::scene::Scene;

/// The names of the generated scenes.
pub const GENERATORS: [&str; 7] =
    ["cornell", "furnace", "sphere", "bowl", "two-rooms", "canyon", "columns"];

/// Rows of buildings in the canyon that goes by that name alone.
const BLOCKS: usize = 6;

/// The generated scene of this name, if there is one.
pub fn generate(name: &str) -> Option<Scene> {
    match name {
        "cornell" => Some(cornell()),
        "furnace" => Some(furnace()),
        "sphere" => Some(sphere()),
        "bowl" => Some(bowl()),
        "two-rooms" => Some(two_rooms()),
        "canyon" => Some(canyon(BLOCKS)),
        "columns" => Some(columns()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Quantity;
    use crate::scene::material::RGB_BANDS;

    #[test]
    fn every_name_makes_a_scene_with_light_in_it_and_a_camera() {
        for name in GENERATORS {
            let scene = generate(name).expect("a listed scene");
            scene.check().expect("a valid scene");
            assert_eq!(scene.bands(), RGB_BANDS, "{name}");
            let emits = |k: usize| scene.emission(k, Quantity::Light).iter().any(|&e| e > 0.0);
            assert!(scene.surfaces.iter().any(|s| emits(s.material)), "{name}");
            let camera = scene.camera.expect("a camera");
            let sight = camera.target - camera.eye;
            assert!(sight.cross(camera.up).length() > 0.1 * sight.length(), "{name}");
            assert!(scene.repairs.is_empty());
        }
        assert!(generate("cornel").is_none());
    }
}
