//! The cells of the one tree that have points of this rank.

use std::ops::Range;

use farfield::PartCell;

use crate::borders::Borders;
use crate::key::{Key, coordinates, first_of, last_of, octant};

/// A cell that has points of this rank.
#[derive(Clone, Debug)]
pub(crate) struct OwnCell {
    pub(crate) level: usize,
    /// The first place along the curve.
    pub(crate) key: Key,
    /// Its index among the cells of the rank; the root is its own.
    pub(crate) parent: usize,
    /// Its places among the points of all ranks.
    pub(crate) places: Range<u32>,
    /// Those of them that are here, counted from the first of the rank.
    pub(crate) here: Range<u32>,
    pub(crate) is_leaf: bool,
    /// Whether other ranks have points of it.
    pub(crate) is_shared: bool,
}

impl OwnCell {
    /// As the engine takes it, with the points that are here.
    pub(crate) fn part(&self, closed: bool) -> PartCell {
        PartCell {
            level: self.level,
            coordinates: coordinates(self.key, self.level),
            points: self.here.clone(),
            count: self.places.len() as u32,
            closed,
        }
    }
}

/// The cells that have points of a rank, level by level, those of a level along the curve. A cell is divided if it has more
/// than `leaf_size` points, on all ranks together, that have not one key.
pub(crate) fn own_cells(
    keys: &[Key],
    borders: &Borders,
    rank: usize,
    leaf_size: usize,
) -> Vec<OwnCell> {
    let mut cells: Vec<OwnCell> = Vec::new();
    let first = borders.of(rank).start;
    let cell = |level: usize, key: Key, parent: usize, here: Range<u32>| {
        let shared = borders.shared(rank, level, key);
        let own = &keys[here.start as usize..here.end as usize];
        let is_shared = shared.is_some();
        let is_leaf = !is_shared && (own.len() <= leaf_size || own[0] == own[own.len() - 1]);
        let places = shared.unwrap_or(first + here.start..first + here.end);
        OwnCell { level, key, parent, places, here, is_leaf, is_shared }
    };
    if !keys.is_empty() {
        cells.push(cell(0, Key::default(), 0, 0..keys.len() as u32));
    }
    let mut level = 0..cells.len();
    while !level.is_empty() {
        for parent in level.clone() {
            let OwnCell { level, ref here, is_leaf, .. } = cells[parent];
            let (mut start, end) = (here.start, here.end);
            while start < end && !is_leaf {
                let key = keys[start as usize];
                let last = last_of(key, level + 1);
                let count = keys[start as usize..end as usize].partition_point(|key| *key <= last);
                let here = start..start + count as u32;
                start = here.end;
                cells.push(cell(level + 1, first_of(key, level + 1), parent, here));
            }
        }
        level = level.end..cells.len();
    }
    cells
}

/// The index of the cell of a level that has that first place among all points.
pub(crate) fn find(cells: &[OwnCell], level: usize, first: u32) -> Option<usize> {
    cells.binary_search_by_key(&(level, first), |cell| (cell.level, cell.places.start)).ok()
}

