//! Visibility by samples, where what a pair of groups exchanges is too little to look at every pair.

use std::ops::Range;

use farfield::{CellView, Real};
use glam::DVec3;

use crate::elements::{Projections, Surfel};
use crate::error::Error;
use crate::form_factors::kappa;
use crate::numbers::mixed;
use crate::occlusion::{Bounds, Shape};

/// Where visibility may be sampled: groups that exchange little.
#[derive(Clone, Debug)]
pub(crate) struct Sampling {
    /// The largest share of a group's irradiance that may come from another group by samples.
    pub(crate) most: f64,
    /// How much brighter than the mean the surfels of a face may be; 1 for faces beyond the last.
    pub(crate) brightness: Vec<f64>,
    /// Elements whose squared distance is no more than this times the sum of their squared radii are
    /// corrected, and have to be asked for one by one.
    pub(crate) kappa: f64,
}

/// Points of a group that rays start from, and rays between two groups.
const ROWS: usize = 4;
pub(crate) const RAYS: usize = ROWS * ROWS;

/// Of [`ROWS`] rays, how many more one point may see than another of its group.
const UNEVEN: u32 = 1;

/// How much less they may exchange where some of their points see more of the other group than others.
const BLIND: f64 = 16.0;

/// What two groups exchange, about.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strength {
    /// What each of the first receives from all of the second, if these have the mean radiosity, and
    /// the other way round.
    received: [f64; 2],
    /// The areas of both.
    areas: [f64; 2],
}

/// The errors of samples add up at random: what a group may contribute grows as the square of the
/// tolerance. Measured, with the lamp of a Cornell box among much darker surfels.
const SAMPLED_ERROR: f64 = 2.0;

impl Sampling {
    /// Sampling that adds no more than about `tolerance` to the error of irradiances.
    pub(crate) fn new(tolerance: f64, brightness: Vec<f64>) -> Result<Self, Error> {
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(Error::InvalidTolerance { found: tolerance });
        }
        let most = (SAMPLED_ERROR * tolerance).powi(2).min(0.1);
        Ok(Self { most, brightness, kappa: kappa(tolerance) })
    }

    /// What two groups exchange, by the factors of each with some of the others.
    pub(crate) fn strength<T: Real>(&self, x: &[Surfel<T>], y: &[Surfel<T>]) -> Strength {
        // A few of either may face the others while most look away: none is left out.
        let some = |n: usize| (0..ROWS).map(move |k| (2 * k + 1) * n / (2 * ROWS));
        let rows = (0..x.len()).flat_map(|i| some(y.len()).map(move |j| (i, j)));
        let columns = (0..y.len()).flat_map(|j| some(x.len()).map(move |i| (i, j)));
        let largest = rows
            .chain(columns)
            .map(|(i, j)| {
                let pair = Projections::new(&x[i], &y[j]);
                if pair.facing() { pair.kernel().as_f64() } else { 0.0 }
            })
            .fold(0.0, f64::max);
        let areas = [x, y].map(|group| group.iter().map(|s| s.area.as_f64()).sum::<f64>());
        let [of_x, of_y] = [x, y].map(|group| {
            let bright = |s: &Surfel<T>| self.brightness.get(s.face as usize).copied();
            group.iter().filter_map(bright).fold(1.0, f64::max)
        });
        Strength { received: [largest * areas[1] * of_y, largest * areas[0] * of_x], areas }
    }

    /// Whether groups that exchange so little may be sampled.
    pub(crate) fn accepts(&self, strength: &Strength) -> bool {
        strength.received.iter().all(|&received| received <= self.most)
    }

    /// Whether elements of two groups may be so close that their sizes count.
    pub(crate) fn are_near(&self, groups: [&[Shape]; 2]) -> bool {
        let centroids =
            groups.map(|group| Bounds::of(group.iter().map(|s| s.centroid().to_array())));
        let radii = groups.map(|group| group.iter().map(|s| s.radius).fold(0.0, f64::max));
        let [a, b] = &centroids;
        let gap = |k: usize| (a.low[k] - b.high[k]).max(b.low[k] - a.high[k]).max(0.0);
        let gap = DVec3::new(gap(0), gap(1), gap(2)).length();
        let squares = radii[0].powi(2) + radii[1].powi(2);
        squares > 0.0 && gap * gap <= self.kappa * squares
    }

    /// Whether they exchange so little that it doesn't matter which of their points see each other.
    pub(crate) fn accepts_blindly(&self, strength: &Strength) -> bool {
        let most = self.most / BLIND;
        strength.received.iter().all(|&received| received <= most)
    }
}

