//! Numbers that count what is done with them.

use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::numbers::number::Number;
use crate::numbers::traits::{Real, sealed};

/// A number that counts the operations of a formula, for all numbers of a thread together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Counted<T>(T);

/// What evaluating a formula takes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Operations {
    /// Sums, products, comparisons and choices.
    pub(crate) simple: f64,
    /// Quotients and square roots, for which registers have no more units if they are wider.
    pub(crate) slow: f64,
}

thread_local! {
    static SO_FAR: Cell<Operations> = const { Cell::new(Operations { simple: 0.0, slow: 0.0 }) };
}

/// What is done with numbers of the type [`Counted`] while `evaluate` runs.
pub(crate) fn operations(evaluate: impl FnOnce()) -> Operations {
    let before = SO_FAR.take();
    evaluate();
    SO_FAR.replace(before)
}

/// Counts these operations; the value passes.
fn counted<T>(simple: f64, slow: f64, value: T) -> Counted<T> {
    SO_FAR.with(|so_far| {
        let Operations { simple: s, slow: q } = so_far.get();
        so_far.set(Operations { simple: s + simple, slow: q + slow });
    });
    Counted(value)
}

impl<T> sealed::Sealed for Counted<T> {}

macro_rules! operators {
    ($($operator:ident $method:ident $sign:tt $simple:literal $slow:literal),*) => {$(
        impl<T: Real> $operator for Counted<T> {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                counted($simple, $slow, self.0 $sign other.0)
            }
        }

        impl<T: Real> $operator<f64> for Counted<T> {
            type Output = Self;
            fn $method(self, other: f64) -> Self {
                counted($simple, $slow, self.0 $sign T::from_f64(other))
            }
        }
    )*};
}

operators!(Add add + 1.0 0.0, Sub sub - 1.0 0.0, Mul mul * 1.0 0.0, Div div / 0.0 1.0);

impl<T: Real> Neg for Counted<T> {
    type Output = Self;
    fn neg(self) -> Self {
        counted(1.0, 0.0, -self.0)
    }
}

/// Functions count as what the module [`math`](crate::math) does for them. What they give doesn't matter.
impl<T: Real> Number for Counted<T> {
    type Real = T;
    type Condition = bool;

    fn constant(x: f64) -> Self {
        Self(T::from_f64(x))
    }
    fn sqrt(self) -> Self {
        counted(0.0, 1.0, self.0)
    }
    fn recip(self) -> Self {
        counted(0.0, 1.0, self.0)
    }
    fn exp(self) -> Self {
        counted(45.0, 0.0, self.0)
    }
    fn ln(self) -> Self {
        counted(50.0, 1.0, self.0)
    }
    fn sin(self) -> Self {
        counted(50.0, 0.0, self.0)
    }
    fn cos(self) -> Self {
        counted(50.0, 0.0, self.0)
    }
    fn tanh(self) -> Self {
        counted(70.0, 1.0, self.0)
    }
    fn erf(self) -> Self {
        counted(110.0, 1.0, self.0)
    }
    fn erfc(self) -> Self {
        counted(130.0, 1.0, self.0)
    }
    fn powi(self, n: i32) -> Self {
        let products = 2 * (n.unsigned_abs() | 1).ilog2();
        counted(f64::from(products), if n < 0 { 1.0 } else { 0.0 }, self.0)
    }
    fn powf(self, _: f64) -> Self {
        counted(170.0, 1.0, self.0)
    }
    fn less_than(self, other: Self) -> bool {
        counted(1.0, 0.0, self.0).0 < other.0
    }
    fn select(condition: bool, yes: Self, no: Self) -> Self {
        counted(1.0, 0.0, if condition { yes.0 } else { no.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numbers::number::Coordinates;

    #[test]
    fn operations_are_those_of_the_formula() {
        let count = |evaluate: &dyn Fn(Coordinates<Counted<f64>>) -> Counted<f64>| {
            operations(|| {
                let [x, y, z] = [1.0, 2.0, 3.0].map(Counted);
                evaluate(Coordinates { x, y, z });
            })
        };
        // Three squares and two sums; a root and a quotient.
        let newton = count(&|d| d.length().recip());
        assert_eq!(newton, Operations { simple: 5.0, slow: 2.0 });
        // What is used twice is computed once.
        let twice = count(&|d| {
            let r = d.length();
            r * r
        });
        assert_eq!(twice, Operations { simple: 6.0, slow: 1.0 });
        let slower = count(&|d| (-d.length()).exp() / d.length());
        assert!(slower.simple > 30.0 && slower.slow == 3.0);
        assert_eq!(count(&|d| d.x), Operations::default(), "each count begins anew");
    }
}
