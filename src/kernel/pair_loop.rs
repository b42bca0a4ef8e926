//! The plain loop over pairs, compiled for wider registers than the build assumes.

use pulp::{Simd, WithSimd};

use crate::dispatch_level::dispatch_up_to_avx2;
use crate::numbers::lane::LANES;

/// `us[i]` += Σ_j K(x_i, y_j) q_j, each pair by `add`, with the same bits as the plain double loop.
///
/// A build for any x86-64 processor may use SSE2 only. Here the loop, with whatever `add` inlines
/// into it, is compiled a second time for AVX2 and FMA, and chosen at run time.
pub(crate) struct PairLoop<'a, F, X, Y, Q, U> {
    /// Adds one pair's contribution: `add(x, y, q, u)`.
    pub(crate) add: F,
    pub(crate) xs: &'a [X],
    pub(crate) ys: &'a [Y],
    pub(crate) qs: &'a [Q],
    pub(crate) us: &'a mut [U],
}

impl<F, X, Y, Q, U> PairLoop<'_, F, X, Y, Q, U>
where
    F: Fn(&X, &Y, &Q, &mut U),
    U: Clone,
{
    pub(crate) fn run(self) {
        // AVX-512 brings a formula nothing: the divider is no faster per number, and a call of a
        // scalar function such as `exp` from a loop in 512-bit registers costs a third of the speed.
        dispatch_up_to_avx2(self);
    }
}

impl<F, X, Y, Q, U> WithSimd for PairLoop<'_, F, X, Y, Q, U>
where
    F: Fn(&X, &Y, &Q, &mut U),
    U: Clone,
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self { add, xs, ys, qs, us } = self;
        let ragged = xs.len() % LANES;
        if ragged > 0 {
            if let (Some(x), Some(u)) = (xs.first_chunk(), us.first_chunk_mut::<LANES>()) {
                // The lanes beyond the ragged ones belong to targets that come again below.
                let sums = side_by_side(&add, x, ys, qs, u.clone());
                u[..ragged].clone_from_slice(&sums[..ragged]);
            } else {
                for (x, u) in xs.iter().zip(&mut *us) {
                    for (y, q) in ys.iter().zip(qs) {
                        add(x, y, q, u);
                    }
                }
            }
        }
        let (xs, us) = (xs[ragged..].as_chunks().0, us[ragged..].as_chunks_mut().0);
        for (x, u) in xs.iter().zip(us) {
            *u = side_by_side(&add, x, ys, qs, u.clone());
        }
    }
}

#[inline(always)]
fn side_by_side<X, Y, Q, U: Clone>(
    add: &impl Fn(&X, &Y, &Q, &mut U),
    xs: &[X; LANES],
    ys: &[Y],
    qs: &[Q],
    mut us: [U; LANES],
) -> [U; LANES] {
    for (y, q) in ys.iter().zip(qs) {
        for (x, u) in xs.iter().zip(&mut us) {
            add(x, y, q, u);
        }
    }
    us
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dispatch_level::DispatchLevel;
    use crate::numbers::traits::Numbers;
    use glam::DVec3;
    use num_complex::Complex;

    fn check<U: Numbers<Real = f64> + PartialEq>(
        add: impl Fn(&DVec3, &DVec3, &U, &mut U) + Copy,
        (xs, ys): (&[DVec3], &[DVec3]),
        charge: impl Fn(f64) -> U,
    ) {
        let qs: Vec<U> = (0..ys.len()).map(|j| charge((j as f64).cos())).collect();
        for n in 0..=xs.len() {
            for m in [0, 1, 2, ys.len()] {
                let (xs, ys, qs) = (&xs[..n], &ys[..m], &qs[..m]);
                let mut plain = vec![U::zero(); n];
                for (x, u) in xs.iter().zip(&mut plain) {
                    for _ in 0..2 {
                        ys.iter().zip(qs).for_each(|(y, q)| add(x, y, q, u));
                    }
                }
                let mut best = vec![U::zero(); n];
                let mut portable = best.clone();
                for _ in 0..2 {
                    PairLoop { add, xs, ys, qs, us: &mut best }.run();
                    let us = &mut portable;
                    DispatchLevel::Portable.run(PairLoop { add, xs, ys, qs, us });
                }
                assert!(best == plain && portable == plain, "{n} targets, {m} sources");
            }
        }
    }

    #[test]
    fn every_size_gives_the_bits_of_the_double_loop() {
        let points = |shift: f64| {
            let at = move |i: i32| (DVec3::new(0.819, 0.671, 0.549) * f64::from(i) + shift).fract();
            (0..27).map(at).collect::<Vec<_>>()
        };
        let (xs, mut ys) = (points(0.0), points(0.25));
        ys[3] = xs[9];
        let sets = (&xs[..], &ys[..]);
        let inverse = |x: &DVec3, y: &DVec3| if x == y { 0.0 } else { 1.0 / x.distance(*y) };
        check(|x, y, q: &f64, u| *u += inverse(x, y) * q, sets, |t| t);
        check(|x, y, q: &[f64; 3], u| u.add_scaled(inverse(x, y), q), sets, |t| [t, 1.0, -t]);
        check(|x, y, q: &f64, u| *u += (-x.distance(*y)).exp() * q, sets, |t| t);
        let wave = |x: &DVec3, y: &DVec3, q: &Complex<f64>, u: &mut Complex<f64>| {
            let r = x.distance(*y);
            *u += Complex::from_polar(if x == y { 0.0 } else { 1.0 / r }, 3.0 * r) * q;
        };
        check(wave, sets, |t| Complex::new(t, 1.0));
    }
}
