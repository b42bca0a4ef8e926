//! Smooth light on the walls, from the values at their surfels.

use glam::DVec2;

use crate::surfels::{Grid, Surfels};

/// A colour: one number per band.
pub(crate) type Rgb = [f64; 3];

/// A smooth field on every wall.
#[derive(Clone, Debug)]
pub(crate) struct Shading {
    walls: Vec<Samples>,
}

/// The values at the centres of a wall's cells, none missing.
#[derive(Clone, Debug)]
struct Samples {
    nu: usize,
    nv: usize,
    values: Vec<Rgb>,
}

impl Shading {
    /// The field that has the given value at each surfel. Under the blocks it goes on as it is around
    /// them, so that no darkness leaks out. So it does at the [feet](Grid::foot) of the blocks: there
    /// cells of floor and block are at any distance down to zero, and sums over centroids erratic.
    pub(crate) fn new(surfels: &Surfels, values: &[Rgb]) -> Self {
        Self { walls: surfels.grids.iter().map(|grid| Samples::new(grid, values)).collect() }
    }

    /// The field at (u, v) of a wall: bilinear between the centres of the four nearest cells, and
    /// extended linearly from there to the wall's edges.
    pub(crate) fn at(&self, wall: usize, parameters: DVec2) -> Rgb {
        let samples = &self.walls[wall];
        let (i, s) = interval(parameters.x, samples.nu);
        let (j, t) = interval(parameters.y, samples.nv);
        let mut sum = [0.0; 3];
        for (dj, weight_v) in [1.0 - t, t].into_iter().enumerate() {
            for (di, weight_u) in [1.0 - s, s].into_iter().enumerate() {
                // A wall of one cell has no second centre: both weights then go to the first.
                let (i, j) = ((i + di).min(samples.nu - 1), (j + dj).min(samples.nv - 1));
                let value = samples.values[i * samples.nv + j];
                for (sum, value) in sum.iter_mut().zip(value) {
                    *sum += weight_u * weight_v * value;
                }
            }
        }
        sum.map(|band| band.max(0.0))
    }
}

impl Samples {
    fn new(grid: &Grid, values: &[Rgb]) -> Self {
        let value = |cell: &Option<usize>| cell.map(|surfel| values[surfel]);
        let cells = grid.cells.iter().zip(&grid.foot);
        let mut known: Vec<Option<Rgb>> =
            cells.map(|(cell, &foot)| value(cell).filter(|_| !foot)).collect();
        if known.iter().all(Option::is_none) {
            known = grid.cells.iter().map(value).collect();
        }
        while known.iter().any(Option::is_none) && known.iter().any(Option::is_some) {
            known = grown(&known, grid.nu, grid.nv);
        }
        let values = known.into_iter().map(Option::unwrap_or_default).collect();
        Self { nu: grid.nu, nv: grid.nv, values }
    }
}

/// The same values, and in each empty cell next to others the mean of those.
fn grown(known: &[Option<Rgb>], nu: usize, nv: usize) -> Vec<Option<Rgb>> {
    let around = |k: usize, n: usize| k.saturating_sub(1)..(k + 2).min(n);
    let mean = |cell: usize| {
        let (i, j) = (cell / nv, cell % nv);
        let neighbours: Vec<Rgb> = around(i, nu)
            .flat_map(|i| around(j, nv).filter_map(move |j| known[i * nv + j]))
            .collect();
        let sum = |band: usize| neighbours.iter().map(|value| value[band]).sum::<f64>();
        let count = neighbours.len() as f64;
        (!neighbours.is_empty()).then(|| [0, 1, 2].map(|band| sum(band) / count))
    };
    (0..known.len()).map(|cell| known[cell].or_else(|| mean(cell))).collect()
}

/// Between which two of `n` cell centres `x` ∈ [0, 1] lies, and how far from the first to the second;
/// less than 0 or more than 1 beyond the outermost centres.
fn interval(x: f64, n: usize) -> (usize, f64) {
    let position = x * n as f64 - 0.5;
    let first = position.floor().clamp(0.0, n.saturating_sub(2) as f64);
    (first as usize, position - first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_fields_are_reproduced_up_to_the_edges() {
        let (nu, nv) = (4, 3);
        let grid = Grid { nu, nv, cells: (0..nu * nv).map(Some).collect(), foot: vec![false; 12] };
        let field = |u: f64, v: f64| [3.0 + u - v, 5.0 * u, 2.0 * v];
        let values: Vec<Rgb> = (0..nu * nv)
            .map(|k| field(((k / nv) as f64 + 0.5) / 4.0, ((k % nv) as f64 + 0.5) / 3.0))
            .collect();
        let shading = Shading { walls: vec![Samples::new(&grid, &values)] };
        for (u, v) in [(0.0, 0.0), (1.0, 1.0), (0.3, 0.9), (0.5, 0.5)] {
            let (found, expected) = (shading.at(0, DVec2::new(u, v)), field(u, v));
            for band in 0..3 {
                assert!((found[band] - expected[band]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn covered_cells_and_feet_do_not_darken_their_neighbours() {
        let mut cells: Vec<Option<usize>> = vec![Some(0); 25];
        for covered in [6, 7, 8, 11, 12, 13, 16, 17] {
            cells[covered] = None;
        }
        let mut foot = vec![false; 25];
        (cells[18], foot[18]) = (Some(1), true);
        let grid = Grid { nu: 5, nv: 5, cells, foot };
        let values = [[1.0, 2.0, 3.0], [0.0; 3]];
        let shading = Shading { walls: vec![Samples::new(&grid, &values)] };
        for k in 0..=20 {
            let found = shading.at(0, DVec2::new(f64::from(k) / 20.0, 0.6));
            assert!((found[0] - 1.0).abs() < 1e-12 && (found[2] - 3.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_single_cell_is_constant() {
        let grid = Grid { nu: 1, nv: 1, cells: vec![Some(0)], foot: vec![false] };
        let shading = Shading { walls: vec![Samples::new(&grid, &[[1.0, 2.0, 3.0]])] };
        let found = shading.at(0, DVec2::new(0.9, 0.1));
        assert!((found[0] - 1.0).abs() < 1e-12 && (found[2] - 3.0).abs() < 1e-12);
    }
}