/// Which octant of its parent a cell is.
pub(crate) fn octant_of(cell: &OwnCell) -> u64 {
    octant(cell.key, cell.level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sort::{Route, cuts, order};
    use crate::threads::on_threads;
    use crate::transport::Transport;
    use farfield::Cube;
    use farfield_testing::clouds::Random;
    use glam::DVec3;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    /// What a rank has after sorting: the keys that are here, the numbers of their points, the cells, and the borders.
    type Sorted = (Vec<Key>, Vec<f64>, Vec<OwnCell>, Borders);

    /// Sorts points that are spread over ranks as `shares` says, and checks that what is brought to the owners comes back.
    fn sorted(points: &[DVec3], shares: &[usize], leaf_size: usize) -> Vec<Sorted> {
        let root = Cube::new(DVec3::splat(0.5), 0.5);
        on_threads(shares.len(), |ranks| {
            let first: usize = shares[..ranks.rank()].iter().sum();
            let numbers: Vec<f64> =
                (first..first + shares[ranks.rank()]).map(|i| i as f64).collect();
            let key = |number: &f64| root.curve_key(points[*number as usize], true);
            let keys: Vec<Key> = numbers.iter().map(key).collect();
            let order = order(&keys);
            let weighted: Vec<(Key, f64)> =
                order.iter().map(|&i| (keys[i as usize], 1.0)).collect();
            let cuts = cuts(ranks, &weighted).unwrap();
            let in_order: Vec<Key> = weighted.iter().map(|(key, _)| *key).collect();
            let borders = Borders::new(ranks, &in_order, &cuts, leaf_size, 63).unwrap();
            let (route, here) = Route::new(ranks, &keys, &order, &borders.firsts).unwrap();
            let brought = route.to_owners(ranks, &numbers).unwrap();
            assert_eq!(route.to_callers(ranks, &brought).unwrap(), numbers);
            let cells = own_cells(&here, &borders, ranks.rank(), leaf_size);
            (here, brought, cells, borders)
        })
    }

    /// The cells of the tree over ascending keys: places and whether they are leaves, by level and first key.
    fn all_cells(keys: &[Key], leaf_size: usize) -> BTreeMap<(usize, Key), (Range<u32>, bool)> {
        let mut cells = BTreeMap::new();
        let mut open = if keys.is_empty() { vec![] } else { vec![(0, 0..keys.len())] };
        while let Some((level, places)) = open.pop() {
            let own = &keys[places.clone()];
            let is_leaf = own.len() <= leaf_size || own[0] == own[own.len() - 1];
            let key = first_of(own[0], level);
            cells.insert((level, key), (places.start as u32..places.end as u32, is_leaf));
            let mut start = places.start;
            while start < places.end && !is_leaf {
                let last = last_of(keys[start], level + 1);
                let end = start + keys[start..places.end].partition_point(|key| *key <= last);
                open.push((level + 1, start..end));
                start = end;
            }
        }
        cells
    }

    /// Holds what the ranks have against the tree that all points make.
    fn check(points: &[DVec3], shares: &[usize], leaf_size: usize) {
        let root = Cube::new(DVec3::splat(0.5), 0.5);
        let mut all: Vec<(Key, usize)> =
            points.iter().map(|p| root.curve_key(*p, true)).zip(0..).collect();
        all.sort_unstable();
        let (keys, numbers): (Vec<Key>, Vec<usize>) = all.into_iter().unzip();
        let expected = all_cells(&keys, leaf_size);
        let ranks = sorted(points, shares, leaf_size);
        let here = ranks.iter().flat_map(|(keys, ..)| keys.iter().copied());
        assert!(here.eq(keys.iter().copied()), "all keys, in order");
        let brought = ranks.iter().flat_map(|(_, numbers, ..)| numbers.iter().copied());
        assert!(brought.eq(numbers.iter().map(|&i| i as f64)), "all points, in order");

        let mut found: BTreeMap<(usize, Key), u32> = BTreeMap::new();
        for (rank, (keys, _, cells, borders)) in ranks.iter().enumerate() {
            assert_eq!(borders.total() as usize, points.len());
            let own = borders.of(rank);
            assert_eq!(own.len(), keys.len());
            assert!(own.clone().all(|place| borders.owner(place) == rank));
            for (index, cell) in cells.iter().enumerate() {
                let (places, is_leaf) = &expected[&(cell.level, cell.key)];
                assert_eq!((&cell.places, cell.is_leaf), (places, *is_leaf));
                let is_whole = own.start <= places.start && places.end <= own.end;
                assert_eq!(cell.is_shared, !is_whole, "leaves are never shared");
                let here = places.start.max(own.start)..places.end.min(own.end);
                assert_eq!(own.start + cell.here.start..own.start + cell.here.end, here);
                if cell.level > 0 {
                    assert_eq!(cells[cell.parent].key, first_of(cell.key, cell.level - 1));
                    assert_eq!(cells[cell.parent].level, cell.level - 1);
                    assert!(octant_of(cell) < 8);
                }
                let begins_here = own.start <= places.start;
                assert_eq!(find(cells, cell.level, cell.places.start), Some(index));
                *found.entry((cell.level, cell.key)).or_default() += u32::from(begins_here);
            }
        }
        assert!(found.len() == expected.len() && found.values().all(|&owners| owners == 1));
    }

    /// Points of which some are the same, or differ in their last digits only.
    fn cloud(n: usize, seed: u64) -> Vec<DVec3> {
        let mut random = Random::new(seed);
        let mut points: Vec<DVec3> = Vec::new();
        for _ in 0..n {
            let kind = if points.is_empty() { 0 } else { random.below(4) };
            let other = points.get(random.below(points.len().max(1))).copied();
            points.push(match (kind, other) {
                (1, Some(other)) => other,
                (2, Some(other)) => (other + 1e-13 * random.in_cube()).min(DVec3::ONE),
                _ => random.in_cube().powf(3.0),
            });
        }
        points
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn ranks_have_parts_of_the_tree_of_all_points(
            shares in prop::collection::vec(prop_oneof![Just(0usize), 0..9usize, 20..90usize], 1..9),
            leaf_size in prop_oneof![Just(1usize), 2..20usize],
            seed in 0..u64::MAX,
        ) {
            check(&cloud(shares.iter().sum(), seed), &shares, leaf_size);
        }
    }

    #[test]
    fn extreme_clouds_are_cut_as_well() {
        let few = cloud(3, 1);
        check(&few, &[0, 0, 2, 0, 0, 0, 1, 0, 0, 0, 0], 1);
        check(&[], &[0, 0, 0], 5);
        let same = vec![DVec3::splat(0.3); 50];
        check(&same, &[20, 0, 30], 4);
        let mut two = same;
        two.extend(vec![DVec3::splat(0.300_000_1); 50]);
        check(&two, &[100, 0, 0, 0, 0], 4);
        check(&cloud(400, 5), &[0, 400, 0], 7);
    }

    #[test]
    fn ranks_have_about_the_same_weight() {
        for (size, shares) in [(4, vec![4000; 4]), (16, vec![1000; 16]), (16, vec![0; 16])] {
            let mut shares: Vec<usize> = shares;
            if shares[0] == 0 {
                shares[3] = 16_000;
            }
            let points: Vec<DVec3> = {
                let mut random = Random::new(9);
                (0..16_000).map(|_| random.in_cube().powf(2.0)).collect()
            };
            let ranks = sorted(&points, &shares, 10);
            let most = ranks.iter().map(|(keys, ..)| keys.len()).max().unwrap_or(0);
            assert!(most as f64 <= 1.1 * 16_000.0 / size as f64, "{size}: {most}");
        }
    }

    #[test]
    fn weights_count_instead_of_numbers() {
        let sums = on_threads(5, |ranks| {
            let mut random = Random::new(ranks.rank() as u64);
            let mut points: Vec<(Key, f64)> = (0..2000)
                .map(|_| {
                    let p = random.in_cube();
                    let key = Cube::new(DVec3::splat(0.5), 0.5).curve_key(p, false);
                    (key, if p.z < 0.5 { 1.0 } else { 9.0 })
                })
                .collect();
            points.sort_unstable_by_key(|(key, _)| *key);
            let cuts = cuts(ranks, &points).unwrap();
            let mut sums = [0.0; 5];
            for (key, weight) in &points {
                sums[cuts.partition_point(|cut| cut <= key)] += weight;
            }
            sums
        });
        for rank in 0..5 {
            let weight: f64 = sums.iter().map(|sums| sums[rank]).sum();
            assert!((0.9..1.1).contains(&(weight / 10_000.0)), "{rank}: {weight}");
        }
    }
}
