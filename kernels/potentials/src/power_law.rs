//! The kernels |x − y|^(−2λ), as potentials or with their gradients.

use std::fmt;
use std::marker::PhantomData;

use farfield::{DispatchLevel, Kernel, Numbers, Outcome, Point, Real};

use crate::exponent::{Exponent, MinusFour, MinusOne, MinusTwo, PlusTwo};
use crate::near_field::Block;
use crate::output::{Output, Potential, WithGradient};
use crate::pair::{add_pair, evaluate};

/// The potential 1/r of charges and masses, 0 at r = 0.
pub type InverseDistance<T, C = T, O = Potential> = PowerLaw<MinusOne, T, C, O>;
/// 1/r², 0 at r = 0.
pub type InverseSquare<T, C = T, O = Potential> = PowerLaw<MinusTwo, T, C, O>;
/// 1/r⁴, 0 at r = 0: the radial factor of diffuse exchange.
pub type InverseFourth<T, C = T, O = Potential> = PowerLaw<MinusFour, T, C, O>;
/// r²: the smooth power law, whose expansion is finite and exact.
pub type SquaredDistance<T, C = T, O = Potential> = PowerLaw<PlusTwo, T, C, O>;

/// The kernel K(x, y) = |x − y|^(−2λ) between bare points, 0 at coincident points.
///
/// `C` is the charge: a number, or several right-hand sides. `O` says what a target receives:
/// [`Potential`] the sum, [`WithGradient`] its gradient ∇_x too. A result overflows only where
/// the exact one does, however small or large |x − y|.
///
/// ```
/// use farfield_potentials::InverseDistance;
/// use glam::DVec3;
/// let kernel = InverseDistance::<f64>::new().with_gradient();
/// let u = farfield::direct(&kernel, &[DVec3::ZERO], &[3.0], &[DVec3::X * 2.0])?;
/// assert_eq!((u[0].potential, u[0].gradient), (1.5, [-0.75, 0.0, 0.0]));
/// # Ok::<(), farfield::Error>(())
/// ```
pub struct PowerLaw<E, T, C = T, O = Potential> {
    types: PhantomData<(E, T, C, O)>,
}

impl<E, T> PowerLaw<E, T> {
    /// The potential for charges of type `T`.
    pub fn new() -> Self {
        Self { types: PhantomData }
    }
}

impl<E, T, C, O> PowerLaw<E, T, C, O> {
    /// The same kernel for charges of another type, such as `[f64; 3]` for three right-hand sides.
    pub fn charges<D>(self) -> PowerLaw<E, T, D, O> {
        PowerLaw { types: PhantomData }
    }

    /// The same kernel with the potential's gradient as part of the value.
    pub fn with_gradient(self) -> PowerLaw<E, T, C, WithGradient> {
        PowerLaw { types: PhantomData }
    }
}

impl<E, T, C, O> Clone for PowerLaw<E, T, C, O> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<E, T, C, O> Copy for PowerLaw<E, T, C, O> {}

impl<E, T, C, O> Default for PowerLaw<E, T, C, O> {
    fn default() -> Self {
        Self { types: PhantomData }
    }
}

impl<E: Exponent, T, C, O> fmt::Debug for PowerLaw<E, T, C, O> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PowerLaw").field("lambda", &E::LAMBDA).finish()
    }
}

impl<E: Exponent, T: Real, C: Numbers<Real = T>, O: Output<T, C>> Kernel for PowerLaw<E, T, C, O> {
    type Real = T;
    type Source = Point<T>;
    type Target = Point<T>;
    type Charge = C;
    type Value = O::Value;
    type Entry = T;

    fn identity(&self) -> Option<String> {
        Some(format!("|x - y|^{}", -2.0 * E::LAMBDA))
    }

    fn pair_seconds(&self, tolerance: f64) -> f64 {
        let numbers = C::LEN * if O::GRADIENT { 4 } else { 1 };
        pair_seconds(size_of::<T>(), numbers, tolerance)
    }

