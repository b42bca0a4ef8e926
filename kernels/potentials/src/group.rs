//! Groups of targets in registers, and what is summed at them.

#![expect(clippy::needless_range_loop, reason = "closures of iterators may not be inlined")]

use farfield::{Numbers, Point, Real, Vector};
use pulp::Simd;

use crate::columns::{from_columns, same, to_columns};
use crate::exponent::Exponent;
use crate::law::{Law, slope};
use crate::output::Output;
use crate::reciprocal::{Digits, Reciprocal};
use crate::registers::Registers;

/// The most numbers that a register can have: 512 bits of `f32`.
pub(crate) const LANES: usize = 16;

/// Numbers in a register.
#[inline(always)]
pub(crate) const fn lanes<F: Registers, S: Simd>() -> usize {
    size_of::<F::Register<S>>() / size_of::<F>()
}

/// One to three registers for each coordinate of as many targets as they hold.
pub(crate) type Targets<F, S, const G: usize> = [[<F as Registers>::Register<S>; G]; 3];

/// How many registers of targets make the next group, if `registers` of them are left and three, or as many as
/// have room for their sums, are the most.
#[inline(always)]
pub(crate) fn group_size<S: Simd>(registers: usize, columns: usize, gradient: bool) -> usize {
    // Three of eight registers for sums leave enough for coordinates and intermediate results.
    let sums = if gradient { 4 * columns } else { columns };
    let most = (S::REGISTER_COUNT * 3 / 8 / sums).clamp(1, 3);
    // Four are two and two: a lone register would wait for its own results.
    if registers == 4 { 2.min(most) } else { registers.min(most) }
}

/// `G` registers of targets and all sources, in the precision that they come in.
#[inline(always)]
pub(crate) fn group<S, E, F, T, C, O, const G: usize, const N: usize>(
    simd: S,
    law: Law,
    digits: Digits,
    xs: &[Point<T>],
    ys: &[Point<T>],
    qs: &[C],
    us: &mut [O::Value],
) where
    S: Simd,
    E: Exponent,
    F: Reciprocal,
    T: Real,
    C: Numbers<Real = T>,
    O: Output<T, C>,
{
    let x = load::<F, S, _, G>(simd, xs, |x| x.to_array().map(same));
    let least = F::splat(simd, F::LEAST);
    let mut sums = Sums::<F, S, G, N>::zero(simd);
    for (y, q) in ys.iter().zip(qs) {
        let y = y.to_array().map(|c| F::splat(simd, same(c)));
        let q = to_columns::<C, F, N>(q).map(|q| F::splat(simd, q));
        for g in 0..G {
            let (d, r2) = difference::<F, S, G>(simd, &x, g, y);
            sums.add(simd, (law, digits, O::GRADIENT), g, (d, r2), Some(least), q);
        }
    }
    let [k, slope] = law.units::<F, S>(simd, digits);
    sums.add_to::<T, C, O>([k, -2.0 * E::LAMBDA * slope], &[1.0; N], us);
}

/// Targets in registers; the places beyond the last hold the last, and what they sum up to is dropped.
#[inline(always)]
pub(crate) fn load<F: Registers, S: Simd, P: Copy, const G: usize>(
    simd: S,
    xs: &[P],
    coordinates: impl Fn(P) -> [F; 3],
) -> Targets<F, S, G> {
    let zero = F::from_f64(0.0);
    let mut x = [[F::splat(simd, zero); G]; 3];
    for (g, xs) in xs.chunks(lanes::<F, S>()).enumerate() {
        let [mut a, mut b, mut c] = [[zero; LANES]; 3];
        for (i, x) in xs.iter().take(LANES).enumerate() {
            [a[i], b[i], c[i]] = coordinates(*x);
        }
        let last = xs.len() - 1;
        for i in xs.len()..lanes::<F, S>() {
            (a[i], b[i], c[i]) = (a[last], b[last], c[last]);
        }
        x[0][g] = F::registers::<S>(&a)[0];
        x[1][g] = F::registers::<S>(&b)[0];
        x[2][g] = F::registers::<S>(&c)[0];
    }
    x
}

