//! Blocks of pairs of surfels in wide registers: sources side by side, targets one by one.
//!
//! Code with wide registers must be inlined into the function that `pulp` compiles for the machine:
//! hence `#[inline(always)]` throughout, and loops over indices.

#![expect(clippy::needless_range_loop, reason = "closures of iterators may not be inlined")]

use farfield::{Columns, Real, Vector};
use farfield_potentials::registers::Registers;
use pulp::{Arch, Simd, WithSimd};

use crate::surfel::Surfel;

/// Which pairs of a block count.
#[derive(Clone, Copy)]
pub(crate) enum Pairs<'a> {
    /// All of them.
    All,
    /// Bit i·n + j is the pair of the i-th target and the j-th of n sources.
    Set(&'a [u64]),
}

/// H(x_i) += Σ_j K(x_i, y_j) A_j B_j for the pairs that count.
pub(crate) struct Block<'a, T: Real, C> {
    pub(crate) clamped: bool,
    pub(crate) xs: &'a [Surfel<T>],
    pub(crate) ys: &'a [Surfel<T>],
    pub(crate) qs: &'a [C],
    pub(crate) pairs: Pairs<'a>,
    /// The relative error that a pair may be off by.
    pub(crate) tolerance: f64,
    pub(crate) us: &'a mut [C],
}

/// Columns of charges that are summed together.
const COLUMNS: usize = 4;

/// Sources side by side: 512 bits of `f32`.
const LANES: usize = 16;

/// Single precision is taken for tolerances from here on: its round-off of 6e-8, some ten times over.
const SINGLE: f64 = 1e-6;

impl<T: Real, C: Columns<T>> Block<'_, T, C> {
    /// Adds the block with the best instructions that the machine has.
    pub(crate) fn run(self) {
        Arch::new().dispatch(self)
    }

    /// The columns from `first` on.
    #[inline(always)]
    fn columns<S: Simd, const N: usize>(&mut self, simd: S, first: usize) {
        if self.tolerance >= SINGLE {
            self.sum::<S, f32, N>(simd, first)
        } else {
            self.sum::<S, f64, N>(simd, first)
        }
    }

    #[inline(always)]
    fn sum<S: Simd, R: Registers, const N: usize>(&mut self, simd: S, first: usize) {
        let Self { clamped, xs, ys, qs, pairs, .. } = *self;
        let width = N.min(C::WIDTH - first);
        let Some(origin) = xs.first().map(|x| x.position.to_array().map(T::as_f64)) else { return };
        // Lengths of about one: nothing overflows, however small or large the scene.
        let away = |p: [T; 3]| (0..3).map(move |k| (p[k].as_f64() - origin[k]).abs());
        let reach = ys.iter().flat_map(|y| away(y.position.to_array())).fold(0.0, f64::max);
        let unit = if reach > 0.0 { reach } else { 1.0 };
        let local = |p: [T; 3]| -> [R; 3] {
            std::array::from_fn(|k| R::from_f64((p[k].as_f64() - origin[k]) / unit))
        };

        let packs: Vec<Pack<R, N>> = ys
            .chunks(LANES)
            .zip(qs.chunks(LANES))
            .map(|(ys, qs)| {
                let mut pack = Pack::empty();
                for (lane, (y, q)) in ys.iter().zip(qs).enumerate() {
                    let (at, normal) = (local(y.position.to_array()), y.normal.to_array());
                    let weight = y.area.as_f64() / (unit * unit) * std::f64::consts::FRAC_1_PI;
                    for k in 0..3 {
                        pack.position[k][lane] = at[k];
                        pack.normal[k][lane] = R::from_f64(normal[k].as_f64());
                    }
                    for n in 0..width {
                        pack.charge[n][lane] = R::from_f64(weight * q.column(first + n).as_f64());
                    }
                }
                pack
            })
            .collect();

        for (i, (x, u)) in xs.iter().zip(&mut *self.us).enumerate() {
            let (at, normal) = (local(x.position.to_array()), x.normal.to_array());
            let normal = normal.map(|c| R::from_f64(c.as_f64()));
            let counting = |pack: usize| {
                let (start, count) = (pack * LANES, (ys.len() - pack * LANES).min(LANES));
                match pairs {
                    Pairs::All => ((1u32 << count) - 1) as u16,
                    Pairs::Set(bits) => bits_from(bits, i * ys.len() + start, count),
                }
            };
            let sums = at_target::<S, R, N>(simd, clamped, &packs, counting, at, normal);
            for (n, sum) in sums.into_iter().enumerate().take(width) {
                u.set_column(first + n, u.column(first + n) + T::from_f64(sum.as_f64()));
            }
        }
    }
}