    fn add_block(
        &self,
        xs: &[Point<T>],
        ys: &[Point<T>],
        qs: &[C],
        tolerance: f64,
        us: &mut [O::Value],
    ) {
        // The inner loop asks for a precision by its name; both are the same to the compiler.
        let outcome = if const { size_of::<T>() == size_of::<f32>() } {
            Block::<E, f32, T, C, O> { xs, ys, qs, tolerance, us: &mut *us, types: PhantomData }
                .run()
        } else {
            Block::<E, f64, T, C, O> { xs, ys, qs, tolerance, us: &mut *us, types: PhantomData }
                .run()
        };
        if outcome == Outcome::Declined {
            for (x, u) in xs.iter().zip(us) {
                for (y, q) in ys.iter().zip(qs) {
                    add_pair::<E, T, C, O>(*x, *y, q, u);
                }
            }
        }
    }

    fn entries(&self, x: Point<T>, y: Point<T>, g: &mut [T]) {
        g[0] = evaluate::<E, T>(x, y).0;
    }

    #[inline(always)]
    fn needs_gradients(&self) -> bool {
        O::GRADIENT
    }

    fn entry_gradients(&self, x: Point<T>, y: Point<T>, g: &mut [[T; 3]]) -> Outcome {
        g[0] = evaluate::<E, T>(x, y).1;
        Outcome::Done
    }

    fn value(&self, _x: &Point<T>, fields: &[T], gradients: &[[T; 3]], u: &mut O::Value) {
        let (mut potential, mut gradient): (C, [C; 3]) = (C::zero(), Numbers::zero());
        for (k, &field) in fields.iter().enumerate() {
            potential.set_number(k, field);
        }
        for (k, slope) in gradients.iter().enumerate() {
            for (component, &slope) in gradient.iter_mut().zip(slope) {
                component.set_number(k, slope);
            }
        }
        O::add(u, &potential, &gradient);
    }
}