/// d = x − y and r² = |d|² for a register of targets.
#[inline(always)]
pub(crate) fn difference<F: Registers, S: Simd, const G: usize>(
    simd: S,
    x: &Targets<F, S, G>,
    g: usize,
    y: [F::Register<S>; 3],
) -> ([F::Register<S>; 3], F::Register<S>) {
    let d = [
        F::minus(simd, x[0][g], y[0]),
        F::minus(simd, x[1][g], y[1]),
        F::minus(simd, x[2][g], y[2]),
    ];
    let r2 = F::times(simd, d[0], d[0]);
    let r2 = F::plus_product(simd, d[1], d[1], r2);
    (d, F::plus_product(simd, d[2], d[2], r2))
}

/// Σ K q and Σ d K r⁻² q at `G` registers of targets, for each of `N` columns.
pub(crate) struct Sums<F: Registers, S: Simd, const G: usize, const N: usize> {
    potential: [[F::Register<S>; G]; N],
    gradient: [[[F::Register<S>; G]; N]; 3],
}

impl<F: Reciprocal, S: Simd, const G: usize, const N: usize> Sums<F, S, G, N> {
    #[inline(always)]
    pub(crate) fn zero(simd: S) -> Self {
        let zero = F::splat(simd, F::from_f64(0.0));
        Self { potential: [[zero; G]; N], gradient: [[[zero; G]; N]; 3] }
    }

    /// Adds one source, at the differences (d, r²) from the targets of register `g`.
    #[inline(always)]
    pub(crate) fn add(
        &mut self,
        simd: S,
        (law, digits, gradient): (Law, Digits, bool),
        g: usize,
        (d, r2): ([F::Register<S>; 3], F::Register<S>),
        least: Option<F::Register<S>>,
        q: [F::Register<S>; N],
    ) {
        let (k, inverse) = law.at::<F, S>(simd, digits, least, r2);
        for n in 0..N {
            self.potential[n][g] = F::plus_product(simd, k, q[n], self.potential[n][g]);
        }
        if gradient {
            let (d, slope) = slope::<F, S>(simd, d, k, inverse);
            for n in 0..N {
                let slope = F::times(simd, slope, q[n]);
                for c in 0..3 {
                    let sum = &mut self.gradient[c][n][g];
                    *sum = F::plus_product(simd, d[c], slope, *sum);
                }
            }
        }
    }

    /// Adds other sums.
    #[inline(always)]
    pub(crate) fn accumulate(&mut self, simd: S, other: &Self, gradient: bool) {
        for n in 0..N {
            for g in 0..G {
                let sum = &mut self.potential[n][g];
                *sum = F::plus(simd, *sum, other.potential[n][g]);
                if gradient {
                    for c in 0..3 {
                        let sum = &mut self.gradient[c][n][g];
                        *sum = F::plus(simd, *sum, other.gradient[c][n][g]);
                    }
                }
            }
        }
    }

    /// Adds the sums to the values of the targets: potentials and gradients times `units`, columns times `charges`.
    #[inline(always)]
    pub(crate) fn add_to<T: Real, C: Numbers<Real = T>, O: Output<T, C>>(
        &self,
        units: [f64; 2],
        charges: &[f64; N],
        us: &mut [O::Value],
    ) {
        for (g, us) in us.chunks_mut(lanes::<F, S>()).enumerate() {
            let mut potential = [[0.0; LANES]; N];
            let mut gradient = [[[0.0; LANES]; N]; 3];
            for n in 0..N {
                potential[n] = numbers::<F, S>(self.potential[n][g], units[0], charges[n]);
                if O::GRADIENT {
                    for c in 0..3 {
                        let sum = self.gradient[c][n][g];
                        gradient[c][n] = numbers::<F, S>(sum, units[1], charges[n]);
                    }
                }
            }
            for (i, u) in us.iter_mut().enumerate() {
                let mut slope: [C; 3] = Numbers::zero();
                if O::GRADIENT {
                    for c in 0..3 {
                        slope[c] = from_columns::<C, f64, N, LANES>(&gradient[c], i);
                    }
                }
                O::add(u, &from_columns::<C, f64, N, LANES>(&potential, i), &slope);
            }
        }
    }
}

/// The numbers of a register, times two powers of two, one after the other.
#[inline(always)]
fn numbers<F: Registers, S: Simd>(sum: F::Register<S>, first: f64, second: f64) -> [f64; LANES] {
    let mut numbers = [F::from_f64(0.0); LANES];
    F::registers_mut::<S>(&mut numbers)[0] = sum;
    let mut scaled = [0.0; LANES];
    for i in 0..lanes::<F, S>() {
        scaled[i] = numbers[i].as_f64() * first * second;
    }
    scaled
}
