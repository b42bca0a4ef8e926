//! Formulas on several pairs side by side.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use crate::dispatch_level::dispatch_up_to_avx2;
use crate::kernel::formula::{Formula, FormulaEntry};
use crate::kernel::ordinary::OrdinaryDistances;
use crate::kernel::outermost::{PLACES, are_ordinary, spread};
use crate::kernel::wide::{Near, Wide};
use crate::numbers::dual::Dual;
use crate::numbers::traits::{Located, Point, Real, Scalar, Vector};

/// Writes the entries of all pairs of a block, as
/// [`Kernel::entries_block`](crate::Kernel::entries_block) does.
pub(super) fn entries_side_by_side<F: Formula, S: Scalar>(
    formula: &F,
    xs: &[Point<S::Real>],
    ys: &[Point<S::Real>],
    g: &mut [S],
) {
    dispatch_up_to_avx2(Entries { formula, xs, ys, g });
}

/// Writes the gradients of the entries of one pair with respect to x.
pub(super) fn slopes<F: Formula, S: Scalar>(
    formula: &F,
    x: Point<S::Real>,
    y: Point<S::Real>,
    g: &mut [[S; 3]],
) {
    let mut evaluator = Evaluator::<Dual<Near<S::Real>>, F, S>::new(formula);
    evaluator.evaluate(0..1, |_| x.to_array(), |_| y.to_array());
    for (g, numbers) in g.iter_mut().zip(evaluator.numbers.chunks_exact(4 * S::PARTS)) {
        *g = [1, 2, 3].map(|part| scalar(numbers, part, 0));
    }
}

struct Entries<'a, F, S: Scalar> {
    formula: &'a F,
    xs: &'a [Point<S::Real>],
    ys: &'a [Point<S::Real>],
    g: &'a mut [S],
}

impl<F: Formula, S: Scalar> WithSimd for Entries<'_, F, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { formula, xs, ys, g } = self;
        let len = formula.fields() * formula.densities();
        let row = ys.len() * len;
        if row == 0 {
            return;
        }
        let mut evaluator = Evaluator::<Near<S::Real>, F, S>::new(formula);
        if ys.len() >= xs.len() {
            for (x, g) in xs.iter().zip(g.chunks_exact_mut(row)) {
                let x = x.to_array();
                for (ys, g) in ys.chunks(PLACES).zip(g.chunks_mut(PLACES * len)) {
                    let y = Points::new(ys);
                    evaluator.evaluate(y.places(), |_| x, |lane| y.at(lane));
                    for (lane, g) in g.chunks_exact_mut(len).enumerate() {
                        evaluator.write(lane, g);
                    }
                }
            }
        } else {
            for (xs, g) in xs.chunks(PLACES).zip(g.chunks_mut(PLACES * row)) {
                let x = Points::new(xs);
                for (j, y) in ys.iter().enumerate() {
                    let y = y.to_array();
                    evaluator.evaluate(x.places(), |lane| x.at(lane), |_| y);
                    for (lane, g) in g.chunks_exact_mut(row).enumerate() {
                        evaluator.write(lane, &mut g[j * len..][..len]);
                    }
                }
            }
        }
    }
}

/// A formula, and its entries for several pairs.
pub(super) struct Evaluator<'a, W: Wide<S::Real>, F: Formula, S: Scalar> {
    formula: &'a F,
    /// The entries of one pair, if they are many.
    many: Vec<F::Entry<W>>,
    ordinary: OrdinaryDistances<S::Real>,
    /// All numbers of all entries, each for all pairs: the real parts of an entry, then the imaginary ones.
    pub(super) numbers: Vec<[S::Real; PLACES]>,
}

impl<'a, W: Wide<S::Real>, F: Formula, S: Scalar> Evaluator<'a, W, F, S> {
    #[inline(always)]
    pub(super) fn new(formula: &'a F) -> Self {
        let len = formula.fields() * formula.densities();
        let many = vec![FormulaEntry::zero(); if len > FEW { len } else { 0 }];
        let numbers = vec![[S::Real::from_f64(0.0); PLACES]; len * S::PARTS * W::PARTS];
        Self { formula, many, ordinary: OrdinaryDistances::new(), numbers }
    }

    /// Evaluates the formula for the pairs at some of the places.
    #[inline(always)]
    pub(super) fn evaluate(
        &mut self,
        places: Range<usize>,
        x: impl Fn(usize) -> [S::Real; 3],
        y: impl Fn(usize) -> [S::Real; 3],
    ) {
        let Self { formula, many, ordinary, numbers } = self;
        if fill::<W, F, S>(formula, many, numbers, places.clone(), &x, &y) {
            fill_anew::<W::Far, F, S>(formula, numbers, places.clone(), &x, &y);
        }
        let [least, greatest] = spread(places.clone(), &x, &y);
        if !ordinary.hold(least, greatest) {
            let pairs = places.clone().map(|lane| (x(lane), y(lane)));
            if are_ordinary::<W, F, S>(formula, pairs) {
                ordinary.widen(least, greatest);
            } else {
                fill_anew::<W::Extended, F, S>(formula, numbers, places, &x, &y);
            }
        }
    }

