//! Norms of numbers of any size, units of their size, and well-mixed bits.

use farfield::Real;

/// ‖x‖₂, also where the squares would overflow or vanish; NaN if some number is.
pub(crate) fn norm(numbers: impl Iterator<Item = f64> + Clone) -> f64 {
    let squares: f64 = numbers.clone().map(|x| x * x).sum();
    // Then no square that matters has overflowed or lost digits.
    if (1e-280..1e280).contains(&squares) {
        return squares.sqrt();
    }
    let unit = unit_of_size(numbers.clone().map(f64::abs));
    numbers.map(|x| (unit * x).powi(2)).sum::<f64>().sqrt() / unit
}

/// ‖a‖ / ‖b‖ over all numbers, 0 if a is zero.
pub(crate) fn relative<T: Real, const BANDS: usize>(a: &[[T; BANDS]], b: &[[T; BANDS]]) -> f64 {
    let all = |rows: &[[T; BANDS]]| norm(rows.as_flattened().iter().map(|x| x.as_f64()));
    let above = all(a);
    if above == 0.0 { 0.0 } else { above / all(b) }
}

/// The power of two that brings the largest of some numbers, none negative, into [1, 2), as far as it is a
/// normal number itself; 1 if all are zero.
pub(crate) fn unit_of_size(numbers: impl Iterator<Item = f64>) -> f64 {
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

/// The steps of a sequence that fills the unit cube of four dimensions evenly: powers of the root of
/// x⁵ = x + 1 (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
const STEPS: [f64; 4] = [
    0.856_674_883_854_502_9,
    0.733_891_856_627_126,
    0.628_706_721_037_808_7,
    0.538_597_257_223_610_1,
];

/// Point `n` of a sequence that fills the unit cube of four dimensions evenly; another one for each `turn`.
pub(crate) fn in_cube(n: usize, turn: u64) -> [f64; 4] {
    std::array::from_fn(|k| {
        let start =
            (mixed(turn.wrapping_mul(4).wrapping_add(k as u64)) >> 11) as f64 / (1u64 << 53) as f64;
        (start + n as f64 * STEPS[k]).fract()
    })
}
