//! Blocks of double precision in registers of single precision, for tolerances that allow it.
//!
//! With c the middle of the sources, coordinates are rounded as differences from c, in units of a power of two:
//! a = (x − c)/2ᵏ, b = (y − c)/2ᵏ, d ≈ a − b. With u = 2⁻²⁴, X = |x − c| and |y − c| ≤ X + r, d is off by at most
//! u (2 X + r), and by u r more. A pair is close if
//!
//! r < 2 X/(ρ − 1),    that is, if (2 X + r)/r > ρ,
//!
//! where rounding may use too much of its tolerance; [`ratio`] says ρ. Close pairs are left out of the loop, as
//! coincident ones are, and summed in double precision.
//!
//! Charges are in units of a power of two for each column. Sums are formed in pieces of [`PIECE`] sources, and from
//! [`CHUNK`] to [`CHUNK`] in double precision. A piece without close pairs needs no comparison but of the least r²; one
//! that has them is summed once more. No target's sum depends on which others are in the block with it, but for whether
//! the block is summed like this, and for what is too close in units of its extent for powers to stay in range.

#![expect(clippy::needless_range_loop, reason = "closures of iterators may not be inlined")]

mod rounded;
#[cfg(test)]
mod tests;

use farfield::{Numbers, Point, Real, Vector};
use pulp::Simd;

use crate::exponent::Exponent;
use crate::group::{LANES, Sums, Targets, difference, group_size, lanes, load};
use crate::law::Law;
use crate::output::Output;
use crate::pair::add_pair;
use crate::reciprocal::Digits;
use crate::registers::Registers;
use crate::single::rounded::{CHUNK, Rounded, Sources, power_of_two, reach, round};

/// Sources whose sum is formed at a time.
const PIECE: usize = 32;
/// Sources whose bits a number of single precision holds.
const BITS: usize = 16;
/// Half the distance between 1 and the next number: the relative error of one rounding.
const ROUNDING: f64 = f32::EPSILON as f64 / 2.0;
/// r² of a pair that is close at any rate: that close, r⁻⁵ and r⁻⁴ in sums could overflow.
const CLOSE: f32 = 1.0 / (1u64 << 40) as f32;
/// Fewer targets, or fewer than fill a register, are not worth rounding the sources.
const LEAST_TARGETS: usize = 8;
/// Fewer sources are not worth rounding the targets.
const LEAST_SOURCES: usize = 4;
/// A lesser ρ makes too many pairs close.
const LEAST_RATIO: f64 = 16.0;
/// The greatest extent of a block, and the inverse of the least.
const GREATEST_EXTENT: f64 = (1u128 << 120) as f64;

/// How a block is rounded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Single {
    law: Law,
    digits: Digits,
    /// ρ
    ratio: f64,
    /// 2⁻ᵏ
    scale: f64,
}

impl Single {
    /// How to sum a block, if single precision serves its tolerance and is faster.
    #[inline(always)]
    pub(crate) fn of<S: Simd, E: Exponent, T: Real>(
        simd: S,
        law: Law,
        gradient: bool,
        tolerance: f64,
        (xs, ys): (&[Point<T>], &[Point<T>]),
    ) -> Option<Self> {
        let lanes = lanes::<f32, S>();
        // One number a register gains nothing.
        if lanes == 1 || xs.len() < LEAST_TARGETS.max(lanes) || ys.len() < LEAST_SOURCES {
            return None;
        }
        let serves = |digits| {
            let ratio = ratio::<S, E>(simd, law, digits, gradient, tolerance);
            (ratio >= LEAST_RATIO).then_some((digits, ratio))
        };
        let (digits, ratio) = serves(Digits::Few).or_else(|| serves(Digits::Half))?;
        let extent = reach::<T>(xs, ys[0]).max(reach::<T>(ys, ys[0]));
        // If the targets are as near to each other as close pairs are, then most pairs of theirs may be close.
        let spread = reach::<T>(xs, xs[0]) * ratio >= 4.0 * extent;
        let in_range = extent <= GREATEST_EXTENT && extent >= GREATEST_EXTENT.recip();
        let scale = power_of_two(extent).recip();
        (in_range && spread).then_some(Self { law, digits, ratio, scale })
    }

