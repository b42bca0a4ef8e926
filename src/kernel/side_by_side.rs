//! Formulas on several pairs side by side.

use pulp::{Simd, WithSimd};

use crate::dispatch_level::dispatch_up_to_avx2;
use crate::kernel::formula::{Form, Formula, FormulaEntry};
use crate::kernel::traits::Kernel;
use crate::numbers::dual::Dual;
use crate::numbers::lanes::Lanes;
use crate::numbers::number::{Coordinates, Number};
use crate::numbers::traits::{Located, Numbers, Point, Real, Scalar, Vector};

/// Pairs side by side: a whole number of registers in either precision.
const LANES: usize = 8;

/// The numbers of several pairs.
pub(super) type Pack<T> = Lanes<T, LANES>;

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
    let at = F::Of::at::<Lanes<S::Real, 1>>(everywhere(x), everywhere(y));
    let mut entries = vec![FormulaEntry::zero(); g.len()];
    formula.entries(F::Of::with_derivatives(at), &mut entries);
    for (g, entry) in g.iter_mut().zip(entries) {
        let parts = entry.parts();
        *g = [0, 1, 2].map(|axis| {
            let [re, im] = parts.map(|part| part.slope[axis].0[0]);
            S::from_parts(re, im)
        });
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
        let mut entries = vec![FormulaEntry::zero(); len];
        for (x, g) in xs.iter().zip(g.chunks_exact_mut(ys.len() * len)) {
            let x = everywhere(*x);
            for (ys, g) in ys.chunks(LANES).zip(g.chunks_mut(LANES * len)) {
                let at = F::Of::at::<Pack<S::Real>>(x, packed(ys));
                formula.entries(at, &mut entries);
                for (k, entry) in entries.iter().enumerate() {
                    let [re, im] = entry.parts();
                    for (lane, g) in g.chunks_exact_mut(len).enumerate() {
                        g[k] = S::from_parts(re.0[lane], im.0[lane]);
                    }
                }
            }
        }
    }
}

/// The near field of a formula's kernel: R_x Σ_j G(x_i, y_j) S_y q_j for all targets of a block.
pub(super) struct Near<'a, K: Kernel, F> {
    pub(super) kernel: &'a K,
    pub(super) formula: &'a F,
    pub(super) skip_coincident: bool,
    pub(super) xs: &'a [K::Target],
    pub(super) ys: &'a [K::Source],
    pub(super) qs: &'a [K::Charge],
    pub(super) us: &'a mut [K::Value],
}

impl<K: Kernel, F: Formula> Near<'_, K, F> {
    /// Adds to the values.
    pub(super) fn add(self) {
        if !self.ys.is_empty() {
            dispatch_up_to_avx2(self);
        }
    }

    /// The sums in numbers of type `W`.
    #[inline(always)]
    fn sum<W: Wide<K::Real>>(self) {
        let Self { kernel, formula, skip_coincident, xs, ys, qs, us } = self;
        let (fields, densities, columns) = (kernel.fields(), kernel.densities(), kernel.columns());
        let zero = <K::Entry as Numbers>::zero();
        let mut sent = vec![zero; ys.len() * densities * columns];
        for ((y, q), d) in ys.iter().zip(qs).zip(sent.chunks_exact_mut(densities * columns)) {
            kernel.density(y, q, d);
        }
        let mut entries = vec![FormulaEntry::<W>::zero(); fields * densities];
        let mut sums = vec![[[Pack::constant(0.0); 2]; MOST_PARTS]; fields * columns];
        let mut received = vec![zero; fields * columns];
        let mut slopes = vec![[zero; 3]; if W::PARTS > 1 { fields * columns } else { 0 }];
        for (xs, us) in xs.chunks(LANES).zip(us.chunks_mut(LANES)) {
            let x = packed(xs);
            sums.fill([[Pack::constant(0.0); 2]; MOST_PARTS]);
            for (y, d) in ys.iter().zip(sent.chunks_exact(densities * columns)) {
                let y = everywhere(y.position());
                formula.entries(W::at::<F::Of>(x, y), &mut entries);
                let coincident = if skip_coincident { equal(x, y) } else { [false; LANES] };
                for (k, entry) in entries.iter().enumerate() {
                    let (field, density) = (k / densities * columns, k % densities * columns);
                    let parts = entry.parts();
                    for column in 0..columns {
                        let [d_re, d_im] = d[density + column].parts();
                        let sums = &mut sums[field + column];
                        for (part, sum) in sums.iter_mut().enumerate().take(W::PARTS) {
                            let [re, im] = parts.map(|p| p.part(part));
                            let re = Pack::select(coincident, Pack::constant(0.0), re);
                            sum[0] = sum[0] + re.scaled(d_re);
                            if K::Entry::COMPLEX {
                                let im = Pack::select(coincident, Pack::constant(0.0), im);
                                sum[0] = sum[0] - im.scaled(d_im);
                                sum[1] = sum[1] + re.scaled(d_im) + im.scaled(d_re);
                            }
                        }
                    }
                }
            }
            for (lane, (x, u)) in xs.iter().zip(us).enumerate() {
                for (k, sums) in sums.iter().enumerate() {
                    let at = |part: usize| {
                        let [re, im] = sums[part].map(|sum: Pack<K::Real>| sum.0[lane]);
                        K::Entry::from_parts(re, im)
                    };
                    received[k] = at(0);
                    if W::PARTS > 1 {
                        slopes[k] = [at(1), at(2), at(3)];
                    }
                }
                kernel.value(x, &received, &slopes, u);
            }
        }
    }

    /// The sums of a real formula of one field, one density and one right-hand side, values alone: the
    /// case that is worth a loop of its own.
    #[inline(always)]
    fn sum_one(self) {
        let Self { kernel, formula, skip_coincident, xs, ys, qs, us } = self;
        let zero = <K::Entry as Numbers>::zero();
        let mut sent = vec![zero; ys.len()];
        for ((y, q), d) in ys.iter().zip(qs).zip(sent.chunks_exact_mut(1)) {
            kernel.density(y, q, d);
        }
        for (xs, us) in xs.chunks(LANES).zip(us.chunks_mut(LANES)) {
            let x = packed(xs);
            let mut sum = Pack::constant(0.0);
            for (y, d) in ys.iter().zip(&sent) {
                let y = everywhere(y.position());
                let mut entry = [FormulaEntry::<Pack<K::Real>>::zero()];
                formula.entries(F::Of::at(x, y), &mut entry);
                let coincident = if skip_coincident { equal(x, y) } else { [false; LANES] };
                let k = Pack::select(coincident, Pack::constant(0.0), entry[0].parts()[0]);
                sum = sum + k.scaled(d.parts()[0]);
            }
            for ((x, u), sum) in xs.iter().zip(us).zip(sum.0) {
                kernel.value(x, &[K::Entry::from_real(sum)], &[], u);
            }
        }
    }
}

