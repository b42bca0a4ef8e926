//! Points of different reach, found from any place.

use std::collections::HashMap;

use glam::{DVec3, I64Vec3};

/// Points that each reach some way around themselves, in uniform grids: one for each power of two
/// that reaches lie between, so that a few large ones don't make the cells of all others large.
#[derive(Clone, Debug)]
pub(crate) struct Neighbours {
    levels: Vec<Level>,
}

/// The points of about one reach.
#[derive(Clone, Debug)]
struct Level {
    /// Edge of a cell; no point of the level reaches further.
    edge: f64,
    /// Indices of the points in each cell that isn't empty.
    cells: HashMap<I64Vec3, Vec<u32>>,
}

impl Neighbours {
    /// Points with their reaches. A point that reaches nowhere, or isn't finite, is never found.
    pub(crate) fn new(points: impl Iterator<Item = (DVec3, f64)>) -> Self {
        let mut levels: HashMap<i32, Level> = HashMap::new();
        for (index, (position, reach)) in points.enumerate() {
            if !(position.is_finite() && reach.is_normal() && reach > 0.0) {
                continue;
            }
            let exponent = reach.log2().ceil() as i32;
            let level = levels.entry(exponent).or_insert_with(|| Level {
                edge: f64::from(exponent).exp2(),
                cells: HashMap::new(),
            });
            level.cells.entry(level.cell(position)).or_default().push(index as u32);
        }
        let mut levels: Vec<_> = levels.into_values().collect();
        // The order in which neighbours are met decides how sums are rounded.
        levels.sort_unstable_by(|a, b| a.edge.total_cmp(&b.edge));
        Self { levels }
    }

    /// Calls `found` with the index of every point that reaches `position`, and of others near it,
    /// always in the same order.
    pub(crate) fn around(&self, position: DVec3, mut found: impl FnMut(usize)) {
        for level in &self.levels {
            let centre = level.cell(position);
            for k in 0..27 {
                let offset = I64Vec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
                for &index in level.cells.get(&(centre + offset)).into_iter().flatten() {
                    found(index as usize);
                }
            }
        }
    }
}

impl Level {
    fn cell(&self, position: DVec3) -> I64Vec3 {
        // Far beyond any cell that a double tells from its neighbours, and no overflow in `around`.
        (position / self.edge).floor().clamp(DVec3::splat(-1e18), DVec3::splat(1e18)).as_i64vec3()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_that_reaches_a_place_is_found_once() {
        let point = |k: usize| {
            let fraction = |step: f64| (k as f64 * step).fract() * 4.0 - 2.0;
            let position = DVec3::new(fraction(0.618), fraction(0.755), fraction(0.569));
            (position, 0.01 * 1.5f64.powi((k % 11) as i32))
        };
        let neighbours = Neighbours::new((0..500).map(point));
        let mut reached = 0;
        for probe in (0..500).map(|k| point(k + 7).0) {
            let mut found = Vec::new();
            neighbours.around(probe, |index| found.push(index));
            let count = found.len();
            found.sort_unstable();
            found.dedup();
            assert_eq!(found.len(), count);
            for (index, (position, reach)) in (0..500).map(|k| (k, point(k))) {
                if position.distance(probe) <= reach {
                    reached += 1;
                    assert!(found.contains(&index));
                }
            }
        }
        assert!(reached > 600, "{reached}");
    }

    #[test]
    fn points_without_a_place_or_a_reach_are_left_out() {
        let nowhere = [(DVec3::NAN, 1.0), (DVec3::ZERO, 0.0), (DVec3::ZERO, f64::INFINITY)];
        let neighbours = Neighbours::new(nowhere.into_iter());
        neighbours.around(DVec3::ZERO, |index| panic!("found {index}"));
        neighbours.around(DVec3::splat(f64::MAX), |index| panic!("found {index}"));
    }
}