impl<T: Real, C: Columns<T>> WithSimd for Block<'_, T, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        match C::WIDTH {
            1 => self.columns::<S, 1>(simd, 0),
            2 => self.columns::<S, 2>(simd, 0),
            3 => self.columns::<S, 3>(simd, 0),
            width => {
                for first in (0..width).step_by(COLUMNS) {
                    self.columns::<S, COLUMNS>(simd, first);
                }
            }
        }
    }
}

/// Sources, component by component.
struct Pack<R, const N: usize> {
    position: [[R; LANES]; 3],
    normal: [[R; LANES]; 3],
    /// A B/π per column.
    charge: [[R; LANES]; N],
}

impl<R: Registers, const N: usize> Pack<R, N> {
    #[inline(always)]
    fn empty() -> Self {
        let zeros = [R::from_f64(0.0); LANES];
        Self { position: [zeros; 3], normal: [zeros; 3], charge: [zeros; N] }
    }
}

/// The sums at one target; `counting` gives the places of a pack that count.
#[inline(always)]
fn at_target<S: Simd, R: Registers, const N: usize>(
    simd: S,
    clamped: bool,
    packs: &[Pack<R, N>],
    counting: impl Fn(usize) -> u16,
    x: [R; 3],
    normal: [R; 3],
) -> [R; N] {
    let zero = R::splat(simd, R::from_f64(0.0));
    let one = R::from_f64(1.0);
    let ones = R::splat(simd, one);
    // Of coincident points both projections are 0, and 0 times this is.
    let least = R::splat(simd, R::min_positive_value());
    let mut at = [zero; 3];
    let mut away = [zero; 3];
    for k in 0..3 {
        at[k] = R::splat(simd, x[k]);
        away[k] = R::splat(simd, R::from_f64(0.0) - normal[k]);
    }
    let mut sums = [zero; N];
    for (p, pack) in packs.iter().enumerate() {
        let places = counting(p);
        if places == 0 {
            continue;
        }
        let mut weights = [R::from_f64(0.0); LANES];
        for l in 0..LANES {
            weights[l] = if places & (1 << l) != 0 { one } else { R::from_f64(0.0) };
        }
        let weights = R::registers::<S>(&weights);
        let [y0, y1, y2] = &pack.position;
        let y = [R::registers::<S>(y0), R::registers::<S>(y1), R::registers::<S>(y2)];
        let [m0, m1, m2] = &pack.normal;
        let m = [R::registers::<S>(m0), R::registers::<S>(m1), R::registers::<S>(m2)];
        for r in 0..weights.len() {
            let d = [
                R::minus(simd, at[0], y[0][r]),
                R::minus(simd, at[1], y[1][r]),
                R::minus(simd, at[2], y[2][r]),
            ];
            let r2 = dot::<S, R>(simd, d, d);
            let mut receiver = dot::<S, R>(simd, d, away);
            let mut source = dot::<S, R>(simd, d, [m[0][r], m[1][r], m[2][r]]);
            if clamped {
                receiver = R::where_at_least(simd, receiver, zero, receiver);
                source = R::where_at_least(simd, source, zero, source);
            }
            let inverse = R::one_over(simd, R::plus_product(simd, least, ones, r2));
            let cosines =
                R::times(simd, R::times(simd, receiver, inverse), R::times(simd, source, inverse));
            let factor = R::times(simd, cosines, weights[r]);
            for n in 0..N {
                let charges = R::registers::<S>(&pack.charge[n]);
                sums[n] = R::plus_product(simd, factor, charges[r], sums[n]);
            }
        }
    }
    let mut totals = [R::from_f64(0.0); N];
    for n in 0..N {
        totals[n] = R::sum(simd, sums[n]);
    }
    totals
}

#[inline(always)]
fn dot<S: Simd, R: Registers>(
    simd: S,
    a: [R::Register<S>; 3],
    b: [R::Register<S>; 3],
) -> R::Register<S> {
    let sum = R::times(simd, a[0], b[0]);
    R::plus_product(simd, a[2], b[2], R::plus_product(simd, a[1], b[1], sum))
}

/// `count` ≤ 16 bits from bit `first` on.
#[inline(always)]
fn bits_from(bits: &[u64], first: usize, count: usize) -> u16 {
    let (word, shift) = (first / 64, first % 64);
    let mut found = bits[word] >> shift;
    if shift + count > 64 {
        found |= bits[word + 1] << (64 - shift);
    }
    (found & ((1 << count) - 1)) as u16
}
