//! What the far field of a leaf costs.

use crate::dispatch_level::DispatchLevel;
use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::tuning::{
    CELL_SECONDS, MOVE_SECONDS, OTHER_SHARE, SINGLE_DIGITS, SORT_SECONDS,
};
use crate::numbers::traits::Scalar;

/// Seconds of one core that the translations with 189 far cells and the other operators take for a leaf
/// and its share of the cells above, for ranks like those of 1/r at this accuracy.
pub(crate) fn leaf_seconds<S: Scalar>(
    accuracy: Accuracy,
    components: usize,
    columns: usize,
) -> f64 {
    let (digits, rank) = (digits(accuracy), rank(accuracy, components));
    let order = 4.0 / 3.0 * digits;
    let by_direction = (0.27 * rank).max(4.0);
    let complex = if S::COMPLEX { 4.0 } else { 1.0 };
    let single = size_of::<S::Real>() == 4 || digits <= SINGLE_DIGITS;
    let m2l_rate = flop_rate() * if single { 2.0 } else { 1.0 };
    // Sums over a cell's functions included.
    let m2l_flops = 2.0 * complex * (0.33 * rank).powi(2);
    let m2l = m2l_flops / m2l_rate + 4.0 * complex * by_direction * MOVE_SECONDS;
    let other_flops = 4.0 * complex * rank * (order.powi(3) / 8.0 + rank);
    let other = other_flops / (OTHER_SHARE * flop_rate()) + CELL_SECONDS;
    let right_hand_sides = columns as f64;
    8.0 / 7.0 * (189.0 * (right_hand_sides * m2l + SORT_SECONDS) + right_hand_sides * other)
}

/// About how many singular vectors of the far field of 1/r this accuracy needs.
pub(crate) fn rank(accuracy: Accuracy, components: usize) -> f64 {
    let digits = digits(accuracy);
    4.0 * (digits + 1.0) * digits * components as f64
}

fn digits(accuracy: Accuracy) -> f64 {
    match accuracy {
        Accuracy::Tolerance(tolerance) => (-tolerance.log10()).clamp(1.0, 14.0),
        Accuracy::Order(order) => (order as f64 - 1.5).clamp(1.0, 14.0),
    }
}

/// Floating-point operations per second of one core in products like those of M2L: measured on one AVX-512 machine,
/// and half or a tenth of it where registers are narrower. `faer`, which makes the products, heeds no cap.
fn flop_rate() -> f64 {
    match DispatchLevel::available().last() {
        Some(DispatchLevel::Avx512) => 8e10,
        Some(DispatchLevel::Avx2) => 4e10,
        _ => 8e9,
    }
}