    /// Makes all entries of a pair zero.
    #[inline(always)]
    pub(super) fn clear(&mut self, lane: usize) {
        for number in &mut self.numbers {
            number[lane] = S::Real::from_f64(0.0);
        }
    }

    /// Writes the entries of a pair.
    #[inline(always)]
    fn write(&self, lane: usize, g: &mut [S]) {
        for (g, numbers) in g.iter_mut().zip(self.numbers.chunks_exact(S::PARTS * W::PARTS)) {
            *g = scalar(numbers, 0, lane);
        }
    }
}

/// Entries of one pair that stay in registers.
const FEW: usize = 10;

/// Fills in the numbers of an [`Evaluator`], and says whether some are wrong because an angle is too large.
#[inline(always)]
fn fill<W: Wide<S::Real>, F: Formula, S: Scalar>(
    formula: &F,
    many: &mut [F::Entry<W>],
    numbers: &mut [[S::Real; PLACES]],
    places: Range<usize>,
    x: &impl Fn(usize) -> [S::Real; 3],
    y: &impl Fn(usize) -> [S::Real; 3],
) -> bool {
    let len = formula.fields() * formula.densities();
    let width = S::PARTS * W::PARTS;
    // Where the compiler knows the length of the entries, it has to see that this is as long.
    let numbers = &mut numbers[..len * width];
    let mut wrong = false;
    for lane in places {
        let mut few = [FormulaEntry::zero(); FEW];
        let entries = if len <= FEW { &mut few[..len] } else { &mut *many };
        formula.entries(W::at::<F::Of>(x(lane), y(lane)), entries);
        for (entry, numbers) in entries.iter().zip(numbers.chunks_exact_mut(width)) {
            for (entry, numbers) in entry.parts().iter().zip(numbers.chunks_exact_mut(W::PARTS)) {
                for (part, number) in numbers.iter_mut().enumerate() {
                    let found = entry.part(part);
                    number[lane] = found.value;
                    wrong |= found.wrong;
                }
            }
        }
    }
    wrong
}

/// As [`fill`], in numbers that are right for all pairs.
#[inline(never)]
fn fill_anew<W: Wide<S::Real>, F: Formula, S: Scalar>(
    formula: &F,
    numbers: &mut [[S::Real; PLACES]],
    places: Range<usize>,
    x: &impl Fn(usize) -> [S::Real; 3],
    y: &impl Fn(usize) -> [S::Real; 3],
) {
    let mut many = vec![FormulaEntry::zero(); formula.fields() * formula.densities()];
    fill::<W, F, S>(formula, &mut many, numbers, places, x, y);
}

/// A part of an entry from its numbers: 0 for its value, or 1 to 3 for a derivative.
#[inline(always)]
pub(super) fn scalar<S: Scalar>(numbers: &[[S::Real; PLACES]], part: usize, lane: usize) -> S {
    let imaginary = numbers.len() / S::PARTS + part;
    let im = if S::COMPLEX { numbers[imaginary][lane] } else { S::Real::from_f64(0.0) };
    S::from_parts(numbers[part][lane], im)
}

/// Points side by side.
pub(super) struct Points<T> {
    coordinates: [[T; PLACES]; 3],
    count: usize,
}

impl<T: Real> Points<T> {
    /// Some points, [`PLACES`] at most. Places beyond the last hold it again.
    #[inline(always)]
    pub(super) fn new<P: Located<Real = T>>(points: &[P]) -> Self {
        let mut packed =
            Self { coordinates: [[T::from_f64(0.0); PLACES]; 3], count: points.len().min(PLACES) };
        for lane in packed.places() {
            let p = points[lane.min(packed.count - 1)].position().to_array();
            for (coordinates, p) in packed.coordinates.iter_mut().zip(p) {
                coordinates[lane] = p;
            }
        }
        packed
    }

    /// The places that hold points: a whole number of registers.
    #[inline(always)]
    pub(super) fn places(&self) -> Range<usize> {
        /// The widest registers have 512 bits.
        const BYTES: usize = 64;
        0..self.count.next_multiple_of(BYTES / size_of::<T>()).min(PLACES)
    }

    /// The point at a place.
    #[inline(always)]
    pub(super) fn at(&self, lane: usize) -> [T; 3] {
        let [x, y, z] = &self.coordinates;
        [x[lane], y[lane], z[lane]]
    }
}
