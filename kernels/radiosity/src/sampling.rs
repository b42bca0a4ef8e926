//! Visibility by samples, where what a pair of groups exchanges is too little to look at every pair.

use farfield::{CellView, Real};

use crate::operator::mixed;
use crate::surfel::{Projections, Surfel};

/// Where visibility may be sampled: groups that exchange little.
#[derive(Clone, Debug)]
pub(crate) struct Sampling {
    /// The largest share of a group's irradiance that may come from another group by samples.
    pub(crate) most: f64,
    /// How much brighter than the mean the surfels of a face may be; 1 for faces beyond the last.
    pub(crate) brightness: Vec<f64>,
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

impl Sampling {
    /// What two groups exchange, by the factors of some of their pairs.
    pub(crate) fn strength<T: Real>(&self, x: &[Surfel<T>], y: &[Surfel<T>]) -> Strength {
        let largest = samples(x.len(), y.len(), 0)
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

/// Which of [`samples`] were unhidden, a bit each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Seen(u16);

impl Seen {
    /// What `sees` says about [`samples`] of `n` and `m` points.
    pub(crate) fn of(
        n: usize,
        m: usize,
        turn: u64,
        mut sees: impl FnMut(usize, usize) -> bool,
    ) -> Self {
        let samples = samples(n, m, turn).enumerate();
        Self(samples.fold(0, |seen, (k, (i, j))| seen | u16::from(sees(i, j)) << k))
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