/// Seconds of one core for a pair in precisions of so many bytes that contributes so many numbers: measured for 1/r
/// on one AVX-512 machine at every level. Few digits are those that blocks of double precision are summed in single
/// precision for, or that estimates of reciprocals have without a term of their series.
fn pair_seconds(bytes: usize, numbers: usize, tolerance: f64) -> f64 {
    let single = bytes == size_of::<f32>();
    let [few_digits, all] = match (DispatchLevel::in_force(), single) {
        (Ok(DispatchLevel::Avx512), false) => [1.5e-10, 3e-10],
        (Ok(DispatchLevel::Avx512), true) => [1e-10, 1.5e-10],
        (Ok(DispatchLevel::Avx2), false) => [1.8e-10, 7e-10],
        (Ok(DispatchLevel::Avx2), true) => [2.5e-10, 3.5e-10],
        (_, false) => [1.7e-9; 2],
        (_, true) => [8.5e-10; 2],
    };
    let few = tolerance >= if single { 1e-4 } else { 1e-5 };
    (if few { few_digits } else { all }) * (1.0 + 0.15 * numbers.saturating_sub(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::PotentialGradient;
    use crate::pair::scaled;
    use approx::assert_relative_eq;
    use farfield::{Numbers, direct, relative_l2_error};
    use glam::{DVec3, Vec3};

    fn points(n: usize, seed: f64) -> Vec<DVec3> {
        let fraction = |x: f64| (x.sin() * 43_758.545_3).fract();
        (0..n)
            .map(|i| seed + 3.0 * i as f64)
            .map(|t| DVec3::new(fraction(t), fraction(t + 1.0), fraction(t + 2.0)))
            .collect()
    }

    #[test]
    fn values_of_all_four() {
        let (x, y, q) = ([DVec3::new(1.0, 2.0, 4.0)], [DVec3::new(-1.0, 1.0, 2.0)], [2.0]);
        // r = 3
        assert_relative_eq!(
            direct(&InverseDistance::<f64>::new(), &y, &q, &x).unwrap()[0],
            2.0 / 3.0
        );
        assert_relative_eq!(
            direct(&InverseSquare::<f64>::new(), &y, &q, &x).unwrap()[0],
            2.0 / 9.0
        );
        assert_relative_eq!(
            direct(&InverseFourth::<f64>::new(), &y, &q, &x).unwrap()[0],
            2.0 / 81.0
        );
        assert_relative_eq!(direct(&SquaredDistance::<f64>::new(), &y, &q, &x).unwrap()[0], 18.0);
    }

    #[test]
    fn gradients_agree_with_differences() {
        fn check<E: Exponent>() {
            let (x, y) = (DVec3::new(0.3, -0.2, 0.9), DVec3::new(-0.5, 0.4, 0.1));
            let (_, gradient) = evaluate::<E, f64>(x, y);
            for (component, axis) in gradient.into_iter().zip(DVec3::AXES) {
                let h = axis * 1e-5;
                let difference =
                    (evaluate::<E, f64>(x + h, y).0 - evaluate::<E, f64>(x - h, y).0) / 2e-5;
                assert_relative_eq!(component, difference, max_relative = 1e-8);
            }
        }
        check::<MinusOne>();
        check::<MinusTwo>();
        check::<MinusFour>();
        check::<PlusTwo>();
    }

    #[test]
    fn blocks_agree_with_pairs() {
        fn check<E: Exponent>() {
            let (mut xs, ys) = (points(19, 0.0), points(23, 0.5));
            xs[3] = ys[7];
            xs[18] = ys[0] + DVec3::X * 1e-160;
            let qs: Vec<_> = points(23, 0.7).into_iter().map(|p| p.to_array()).collect();
            let kernel = PowerLaw::<E, f64>::new().charges::<[f64; 3]>().with_gradient();
            let mut block = vec![Numbers::zero(); xs.len()];
            kernel.add_block(&xs, &ys, &qs, 0.0, &mut block);
            let mut pairs: Vec<PotentialGradient<[f64; 3]>> = vec![Numbers::zero(); xs.len()];
            for (x, u) in xs.iter().zip(&mut pairs) {
                for (y, q) in ys.iter().zip(&qs) {
                    let (k, gradient) = evaluate::<E, f64>(*x, *y);
                    let [a, b, c] = gradient.map(|component| scaled(component, q));
                    u.accumulate(&PotentialGradient {
                        potential: scaled(k, q),
                        gradient: [a, b, c],
                    });
                }
            }
            assert!(relative_l2_error(&block, &pairs) < 1e-15);
            assert!(block.iter().zip(&pairs).all(|(a, b)| relative_l2_error(&[*a], &[*b]) < 1e-14));
        }
        check::<MinusOne>();
        check::<MinusTwo>();
        check::<PlusTwo>();
    }

    #[test]
    fn coincident_points_contribute_nothing() {
        let at = [DVec3::ONE];
        let kernel = InverseFourth::<f64>::new().with_gradient();
        assert_eq!(direct(&kernel, &at, &[1.0], &at).unwrap()[0], Default::default());
        let mut entry = [1.0];
        InverseDistance::<f64>::new().entries(at[0], at[0], &mut entry);
        assert_eq!(entry, [0.0]);
    }

    #[test]
    fn extreme_distances_keep_their_digits() {
        for r in [1e-300, 1e-200, 1e-155, 1e155, 1e300] {
            let x = [DVec3::new(0.6, 0.0, -0.8) * r];
            let u = direct(&InverseDistance::<f64>::new(), &[DVec3::ZERO], &[1.0], &x).unwrap()[0];
            assert_relative_eq!(u, 1.0 / r, max_relative = 1e-14);
        }
        let x = [Vec3::new(0.0, 1e-9, 0.0)];
        let u = direct(&InverseFourth::<f32>::new(), &[Vec3::ZERO], &[1e-3], &x).unwrap()[0];
        assert_relative_eq!(u, 1e33, max_relative = 1e-5);
        let kernel = InverseDistance::<f32>::new().with_gradient();
        let x = [Vec3::new(0.0, 0.0, 1e-18)];
        let u = direct(&kernel, &[Vec3::ZERO], &[1.0], &x).unwrap()[0];
        assert_relative_eq!(u.gradient[2], -1e36, max_relative = 1e-5);
    }
}
