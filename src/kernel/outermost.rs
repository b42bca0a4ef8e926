//! The nearest and the farthest of some pairs, between which numbers neither overflow nor vanish unless they do there.

use std::ops::Range;

use crate::kernel::formula::{Formula, FormulaEntry};
use crate::kernel::ordinary::{OrdinaryDistances, outermost, square_of};
use crate::kernel::wide::{Whole, Wide};
use crate::numbers::extended::Extended;
use crate::numbers::traits::{Point, Real, Scalar, Vector};

/// Pairs that are worked on side by side, at most: enough for loops over them to cost little more than what
/// they do.
pub(super) const PLACES: usize = 32;

/// The least r² of pairs that don't coincide, and the greatest.
#[inline(always)]
pub(super) fn spread<T: Real>(
    places: Range<usize>,
    x: &impl Fn(usize) -> [T; 3],
    y: &impl Fn(usize) -> [T; 3],
) -> [T; 2] {
    let mut spread = Spread::new();
    for lane in places {
        let (square, coincident) = square_of(x(lane), y(lane));
        spread.add(lane, square, coincident);
    }
    spread.ends()
}

/// The least r² of pairs that don't coincide, and the greatest, place by place.
pub(super) struct Spread<T> {
    least: [T; PLACES],
    greatest: [T; PLACES],
}

impl<T: Real> Spread<T> {
    #[inline(always)]
    pub(super) fn new() -> Self {
        // Where all points coincide, there is nothing to look at.
        Self { least: [T::from_f64(1.0); PLACES], greatest: [T::from_f64(1.0); PLACES] }
    }

    #[inline(always)]
    pub(super) fn add(&mut self, place: usize, square: T, coincident: bool) {
        let (least, greatest) = (&mut self.least[place], &mut self.greatest[place]);
        *least = if (square < *least) & !coincident { square } else { *least };
        *greatest = if square > *greatest { square } else { *greatest };
    }

    #[inline(always)]
    pub(super) fn ends(&self) -> [T; 2] {
        let (mut least, mut greatest) = (self.least[0], self.greatest[0]);
        for place in 1..PLACES {
            least = if self.least[place] < least { self.least[place] } else { least };
            greatest =
                if self.greatest[place] > greatest { self.greatest[place] } else { greatest };
        }
        [least, greatest]
    }
}

/// Whether plain numbers serve for the nearest and the farthest of some pairs.
#[inline(never)]
pub(super) fn are_ordinary<W: Wide<S::Real>, F: Formula, S: Scalar>(
    formula: &F,
    pairs: impl Iterator<Item = ([S::Real; 3], [S::Real; 3])>,
) -> bool {
    let Some(ends) = outermost(pairs) else { return true };
    let len = formula.fields() * formula.densities();
    let mut plain: Vec<F::Entry<W::Far>> = vec![FormulaEntry::zero(); len];
    let mut extended: Vec<F::Entry<W::Extended>> = vec![FormulaEntry::zero(); len];
    ends.into_iter().all(|(x, y)| {
        formula.entries(<W::Far as Wide<S::Real>>::at::<F::Of>(x, y), &mut plain);
        formula.entries(<W::Extended as Wide<S::Real>>::at::<F::Of>(x, y), &mut extended);
        plain.iter().zip(&extended).all(|(plain, extended)| {
            plain.parts().iter().zip(extended.parts()).all(|(plain, extended)| {
                (0..W::PARTS).all(|part| {
                    OrdinaryDistances::agree(plain.part(part).value, extended.whole(part))
                })
            })
        })
    })
}

/// The largest entry of a pair and, with derivatives, the largest of these, as
/// [`Kernel::sizes`](crate::Kernel::sizes) says.
pub(super) fn sizes<W: Wide<S::Real>, F: Formula, S: Scalar>(
    formula: &F,
    x: Point<S::Real>,
    y: Point<S::Real>,
) -> [f64; 2] {
    let mut entries: Vec<F::Entry<W::Extended>> =
        vec![FormulaEntry::zero(); formula.fields() * formula.densities()];
    let at = <W::Extended as Wide<S::Real>>::at::<F::Of>(x.to_array(), y.to_array());
    formula.entries(at, &mut entries);
    let largest = |parts: Range<usize>| {
        let numbers = entries.iter().flat_map(|entry| entry.parts());
        let numbers = numbers.flat_map(|number| parts.clone().map(move |part| number.whole(part)));
        numbers.map(Extended::size).fold(0.0, f64::max)
    };
    [largest(0..1), largest(1..W::PARTS)]
}
