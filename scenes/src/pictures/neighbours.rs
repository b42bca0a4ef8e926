//! Points of different reach, found from any place.

use glam::DVec3;
use rstar::RTree;
use rstar::primitives::{GeomWithData, Rectangle};

/// Points that each reach some way around themselves: boxes in an R-tree.
#[derive(Clone, Debug)]
pub(crate) struct Neighbours {
    boxes: RTree<GeomWithData<Rectangle<[f64; 3]>, u32>>,
}

impl Neighbours {
    /// Points with their reaches. A point that reaches nowhere, or isn't finite, is never found.
    pub(crate) fn new(points: impl Iterator<Item = (DVec3, f64)>) -> Self {
        let known = points.zip(0..).filter(|((position, reach), _)| {
            position.is_finite() && reach.is_normal() && *reach > 0.0
        });
        let reached = known.map(|((position, reach), index)| {
            let corners = [position - reach, position + reach].map(|corner| corner.to_array());
            GeomWithData::new(Rectangle::from_corners(corners[0], corners[1]), index)
        });
        Self { boxes: RTree::bulk_load(reached.collect()) }
    }

    /// Calls `found` with the index of every point that reaches `position`, and of others near it,
    /// always in the same order.
    pub(crate) fn around(&self, position: DVec3, mut found: impl FnMut(usize)) {
        for reached in self.boxes.locate_all_at_point(position.to_array()) {
            found(reached.data as usize);
        }
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
