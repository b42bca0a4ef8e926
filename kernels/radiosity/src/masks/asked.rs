//! The pairs of two leaves, asked about together.

use std::ops::Range;

use farfield::Real;

use crate::elements::{Projections, Surfel};
use crate::masks::counts::Counters;
use crate::masks::sampling::{RAYS, Sampling, Seen, part};
use crate::numbers::mixed;
use crate::occlusion::{AllPairs, Facet, LANES, Shape, Sights, SomePairs};

/// Two leaves whose pairs are being asked about.
pub(crate) struct Asked<'a, T: Real> {
    pub(crate) xs: (&'a [Surfel<T>], &'a [Shape]),
    pub(crate) ys: (&'a [Surfel<T>], &'a [Shape]),
    pub(crate) sights: &'a Sights<'a>,
    pub(crate) counters: &'a Counters,
    /// Whether each pair of leaves is asked for once for both directions.
    pub(crate) mirrored: bool,
    /// What hid a pair most lately.
    pub(crate) last: Option<&'a Facet>,
    pub(crate) count: &'a mut dyn FnMut(usize, usize, f64),
    pub(crate) facing: u64,
    /// Of which some part is seen.
    pub(crate) visible: u64,
    pub(crate) rays: u64,
}

/// Groups of so few pairs are not worth a look at what they exchange.
const FEW_PAIRS: usize = 32;

impl<T: Real> Asked<'_, T> {
    /// By rays of its own for each pair.
    pub(crate) fn one_by_one(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let Self { xs, ys, sights, .. } = *self;
        let xs = (&xs.0[rows.clone()], &xs.1[rows.clone()]);
        let ys = (&ys.0[columns.clone()], &ys.1[columns.clone()]);
        let mut answer = |i: usize, j: usize, share| {
            self.answer(rows.start + i, columns.start + j, share);
        };
        let rays = AllPairs { sights, xs, ys, answer: &mut answer }.run();
        self.rays += rays as u64;
    }

    /// By samples for two groups that exchange little: all at once if the samples agree, else row by row
    /// or column by column if they differ that way only. If they differ both ways, groups that exchange
    /// next to nothing are left at that, others halved.
    pub(crate) fn groups(
        &mut self,
        sampling: &Sampling,
        rows: Range<usize>,
        columns: Range<usize>,
    ) {
        if rows.len() * columns.len() <= FEW_PAIRS {
            return self.one_by_one(rows, columns);
        }
        let (x, y) = (&self.xs.0[rows.clone()], &self.ys.0[columns.clone()]);
        let shapes = [&self.xs.1[rows.clone()], &self.ys.1[columns.clone()]];
        let strength = sampling.strength(x, y);
        if !sampling.accepts(&strength) || sampling.are_near(shapes) {
            return self.halves(sampling, rows, columns);
        }
        let key = mixed(((rows.start as u64) << 32) | columns.start as u64);
        let (i, j) = (rows.start, columns.start);
        let seen = Seen::of(x.len(), y.len(), key, |pairs| {
            let pairs: [_; RAYS] = std::array::from_fn(|k| (i + pairs[k].0, j + pairs[k].1));
            self.see(&pairs)
        });
        let both = if self.mirrored { 1.0 } else { 0.5 };
        self.counters.add_variance(both * strength.variance(seen.count()) / RAYS as f64);
        if let 0 | RAYS = seen.count() {
            self.answer_all(rows, columns, f64::from(u8::from(seen.count() > 0)));
        } else if seen.columns_agree() {
            let sample = |i| (i, columns.start + mixed(key ^ i as u64) as usize % columns.len());
            let sampled: Vec<_> = rows.map(sample).collect();
            for pairs in sampled.chunks(LANES) {
                let seen = self.see(pairs);
                for (lane, &(i, _)) in pairs.iter().enumerate() {
                    self.answer_all(i..i + 1, columns.clone(), f64::from(seen >> lane & 1));
                }
            }
        } else if seen.rows_agree() {
            let sample = |j| (rows.start + mixed(key ^ j as u64) as usize % rows.len(), j);
            let sampled: Vec<_> = columns.map(sample).collect();
            for pairs in sampled.chunks(LANES) {
                let seen = self.see(pairs);
                for (lane, &(_, j)) in pairs.iter().enumerate() {
                    self.answer_all(rows.clone(), j..j + 1, f64::from(seen >> lane & 1));
                }
            }
        } else if sampling.accepts_blindly(&strength) {
            // Each ray stands for its part of the pairs.
            for (k, l, sees) in seen.parts() {
                let share = f64::from(u8::from(sees));
                self.answer_all(part(&rows, k), part(&columns, l), share);
            }
        } else {
            self.halves(sampling, rows, columns);
        }
    }

    /// Halves of the larger of two groups. Points of a leaf stand along a space-filling curve: halves are
    /// compact.
    fn halves(&mut self, sampling: &Sampling, rows: Range<usize>, columns: Range<usize>) {
        let middle = |range: &Range<usize>| range.start + range.len() / 2;
        if rows.len() >= columns.len() {
            let middle = middle(&rows);
            self.groups(sampling, rows.start..middle, columns.clone());
            self.groups(sampling, middle..rows.end, columns);
        } else {
            let middle = middle(&columns);
            self.groups(sampling, rows.clone(), columns.start..middle);
            self.groups(sampling, rows, middle..columns.end);
        }
    }

    /// The same answer for all pairs that face each other.
    fn answer_all(&mut self, rows: Range<usize>, columns: Range<usize>, share: f64) {
        for i in rows {
            for j in columns.clone() {
                if Projections::new(&self.xs.0[i], &self.ys.0[j]).facing() {
                    self.answer(i, j, share);
                }
            }
        }
    }

    /// Which of some pairs are unhidden, a bit each.
    fn see(&mut self, pairs: &[(usize, usize)]) -> u16 {
        self.rays += pairs.len() as u64;
        let Self { xs, ys, last, sights, .. } = self;
        SomePairs { sights, xs: *xs, ys: *ys, pairs, last }.run()
    }

    fn answer(&mut self, i: usize, j: usize, share: f64) {
        self.facing += 1;
        if share > 0.0 {
            self.visible += 1;
            (self.count)(i, j, share);
        }
    }
}