    /// Adds the block.
    #[inline(always)]
    pub(crate) fn sum<S, E, T, C, O, const N: usize>(
        self,
        simd: S,
        xs: &[Point<T>],
        ys: &[Point<T>],
        qs: &[C],
        us: &mut [O::Value],
    ) where
        S: Simd,
        E: Exponent,
        T: Real,
        C: Numbers<Real = T>,
        O: Output<T, C>,
    {
        let mut rounded = Rounded { positions: [[0.0; CHUNK]; 3], charges: [[0.0; CHUNK]; N] };
        for (ys, qs) in ys.chunks(CHUNK).zip(qs.chunks(CHUNK)) {
            let sources = Sources::round(self.scale, ys, qs, &mut rounded);
            // Two loops are compiled, each for its digits.
            if self.digits == Digits::Few {
                self.chunk::<S, E, T, C, O, N>(simd, Digits::Few, xs, &sources, us);
            } else {
                self.chunk::<S, E, T, C, O, N>(simd, Digits::Half, xs, &sources, us);
            }
        }
    }

    #[inline(always)]
    fn chunk<S, E, T, C, O, const N: usize>(
        self,
        simd: S,
        digits: Digits,
        mut xs: &[Point<T>],
        sources: &Sources<'_, T, C, N>,
        mut us: &mut [O::Value],
    ) where
        S: Simd,
        E: Exponent,
        T: Real,
        C: Numbers<Real = T>,
        O: Output<T, C>,
    {
        let lanes = lanes::<f32, S>();
        while !xs.is_empty() {
            let size = group_size::<S>(xs.len().div_ceil(lanes), N, O::GRADIENT);
            let count = (size * lanes).min(xs.len());
            let (x, rest_x) = xs.split_at(count);
            let (u, rest_u) = us.split_at_mut(count);
            if size == 1 {
                self.group::<S, E, T, C, O, 1, N>(simd, digits, x, sources, u);
            } else if size == 2 {
                self.group::<S, E, T, C, O, 2, N>(simd, digits, x, sources, u);
            } else {
                self.group::<S, E, T, C, O, 3, N>(simd, digits, x, sources, u);
            }
            (xs, us) = (rest_x, rest_u);
        }
    }

    #[inline(always)]
    fn group<S, E, T, C, O, const G: usize, const N: usize>(
        self,
        simd: S,
        digits: Digits,
        xs: &[Point<T>],
        sources: &Sources<'_, T, C, N>,
        us: &mut [O::Value],
    ) where
        S: Simd,
        E: Exponent,
        T: Real,
        C: Numbers<Real = T>,
        O: Output<T, C>,
    {
        let how = (self.law, digits, O::GRADIENT);
        let x = load::<f32, S, _, G>(simd, xs, |x| round::<T>(x, sources.centre, self.scale));
        let least = self.least(simd, &x);
        let one = f32::splat(simd, 1.0);
        let mut sums = Sums::<f32, S, G, N>::zero(simd);
        let count = sources.ys.len();
        for first in (0..count).step_by(PIECE) {
            let piece = first..(first + PIECE).min(count);
            let mut part = Sums::zero(simd);
            let mut nearest = [f32::splat(simd, f32::MAX); G];
            for j in piece.clone() {
                let (y, q) = sources.rounded.splat(simd, j);
                for g in 0..G {
                    let (d, r2) = difference::<f32, S, G>(simd, &x, g, y);
                    nearest[g] = f32::lesser(simd, nearest[g], r2);
                    part.add(simd, how, g, (d, r2), None, q);
                }
            }
            let mut apart = one;
            for g in 0..G {
                apart = f32::where_at_least(simd, nearest[g], least[g], apart);
            }
            if f32::sum(simd, apart) < lanes::<f32, S>() as f32 {
                // Σ 2ʲ over the sources apart, exact for so few of them.
                let mut apart = [[simd.splat_f32s(0.0); G]; PIECE / BITS];
                part = Sums::zero(simd);
                for j in piece.clone() {
                    let (y, q) = sources.rounded.splat(simd, j);
                    let bit = simd.splat_f32s((1 << (j % BITS)) as f32);
                    for g in 0..G {
                        let (d, r2) = difference::<f32, S, G>(simd, &x, g, y);
                        part.add(simd, how, g, (d, r2), Some(least[g]), q);
                        let bit = f32::where_at_least(simd, r2, least[g], bit);
                        let apart = &mut apart[(j - first) / BITS][g];
                        *apart = simd.add_f32s(*apart, bit);
                    }
                }
                for (k, apart) in apart.iter().enumerate() {
                    let these =
                        (first + k * BITS).min(piece.end)..(first + (k + 1) * BITS).min(piece.end);
                    let close = close::<S, G>(apart, these.len());
                    let (ys, qs) = (&sources.ys[these.clone()], &sources.qs[these]);
                    add_close::<E, T, C, O>(&close, lanes::<f32, S>(), xs, ys, qs, us);
                }
            }
            sums.accumulate(simd, &part, O::GRADIENT);
        }
        let [k, slope] = self.law.units::<f32, S>(simd, digits);
        // r^(−2λ) and r^(−2λ−1) in the units of lengths.
        let power = (2.0 * E::LAMBDA) as i32;
        let units =
            [k * self.scale.powi(power), -2.0 * E::LAMBDA * slope * self.scale.powi(power + 1)];
        sums.add_to::<T, C, O>(units, &sources.charges, us);
    }

