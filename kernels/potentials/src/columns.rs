//! The numbers of charges and values, in a precision that is known by name.

use farfield::{Numbers, Real};

/// The same number in the same precision, by its other name.
#[inline(always)]
pub(crate) fn same<A: Real, B: Real>(a: A) -> B {
    B::from_f64(a.as_f64())
}

/// The `N` numbers of a charge.
#[inline(always)]
pub(crate) fn to_columns<C: Numbers, F: Real, const N: usize>(charge: &C) -> [F; N] {
    let mut columns = [F::from_f64(0.0); N];
    for (n, column) in columns.iter_mut().enumerate() {
        *column = same(charge.get(n));
    }
    columns
}

/// The inverse of [`to_columns`], from the numbers at place `i`.
#[inline(always)]
pub(crate) fn from_columns<C: Numbers, F: Real, const N: usize, const LANES: usize>(
    rows: &[[F; LANES]; N],
    i: usize,
) -> C {
    let mut charge = C::zero();
    for (n, row) in rows.iter().enumerate() {
        charge.set(n, same(row[i]));
    }
    charge
}
