//! Blocks of pairs of surfels in wide registers: sources side by side, targets one by one.
//!
//! Code with wide registers must be inlined into the function that `pulp` compiles for the machine:
//! hence `#[inline(always)]` throughout, and loops over indices.

#![expect(clippy::needless_range_loop, reason = "closures of iterators may not be inlined")]

use farfield::{Numbers, Real, Vector, dispatch};
use farfield_potentials::registers::Registers;
use pulp::{Simd, WithSimd};

use crate::elements::Surfel;

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

impl<T: Real, C: Numbers<Real = T>> Block<'_, T, C> {
    /// Adds the block with the best instructions that the machine has.
    pub(crate) fn run(self) {
        dispatch(self)
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
        let width = N.min(C::LEN - first);
        let Some(origin) = xs.first().map(|x| x.position.to_array().map(T::as_f64)) else { return };
        // Lengths of at most about one: nothing overflows, however small or large the scene.
        let away = |p: [T; 3]| (0..3).map(move |k| (p[k].as_f64() - origin[k]).abs());
        let all = xs.iter().chain(ys);
        let reach = all.flat_map(|p| away(p.position.to_array())).fold(0.0, f64::max);
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
                        pack.charge[n][lane] = R::from_f64(weight * q.get(first + n).as_f64());
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
                u.set(first + n, u.get(first + n) + T::from_f64(sum.as_f64()));
            }
        }
    }
}

