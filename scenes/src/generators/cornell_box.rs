//! The Cornell box: published geometry \[mm\], with colours in three bands (R, G, B).
//!
//! Every wall's front is lit: the inside of the room, the outside of the two blocks. The room has no
//! front wall, and no floor where the blocks stand.

use std::f64::consts::PI;

use glam::DVec3;

use crate::generators::builder::{Builder, plan};
use crate::generators::polygon::subtract;
use crate::scene::Scene;
use crate::scene::material::Material;
use crate::scene::viewpoint::Viewpoint;

/// The Cornell box.
pub(crate) fn cornell() -> Scene {
    let lamp = [17.0, 12.0, 4.0].map(|radiance| PI * radiance);
    let mut builder = Builder::new(vec![
        Material::rgb("white", [0.725, 0.71, 0.68], [0.0; 3]),
        Material::rgb("red", [0.63, 0.065, 0.05], [0.0; 3]),
        Material::rgb("green", [0.14, 0.45, 0.091], [0.0; 3]),
        Material::rgb("lamp", [0.0; 3], lamp),
    ]);
    let blocks = [SHORT_BLOCK_TOP, TALL_BLOCK_TOP].map(|top| top.map(|p| plan(p.into())));
    let floor = blocks
        .iter()
        .fold(vec![FLOOR.map(|p| plan(p.into())).to_vec()], |floor, block| subtract(floor, block));
    builder.add_level(&floor, 0.0, DVec3::Y, WHITE);
    let light = LIGHT.map(|p| plan(p.into())).to_vec();
    let ceiling = subtract(vec![CEILING.map(|p| plan(p.into())).to_vec()], &light);
    builder.add_level(&ceiling, HEIGHT, DVec3::NEG_Y, WHITE);
    builder.add_level(&[light], HEIGHT, DVec3::NEG_Y, LAMP);
    builder.add(&BACK.map(DVec3::from_array), DVec3::NEG_Z, WHITE);
    builder.add(&RIGHT.map(DVec3::from_array), DVec3::X, GREEN);
    // Its corners lie 3.2 mm off a plane.
    let [a, b, c, d] = LEFT.map(DVec3::from_array);
    builder.add(&[a, b, c], DVec3::NEG_X, RED);
    builder.add(&[a, c, d], DVec3::NEG_X, RED);
    for (block, top) in blocks.iter().zip([SHORT_BLOCK_TOP, TALL_BLOCK_TOP]) {
        let height = top[0][1];
        builder.add_level(&[block.to_vec()], height, DVec3::Y, WHITE);
        builder.add_sides(block, [0.0, height], WHITE);
    }
    let camera =
        Viewpoint { eye: EYE, target: EYE.with_z(0.0), up: DVec3::Y, film_over_focal: FILM };
    builder.finish(camera, false)
}

const WHITE: usize = 0;
const RED: usize = 1;
const GREEN: usize = 2;
const LAMP: usize = 3;

const EYE: DVec3 = DVec3::new(278.0, 273.0, -800.0);
/// The published film is 25 mm wide, the focal length 35 mm.
const FILM: f64 = 0.025 / 0.035;
const HEIGHT: f64 = 548.8;
const FLOOR: [[f64; 3]; 4] =
    [[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]];
const LIGHT: [[f64; 3]; 4] = [
    [343.0, HEIGHT, 227.0],
    [213.0, HEIGHT, 227.0],
    [213.0, HEIGHT, 332.0],
    [343.0, HEIGHT, 332.0],
];
const CEILING: [[f64; 3]; 4] =
    [[556.0, HEIGHT, 0.0], [0.0, HEIGHT, 0.0], [0.0, HEIGHT, 559.2], [556.0, HEIGHT, 559.2]];
const BACK: [[f64; 3]; 4] =
    [[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, HEIGHT, 559.2], [556.0, HEIGHT, 559.2]];
const RIGHT: [[f64; 3]; 4] =
    [[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, HEIGHT, 0.0], [0.0, HEIGHT, 559.2]];
const LEFT: [[f64; 3]; 4] =
    [[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, HEIGHT, 559.2], [556.0, HEIGHT, 0.0]];
const SHORT_BLOCK_TOP: [[f64; 3]; 4] =
    [[130.0, 165.0, 65.0], [82.0, 165.0, 225.0], [240.0, 165.0, 272.0], [290.0, 165.0, 114.0]];
