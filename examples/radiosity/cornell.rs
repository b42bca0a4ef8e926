//! The Cornell box: published geometry \[mm\], with colours in three bands (R, G, B).
//!
//! Every wall is a quadrangle whose front is lit: the inside of the room, the outside of the two
//! blocks. The blocks have no bottoms, and the room has no front wall.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

/// The published viewpoint.
pub(crate) const EYE: DVec3 = DVec3::new(278.0, 273.0, -800.0);
/// The published direction of view.
pub(crate) const FORWARD: DVec3 = DVec3::Z;
/// The published up direction.
pub(crate) const UP: DVec3 = DVec3::Y;
/// Edge of the published film over its distance from the lens.
pub(crate) const FILM_OVER_FOCAL: f64 = 0.025 / 0.035;

/// What a wall does with light, band by band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Material {
    /// Diffuse reflectance ρ.
    pub(crate) reflectance: [f64; 3],
    /// Emitted exitance E = π times the emitted radiance.
    pub(crate) emission: [f64; 3],
}

/// The scene: walls by face number.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    /// The walls; a wall's index is its face number.
    pub(crate) walls: Vec<Wall>,
    /// What the blocks stand on: the floor there is never lit.
    footprints: [[DVec3; 4]; 2],
}

/// One wall of one material.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wall {
    /// Its corners, counter-clockwise around the lit side.
    pub(crate) corners: [DVec3; 4],
    /// Its material.
    pub(crate) material: Material,
}

impl Scene {
    /// The Cornell box.
    pub(crate) fn cornell_box() -> Self {
        let room = |corners: [[f64; 3]; 4], material| {
            let corners = corners.map(DVec3::from_array);
            Wall { corners: facing(ROOM_CENTRE - centroid(&corners), corners), material }
        };
        let mut walls = vec![
            room(FLOOR, WHITE),
            room(BACK, WHITE),
            room(RIGHT, GREEN),
            room(LEFT, RED),
            room(LIGHT, LAMP),
        ];
        walls.extend(ceiling_around_light().map(|corners| room(corners, WHITE)));
        let tops = [SHORT_BLOCK_TOP, TALL_BLOCK_TOP].map(|top| top.map(DVec3::from_array));
        walls.extend(tops.into_iter().flat_map(block_walls));
        Self { walls, footprints: tops }
    }

    /// Whether a point, up to `margin`, lies on the floor and under a block.
    pub(crate) fn is_covered(&self, point: DVec3, margin: f64) -> bool {
        point.y <= margin && self.footprints.iter().any(|corners| contains(corners, point, margin))
    }

    /// The area of all walls without what the blocks stand on.
    pub(crate) fn lit_area(&self) -> f64 {
        let walls: f64 = self.walls.iter().map(|wall| area(&wall.corners)).sum();
        walls - self.footprints.iter().map(area).sum::<f64>()
    }

    /// Index of the wall that emits light.
    pub(crate) fn light(&self) -> usize {
        let emits = |wall: &Wall| wall.material.emission != [0.0; 3];
        self.walls.iter().position(emits).expect("the box has one light")
    }
}

const WHITE: Material = Material { reflectance: [0.725, 0.71, 0.68], emission: [0.0; 3] };
const RED: Material = Material { reflectance: [0.63, 0.065, 0.05], emission: [0.0; 3] };
const GREEN: Material = Material { reflectance: [0.14, 0.45, 0.091], emission: [0.0; 3] };
const LAMP: Material =
    Material { reflectance: [0.0; 3], emission: [17.0 * PI, 12.0 * PI, 4.0 * PI] };

const ROOM_CENTRE: DVec3 = DVec3::new(278.0, 274.4, 279.6);
const FLOOR: [[f64; 3]; 4] =
    [[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]];
const BACK: [[f64; 3]; 4] =
    [[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]];
const RIGHT: [[f64; 3]; 4] =
    [[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]];
/// 3.2 mm off a plane: [`Quad`] folds it into two triangles.
const LEFT: [[f64; 3]; 4] =
    [[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]];
const CEILING_X: [f64; 2] = [0.0, 556.0];
const CEILING_Z: [f64; 2] = [0.0, 559.2];
const CEILING_Y: f64 = 548.8;
const LIGHT_X: [f64; 2] = [213.0, 343.0];
const LIGHT_Z: [f64; 2] = [227.0, 332.0];
const LIGHT: [[f64; 3]; 4] = at_ceiling(LIGHT_X, LIGHT_Z);
const SHORT_BLOCK_TOP: [[f64; 3]; 4] =
    [[130.0, 165.0, 65.0], [82.0, 165.0, 225.0], [240.0, 165.0, 272.0], [290.0, 165.0, 114.0]];
const TALL_BLOCK_TOP: [[f64; 3]; 4] =
    [[423.0, 330.0, 247.0], [265.0, 330.0, 296.0], [314.0, 330.0, 456.0], [472.0, 330.0, 406.0]];

