//! A hall with two rows of columns, lamps along its ceiling and windows on one side.

use glam::{DVec2, DVec3};

use crate::generators::builder::Builder;
use crate::generators::polygon::{rectangle, regular, subtract};
use crate::scene::Scene;
use crate::scene::material::Material;
use crate::scene::viewpoint::Viewpoint;

/// The hall \[m]: columns of twelve sides from floor to ceiling, which both have holes where they
/// stand; warm lamps in the ceiling, and daylight from windows at low x.
pub(crate) fn columns() -> Scene {
    let mut builder = Builder::new(vec![
        Material::rgb("floor", [0.42, 0.30, 0.22], [0.0; 3]),
        Material::rgb("plaster", [0.72, 0.68, 0.60], [0.0; 3]),
        Material::rgb("sandstone", [0.66, 0.54, 0.38], [0.0; 3]),
        Material::rgb("lamp", [0.2; 3], [60.0, 46.0, 28.0]),
        Material::rgb("window", [0.1; 3], [12.0, 19.0, 30.0]),
    ]);
    let [floor, plaster, sandstone, lamp, window] = [0, 1, 2, 3, 4];
    let bays = 0..BAYS;
    let rows = [-ROW, ROW];
    let footprints: Vec<_> = bays
        .clone()
        .flat_map(|bay| rows.map(|x| DVec2::new((bay as f64 + 0.5) * BAY, x)))
        .map(|centre| regular(centre, RADIUS, SIDES))
        .collect();
    let lamps: Vec<_> = bays
        .clone()
        .map(|bay| {
            let z = bay as f64 * BAY;
            rectangle(DVec2::new(z + 1.0, -LAMP), DVec2::new(z + BAY - 1.0, LAMP))
        })
        .collect();
    let levels = [(0.0, DVec3::Y, floor, &[][..]), (HEIGHT, DVec3::NEG_Y, plaster, &lamps[..])];
    for (y, front, material, holes) in levels {
        // Bay by bay and row by row, each hole cuts up its own cell only.
        let mut cells: Vec<_> = bays.clone().flat_map(cells).collect();
        for hole in footprints.iter().chain(holes) {
            cells = subtract(cells, hole);
        }
        builder.add_level(&cells, y, front, material);
    }
    builder.add_level(&lamps, HEIGHT, DVec3::NEG_Y, lamp);
    for footprint in &footprints {
        builder.add_sides(footprint, [0.0, HEIGHT], sandstone);
    }

    // Walls are drawn in (z, y) or (x, y).
    let side = rectangle(DVec2::ZERO, DVec2::new(LENGTH, HEIGHT));
    let windows: Vec<_> = (1..BAYS)
        .map(|bay| bay as f64 * BAY)
        .map(|z| rectangle(DVec2::new(z - 0.8, 1.5), DVec2::new(z + 0.8, HEIGHT - 1.0)))
        .collect();
    let strips: Vec<_> = bays
        .map(|bay| bay as f64 * BAY)
        .map(|z| rectangle(DVec2::new(z, 0.0), DVec2::new(z + BAY, HEIGHT)))
        .collect();
    let low_x = |p: DVec2| DVec3::new(-HALF_WIDTH, p.y, p.x);
    let pierced = windows.iter().fold(strips, |wall, window| subtract(wall, window));
    builder.add_flat(&pierced, low_x, DVec3::X, plaster);
    builder.add_flat(&windows, low_x, DVec3::X, window);
    builder.add_flat(&[side], |p| DVec3::new(HALF_WIDTH, p.y, p.x), DVec3::NEG_X, plaster);
    let end = rectangle(DVec2::new(-HALF_WIDTH, 0.0), DVec2::new(HALF_WIDTH, HEIGHT));
    for (z, front) in [(0.0, DVec3::Z), (LENGTH, DVec3::NEG_Z)] {
        builder.add_flat(std::slice::from_ref(&end), |p| DVec3::new(p.x, p.y, z), front, plaster);
    }

    let camera = Viewpoint {
        eye: DVec3::new(1.1, 1.7, 0.4),
        target: DVec3::new(-0.6, 2.6, LENGTH),
        up: DVec3::Y,
        film_over_focal: 1.3,
    };
    builder.finish(camera, true)
}