impl Strength {
    /// The variance of the irradiance of both, times their areas, if `visible` of [`RAYS`] rays were
    /// unhidden.
    ///
    /// The groups don't all see the same: beside the variance of the mean stands that of its parts.
    pub(crate) fn variance(&self, visible: usize) -> f64 {
        let (k, n) = (visible as f64, RAYS as f64);
        // Laplace's rule of succession: no share is certain.
        let share = (k + 1.0) / (n + 2.0);
        share * (1.0 - share) * (1.0 + 1.0 / n) * self.squares()
    }

    fn squares(&self) -> f64 {
        (0..2).map(|k| self.areas[k] * self.received[k].powi(2)).sum()
    }
}

/// [`RAYS`] pairs of `n` and `m`: [`ROWS`] points of either with every one of the other, spread evenly;
/// others for another `turn`.
fn samples(n: usize, m: usize, turn: u64) -> impl Iterator<Item = (usize, usize)> {
    let within = move |stratum: usize, count: usize, key: u64| {
        let offset = (mixed(key) >> 11) as f64 / (1u64 << 53) as f64;
        (((stratum as f64 + offset) / ROWS as f64 * count as f64) as usize).min(count - 1)
    };
    let key = mixed(turn);
    let rows: [usize; ROWS] = std::array::from_fn(|k| within(k, n, key.wrapping_add(k as u64)));
    let columns: [usize; ROWS] =
        std::array::from_fn(|k| within(k, m, key.wrapping_add((ROWS + k) as u64)));
    (0..RAYS).map(move |k| (rows[k / ROWS], columns[k % ROWS]))
}

/// One of the two even numbers next to an odd one, by the toss of a coin that `key` decides: always the
/// lower would lose light.
pub(crate) fn even(count: usize, key: u64) -> usize {
    let odd = count % 2;
    if mixed(key) >> 63 == 0 { count - odd } else { count + odd }
}

/// The k-th of the stretches of a group that have one sample each.
pub(crate) fn part(group: &Range<usize>, k: usize) -> Range<usize> {
    let border = |k: usize| group.start + (k * group.len()).div_ceil(ROWS);
    border(k)..border(k + 1)
}

/// Which of [`samples`] were unhidden, a bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Seen(u16);

impl Seen {
    /// What `see` says about [`samples`] of `n` and `m` points: a bit for each.
    pub(crate) fn of(
        n: usize,
        m: usize,
        turn: u64,
        see: impl FnOnce(&[(usize, usize)]) -> u16,
    ) -> Self {
        let mut pairs = [(0, 0); RAYS];
        samples(n, m, turn).zip(&mut pairs).for_each(|(sample, pair)| *pair = sample);
        Self(see(&pairs))
    }

    /// What was seen from each [`part`] of the first group to each of the second.
    pub(crate) fn parts(self) -> impl Iterator<Item = (usize, usize, bool)> {
        (0..RAYS).map(move |k| (k / ROWS, k % ROWS, self.0 >> k & 1 > 0))
    }

    /// How many.
    pub(crate) fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether the points of the first group see about the same share of the second.
    pub(crate) fn rows_agree(self) -> bool {
        agree(std::array::from_fn(|k| self.0 >> (ROWS * k) & 0xf))
    }

    /// Whether those of the second see about the same share of the first.
    pub(crate) fn columns_agree(self) -> bool {
        agree(std::array::from_fn(|k| self.0 >> k & 0x1111))
    }
}

/// Whether sets of rays are of about the same size.
fn agree(sets: [u16; ROWS]) -> bool {
    let counts = sets.map(u16::count_ones);
    counts.iter().max().unwrap_or(&0) - counts.iter().min().unwrap_or(&0) <= UNEVEN
}