const TALL_BLOCK_TOP: [[f64; 3]; 4] =
    [[423.0, 330.0, 247.0], [265.0, 330.0, 296.0], [314.0, 330.0, 456.0], [472.0, 330.0, 406.0]];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::polygon;
    use crate::scene::geometry::{centroid, contains, vector_area};
    use crate::scene::surface::Surface;

    /// The corners of the surfaces for which `counts` holds, and their faces.
    fn of(counts: impl Fn(&Surface, &[DVec3]) -> bool) -> (Vec<Vec<DVec3>>, Vec<u32>) {
        let scene = cornell();
        let all = scene.surfaces.iter().map(|surface| (surface, scene.corners(surface)));
        let counted = all.filter(|(surface, corners)| counts(surface, corners));
        counted.map(|(surface, corners)| (corners, surface.face)).unzip()
    }

    fn area(corners: &[Vec<DVec3>]) -> f64 {
        corners.iter().map(|corners| vector_area(corners).length()).sum()
    }

    #[test]
    fn the_box_is_a_valid_open_scene() {
        let scene = cornell();
        assert!(scene.check().is_ok() && !scene.closed);
        let camera = scene.camera.expect("the published one");
        assert_eq!((camera.target - camera.eye).normalize(), DVec3::Z);
    }

    #[test]
    fn the_floor_ends_where_the_blocks_begin() {
        let blocks = [SHORT_BLOCK_TOP, TALL_BLOCK_TOP].map(|top| top.map(|p| plan(p.into())));
        let covered: f64 = blocks.iter().map(|block| polygon::area(block).abs()).sum();
        let whole = polygon::area(&FLOOR.map(|p| plan(p.into()))).abs();
        let (floor, _) = of(|_, corners| corners.iter().all(|p| p.y == 0.0));
        let lit = area(&floor);
        assert!((lit - (whole - covered)).abs() < 1e-8 * whole, "{lit} {whole} {covered}");
        assert!(floor.iter().all(|s| vector_area(s).y > 0.0));
        // Where blocks stand there is no floor, and elsewhere there is exactly one piece of it.
        for i in 0..40 {
            for j in 0..40 {
                let p = DVec3::new(13.7 * i as f64 + 1.1, 0.0, 13.9 * j as f64 + 1.3);
                let under = blocks.iter().any(|b| polygon_contains(b, plan(p)));
                let pieces = floor.iter().filter(|s| contains(s, p)).count();
                let room = p.x < 549.0;
                assert_eq!(pieces, usize::from(room && !under), "{p}");
            }
        }
    }

    fn polygon_contains(corners: &[glam::DVec2], point: glam::DVec2) -> bool {
        let inside = |k: usize, sign: f64| {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            sign * (b - a).perp_dot(point - a) > 0.0
        };
        [1.0, -1.0].iter().any(|&sign| (0..corners.len()).all(|k| inside(k, sign)))
    }

    #[test]
    fn light_and_ceiling_together_fill_the_top() {
        let (top, faces) = of(|_, corners| corners.iter().all(|p| p.y == HEIGHT));
        assert!((area(&top) - 556.0 * 559.2).abs() < 1e-7);
        assert!(faces.iter().all(|&face| face == faces[0]));
        assert!(top.iter().all(|corners| vector_area(corners).y < 0.0));
        let (lamp, _) = of(|surface, _| surface.material == LAMP);
        assert!((area(&lamp) - 130.0 * 105.0).abs() < 1e-9);
    }

    #[test]
    fn coloured_walls_look_into_the_room_and_blocks_out_of_themselves() {
        let [(red, faces), (green, _)] =
            [RED, GREEN].map(|material| of(|surface, _| surface.material == material));
        assert_eq!((red.len(), green.len()), (2, 1));
        assert_ne!(faces[0], faces[1]);
        assert!(red.iter().all(|s| centroid(s).x > 540.0 && vector_area(s).x < 0.0));
        assert!(green.iter().all(|s| centroid(s).x == 0.0 && vector_area(s).x > 0.0));
        let (surfaces, _) = of(|_, _| true);
        for block in surfaces[surfaces.len() - 10..].chunks(5) {
            let centre = centroid(&block[0]) * DVec3::new(1.0, 0.5, 1.0);
            for wall in block {
                assert!(vector_area(wall).dot(centroid(wall) - centre) > 0.0);
            }
            // Without a bottom, what remains is the vector area of the top.
            let whole: DVec3 = block.iter().map(|s| vector_area(s)).sum();
            assert!(whole.distance(vector_area(&block[0])) < 1e-8);
        }
    }
}
