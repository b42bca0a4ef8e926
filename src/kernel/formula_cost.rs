//! What a pair of a formula takes, counted.

use crate::dispatch_level::DispatchLevel;
use crate::kernel::formula::{Form, Formula, FormulaEntry};
use crate::numbers::counted::{Counted, operations};
use crate::numbers::number::{Coordinates, Number};
use crate::numbers::traits::Real;

/// Seconds of one core for one simple operation with a register, measured with formulas of all functions on two
/// AVX-512 machines.
const REGISTER_SECONDS: f64 = 2e-10;
/// Seconds for a quotient or a square root of one number in double precision. Registers of any width take as long.
const SLOW_SECONDS: f64 = 4.5e-10;
/// Simple operations of every pair beside those of its formula and of its products.
const OTHER_OPERATIONS: f64 = 4.0;

/// The share of the operations with derivatives that compilers leave: many derivatives are 0 or 1, or needed twice.
const DERIVED_SHARE: f64 = 0.5;

/// About how many seconds one core takes for a pair: from the operations of the formula, counted, and those for its
/// products with the densities of all columns.
pub(super) fn pair_seconds<F: Formula, T: Real>(
    formula: &F,
    columns: usize,
    gradients: bool,
) -> f64 {
    let entries = formula.fields() * formula.densities();
    let (made, parts) = if gradients {
        let evaluate = || {
            let mut g = vec![FormulaEntry::zero(); entries];
            formula.entries(F::Of::with_derivatives(somewhere::<F, T>()), &mut g);
        };
        (operations(evaluate), 4)
    } else {
        let evaluate = || {
            let mut g = vec![FormulaEntry::zero(); entries];
            formula.entries(somewhere::<F, T>(), &mut g);
        };
        (operations(evaluate), 1)
    };
    let single = size_of::<T>() == size_of::<f32>();
    let numbers = register_bytes() / size_of::<T>();
    let products = (2 * entries * parts * columns) as f64;
    let simple = made.simple + products + OTHER_OPERATIONS;
    let slow_seconds = if single { SLOW_SECONDS / 2.0 } else { SLOW_SECONDS };
    let seconds = simple * REGISTER_SECONDS / numbers as f64 + made.slow * slow_seconds;
    if gradients { DERIVED_SHARE * seconds } else { seconds }
}

/// The argument of a formula for some pair.
fn somewhere<F: Formula, T: Real>() -> <F::Of as Form>::At<Counted<T>> {
    let at = |x: f64| Coordinates {
        x: Counted::constant(x),
        y: Counted::constant(2.0 * x),
        z: Counted::constant(3.0 * x),
    };
    F::Of::at(at(1.0), at(0.5))
}

/// Bytes of the registers that formulas are evaluated in.
fn register_bytes() -> usize {
    match DispatchLevel::in_force() {
        Ok(DispatchLevel::Avx512) => 64,
        Ok(DispatchLevel::Avx2) => 32,
        _ => 16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::formula::Difference;

    struct Power(i32);

    impl Formula for Power {
        type Of = Difference;
        type Entry<N: Number> = N;
        fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [N]) {
            g[0] = d.length().powi(-self.0);
        }
    }

    #[test]
    fn what_is_more_takes_longer() {
        let [few, many] = [1, 100].map(|n| pair_seconds::<_, f64>(&Power(n), 1, false));
        assert!(1e-10 < few && few < many && many < 1e-8, "{few:e} {many:e}");
        let with_gradients = pair_seconds::<_, f64>(&Power(1), 1, true);
        let columns = pair_seconds::<_, f64>(&Power(1), 8, false);
        let single = pair_seconds::<_, f32>(&Power(1), 1, false);
        assert!(few < with_gradients && few < columns && single < few);
    }
}
