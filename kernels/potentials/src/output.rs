//! What a target receives: a potential, or a potential and its gradient.

use farfield::{Numbers, Real, Scalar};

/// What a target receives from a power law.
pub trait Output<T: Real, C: Numbers<Real = T>>: Send + Sync + 'static {
    /// The type of it.
    type Value: Numbers<Real = T>;
    /// Whether the gradient is part of it.
    const GRADIENT: bool;
    /// Adds a potential and, if it is part of the value, its gradient.
    fn add(value: &mut Self::Value, potential: &C, gradient: &[C; 3]);
}

/// The sum alone: a value of the same type as the charges.
#[derive(Clone, Copy, Debug, Default)]
pub struct Potential;

/// The sum and its gradient: a [`PotentialGradient`].
#[derive(Clone, Copy, Debug, Default)]
pub struct WithGradient;

impl<T: Real, C: Numbers<Real = T>> Output<T, C> for Potential {
    type Value = C;
    const GRADIENT: bool = false;

    #[inline(always)]
    fn add(value: &mut C, potential: &C, _gradient: &[C; 3]) {
        value.accumulate(potential);
    }
}

impl<T: Real, C: Numbers<Real = T>> Output<T, C> for WithGradient {
    type Value = PotentialGradient<C>;
    const GRADIENT: bool = true;

    #[inline(always)]
    fn add(value: &mut PotentialGradient<C>, potential: &C, gradient: &[C; 3]) {
        value.potential.accumulate(potential);
        value.gradient.accumulate(gradient);
    }
}

/// A potential u(x) and its gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PotentialGradient<C> {
    /// u
    pub potential: C,
    /// ∂u/∂x, ∂u/∂y, ∂u/∂z
    pub gradient: [C; 3],
}

impl<C: Numbers> Numbers for PotentialGradient<C> {
    type Real = C::Real;
    const LEN: usize = 4 * C::LEN;

    #[inline(always)]
    fn zero() -> Self {
        Self { potential: C::zero(), gradient: Numbers::zero() }
    }

    #[inline(always)]
    fn get(&self, index: usize) -> C::Real {
        if index < C::LEN { self.potential.get(index) } else { self.gradient.get(index - C::LEN) }
    }

    #[inline(always)]
    fn set(&mut self, index: usize, number: C::Real) {
        if index < C::LEN {
            self.potential.set(index, number);
        } else {
            self.gradient.set(index - C::LEN, number);
        }
    }

    #[inline(always)]
    fn add_scaled<S: Scalar<Real = C::Real>>(&mut self, scale: S, other: &Self) {
        self.potential.add_scaled(scale, &other.potential);
        self.gradient.add_scaled(scale, &other.gradient);
    }
}
