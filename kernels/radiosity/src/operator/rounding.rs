//! The rounding of a sum: how far it is from linear.

use farfield::Real;

use crate::numbers::mixed;

/// H(B) − H(B′) − H(B − B′) for a B′ between a quarter and three quarters of B: zero but for rounding.
/// Two calls of `gather`, which is H; `irradiance` is H(B).
///
/// An error that is the same for every B, such as that of an expansion, is linear and does not show. It
/// makes a sum another sum, whose equation has a solution too.
pub(crate) fn rounding<T: Real, const BANDS: usize, E>(
    radiosity: &[[T; BANDS]],
    irradiance: &[[T; BANDS]],
    mut gather: impl FnMut(&[[T; BANDS]]) -> Result<Vec<[T; BANDS]>, E>,
) -> Result<Vec<[T; BANDS]>, E> {
    let share = |i: usize, k: usize| {
        let bits = mixed((i * BANDS + k) as u64) >> 11;
        T::from_f64(0.25 + 0.5 * bits as f64 / (1u64 << 53) as f64)
    };
    let split = |(i, b): (usize, &[T; BANDS])| std::array::from_fn(|k| share(i, k) * b[k]);
    let part: Vec<[T; BANDS]> = radiosity.iter().enumerate().map(split).collect();
    let rest: Vec<_> = differences(radiosity, &part);
    Ok(differences(&differences(irradiance, &gather(&part)?), &gather(&rest)?))
}

fn differences<T: Real, const BANDS: usize>(a: &[[T; BANDS]], b: &[[T; BANDS]]) -> Vec<[T; BANDS]> {
    a.iter().zip(b).map(|(a, b)| std::array::from_fn(|k| a[k] - b[k])).collect()
}