/// Columns in a row.
const BAYS: usize = 6;
/// From one column to the next \[m].
const BAY: f64 = 4.0;
/// Length of the hall \[m].
const LENGTH: f64 = BAYS as f64 * BAY;
/// From the middle of the hall to its walls \[m].
const HALF_WIDTH: f64 = 5.0;
/// Height of the hall \[m].
const HEIGHT: f64 = 6.0;
/// From the middle of the hall to a row of columns \[m].
const ROW: f64 = 2.5;
/// From the axis of a column to its edges \[m].
const RADIUS: f64 = 0.5;
/// Sides of a column.
const SIDES: usize = 12;
/// Half the width of a lamp \[m].
const LAMP: f64 = 0.4;

/// The plans of a bay: those around the two columns, and the aisles beside them.
fn cells(bay: usize) -> [Vec<DVec2>; 5] {
    let z = bay as f64 * BAY;
    let edges = [-HALF_WIDTH, -ROW - 1.0, -ROW + 1.0, ROW - 1.0, ROW + 1.0, HALF_WIDTH];
    std::array::from_fn(|k| rectangle(DVec2::new(z, edges[k]), DVec2::new(z + BAY, edges[k + 1])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::builder::at;
    use crate::generators::polygon;
    use crate::scene::geometry::contains;
    use crate::scene::surface::Surface;

    fn of(scene: &Scene, material: usize) -> Vec<&Surface> {
        scene.surfaces.iter().filter(|s| s.material == material).collect()
    }

    fn column_area() -> f64 {
        polygon::area(&regular(DVec2::ZERO, RADIUS, SIDES))
    }

    #[test]
    fn the_hall_is_closed() {
        let scene = columns();
        assert!(scene.check().is_ok() && scene.closed);
        assert!(scene.open_area().length() < 1e-10);
        let plan = 2.0 * HALF_WIDTH * LENGTH - (2 * BAYS) as f64 * column_area();
        assert!((scene.volume() / (-plan * HEIGHT) - 1.0).abs() < 1e-12);
        let floor: f64 = of(&scene, 0).iter().map(|s| scene.area(s)).sum();
        assert!((floor / plan - 1.0).abs() < 1e-12);
        let high = |s: &&Surface| scene.corners(s).iter().all(|p| p.y == HEIGHT);
        let ceiling = scene.surfaces.iter().filter(high);
        assert!((ceiling.map(|s| scene.area(s)).sum::<f64>() / plan - 1.0).abs() < 1e-12);
    }

    #[test]
    fn neither_floor_nor_ceiling_reach_into_a_column() {
        let scene = columns();
        for bay in 0..BAYS {
            for k in 0..60 {
                let centre = DVec2::new((bay as f64 + 0.5) * BAY, -ROW);
                let radius = if k % 2 == 0 { 0.45 } else { 0.51 };
                let p = centre + radius * DVec2::from_angle(k as f64 * 0.1 + 0.003);
                let holds = |s: &&Surface| contains(&scene.corners(s), at(p, 0.0));
                let pieces = of(&scene, 0).into_iter().filter(holds).count();
                assert_eq!(pieces, k % 2, "{p}");
            }
        }
    }

    #[test]
    fn planes_are_faces() {
        let scene = columns();
        let face_of = |material| {
            let surfaces = of(&scene, material);
            let face = surfaces[0].face;
            assert!(surfaces.iter().all(|s| s.face == face), "material {material}");
            face
        };
        assert_ne!(face_of(0), face_of(3));
        let window = face_of(4);
        assert!(of(&scene, 1).iter().any(|s| s.face == window));
        let last = scene.surfaces.iter().map(|s| s.face).max();
        // Six walls. Columns of a row share the planes of two of their sides, those that stand side
        // by side the planes of two others; eight sides of each column are planes of their own.
        assert_eq!(last, Some(6 + 2 * 2 + 6 * 2 + 12 * 8 - 1));
        assert_eq!(of(&scene, 3).len(), BAYS);
        assert_eq!(of(&scene, 4).len(), BAYS - 1);
    }
}