impl<K: Kernel, F: Formula> WithSimd for Near<'_, K, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let kernel = self.kernel;
        let components = kernel.fields() * kernel.densities() * kernel.columns();
        if kernel.needs_gradients() {
            self.sum::<Dual<Pack<K::Real>>>();
        } else if components == 1 && !K::Entry::COMPLEX {
            self.sum_one();
        } else {
            self.sum::<Pack<K::Real>>();
        }
    }
}

/// The most parts that a number of [`Wide`] has: a value and three derivatives.
const MOST_PARTS: usize = 4;

/// Numbers that a near field is summed in: with derivatives or without.
trait Wide<T: Real>: Number<Real = T> {
    /// 1, or 4 with derivatives.
    const PARTS: usize;
    /// The argument of a formula.
    fn at<O: Form>(x: Coordinates<Pack<T>>, y: Coordinates<Pack<T>>) -> O::At<Self>;
    /// The value, or a derivative.
    fn part(&self, part: usize) -> Pack<T>;
}

impl<T: Real> Wide<T> for Pack<T> {
    const PARTS: usize = 1;
    #[inline(always)]
    fn at<O: Form>(x: Coordinates<Self>, y: Coordinates<Self>) -> O::At<Self> {
        O::at(x, y)
    }
    #[inline(always)]
    fn part(&self, _: usize) -> Self {
        *self
    }
}

impl<T: Real> Wide<T> for Dual<Pack<T>> {
    const PARTS: usize = MOST_PARTS;
    #[inline(always)]
    fn at<O: Form>(x: Coordinates<Pack<T>>, y: Coordinates<Pack<T>>) -> O::At<Self> {
        O::with_derivatives(O::at(x, y))
    }
    #[inline(always)]
    fn part(&self, part: usize) -> Pack<T> {
        if part == 0 { self.value } else { self.slope[part - 1] }
    }
}

/// Points side by side; places beyond the last hold it again.
#[inline(always)]
fn packed<P: Located>(points: &[P]) -> Coordinates<Pack<P::Real>> {
    let zero = P::Real::from_f64(0.0);
    let mut packed = [[zero; LANES]; 3];
    for lane in 0..LANES {
        let p = points[lane.min(points.len() - 1)].position().to_array();
        for axis in 0..3 {
            packed[axis][lane] = p[axis];
        }
    }
    let [x, y, z] = packed.map(Lanes);
    Coordinates { x, y, z }
}

/// The same point in every place.
#[inline(always)]
fn everywhere<V: Vector<T>, T: Real, const L: usize>(p: V) -> Coordinates<Lanes<T, L>> {
    let [x, y, z] = p.to_array().map(|x| Lanes([x; L]));
    Coordinates { x, y, z }
}

/// Where two points are the same.
#[inline(always)]
fn equal<T: Real>(a: Coordinates<Pack<T>>, b: Coordinates<Pack<T>>) -> [bool; LANES] {
    let mut same = [true; LANES];
    for (a, b) in a.to_array().iter().zip(b.to_array()) {
        for (lane, same) in same.iter_mut().enumerate() {
            *same &= a.0[lane] == b.0[lane];
        }
    }
    same
}
