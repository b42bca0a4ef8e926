//! The pairs of two leaves, asked about together.

use std::ops::Range;
use std::sync::atomic::Ordering;

use farfield::Real;

use crate::facet::{Facet, ordered};
use crate::operator::mixed;
use crate::packet::AllPairs;
use crate::sampling::{RAYS, Sampling, Seen};
use crate::shaft::position;
use crate::surfel::{Projections, Surfel};
use crate::visibility::Visibility;

/// From so many facets on that may hide some of the pairs, each pair looks for its own in the hierarchy.
pub(crate) const MOST_CANDIDATES: usize = 12;

/// Two leaves whose pairs are being asked about.
pub(crate) struct Asked<'a, T: Real> {
    pub(crate) xs: &'a [Surfel<T>],
    pub(crate) ys: &'a [Surfel<T>],
    pub(crate) visibility: &'a Visibility<'a>,
    /// The facets that may hide any of the pairs, if they are few.
    pub(crate) candidates: Option<Vec<Facet>>,
    /// What hid a pair most lately.
    pub(crate) last: Option<Facet>,
    pub(crate) count: &'a mut dyn FnMut(usize, usize),
    pub(crate) facing: u64,
    pub(crate) visible: u64,
    pub(crate) rays: u64,
}

/// Groups of so few pairs are not worth a look at what they exchange.
const FEW_PAIRS: usize = 32;

impl<T: Real> Asked<'_, T> {
    /// By one ray per pair.
    pub(crate) fn one_by_one(&mut self, rows: Range<usize>, columns: Range<usize>) {
        let (xs, ys) = (&self.xs[rows.clone()], &self.ys[columns.clone()]);
        let occluders = self.visibility.occluders;
        let mut answer = |i: usize, j: usize, sees| {
            self.rays += 1;
            self.answer(rows.start + i, columns.start + j, sees);
        };
        AllPairs { occluders, xs, ys, answer: &mut answer }.run();
    }

    /// By samples for two groups that exchange little: all at once if the samples agree, else row by row
    /// or column by column if they differ that way only.
    pub(crate) fn groups(
        &mut self,
        sampling: &Sampling,
        rows: Range<usize>,
        columns: Range<usize>,
    ) {
        if rows.len() * columns.len() <= FEW_PAIRS {
            return self.one_by_one(rows, columns);
        }
        let (x, y) = (&self.xs[rows.clone()], &self.ys[columns.clone()]);
        let strength = sampling.strength(x, y);
        if !sampling.accepts(&strength) {
            return self.halves(sampling, rows, columns);
        }
        let key = mixed(((rows.start as u64) << 32) | columns.start as u64);
        let (i, j) = (rows.start, columns.start);
        let seen = Seen::of(x.len(), y.len(), key, |k, l| self.sees(i + k, j + l));
        let both = if self.visibility.mirrored.load(Ordering::Relaxed) { 1.0 } else { 0.5 };
        self.visibility.add_variance(both * strength.variance(seen.count()) / RAYS as f64);
        if let 0 | RAYS = seen.count() {
            self.answer_all(rows, columns, seen.count() > 0);
        } else if seen.columns_agree() {
            let sample =
                |i: usize| columns.start + (mixed(key ^ i as u64) as usize) % columns.len();
            for i in rows {
                let sees = self.sees(i, sample(i));
                self.answer_all(i..i + 1, columns.clone(), sees);
            }
        } else if seen.rows_agree() {
            let sample = |j: usize| rows.start + (mixed(key ^ j as u64) as usize) % rows.len();
            for j in columns {
                let sees = self.sees(sample(j), j);
                self.answer_all(rows.clone(), j..j + 1, sees);
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
    fn answer_all(&mut self, rows: Range<usize>, columns: Range<usize>, sees: bool) {
        for i in rows {
            for j in columns.clone() {
                if Projections::new(&self.xs[i], &self.ys[j]).facing() {
                    self.answer(i, j, sees);
                }
            }
        }
    }

    fn sees(&mut self, i: usize, j: usize) -> bool {
        let (x, y) = (&self.xs[i], &self.ys[j]);
        let (from, to) = ordered(position(x), position(y));
        let margin = self.visibility.occluders.margin();
        self.rays += 1;
        let blocks = |facet: &Facet| facet.blocks(from, to, [x.face, y.face], margin);
        // What hides one pair is likely to hide the next.
        if self.last.as_ref().is_some_and(blocks) {
            return false;
        }
        let found = match &self.candidates {
            Some(candidates) => candidates.iter().find(|facet| blocks(facet)),
            None => self.visibility.occluders.blocker(from, to, [x.face, y.face]),
        };
        self.last = found.copied().or(self.last);
        found.is_none()
    }

    fn answer(&mut self, i: usize, j: usize, sees: bool) {
        self.facing += 1;
        if sees {
            self.visible += 1;
            (self.count)(i, j);
        }
    }
}
