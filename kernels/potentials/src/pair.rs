//! One pair after the other, at any distance.

use farfield::{Numbers, Point, Real, Vector};

use crate::exponent::Exponent;
use crate::output::Output;

/// Adds K(x, y) q to `u`.
#[inline(always)]
pub(crate) fn add_pair<E: Exponent, T: Real, C: Numbers<Real = T>, O: Output<T, C>>(
    x: Point<T>,
    y: Point<T>,
    q: &C,
    u: &mut O::Value,
) {
    let (k, gradient) = evaluate::<E, T>(x, y);
    O::add(u, &scaled(k, q), &gradient.map(|component| scaled(component, q)));
}

/// K(x, y) and ∂K/∂x = −2λ K d/r², d = x − y; both 0 at r = 0.
#[inline]
pub(crate) fn evaluate<E: Exponent, T: Real>(x: Point<T>, y: Point<T>) -> (T, [T; 3]) {
    let d = (x - y).to_array();
    let r2 = squared(d);
    if is_ordinary(r2) { from_squared::<E, T>(d, r2) } else { evaluate_extreme::<E, T>(d) }
}

/// [`evaluate`] where r² over- or underflows: with d in units of its largest component s.
#[cold]
fn evaluate_extreme<E: Exponent, T: Real>(d: [T; 3]) -> (T, [T; 3]) {
    let zero = T::from_f64(0.0);
    if d == [zero; 3] {
        return (zero, d);
    }
    let s = d.iter().fold(zero, |s, component| s.max(component.abs()));
    let unit = d.map(|component| component / s);
    let (k, gradient) = from_squared::<E, T>(unit, squared(unit));
    let scale = s.powf(T::from_f64(-2.0 * E::LAMBDA));
    (k * scale, gradient.map(|component| component * scale / s))
}

#[inline(always)]
fn from_squared<E: Exponent, T: Real>(d: [T; 3], r2: T) -> (T, [T; 3]) {
    let k = E::power(r2);
    let (slope, inverse) = (T::from_f64(-2.0 * E::LAMBDA) * k, r2.recip());
    (k, d.map(|component| slope * (component * inverse)))
}

#[inline(always)]
fn squared<T: Real>([x, y, z]: [T; 3]) -> T {
    x * x + y * y + z * z
}

/// Whether r² is accurate: finite, and so large that no square that matters in it was subnormal.
#[inline(always)]
fn is_ordinary<T: Real>(r2: T) -> bool {
    r2 >= T::min_positive_value() / T::epsilon() && r2 < T::infinity()
}

#[inline(always)]
pub(crate) fn scaled<T: Real, C: Numbers<Real = T>>(scale: T, q: &C) -> C {
    let mut product = C::zero();
    product.add_scaled(scale, q);
    product
}
