//! A value together with its gradient.

use crate::numbers::traits::{Numbers, Scalar};

/// A value u(x) and its gradient with respect to x.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WithGradient<C> {
    /// u
    pub value: C,
    /// ∂u/∂x, ∂u/∂y, ∂u/∂z
    pub gradient: [C; 3],
}

impl<C: Numbers> WithGradient<C> {
    /// Adds fields and their gradients, number by number.
    #[inline(always)]
    pub(super) fn add<S: Scalar<Real = C::Real>>(&mut self, fields: &[S], gradients: &[[S; 3]]) {
        for (k, (&field, gradient)) in fields.iter().zip(gradients).enumerate() {
            self.value.set_column(k, self.value.column::<S>(k) + field);
            for (sum, &part) in self.gradient.iter_mut().zip(gradient) {
                sum.set_column(k, sum.column::<S>(k) + part);
            }
        }
    }
}

impl<C: Numbers> Numbers for WithGradient<C> {
    type Real = C::Real;
    const LEN: usize = {
        assert!(C::LEN > 0 || size_of::<C>() == 0, "a list has no length of its own");
        4 * C::LEN
    };

    #[inline(always)]
    fn zero() -> Self {
        Self { value: C::zero(), gradient: Numbers::zero() }
    }

    #[inline(always)]
    fn number(&self, index: usize) -> C::Real {
        if index < C::LEN { self.value.number(index) } else { self.gradient.number(index - C::LEN) }
    }

    #[inline(always)]
    fn set_number(&mut self, index: usize, number: C::Real) {
        if index < C::LEN {
            self.value.set_number(index, number);
        } else {
            self.gradient.set_number(index - C::LEN, number);
        }
    }
}
