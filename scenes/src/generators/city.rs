//! Street canyons: rows of buildings between which light and heat go to and fro.

use glam::{DVec2, DVec3};

use crate::generators::builder::{Builder, at};
use crate::generators::polygon::rectangle;
use crate::scene::Scene;
use crate::scene::material::Material;
use crate::scene::viewpoint::Viewpoint;

/// A town of `blocks` × `blocks` buildings of different heights \[m] on level ground, under an open
/// sky: at night the shop fronts light the streets, and everything has a temperature. There is no
/// ground under the buildings.
pub(crate) fn canyon(blocks: usize) -> Scene {
    let warm = |temperature: f64, material: Material| Material {
        temperature: Some(temperature),
        ..material
    };
    let mut builder = Builder::new(vec![
        warm(303.0, Material::rgb("asphalt", [0.14, 0.14, 0.15], [0.0; 3])),
        warm(308.0, Material::rgb("roof", [0.30, 0.28, 0.26], [0.0; 3])),
        warm(298.0, Material::rgb("plaster", [0.62, 0.58, 0.50], [0.0; 3])),
        warm(298.0, Material::rgb("brick", [0.45, 0.20, 0.14], [0.0; 3])),
        warm(300.0, Material::rgb("warm shop", [0.10; 3], [9.0, 6.0, 2.5])),
        warm(300.0, Material::rgb("cold shop", [0.10; 3], [2.5, 5.0, 8.0])),
    ]);
    let [asphalt, roof, plaster, brick, warm_shop, cold_shop] = [0, 1, 2, 3, 4, 5];
    let lines: Vec<f64> = (0..blocks)
        .flat_map(|k| [0.0, STREET].map(|offset| k as f64 * PERIOD + offset))
        .chain([0.0, STREET].map(|offset| blocks as f64 * PERIOD + offset))
        .collect();
    for (i, z) in lines.windows(2).enumerate() {
        for (j, x) in lines.windows(2).enumerate() {
            let cell = rectangle(DVec2::new(z[0], x[0]), DVec2::new(z[1], x[1]));
            if i % 2 == 0 || j % 2 == 0 {
                builder.add_level(&[cell], 0.0, DVec3::Y, asphalt);
                continue;
            }
            let height = LOWEST + (HIGHEST - LOWEST) * noise(i, j, 0);
            let wall = if noise(i, j, 1) < 0.5 { plaster } else { brick };
            let front = match noise(i, j, 2) {
                lot if lot < 0.4 => warm_shop,
                lot if lot < 0.6 => cold_shop,
                _ => wall,
            };
            builder.add_sides(&cell, [0.0, SHOP], front);
            builder.add_sides(&cell, [SHOP, height], wall);
            builder.add_level(&[cell], height, DVec3::Y, roof);
        }
    }
    let size = lines[lines.len() - 1];
    let camera = Viewpoint {
        eye: at(DVec2::new(-0.35 * size, -0.2 * size), 0.55 * size),
        target: at(DVec2::splat(0.45 * size), 0.0),
        up: DVec3::Y,
        film_over_focal: 0.9,
    };
    builder.finish(camera, false)
}

/// Width of a street \[m].
const STREET: f64 = 12.0;
/// From one street to the next \[m].
const PERIOD: f64 = 32.0;
/// Height of the shop fronts \[m].
const SHOP: f64 = 4.0;
/// Height of the lowest building \[m].
const LOWEST: f64 = 10.0;
/// Height that no building reaches \[m].
const HIGHEST: f64 = 42.0;

/// A number in [0, 1) that looks random but is always the same for a building and a purpose.
fn noise(i: usize, j: usize, purpose: usize) -> f64 {
    let mut bits = [i, j, purpose].into_iter().fold(0, |bits: u64, k| {
        (bits ^ k as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
    });
    // The finaliser of SplitMix64.
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::{centroid, vector_area};

    #[test]
    fn the_town_covers_its_ground_once() {
        for blocks in [0, 1, 4] {
            let scene = canyon(blocks);
            assert!(scene.check().is_ok() && !scene.closed);
            let size = blocks as f64 * PERIOD + STREET;
            // Walls cancel out; ground and roofs together are the plan.
            let open = scene.open_area();
            assert!(open.distance(DVec3::Y * size * size) < 1e-8, "{open}");
            let level = scene.surfaces.iter().filter(|s| s.material < 2);
            let level: f64 = level.map(|s| scene.area(s)).sum();
            assert!((level - size * size).abs() < 1e-8);
            let roofs = scene.surfaces.iter().filter(|s| s.material == 1).count();
            assert_eq!(roofs, blocks * blocks);
        }
    }

    #[test]
    fn there_is_no_ground_under_a_building_and_walls_look_into_the_streets() {
        let scene = canyon(3);
        let in_street = |c: f64| c.rem_euclid(PERIOD) < STREET;
        for surface in &scene.surfaces {
            let corners = scene.corners(surface);
            let (centre, normal) = (centroid(&corners), vector_area(&corners).normalize());
            let ahead = centre + normal;
            match surface.material {
                0 => assert!(centre.y == 0.0 && (in_street(centre.x) || in_street(centre.z))),
                1 => assert!(centre.y >= LOWEST && normal == DVec3::Y),
                _ => assert!(normal.y == 0.0 && (in_street(ahead.x) || in_street(ahead.z))),
            }
        }
    }

    #[test]
    fn heights_differ_but_not_from_run_to_run() {
        let heights = |scene: Scene| -> Vec<u64> {
            let roofs = scene.surfaces.iter().filter(|s| s.material == 1);
            roofs.map(|s| scene.corners(s)[0].y.to_bits()).collect()
        };
        let mut first = heights(canyon(4));
        assert_eq!(first, heights(canyon(4)));
        first.sort_unstable();
        first.dedup();
        assert_eq!(first.len(), 16);
    }

    #[test]
    fn three_of_five_buildings_have_lit_shops() {
        let scene = canyon(20);
        let lit = scene.surfaces.iter().filter(|s| s.material >= 4).count();
        assert!((0.54..0.66).contains(&(lit as f64 / (4 * 400) as f64)), "{lit}");
        let mut values = (0..1000).map(|k| noise(k % 10, k / 10 % 10, k / 100));
        let mean = values.clone().sum::<f64>() / 1e3;
        assert!((mean - 0.5).abs() < 0.03, "{mean}");
        assert!(values.all(|value| (0.0..1.0).contains(&value)));
    }
}
