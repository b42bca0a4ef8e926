//! A value together with its gradient.

use crate::numbers::traits::Numbers;

/// A value u(x) and its gradient with respect to x.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WithGradient<C> {
    /// u
    pub value: C,
    /// ∂u/∂x, ∂u/∂y, ∂u/∂z
    pub gradient: [C; 3],
}

impl<C: Numbers> Numbers for WithGradient<C> {
    type Real = C::Real;
    const LEN: usize = 4 * C::LEN;

    #[inline(always)]
    fn zero() -> Self {
        Self { value: C::zero(), gradient: Numbers::zero() }
    }

    #[inline(always)]
    fn get(&self, index: usize) -> C::Real {
        if index < C::LEN { self.value.get(index) } else { self.gradient.get(index - C::LEN) }
    }

    #[inline(always)]
    fn set(&mut self, index: usize, number: C::Real) {
        if index < C::LEN {
            self.value.set(index, number);
        } else {
            self.gradient.set(index - C::LEN, number);
        }
    }
}
