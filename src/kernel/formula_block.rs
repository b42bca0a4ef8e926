//! The near field of formulas.

use pulp::{Simd, WithSimd};

use crate::dispatch_level::dispatch;
use crate::kernel::formula::{Formula, FormulaEntry};
use crate::kernel::ordinary::{OrdinaryDistances, square_of};
use crate::kernel::outermost::{PLACES, Spread, are_ordinary};
use crate::kernel::side_by_side::{Evaluator, Points, scalar};
use crate::kernel::traits::Kernel;
use crate::kernel::wide::{Near, Wide};
use crate::numbers::dual::Dual;
use crate::numbers::traits::{Located, Numbers, Real, Scalar, Vector};

/// The near field of a formula's kernel: R_x Σ_j G(x_i, y_j) S_y q_j for all targets of a block.
pub(super) struct FormulaBlock<'a, K: Kernel, F> {
    pub(super) kernel: &'a K,
    pub(super) formula: &'a F,
    pub(super) skip_coincident: bool,
    pub(super) xs: &'a [K::Target],
    pub(super) ys: &'a [K::Source],
    pub(super) qs: &'a [K::Charge],
    pub(super) us: &'a mut [K::Value],
}

impl<K: Kernel, F: Formula> FormulaBlock<'_, K, F> {
    /// Adds to the values.
    pub(super) fn add(self) {
        let kernel = self.kernel;
        let numbers = kernel.fields() * kernel.densities() * kernel.columns();
        if !self.ys.is_empty() && numbers > 0 {
            dispatch(self);
        }
    }

    /// The sums in numbers of type `W`.
    #[inline(always)]
    fn sum<W: Wide<K::Real>>(self) {
        let Self { kernel, formula, skip_coincident, xs, ys, qs, us } = self;
        let (fields, densities, columns) = (kernel.fields(), kernel.densities(), kernel.columns());
        let sent = sent(kernel, ys, qs);
        let mut evaluator = Evaluator::<W, F, K::Entry>::new(formula);
        let width = K::Entry::PARTS * W::PARTS;
        let mut sums = vec![[K::Real::from_f64(0.0); PLACES]; fields * columns * width];
        let zero = <K::Entry as Numbers>::zero();
        let mut received = vec![zero; fields * columns];
        let mut slopes = vec![[zero; 3]; if W::PARTS > 1 { fields * columns } else { 0 }];
        for (xs, us) in xs.chunks(PLACES).zip(us.chunks_mut(PLACES)) {
            let x = Points::new(xs);
            sums.fill([K::Real::from_f64(0.0); PLACES]);
            for (y, d) in ys.iter().zip(sent.chunks_exact(densities * columns)) {
                let y = y.position().to_array();
                evaluator.evaluate(x.places(), |lane| x.at(lane), |_| y);
                if skip_coincident {
                    x.places().filter(|&l| x.at(l) == y).for_each(|l| evaluator.clear(l));
                }
                for (k, entry) in evaluator.numbers.chunks_exact(width).enumerate() {
                    let (field, density) = (k / densities * columns, k % densities * columns);
                    let sums = sums[field * width..].chunks_exact_mut(width);
                    for (sum, d) in sums.zip(&d[density..][..columns]) {
                        add_product(sum, entry, *d);
                    }
                }
            }
            for (lane, (x, u)) in xs.iter().zip(us).enumerate() {
                for (k, sums) in sums.chunks_exact(width).enumerate() {
                    received[k] = scalar(sums, 0, lane);
                    if W::PARTS > 1 {
                        slopes[k] = [1, 2, 3].map(|part| scalar(sums, part, lane));
                    }
                }
                kernel.value(x, &received, &slopes, u);
            }
        }
    }

    /// The sums of a real formula of one field, one density and one right-hand side: the case that is worth
    /// a loop of its own, in which entries stay in registers.
    #[inline(always)]
    fn sum_one<W: Wide<K::Real>>(self) {
        let Self { kernel, formula, skip_coincident, xs, ys, qs, us } = self;
        let sent = sent(kernel, ys, qs);
        let sources = One { formula, skip_coincident, ys, sent: &sent };
        let mut ordinary = OrdinaryDistances::new();
        for (xs, us) in xs.chunks(PLACES).zip(us.chunks_mut(PLACES)) {
            let places = Points::new(xs);
            let (mut sums, wrong, [least, greatest]) = sources.sums::<W>(&places);
            if wrong {
                sums = sources.sums_anew::<W::Far>(&places);
            }
            if !ordinary.hold(least, greatest) {
                if sources.are_ordinary::<W>(&places) {
                    ordinary.widen(least, greatest);
                } else {
                    sums = sources.sums_anew::<W::Extended>(&places);
                }
            }
            for (lane, (x, u)) in xs.iter().zip(us).enumerate() {
                let [value, slope @ ..] = sums.map(|sum| K::Entry::from_real(sum[lane]));
                let slopes = &[slope][..if W::PARTS > 1 { 1 } else { 0 }];
                kernel.value(x, &[value], slopes, u);
            }
        }
    }
}