    /// The least r² of pairs that aren't close, target by target.
    #[inline(always)]
    fn least<S: Simd, const G: usize>(
        self,
        simd: S,
        x: &Targets<f32, S, G>,
    ) -> [<f32 as Registers>::Register<S>; G] {
        // By so much r may be less than it was rounded to.
        let factor = (2.0 / (self.ratio - 1.0) + 4.0 * ROUNDING).powi(2) * (1.0 + 64.0 * ROUNDING);
        let factor = simd.splat_f32s(factor as f32);
        let mut least = [simd.splat_f32s(CLOSE); G];
        for g in 0..G {
            for x in x {
                let square = f32::times(simd, x[g], x[g]);
                least[g] = f32::plus_product(simd, square, factor, least[g]);
            }
        }
        least
    }
}

/// ρ: how many times as long as r the coordinates of a pair may be together.
///
/// K and its gradient are products of P = 2λ, or 2λ + 3, lengths, each off by η = ρ u and by roundings; the error of
/// the sum is bounded by one rounding for each term of a piece and for each piece. With e the [`error`](Law::error) of
/// reciprocals, all that is within the tolerance ε where
///
/// (1 − η)^(−P) (1 + e) (1 + (6 (P + 1) + PIECE + CHUNK/PIECE) u) ≤ 1 + ε.
///
/// With 1 + δ for what (1 − η)^(−P) may be and w = δ/(P (1 + δ)), η = w/(1 + w) is less than the solution, and near it.
#[inline(always)]
fn ratio<S: Simd, E: Exponent>(
    simd: S,
    law: Law,
    digits: Digits,
    gradient: bool,
    tolerance: f64,
) -> f64 {
    let lengths = 2.0 * E::LAMBDA + if gradient { 3.0 } else { 0.0 };
    let roundings = 6.0 * (lengths + 1.0) + (PIECE + CHUNK / PIECE) as f64;
    let error = law.error::<f32, S>(simd, digits, gradient);
    let rest = (1.0 + tolerance) / ((1.0 + error) * (1.0 + roundings * ROUNDING));
    let w = (rest - 1.0) / (lengths * rest);
    w / ((1.0 + w) * ROUNDING)
}

/// The bits of `count` sources that aren't in the sums of [`Single::group`], target by target.
#[inline(always)]
fn close<S: Simd, const G: usize>(apart: &[S::f32s; G], count: usize) -> [[u32; LANES]; G] {
    let mut close = [[0; LANES]; G];
    for g in 0..G {
        let mut places = [0.0; LANES];
        f32::registers_mut::<S>(&mut places)[0] = apart[g];
        for i in 0..LANES {
            close[g][i] = places[i] as u32 ^ ((1 << count) - 1);
        }
    }
    close
}

/// Adds the pairs whose bits are set, in double precision; there are so many targets in a register.
#[inline(never)]
fn add_close<E: Exponent, T: Real, C: Numbers<Real = T>, O: Output<T, C>>(
    close: &[[u32; LANES]],
    lanes: usize,
    xs: &[Point<T>],
    ys: &[Point<T>],
    qs: &[C],
    us: &mut [O::Value],
) {
    let close = close.iter().flat_map(|close| &close[..lanes]);
    for ((bits, x), u) in close.zip(xs).zip(us) {
        let mut bits = *bits;
        while bits != 0 {
            let j = bits.trailing_zeros() as usize;
            if x.to_array() != ys[j].to_array() {
                add_pair::<E, T, C, O>(*x, ys[j], &qs[j], u);
            }
            bits &= bits - 1;
        }
    }
}
