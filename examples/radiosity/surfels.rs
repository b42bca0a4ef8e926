//! Cutting the walls into surfels, on one grid per wall.

use farfield_radiosity::{Surfel, Triangle, quad_surfels, quad_triangles};

use crate::cornell::{Scene, Wall};

/// The scene in surfels.
#[derive(Clone, Debug)]
pub(crate) struct Surfels {
    /// The surfels, wall after wall.
    pub(crate) surfels: Vec<Surfel>,
    /// Their reflectance ρ.
    pub(crate) reflectance: Vec<[f64; 3]>,
    /// Their emission E.
    pub(crate) emission: Vec<[f64; 3]>,
    /// One grid per wall.
    pub(crate) grids: Vec<Grid>,
}

/// Which surfels make up a wall: cell i·nv + j covers u ∈ [i, i+1]/nu, v ∈ [j, j+1]/nv, where u runs
/// from the wall's first corner to its second, v from its first to its fourth.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    /// Number of cells along u.
    pub(crate) nu: usize,
    /// Number of cells along v.
    pub(crate) nv: usize,
    /// The surfel of each cell; none under the blocks.
    pub(crate) cells: Vec<Option<usize>>,
    /// Whether a block meets the floor in or near a cell.
    pub(crate) foot: Vec<bool>,
}

impl Surfels {
    /// About `count` surfels of nearly square, nearly equal cells; at least one per wall. A cell
    /// whose centre lies under a block is left out.
    pub(crate) fn new(scene: &Scene, count: usize) -> Self {
        let edge = (scene.lit_area() / count as f64).sqrt();
        let mut all = Self {
            surfels: Vec::new(),
            reflectance: Vec::new(),
            emission: Vec::new(),
            grids: Vec::new(),
        };
        for (face, wall) in scene.walls.iter().enumerate() {
            all.add_wall(scene, face, wall, edge);
        }
        all
    }

    /// Adds a wall in cells with edges of about the given length.
    fn add_wall(&mut self, scene: &Scene, face: usize, wall: &Wall, edge: f64) {
        let [a, b, c, d] = wall.corners;
        let length_u = 0.5 * (a.distance(b) + d.distance(c));
        let length_v = 0.5 * (a.distance(d) + b.distance(c));
        let [nu, nv] = [length_u, length_v].map(|length| (length / edge).round().max(1.0) as usize);
        let surfels = quad_surfels(wall.corners, nu, nv, face as u32);
        // Half a cell's diagonal.
        let reach = edge * std::f64::consts::FRAC_1_SQRT_2;
        let foot = surfels.iter().map(|s| scene.is_covered(s.position, reach)).collect();
        let mut cells = Vec::with_capacity(surfels.len());
        for surfel in surfels {
            let covered = scene.is_covered(surfel.position, 0.0);
            cells.push((!covered).then_some(self.surfels.len()));
            if !covered {
                self.surfels.push(surfel);
                self.reflectance.push(wall.material.reflectance);
                self.emission.push(wall.material.emission);
            }
        }
        self.grids.push(Grid { nu, nv, cells, foot });
    }
}

/// The walls as triangles: 2k and 2k + 1 are wall k.
pub(crate) fn triangles(scene: &Scene) -> Vec<Triangle> {
    let walls = scene.walls.iter().enumerate();
    walls.flat_map(|(face, wall)| quad_triangles(wall.corners, face as u32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_add_up_to_the_walls_less_the_footprints() {
        let scene = Scene::cornell_box();
        let surfels = Surfels::new(&scene, 10_000);
        let whole = |wall: usize| quad_surfels(scene.walls[wall].corners, 1, 1, 0)[0].area;
        for wall in 0..scene.walls.len() {
            let own = surfels.surfels.iter().filter(|s| s.face == wall as u32);
            let area: f64 = own.map(|s| s.area).sum();
            // The blocks stand on wall 0 with the areas of their tops. Cells that straddle a foot
            // count whole or not at all; the red wall, wall 3, is not quite plane.
            let (expected, tolerance) = match wall {
                0 => (whole(0) - whole(9) - whole(14), 3e-3),
                3 => (whole(3), 1e-4),
                _ => (whole(wall), 1e-12),
            };
            assert!((area / expected - 1.0).abs() < tolerance, "wall {wall}: {area} {expected}");
        }
    }

    #[test]
    fn the_number_of_surfels_is_about_what_was_asked_for() {
        let scene = Scene::cornell_box();
        for count in [1_000, 10_000, 100_000] {
            let found = Surfels::new(&scene, count).surfels.len() as f64;
            assert!((found / count as f64 - 1.0).abs() < 0.04, "{count}: {found}");
        }
        assert!(Surfels::new(&scene, 1).surfels.len() >= 18);
    }

    #[test]
    fn every_surfel_is_in_one_cell_of_its_wall() {
        let surfels = Surfels::new(&Scene::cornell_box(), 2_000);
        let cells = surfels.grids.iter().enumerate();
        let listed: Vec<(u32, usize)> = cells
            .flat_map(|(face, grid)| grid.cells.iter().flatten().map(move |&i| (face as u32, i)))
            .collect();
        assert_eq!(listed.len(), surfels.surfels.len());
        for (position, &(face, index)) in listed.iter().enumerate() {
            assert_eq!((position, surfels.surfels[index].face), (index, face));
        }
    }
}
