//! The sixteen moments by which the numerator of the radiosity kernel separates.

use farfield::{Numbers, Real};

/// SM(y) = { n yᵗ, n, (y·n) y, y·n }.
pub(crate) fn source_matrix<T: Real>(y: [T; 3], n: [T; 3]) -> [T; 16] {
    let along = y[0] * n[0] + y[1] * n[1] + y[2] * n[2];
    std::array::from_fn(|c| match c {
        0..9 => n[c / 3] * y[c % 3],
        9..12 => n[c - 9],
        12..15 => along * y[c - 12],
        _ => along,
    })
}

/// RM(x) = { x nᵗ, −(x·n) x, −n, x·n }.
pub(crate) fn receiver_matrix<T: Real>(x: [T; 3], n: [T; 3]) -> [T; 16] {
    let along = x[0] * n[0] + x[1] * n[1] + x[2] * n[2];
    std::array::from_fn(|c| match c {
        0..9 => x[c / 3] * n[c % 3],
        9..12 => -along * x[c - 9],
        12..15 => -n[c - 12],
        _ => along,
    })
}

/// TM: for each term the combination of SM(y) that is SM(s y + t):
///
/// ```text
/// n (s y + t)ᵗ             = s n yᵗ + n tᵗ
/// ((s y + t)·n) (s y + t)  = s² (y·n) y + s (y·n) t + s (n yᵗ)ᵗ t + (t·n) t
/// (s y + t)·n              = s y·n + t·n
/// ```
pub(crate) fn shifted<T: Real, C: Numbers<Real = T>>(
    terms: &[[C; 16]],
    s: T,
    t: [T; 3],
) -> Vec<[C; 16]> {
    let shift = |from: &[C; 16]| {
        let mut to = <[C; 16]>::zero();
        let mut along = C::zero();
        for i in 0..3 {
            along.add_scaled(t[i], &from[9 + i]);
            to[9 + i] = from[9 + i].clone();
        }
        for j in 0..3 {
            for i in 0..3 {
                to[3 * i + j].add_scaled(s, &from[3 * i + j]);
                to[3 * i + j].add_scaled(t[j], &from[9 + i]);
                to[12 + j].add_scaled(s * t[i], &from[3 * i + j]);
            }
            to[12 + j].add_scaled(s * s, &from[12 + j]);
            to[12 + j].add_scaled(s * t[j], &from[15]);
            to[12 + j].add_scaled(t[j], &along);
        }
        to[15].add_scaled(s, &from[15]);
        to[15].accumulate(&along);
        to
    };
    terms.iter().map(shift).collect()
}