const fn at_ceiling([x0, x1]: [f64; 2], [z0, z1]: [f64; 2]) -> [[f64; 3]; 4] {
    [[x0, CEILING_Y, z0], [x1, CEILING_Y, z0], [x1, CEILING_Y, z1], [x0, CEILING_Y, z1]]
}

/// The ceiling in four strips: the light is coplanar with it and fills a hole between them.
fn ceiling_around_light() -> [[[f64; 3]; 4]; 4] {
    let ([x0, x3], [x1, x2]) = (CEILING_X, LIGHT_X);
    let ([z0, z3], [z1, z2]) = (CEILING_Z, LIGHT_Z);
    [
        at_ceiling([x0, x1], [z0, z3]),
        at_ceiling([x2, x3], [z0, z3]),
        at_ceiling([x1, x2], [z0, z1]),
        at_ceiling([x1, x2], [z2, z3]),
    ]
}

/// The top and the four sides of a block that stands on the floor y = 0.
fn block_walls(top: [DVec3; 4]) -> [Wall; 5] {
    let ground = |p: DVec3| DVec3::new(p.x, 0.0, p.z);
    let centre = 0.5 * (centroid(&top) + centroid(&top.map(ground)));
    let wall =
        |corners| Wall { corners: facing(centroid(&corners) - centre, corners), material: WHITE };
    let side = |k: usize| {
        let (p, q) = (top[k], top[(k + 1) % 4]);
        wall([p, ground(p), ground(q), q])
    };
    [wall(top), side(0), side(1), side(2), side(3)]
}

/// The same quadrangle, its corners counter-clockwise as seen from where `towards` points.
fn facing(towards: DVec3, [a, b, c, d]: [DVec3; 4]) -> [DVec3; 4] {
    if (b - a).cross(d - a).dot(towards) > 0.0 { [a, b, c, d] } else { [a, d, c, b] }
}

fn centroid(corners: &[DVec3; 4]) -> DVec3 {
    corners.iter().sum::<DVec3>() / 4.0
}

fn area(&[a, b, c, d]: &[DVec3; 4]) -> f64 {
    0.5 * (c - a).cross(d - b).length()
}

/// Whether a convex quadrangle, seen from above, contains a point or passes it within `margin`, up
/// to the rounding of its corners: outside of no edge by more than that.
fn contains(corners: &[DVec3; 4], point: DVec3, margin: f64) -> bool {
    let plan = |p: DVec3| DVec2::new(p.x, p.z);
    let centre = plan(centroid(corners));
    (0..4).all(|k| {
        let start = plan(corners[k]);
        let left = (plan(corners[(k + 1) % 4]) - start).perp().normalize();
        let outwards = if left.dot(centre - start) > 0.0 { -left } else { left };
        outwards.dot(plan(point) - start) < margin
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_radiosity::quad_surfels;

    /// A wall as a single surfel.
    fn whole(wall: &Wall) -> farfield_radiosity::Surfel {
        quad_surfels(wall.corners, 1, 1, 0)[0]
    }

    #[test]
    fn room_normals_point_inward_and_block_normals_outward() {
        let scene = Scene::cornell_box();
        assert_eq!(scene.walls.len(), 19);
        for wall in scene.walls[..9].iter().map(whole) {
            assert!(wall.normal.dot(ROOM_CENTRE - wall.position) > 200.0);
        }
        for block in scene.walls[9..].chunks(5) {
            let top = whole(&block[0]);
            assert!(top.normal.abs_diff_eq(DVec3::Y, 1e-12));
            let centre = top.position * DVec3::new(1.0, 0.5, 1.0);
            for wall in block.iter().map(whole) {
                assert!(wall.normal.dot(wall.position - centre) > 70.0);
            }
        }
    }

    #[test]
    fn light_and_ceiling_together_fill_the_top() {
        let scene = Scene::cornell_box();
        let top: f64 = scene.walls[4..9].iter().map(|wall| whole(wall).area).sum();
        assert!((top - 556.0 * 559.2).abs() < 1e-9);
        assert_eq!(scene.light(), 4);
        assert!((whole(&scene.walls[4]).area - 130.0 * 105.0).abs() < 1e-9);
    }

    #[test]
    fn the_floor_is_covered_under_the_blocks_only() {
        let scene = Scene::cornell_box();
        let covered = |x, y, z, margin| scene.is_covered(DVec3::new(x, y, z), margin);
        assert!(covered(186.0, 0.0, 169.0, 0.0) && covered(368.0, 0.0, 351.0, 0.0));
        assert!(!covered(186.0, 1.0, 169.0, 0.0));
        assert!(!covered(290.0, 0.0, 150.0, 0.0) && !covered(250.0, 0.0, 290.0, 0.0));
        // The short block's foremost corner is at z = 65.
        assert!(!covered(130.0, 0.0, 60.0, 0.0) && covered(130.0, 9.0, 60.0, 10.0));
        assert!(!covered(130.0, 11.0, 60.0, 10.0));
    }
}