/// Whether the first of two cells of one level comes first in an order that doesn't depend on which is the target;
/// a number that only the two share.
pub(crate) fn order<P: farfield::Located>(a: &CellView<'_, P>, b: &CellView<'_, P>) -> (bool, u64) {
    let key = |cell: &CellView<'_, P>| cell.cell.coordinates().map(u64::from);
    let (first, second) = (key(a), key(b));
    let fold = |seed: u64, key: [u64; 3]| key.iter().fold(seed, |seed, &k| mixed(seed ^ k));
    let (low, high) = if first <= second { (first, second) } else { (second, first) };
    (first <= second, fold(fold(a.cell.level() as u64, low), high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::Element;
    use approx::assert_relative_eq;
    use farfield::{Cell, Cube};
    use glam::DVec3;
    use std::collections::BTreeSet;

    #[test]
    fn samples_pair_one_point_of_every_quarter_with_one_of_every_quarter() {
        for n in [1, 2, 3, 4, 5, 17, 64] {
            for m in [1, 4, 9, 64] {
                for turn in 0..20 {
                    let found: Vec<_> = samples(n, m, turn).collect();
                    assert_eq!(found.len(), RAYS);
                    for (k, &(i, j)) in found.iter().enumerate() {
                        let within = |index: usize, quarter: usize, count: usize| {
                            let at = index as f64 * ROWS as f64 / count as f64;
                            at < (quarter + 1) as f64
                                && at + ROWS as f64 / count as f64 > quarter as f64
                        };
                        assert!(within(i, k / ROWS, n) && within(j, k % ROWS, m));
                        assert_eq!((i, j), (found[k / ROWS * ROWS].0, found[k % ROWS].1));
                    }
                }
            }
        }
        let different: BTreeSet<Vec<_>> = (0..50).map(|t| samples(64, 64, t).collect()).collect();
        assert_eq!(different.len(), 50);
    }

    #[test]
    fn every_part_holds_its_samples() {
        for (n, m) in [(4, 9), (17, 64), (33, 5)] {
            let mut count = 0;
            let (rows, columns) = (3..3 + n, 7..7 + m);
            for (k, l, seen) in Seen(0b1010_0000_0000_0001).parts() {
                assert_eq!(seen, matches!((k, l), (0, 0) | (3, 1 | 3)));
                count += part(&rows, k).len() * part(&columns, l).len();
                for (i, j) in (0..20).filter_map(|t| samples(n, m, t).nth(ROWS * k + l)) {
                    // A sample on the border belongs to either part.
                    let near =
                        |part: Range<usize>, at: usize| part.start <= at + 1 && at < part.end;
                    assert!(near(part(&rows, k), 3 + i) && near(part(&columns, l), 7 + j));
                }
            }
            assert_eq!(count, n * m);
        }
    }

    fn square(n: usize, z: f64, up: f64, face: u32) -> Vec<Surfel> {
        let at = |i: usize| DVec3::new((i % 4) as f64, (i / 4) as f64, 0.0) * 1e-3;
        let surfel = |i: usize| Surfel {
            position: at(i) + DVec3::Z * z,
            normal: DVec3::Z * up,
            area: 1e-6,
            face,
        };
        (0..n).map(surfel).collect()
    }

    #[test]
    fn groups_exchange_what_their_areas_and_brightness_make_of_the_kernel() {
        let (floor, ceiling) = (square(16, 0.0, 1.0, 0), square(8, 2.0, -1.0, 1));
        let sampling = |most| Sampling { most, brightness: vec![10.0, 0.5], kappa: 1.0 };
        let strength = sampling(1.0).strength(&floor, &ceiling);
        let kernel = 0.25 * std::f64::consts::FRAC_1_PI;
        assert_relative_eq!(strength.areas[0], 16e-6, max_relative = 1e-12);
        assert_relative_eq!(strength.areas[1], 8e-6, max_relative = 1e-12);
        // What is darker than the mean counts as the mean.
        assert_relative_eq!(strength.received[0], kernel * 8e-6, max_relative = 1e-5);
        assert_relative_eq!(strength.received[1], kernel * 160e-6, max_relative = 1e-5);
        assert!(sampling(13e-6).accepts(&strength) && !sampling(12e-6).accepts(&strength));
        let least = 13e-6 * BLIND;
        assert!(sampling(least).accepts_blindly(&strength));
        assert!(!sampling(0.9 * least).accepts_blindly(&strength));

        let away = square(8, 2.0, 1.0, 7);
        assert_eq!(sampling(1.0).strength(&floor, &away).received, [0.0; 2]);
        let single: Vec<Surfel<f32>> = floor.iter().map(Surfel::cast).collect();
        let above: Vec<Surfel<f32>> = ceiling.iter().map(Surfel::cast).collect();
        let same = sampling(1.0).strength(&single, &above);
        assert_relative_eq!(same.received[1], strength.received[1], max_relative = 1e-5);
    }

    #[test]
    fn groups_are_near_while_some_of_their_elements_may_be() {
        let shapes = |height: f64, count: usize| -> Vec<Shape> {
            let area = std::f64::consts::PI * 0.01;
            let shape = |s: Surfel| Shape::new(0, &Element::disk(Surfel { area, ..s }));
            square(count, height, 1.0, 0).into_iter().map(shape).collect()
        };
        let sampling = Sampling { most: 1.0, brightness: vec![], kappa: 8.0 };
        // Elements are corrected up to a distance of √(8 · 0.02) = 0.4 of their centroids.
        for (height, near) in [(0.0, true), (0.39, true), (0.41, false), (0.61, false)] {
            let groups = [shapes(0.0, 16), shapes(height, 64)];
            assert_eq!(sampling.are_near([&groups[0], &groups[1]]), near, "{height}");
            assert_eq!(sampling.are_near([&groups[1], &groups[0]]), near, "{height}");
        }
        let points: Vec<Shape> = square(16, 0.0, 1.0, 0).iter().map(Shape::point).collect();
        assert!(!sampling.are_near([&points, &points]), "points have no size");
    }

    #[test]
    fn one_that_faces_the_others_counts_among_many_that_look_away() {
        let sampling = Sampling { most: 1.0, brightness: vec![], kappa: 4.0 };
        let floor = square(64, 0.0, 1.0, 0);
        for one in 0..64 {
            let mut above = square(64, 2.0, 1.0, 1);
            above[one].normal = DVec3::NEG_Z;
            for (x, y) in [(&floor, &above), (&above, &floor)] {
                assert!(sampling.strength(x, y).received.iter().all(|&r| r > 1e-6), "{one}");
            }
        }
    }

    #[test]
    fn the_variance_is_that_of_a_share_and_never_none() {
        let strength = Strength { received: [0.1, 0.2], areas: [3.0, 4.0] };
        let squares = 3.0 * 0.01 + 4.0 * 0.04;
        assert_relative_eq!(
            strength.variance(RAYS / 2),
            0.25 * (1.0 + 1.0 / 16.0) * squares,
            max_relative = 1e-12
        );
        for k in 0..=RAYS / 2 {
            let (few, many) = (strength.variance(k), strength.variance(RAYS - k));
            assert_relative_eq!(few, many, max_relative = 1e-12);
            assert!(few > 0.0 && (k == 0 || few > strength.variance(k - 1)));
        }
    }

    #[test]
    fn rows_and_columns_of_rays_agree_unless_they_see_different_shares() {
        let seen = |sees: &dyn Fn(usize, usize) -> bool| {
            let see = |pairs: &[(usize, usize)]| {
                let bits = pairs.iter().enumerate().map(|(k, &(i, j))| u16::from(sees(i, j)) << k);
                bits.fold(0, std::ops::BitOr::bitor)
            };
            let seen = Seen::of(ROWS, ROWS, 0, see);
            (seen.count(), seen.rows_agree(), seen.columns_agree())
        };
        assert_eq!(seen(&|_, _| false), (0, true, true));
        assert_eq!(seen(&|_, _| true), (RAYS, true, true));
        assert_eq!(seen(&|i, _| i < 2), (8, false, true));
        assert_eq!(seen(&|_, j| j == 3), (4, true, false));
        assert_eq!(seen(&|i, j| (i + j) % 2 == 0), (8, true, true));
        assert_eq!(seen(&|i, j| i == 0 && j == 0), (1, true, true));
        assert_eq!(seen(&|i, j| i < 2 && j < 2), (4, false, false));
    }

    #[test]
    fn two_cells_come_in_the_same_order_and_with_the_same_number_from_either_end() {
        let root = Cube::new(DVec3::ZERO, 1.0);
        let places = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 2, 1], [1, 2, 3]];
        let cells = places.map(|place| Cell::new(&root, 2, place));
        let points: [Surfel; 0] = [];
        let view = |k: usize| CellView { cell: &cells[k], points: &points };
        let mut numbers = BTreeSet::new();
        for i in 0..places.len() {
            for j in 0..i {
                let (there, back) = (order(&view(i), &view(j)), order(&view(j), &view(i)));
                assert_eq!(there.1, back.1);
                assert_ne!(there.0, back.0);
                assert!(numbers.insert(there.1), "every pair has a number of its own");
            }
        }
    }

    #[test]
    fn shares_are_rounded_to_eighths_without_a_bias() {
        for count in 0..=RAYS {
            let sum: usize = (0..1000).map(|key| even(count, key)).sum();
            assert!((0..1000).all(|key| matches!(even(count, key), 0..=RAYS)));
            assert!((0..1000).all(|key| even(count, key).is_multiple_of(2)));
            assert!((sum as f64 / 1000.0 - count as f64).abs() < 0.1, "{count}: {sum}");
        }
    }
}