impl<K: Kernel, F: Formula> WithSimd for FormulaBlock<'_, K, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let kernel = self.kernel;
        let components = kernel.fields() * kernel.densities() * kernel.columns();
        let one = components == 1 && !K::Entry::COMPLEX;
        if kernel.needs_gradients() {
            if one { self.sum_one::<Dual<Near<_>>>() } else { self.sum::<Dual<Near<_>>>() }
        } else if one {
            self.sum_one::<Near<_>>();
        } else {
            self.sum::<Near<_>>();
        }
    }
}

/// What the sources send, one after the other.
#[inline(always)]
fn sent<K: Kernel>(kernel: &K, ys: &[K::Source], qs: &[K::Charge]) -> Vec<K::Entry> {
    let len = kernel.densities() * kernel.columns();
    let mut sent = vec![<K::Entry as Numbers>::zero(); ys.len() * len];
    for ((y, q), d) in ys.iter().zip(qs).zip(sent.chunks_exact_mut(len)) {
        kernel.density(y, q, d);
    }
    sent
}

/// `sums` += `entry` · `d` for all pairs, values and derivatives alike.
#[inline(always)]
fn add_product<S: Scalar>(sums: &mut [[S::Real; PLACES]], entry: &[[S::Real; PLACES]], d: S) {
    let [d_re, d_im] = d.parts();
    if S::COMPLEX {
        let half = entry.len() / 2;
        let (sums_re, sums_im) = sums.split_at_mut(half);
        let (entry_re, entry_im) = entry.split_at(half);
        let sums = sums_re.iter_mut().zip(sums_im);
        for ((sum_re, sum_im), (re, im)) in sums.zip(entry_re.iter().zip(entry_im)) {
            for lane in 0..PLACES {
                sum_re[lane] = sum_re[lane] + re[lane] * d_re - im[lane] * d_im;
                sum_im[lane] = sum_im[lane] + re[lane] * d_im + im[lane] * d_re;
            }
        }
    } else {
        for (sum, entry) in sums.iter_mut().zip(entry) {
            for (sum, entry) in sum.iter_mut().zip(entry) {
                *sum += *entry * d_re;
            }
        }
    }
}

/// Sources of a real formula of one field, one density and one right-hand side.
struct One<'a, F, Y, S> {
    formula: &'a F,
    skip_coincident: bool,
    ys: &'a [Y],
    sent: &'a [S],
}

/// A value and three derivatives, for several targets.
type Sums<T> = [[T; PLACES]; 4];

impl<F: Formula, Y: Located, S: Scalar<Real = Y::Real>> One<'_, F, Y, S> {
    /// The sums for some targets, whether they are wrong because an angle is too large, and the least and the greatest
    /// r² of points that don't coincide.
    #[inline(always)]
    fn sums<W: Wide<Y::Real>>(&self, x: &Points<Y::Real>) -> (Sums<Y::Real>, bool, [Y::Real; 2]) {
        let zero = Y::Real::from_f64(0.0);
        let mut sums = [[zero; PLACES]; 4];
        let (mut wrong, mut spread) = (false, Spread::new());
        for (y, d) in self.ys.iter().zip(self.sent) {
            let (y, [d, _]) = (y.position().to_array(), d.parts());
            for lane in x.places() {
                let [x0, x1, x2] = x.at(lane);
                let mut entry = [FormulaEntry::<W>::zero()];
                self.formula.entries(W::at::<F::Of>([x0, x1, x2], y), &mut entry);
                let (square, coincident) = square_of([x0, x1, x2], y);
                spread.add(lane, square, coincident);
                for (part, sum) in sums.iter_mut().enumerate().take(W::PARTS) {
                    let found = entry[0].parts()[0].part(part);
                    let k = if self.skip_coincident & coincident { zero } else { found.value };
                    sum[lane] += k * d;
                    wrong |= found.wrong;
                }
            }
        }
        (sums, wrong, spread.ends())
    }

    /// As [`sums`](Self::sums), in numbers that are right for all pairs.
    #[inline(never)]
    fn sums_anew<W: Wide<Y::Real>>(&self, x: &Points<Y::Real>) -> Sums<Y::Real> {
        self.sums::<W>(x).0
    }

    /// Whether plain numbers serve for the nearest and the farthest pair.
    #[inline(never)]
    fn are_ordinary<W: Wide<Y::Real>>(&self, x: &Points<Y::Real>) -> bool {
        let ys = self.ys.iter().map(|y| y.position().to_array());
        let pairs = ys.flat_map(|y| x.places().map(move |lane| (x.at(lane), y)));
        are_ordinary::<W, F, S>(self.formula, pairs)
    }
}
