//! Norms of numbers of any size, units of their size, and well-mixed bits.

use farfield::Real;

/// ‖x‖₂, also where the squares would overflow or vanish; NaN if some number is.
pub(crate) fn norm(numbers: impl Iterator<Item = f64> + Clone) -> f64 {
    let largest = numbers.clone().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if largest == 0.0 {
        // Zeros and NaNs only.
        return numbers.sum();
    }
    numbers.map(|x| (x / largest).powi(2)).sum::<f64>().sqrt() * largest
}

/// ‖a‖ / ‖b‖ over all numbers, 0 if a is zero.
pub(crate) fn relative<T: Real, const BANDS: usize>(a: &[[T; BANDS]], b: &[[T; BANDS]]) -> f64 {
    let all = |rows: &[[T; BANDS]]| norm(rows.as_flattened().iter().map(|x| x.as_f64()));
    let above = all(a);
    if above == 0.0 { 0.0 } else { above / all(b) }
}

/// 2ⁿ with 2ⁿ times the largest number in [1, 2), as far as 2ⁿ is a normal number; 1 if all are zero.
pub(crate) fn power_of_two_under(numbers: impl Iterator<Item = f64>) -> f64 {
    let largest = numbers.fold(0.0, f64::max);
    if largest > 0.0 { (-largest.log2().floor()).clamp(-1022.0, 1023.0).exp2() } else { 1.0 }
}

/// Well-mixed bits of a number (Steele, Lea and Flood, "Fast splittable pseudorandom number
/// generators", OOPSLA 2014).
pub(crate) fn mixed(n: u64) -> u64 {
    let z = n.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
