//! Blocks of ordinary coordinates: those whose powers neither overflow nor vanish.

use farfield::{Point, Real, Vector};

use crate::columns::same;
use crate::reciprocal::Reciprocal;

/// Whether every r² lies between `LEAST` and its inverse, coincident points aside.
#[inline(always)]
pub(crate) fn is_ordinary<F: Reciprocal, T: Real>(xs: &[Point<T>], ys: &[Point<T>]) -> bool {
    let root = F::LEAST.sqrt();
    let (least, greatest) = (root / F::epsilon(), (F::from_f64(4.0) * root).recip());
    let (mut apart, mut near) = (true, true);
    for points in [xs, ys] {
        for point in points {
            for c in point.to_array() {
                let c = same::<T, F>(c).abs();
                apart &= (c >= least) | (c == F::from_f64(0.0));
                near &= c <= greatest;
            }
        }
    }
    // Numbers of at least √LEAST / ε differ by √LEAST, if they differ. Only smaller ones need a look
    // at each pair.
    near && (apart || !any_too_close::<F, T>(xs, ys))
}

/// Whether any r² that isn't 0 is less than `LEAST`, or could be when rounded differently.
#[inline(always)]
fn any_too_close<F: Reciprocal, T: Real>(xs: &[Point<T>], ys: &[Point<T>]) -> bool {
    let least = same::<F, T>(F::LEAST) * T::from_f64(2.0);
    let mut any = false;
    for x in xs {
        for y in ys {
            let [a, b, c] = (*x - *y).to_array();
            let zero = T::from_f64(0.0);
            let differ = (a != zero) | (b != zero) | (c != zero);
            any |= differ & (a * a + b * b + c * c < least);
        }
    }
    any
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_whose_squares_overflow_or_vanish_are_not_ordinary() {
        let f64s =
            |x: f64, y: f64| is_ordinary::<f64, f64>(&[glam::DVec3::Y * x], &[glam::DVec3::Y * y]);
        let f32s =
            |x: f32, y: f32| is_ordinary::<f32, f32>(&[glam::Vec3::Z * x], &[glam::Vec3::Z * y]);
        assert!(!f64s(0.0, 1e-170) && !f64s(0.0, 1e60) && !f64s(0.0, f64::NAN));
        assert!(f64s(1e-40, -1e-40) && f64s(1e-170, 1e-170));
        assert!(!f32s(1e-20, 0.0) && f32s(1e-20, 1e-20) && f32s(1e-20, 1.0));
    }
}