impl<T: Real, C: Numbers<Real = T>> WithSimd for Block<'_, T, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        match C::LEN {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::Projections;
    use crate::expansion::Irradiance;
    use crate::numbers::mixed;
    use glam::DVec3;

    /// `n` surfels in a unit cube at `centre` that look about `towards`, all times `scale`.
    fn cloud(n: usize, seed: u64, centre: DVec3, towards: DVec3, scale: f64) -> Vec<Surfel> {
        let random = |i: usize, k: u64| {
            let bits = mixed(seed * 1_000_003 + 16 * i as u64 + k) >> 11;
            bits as f64 / (1u64 << 53) as f64 - 0.5
        };
        let vector = |i: usize, k: u64| DVec3::from([k, k + 1, k + 2].map(|k| random(i, k)));
        (0..n)
            .map(|i| Surfel {
                position: scale * (centre + vector(i, 0)),
                normal: (towards + 2.0 * vector(i, 3)).normalize(),
                area: scale * scale * (0.01 + 0.01 * random(i, 6)),
                face: 0,
            })
            .collect()
    }

    /// The plain sum of what counts, in double precision, and what it would be without the cosines.
    fn plainly<T: Real, const N: usize>(
        clamped: bool,
        (xs, ys): (&[Surfel<T>], &[Surfel<T>]),
        qs: &[[T; N]],
        counts: impl Fn(usize, usize) -> bool,
    ) -> Vec<([f64; N], f64)> {
        let kernel = if clamped { Irradiance::<f64>::clamped() } else { Irradiance::signed() };
        let ys: Vec<Surfel> = ys.iter().map(Surfel::cast).collect();
        let at = |(i, x): (usize, &Surfel<T>)| {
            let x = x.cast();
            let (mut sums, mut size) = ([0.0; N], 0.0);
            for (j, y) in ys.iter().enumerate().filter(|(j, _)| counts(i, *j)) {
                let factor = kernel.factor(&x, y) * y.area;
                for (sum, q) in sums.iter_mut().zip(qs[j]) {
                    *sum += factor * q.as_f64();
                }
                let r2 = Projections::new(&x, y).distance_squared;
                size += if r2 > 0.0 { y.area / r2 } else { 0.0 };
            }
            (sums, size)
        };
        xs.iter().enumerate().map(at).collect()
    }

    /// Compares a block with the plain sum, both added to 1; charges are less than 2.
    #[track_caller]
    fn check<T: Real, const N: usize>(
        (xs, ys): (&[Surfel<T>], &[Surfel<T>]),
        bits: Option<&[u64]>,
        clamped: bool,
        tolerance: f64,
        bound: f64,
    ) where
        [T; N]: Numbers<Real = T>,
    {
        let charge = |j: usize, k: usize| T::from_f64((1.7 * j as f64 + k as f64).sin() + 0.5);
        let qs: Vec<[T; N]> =
            (0..ys.len()).map(|j| std::array::from_fn(|k| charge(j, k))).collect();
        let counts = |i: usize, j: usize| {
            let at = i * ys.len() + j;
            bits.is_none_or(|bits| bits[at / 64] >> (at % 64) & 1 == 1)
        };
        let exact = plainly(clamped, (xs, ys), &qs, counts);
        let mut us = vec![[T::from_f64(1.0); N]; xs.len()];
        let pairs = bits.map_or(Pairs::All, Pairs::Set);
        Block { clamped, xs, ys, qs: &qs, pairs, tolerance, us: &mut us }.run();
        for (u, (sums, size)) in us.iter().zip(exact) {
            for (u, sum) in u.iter().zip(sums) {
                let error = (u.as_f64() - 1.0 - sum).abs();
                let allowed = bound * size + T::epsilon().as_f64() * (1.0 + sum.abs());
                assert!(error <= allowed, "{u} - 1 is not {sum}: {error:e}, not {allowed:e}");
            }
        }
    }

    /// Words of random bits for so many pairs; the bits beyond them are random too.
    fn words(pairs: usize) -> Vec<u64> {
        (0..pairs.div_ceil(64)).map(|k| mixed(k as u64) & mixed(k as u64 + 77)).collect()
    }

    /// Of the tolerances 0 and 1e-3, what sums may be off by relative to those without cosines.
    const BOUNDS: [(f64, f64); 2] = [(0.0, 1e-13), (1e-3, 1e-5)];

    #[test]
    fn blocks_of_all_sizes_are_the_plain_sums() {
        let all_xs = cloud(40, 1, DVec3::ZERO, DVec3::Z, 1.0);
        let all_ys = cloud(40, 2, DVec3::Z * 1.2, -DVec3::Z, 1.0);
        for n in 0..=40 {
            for m in 0..=40 {
                let (pair, bits) = ((&all_xs[..n], &all_ys[..m]), words(n * m));
                for (tolerance, bound) in BOUNDS {
                    check::<f64, 2>(pair, None, false, tolerance, bound);
                    check::<f64, 1>(pair, Some(&bits), false, tolerance, bound);
                    // The plain sum leaves out cosines below √ε.
                    check::<f64, 1>(pair, Some(&bits), true, tolerance, bound.max(1e-8));
                }
            }
        }
    }

    #[test]
    fn every_column_gets_its_own_sum() {
        let xs = cloud(19, 3, DVec3::ZERO, DVec3::Z, 1.0);
        let ys = cloud(37, 4, DVec3::Z, -DVec3::Z, 1.0);
        let bits = words(19 * 37);
        for (tolerance, bound) in BOUNDS {
            for bits in [None, Some(&bits[..])] {
                check::<f64, 1>((&xs, &ys), bits, false, tolerance, bound);
                check::<f64, 4>((&xs, &ys), bits, false, tolerance, bound);
                check::<f64, 5>((&xs, &ys), bits, false, tolerance, bound);
            }
        }
    }

    #[test]
    fn single_precision_surfels() {
        let single = |cloud: Vec<Surfel>| cloud.iter().map(Surfel::cast).collect::<Vec<_>>();
        let xs: Vec<Surfel<f32>> = single(cloud(23, 5, DVec3::ZERO, DVec3::Z, 1.0));
        let ys: Vec<Surfel<f32>> = single(cloud(33, 6, DVec3::Z, -DVec3::Z, 1.0));
        let bits = words(23 * 33);
        for (tolerance, bound) in [(0.0, 1e-7), (1e-3, 1e-5)] {
            for clamped in [true, false] {
                check::<f32, 3>((&xs, &ys), None, clamped, tolerance, bound);
                check::<f32, 5>((&xs, &ys), Some(&bits), clamped, tolerance, bound);
            }
        }
    }

    #[test]
    fn scenes_of_any_size_and_far_from_the_origin() {
        for scale in [1e-20, 1e-3, 1e20] {
            let xs = cloud(21, 7, DVec3::splat(3.0), DVec3::Z, scale);
            let ys = cloud(21, 8, DVec3::splat(3.5), -DVec3::Z, scale);
            for (tolerance, bound) in BOUNDS {
                check::<f64, 3>((&xs, &ys), None, false, tolerance, bound);
                check::<f64, 3>((&xs, &ys), None, true, tolerance, bound.max(1e-8));
            }
        }
    }

    #[test]
    fn coincident_points_exchange_nothing() {
        let both = cloud(18, 9, DVec3::ZERO, DVec3::Z, 1.0);
        for (tolerance, bound) in BOUNDS {
            check::<f64, 3>((&both, &both), None, false, tolerance, bound);
            check::<f64, 3>((&both, &both), None, true, tolerance, bound.max(1e-8));
            check::<f64, 3>((&[both[0]; 5], &[both[0]; 5]), None, false, tolerance, bound);
        }
    }

    #[test]
    fn sources_next_to_the_first_target_reach_the_others() {
        let mut xs = cloud(3, 10, DVec3::Z * 2.0, -DVec3::Z, 1e3);
        let first = Surfel { position: DVec3::ZERO, normal: DVec3::Z, area: 1e4, face: 0 };
        xs.insert(0, first);
        let ys = [Surfel { position: DVec3::X * 1e-25, ..first }];
        for (tolerance, bound) in BOUNDS {
            // The first itself is too close for single precision to tell from coincident.
            check::<f64, 3>((&xs, &ys), Some(&[0b1110]), false, tolerance, bound);
        }
    }
}
