//! What a target receives: a potential, or a potential and its gradient.

use farfield::{Additive, Linear, Real};

/// What a target receives from a power law.
pub trait Output<T: Real, C: Linear<T>>: Send + Sync + 'static {
    /// The type of it.
    type Value: Linear<T>;
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

impl<T: Real, C: Linear<T>> Output<T, C> for Potential {
    type Value = C;
    const GRADIENT: bool = false;

    #[inline(always)]
    fn add(value: &mut C, potential: &C, _gradient: &[C; 3]) {
        value.accumulate(potential);
    }
}

impl<T: Real, C: Linear<T>> Output<T, C> for WithGradient {
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

impl<C: Additive> Additive for PotentialGradient<C> {
    #[inline(always)]
    fn zero() -> Self {
        Self { potential: C::zero(), gradient: Additive::zero() }
    }
    #[inline(always)]
    fn accumulate(&mut self, other: &Self) {
        self.potential.accumulate(&other.potential);
        self.gradient.accumulate(&other.gradient);
    }
    #[inline(always)]
    fn subtract(&mut self, other: &Self) {
        self.potential.subtract(&other.potential);
        self.gradient.subtract(&other.gradient);
    }
    #[inline(always)]
    fn is_finite(&self) -> bool {
        self.potential.is_finite() && self.gradient.is_finite()
    }
    #[inline(always)]
    fn norm(&self) -> f64 {
        let [x, y, z] = self.gradient;
        [self.potential, x, y, z].norm()
    }
}

impl<S: Copy, C: Linear<S>> Linear<S> for PotentialGradient<C> {
    #[inline(always)]
    fn add_scaled(&mut self, scale: S, other: &Self) {
        self.potential.add_scaled(scale, &other.potential);
        self.gradient.add_scaled(scale, &other.gradient);
    }
}
