//! Blocks of pairs of surfels in wide registers: sources side by side, targets one by one.
//!
//! Code with wide registers must be inlined into the function that `pulp` compiles for the machine:
//! hence `#[inline(always)]` throughout.

use farfield::{Columns, Real, Vector};
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
    fn columns<const N: usize>(&mut self, first: usize) {
        if self.tolerance >= SINGLE { self.sum::<f32, N>(first) } else { self.sum::<f64, N>(first) }
    }

    #[inline(always)]
    fn sum<R: Lane, const N: usize>(&mut self, first: usize) {
        let Self { clamped, xs, ys, qs, pairs, .. } = *self;
        let width = N.min(C::WIDTH - first);
        let Some(origin) = xs.first().map(|x| x.position.to_array().map(T::as_f64)) else { return };
        // Lengths of about one: nothing overflows, however small or large the scene.
        let away = |p: [T; 3]| (0..3).map(move |k| (p[k].as_f64() - origin[k]).abs());
        let reach = ys.iter().flat_map(|y| away(y.position.to_array())).fold(0.0, f64::max);
        let unit = if reach > 0.0 { reach } else { 1.0 };
        let local = |p: [T; 3]| -> [R; 3] {
            std::array::from_fn(|k| R::of((p[k].as_f64() - origin[k]) / unit))
        };

        let packs: Vec<Pack<R, N>> = ys
            .chunks(LANES)
            .zip(qs.chunks(LANES))
            .map(|(ys, qs)| {
                let mut pack = Pack::EMPTY;
                for (lane, (y, q)) in ys.iter().zip(qs).enumerate() {
                    let (at, normal) = (local(y.position.to_array()), y.normal.to_array());
                    let weight = y.area.as_f64() / (unit * unit) * std::f64::consts::FRAC_1_PI;
                    for k in 0..3 {
                        pack.position[k][lane] = at[k];
                        pack.normal[k][lane] = R::of(normal[k].as_f64());
                    }
                    for n in 0..width {
                        pack.charge[n][lane] = R::of(weight * q.column(first + n).as_f64());
                    }
                }
                pack
            })
            .collect();

        for (i, (x, u)) in xs.iter().zip(&mut *self.us).enumerate() {
            let (at, normal) = (local(x.position.to_array()), x.normal.to_array());
            let normal = normal.map(|c| R::of(c.as_f64()));
            let counting = |pack: usize| {
                let (start, count) = (pack * LANES, (ys.len() - pack * LANES).min(LANES));
                match pairs {
                    Pairs::All => ((1u32 << count) - 1) as u16,
                    Pairs::Set(bits) => bits_from(bits, i * ys.len() + start, count),
                }
            };
            let sums = if clamped {
                at_target::<R, N, true>(&packs, counting, at, normal)
            } else {
                at_target::<R, N, false>(&packs, counting, at, normal)
            };
            for (n, sum) in sums.into_iter().enumerate().take(width) {
                u.set_column(first + n, u.column(first + n) + T::from_f64(sum));
            }
        }
    }
}

impl<T: Real, C: Columns<T>> WithSimd for Block<'_, T, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) {
        match C::WIDTH {
            1 => self.columns::<1>(0),
            2 => self.columns::<2>(0),
            3 => self.columns::<3>(0),
            width => {
                for first in (0..width).step_by(COLUMNS) {
                    self.columns::<COLUMNS>(first);
                }
            }
        }
    }
}

/// The number in one place of a register.
trait Lane:
    Copy
    + PartialOrd
    + std::ops::Add<Output = Self>
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
    + std::ops::Div<Output = Self>
{
    const ZERO: Self;
    const ONE: Self;
    fn of(x: f64) -> Self;
    fn as_f64(self) -> f64;
}

macro_rules! lane {
    ($t:ty) => {
        impl Lane for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as Self
            }
            #[inline(always)]
            fn as_f64(self) -> f64 {
                self.into()
            }
        }
    };
}

lane!(f32);
lane!(f64);

/// Sources, component by component.
struct Pack<R, const N: usize> {
    position: [[R; LANES]; 3],
    normal: [[R; LANES]; 3],
    /// A B/π per column.
    charge: [[R; LANES]; N],
}

impl<R: Lane, const N: usize> Pack<R, N> {
    const EMPTY: Self = Self {
        position: [[R::ZERO; LANES]; 3],
        normal: [[R::ZERO; LANES]; 3],
        charge: [[R::ZERO; LANES]; N],
    };
}

/// The sums at one target; `counting` gives the places of a pack that count.
#[inline(always)]
fn at_target<R: Lane, const N: usize, const CLAMPED: bool>(
    packs: &[Pack<R, N>],
    counting: impl Fn(usize) -> u16,
    x: [R; 3],
    normal: [R; 3],
) -> [f64; N] {
    let mut sums = [[R::ZERO; LANES]; N];
    for (p, pack) in packs.iter().enumerate() {
        let places = counting(p);
        if places == 0 {
            continue;
        }
        let mut factor = [R::ZERO; LANES];
        for l in 0..LANES {
            let d: [R; 3] = [
                x[0] - pack.position[0][l],
                x[1] - pack.position[1][l],
                x[2] - pack.position[2][l],
            ];
            let m = [pack.normal[0][l], pack.normal[1][l], pack.normal[2][l]];
            let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let source = d[0] * m[0] + d[1] * m[1] + d[2] * m[2];
            let receiver = R::ZERO - (d[0] * normal[0] + d[1] * normal[1] + d[2] * normal[2]);
            let mut counts = places >> l & 1 != 0 && r2 > R::ZERO;
            if CLAMPED {
                counts = counts & (receiver > R::ZERO) & (source > R::ZERO);
            }
            let inverse = R::ONE / r2;
            let product = (receiver * inverse) * (source * inverse);
            factor[l] = if counts { product } else { R::ZERO };
        }
        for n in 0..N {
            for l in 0..LANES {
                sums[n][l] = sums[n][l] + factor[l] * pack.charge[n][l];
            }
        }
    }
    let mut totals = [0.0; N];
    for n in 0..N {
        for l in 0..LANES {
            totals[n] += sums[n][l].as_f64();
        }
    }
    totals
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
