//! Products of spherical harmonics: Wigner's 3j symbols and Gaunt coefficients.

/// The symbols (l1 l2 j; −m m 0) for j = |l1 − l2|, …, l1 + l2, up to a common sign, m ≤ min(l1, l2).
///
/// They obey, with α(j)² = (j² − (l1−l2)²)((l1+l2+1)² − j²),
///
/// α(j+1) f(j+1) + 2m (2j+1) f(j) + α(j) f(j−1) = 0,    Σ_j (2j+1) f(j)² = 1.
///
/// The recursion is stable from either end towards the classically allowed range of j, so one runs
/// from each end and the two are joined in there (Schulten and Gordon 1975).
pub(super) fn three_j(l1: usize, l2: usize, m: usize) -> Vec<f64> {
    let (low, high) = (l1.abs_diff(l2), l1 + l2);
    let steps = high - low;
    let (difference, sum) = (low as f64, high as f64);
    let alpha = |j: f64| {
        ((j - difference) * (j + difference) * (sum + 1.0 - j) * (sum + 1.0 + j)).max(0.0).sqrt()
    };
    let diagonal = |j: f64| 2.0 * m as f64 * (2.0 * j + 1.0);

    let mut up = vec![1.0; steps + 1];
    for k in 0..steps {
        let j = (low + k) as f64;
        let below = if k > 0 { alpha(j) * up[k - 1] } else { 0.0 };
        up[k + 1] = -(diagonal(j) * up[k] + below) / alpha(j + 1.0);
    }
    let mut f = vec![1.0; steps + 1];
    for k in (1..=steps).rev() {
        let j = (low + k) as f64;
        let above = if k < steps { alpha(j + 1.0) * f[k + 1] } else { 0.0 };
        f[k - 1] = -(diagonal(j) * f[k] + above) / alpha(j);
    }

    // α vanishes just outside both ends, so the geometric mean of these lies well inside. Of two
    // neighbours at most one is small.
    let centre = ((difference * (sum + 1.0)).sqrt() as usize).max(low) - low;
    let joint = centre..(centre + 2).min(steps + 1);
    let overlap: f64 = joint.clone().map(|k| up[k] * f[k]).sum();
    let norm: f64 = joint.clone().map(|k| up[k] * up[k]).sum();
    for k in 0..joint.start {
        f[k] = up[k] * overlap / norm;
    }

    let norm: f64 = f.iter().enumerate().map(|(k, f)| (2 * (low + k) + 1) as f64 * f * f).sum();
    for f in &mut f {
        *f /= norm.sqrt();
    }
    f
}

/// ∫ Y_l^m(û)* Y_L^m(û) Y_j^0(û) dΩ · Y_j^0(ẑ) · 4π for j = |l − L|, …, l + L: what is left of the
/// addition theorem's Gaunt coefficient when the shift is along z.
pub(super) fn axial_gaunt(l: usize, big_l: usize, m: usize) -> Vec<f64> {
    let norm = (((2 * l + 1) * (2 * big_l + 1)) as f64).sqrt();
    let low = l.abs_diff(big_l);
    // The symbols' common signs: (l L l+L; 0 0 0) and (l L l+L; −m m 0) have the same.
    three_j(l, big_l, 0)
        .into_iter()
        .zip(three_j(l, big_l, m))
        .enumerate()
        .map(|(k, (zero, f))| norm * (2 * (low + k) + 1) as f64 * zero * f)
        .map(|gaunt| if m.is_multiple_of(2) { gaunt } else { -gaunt })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn known_symbols() {
        // (1 1 j; −1 1 0) = 1/√3, −1/√6, 1/√30 and (2 2 2; −1 1 0) = 1/√70 up to the common sign.
        let f = three_j(1, 1, 1);
        for (f, expected) in f.iter().zip([3f64, -6.0, 30.0]) {
            assert_relative_eq!(*f, 1.0 / (expected.signum() * expected.abs().sqrt()));
        }
        let f = three_j(2, 2, 1);
        assert_relative_eq!(f[2].abs(), 1.0 / 70f64.sqrt(), max_relative = 1e-14);
        assert_relative_eq!(f[0].abs(), 1.0 / 5f64.sqrt(), max_relative = 1e-14);
    }

    #[test]
    fn symbols_are_orthogonal() {
        // Σ_j (2j+1) (l1 l2 j; −m m 0)(l1 l2 j; −m' m' 0) = δ_mm'
        for (l1, l2) in [(40, 40), (40, 39), (40, 13), (27, 5), (3, 0)] {
            let rows: Vec<_> = (0..=l1.min(l2)).map(|m| three_j(l1, l2, m)).collect();
            for (a, row) in rows.iter().enumerate() {
                for (b, other) in rows.iter().enumerate() {
                    let product: f64 = (0..row.len())
                        .map(|k| (2 * (l1.abs_diff(l2) + k) + 1) as f64 * row[k] * other[k])
                        .sum();
                    let expected = if a == b { 1.0 } else { 0.0 };
                    assert!((product - expected).abs() < 1e-12, "{l1} {l2} {a} {b}: {product}");
                }
            }
        }
    }
}
