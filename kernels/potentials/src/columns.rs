//! Charges seen as the numbers that they are made of.
//!
//! A charge may be of any linear type, and most such types are a few numbers side by side. The common
//! ones are recognised by name. That is settled when the code is compiled, and so is the conversion
//! from a precision that is a type parameter to the same one known by name.

use std::any::{Any, TypeId};

use farfield::{Additive, Point, Real, Vector};
use num_complex::Complex;

/// The same number in the same precision, by its other name.
#[inline(always)]
pub(crate) fn same<A: Real, B: Real>(a: A) -> B {
    B::from_f64(a.as_f64())
}

/// How many numbers a charge is made of, if it is a number, real or complex, a point, or an array of
/// up to four numbers.
#[inline(always)]
pub(crate) fn columns<T: Real, C: 'static>() -> Option<usize> {
    let types = [
        (TypeId::of::<T>(), 1),
        (TypeId::of::<[T; 1]>(), 1),
        (TypeId::of::<[T; 2]>(), 2),
        (TypeId::of::<Complex<T>>(), 2),
        (TypeId::of::<[T; 3]>(), 3),
        (TypeId::of::<Point<T>>(), 3),
        (TypeId::of::<[T; 4]>(), 4),
    ];
    types.into_iter().find(|(id, _)| *id == TypeId::of::<C>()).map(|(_, columns)| columns)
}

/// The `N` numbers of a charge; see [`columns`].
#[inline(always)]
pub(crate) fn to_columns<T: Real, C: 'static, F: Real, const N: usize>(charge: &C) -> [F; N] {
    let charge: &dyn Any = charge;
    let mut columns = [F::from_f64(0.0); N];
    if let Some(numbers) = charge.downcast_ref::<[T; N]>() {
        for n in 0..N {
            columns[n] = same(numbers[n]);
        }
    } else if let Some(&number) = charge.downcast_ref::<T>() {
        columns[0] = same(number);
    } else if let Some(number) = charge.downcast_ref::<Complex<T>>() {
        for n in 0..N {
            columns[n] = same([number.re, number.im][n % 2]);
        }
    } else if let Some(point) = charge.downcast_ref::<Point<T>>() {
        let point = point.to_array();
        for n in 0..N {
            columns[n] = same(point[n % 3]);
        }
    }
    columns
}

/// The inverse of [`to_columns`], from the numbers at place `i`.
#[inline(always)]
pub(crate) fn from_columns<T: Real, C: Additive, F: Real, const N: usize, const LANES: usize>(
    rows: &[[F; LANES]; N],
    i: usize,
) -> C {
    let mut columns = [T::from_f64(0.0); N];
    for n in 0..N {
        columns[n] = same(rows[n][i]);
    }
    let at = |n: usize| columns[n % N];
    let point = Point::<T>::from_array([at(0), at(1), at(2)]);
    let complex = Complex::new(at(0), at(1));
    let forms: [&dyn Any; 4] = [&columns, &columns[0], &complex, &point];
    for form in forms {
        if let Some(&charge) = form.downcast_ref::<C>() {
            return charge;
        }
    }
    C::zero()
}
