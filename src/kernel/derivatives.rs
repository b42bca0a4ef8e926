//! A formula together with its first and second derivatives.

use crate::kernel::formula::{Form, Formula, FormulaEntry};
use crate::numbers::number::Number;
use crate::numbers::traits::Numbers;

/// A value u(x), its gradient and its second derivatives with respect to x.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WithHessian<C> {
    /// u
    pub value: C,
    /// ∂u/∂x, ∂u/∂y, ∂u/∂z
    pub gradient: [C; 3],
    /// ∂²u/∂x², ∂²u/∂x∂y, ∂²u/∂x∂z, ∂²u/∂y², ∂²u/∂y∂z, ∂²u/∂z²
    pub hessian: [C; 6],
}

impl<C: Numbers> Numbers for WithHessian<C> {
    type Real = C::Real;
    const LEN: usize = {
        assert!(C::LEN > 0 || size_of::<C>() == 0, "a list has no length of its own");
        10 * C::LEN
    };

    fn zero() -> Self {
        Self { value: C::zero(), gradient: Numbers::zero(), hessian: Numbers::zero() }
    }

    fn number(&self, index: usize) -> C::Real {
        match index / C::LEN {
            0 => self.value.number(index),
            1..4 => self.gradient.number(index - C::LEN),
            _ => self.hessian.number(index - 4 * C::LEN),
        }
    }

    fn set_number(&mut self, index: usize, number: C::Real) {
        match index / C::LEN {
            0 => self.value.set_number(index, number),
            1..4 => self.gradient.set_number(index - C::LEN, number),
            _ => self.hessian.set_number(index - 4 * C::LEN, number),
        }
    }
}

/// The formula whose fields are those of another, then their three first derivatives with respect to the
/// target, then their six second derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Derivatives<F>(pub(super) F);

/// Entries that are kept without allocating.
const FEW: usize = 9;

/// The axes of the second derivatives, in the order of [`WithHessian::hessian`].
const SECOND: [[usize; 2]; 6] = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];

impl<F: Formula> Formula for Derivatives<F> {
    type Of = F::Of;
    type Entry<N: Number> = F::Entry<N>;

    fn identity(&self) -> Option<String> {
        self.0.identity().map(|name| format!("{name}, its derivatives"))
    }

    fn entries<N: Number>(&self, at: <F::Of as Form>::At<N>, g: &mut [F::Entry<N>]) {
        let at = F::Of::with_derivatives(F::Of::with_derivatives(at));
        let len = g.len() / 10;
        // No allocation for the usual sizes: this is the innermost loop.
        let (mut few, mut many) = ([FormulaEntry::zero(); FEW], Vec::new());
        let twice = if len <= FEW {
            &mut few[..len]
        } else {
            many.resize(len, FormulaEntry::zero());
            &mut many[..]
        };
        self.0.entries(at, twice);
        for (k, entry) in twice.iter().enumerate() {
            let parts = entry.parts();
            g[k] = FormulaEntry::from_parts(parts.map(|part| part.value.value));
            for axis in 0..3 {
                let slope = parts.map(|part| part.slope[axis].value);
                g[(1 + axis) * len + k] = FormulaEntry::from_parts(slope);
            }
            for (second, [a, b]) in SECOND.into_iter().enumerate() {
                let curvature = parts.map(|part| part.slope[a].slope[b]);
                g[(4 + second) * len + k] = FormulaEntry::from_parts(curvature);
            }
        }
    }

    fn fields(&self) -> usize {
        10 * self.0.fields()
    }

    fn densities(&self) -> usize {
        self.0.densities()
    }
}
