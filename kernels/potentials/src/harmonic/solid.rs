//! Real orthonormal solid harmonics H_lm(x) = |x|^l Y_lm(x/|x|), polynomials in x, y, z.
//!
//! Within one l the 2l + 1 functions are stored in four runs, each by descending |m|:
//!
//! | run | function | |m| |
//! |---|---|---|
//! | 0 | cosine | l, l−2, … ≥ 0 |
//! | 1 | cosine | l−1, l−3, … ≥ 0 |
//! | 2 | sine | l, l−2, … ≥ 1 |
//! | 3 | sine | l−1, l−3, … ≥ 1 |
//!
//! A run holds one combination of parities in y and z, so that the exchange of these two axes maps
//! runs to runs (see `swap`).

use farfield::Real;

/// Lengths of the four runs of degree l.
pub(super) fn runs(l: usize) -> [usize; 4] {
    [l / 2 + 1, l.div_ceil(2), l.div_ceil(2), l / 2]
}

/// Position of cos mφ among the functions of degree l, 0 ≤ m ≤ l.
pub(super) fn cosine(l: usize, m: usize) -> usize {
    let back = l - m;
    back / 2 + (back % 2) * (l / 2 + 1)
}

/// Position of sin mφ among the functions of degree l, 1 ≤ m ≤ l. (For m = 0, that of another
/// function.)
pub(super) fn sine(l: usize, m: usize) -> usize {
    let back = l - m;
    back / 2 + l + 1 + (back % 2) * l.div_ceil(2)
}

/// Coefficients of the recursions for H_lm and its gradient, l up to a top degree.
#[derive(Clone, Debug)]
pub(super) struct SolidHarmonics<T> {
    top: usize,
    /// H_mm = diagonal[m] · Re (x + iy)^m.
    diagonal: Vec<T>,
    /// By (l, m), 0 ≤ m ≤ l.
    steps: Vec<Step<T>>,
}

#[derive(Clone, Copy, Debug)]
struct Step<T> {
    /// H_lm = a z H_{l−1,m} − b |x|² H_{l−2,m} for m < l.
    a: T,
    b: T,
    /// ∂H_lm/∂z = same · H_{l−1,m}.
    same: T,
    /// (∂x, ∂y) H_lm from lower · H_{l−1,m−1} and upper · H_{l−1,m+1}.
    lower: T,
    upper: T,
}

impl<T: Real> SolidHarmonics<T> {
    pub(super) fn new(top: usize) -> Self {
        let mut diagonal = Vec::with_capacity(top + 1);
        let mut norm = 1.0 / (4.0 * std::f64::consts::PI);
        for m in 0..=top {
            if m > 0 {
                norm *= (2 * m + 1) as f64 / (2 * m) as f64;
            }
            let cosine_norm = if m == 0 { 1.0 } else { 2.0 };
            diagonal.push(T::from_f64((cosine_norm * norm).sqrt()));
        }
        let mut steps = Vec::with_capacity((top + 1) * (top + 2) / 2);
        for l in 0..=top {
            steps.extend((0..=l).map(|m| Step::new(l, m)));
        }
        Self { top, diagonal, steps }
    }

    fn step(&self, l: usize, m: usize) -> &Step<T> {
        &self.steps[l * (l + 1) / 2 + m]
    }

    /// Writes H_lm(x) for all l, those of degree l at `heads[l]` in `out`.
    pub(super) fn evaluate(&self, [x, y, z]: [T; 3], heads: &[usize], out: &mut [T]) {
        let zero = T::from_f64(0.0);
        let r2 = x * x + y * y + z * z;
        // (x + iy)^m = re + i im
        let (mut re, mut im) = (T::from_f64(1.0), zero);
        for m in 0..=self.top {
            let (mut before, mut now) = (zero, self.diagonal[m]);
            for l in m..=self.top {
                if l > m {
                    let step = self.step(l, m);
                    (before, now) = (now, step.a * z * now - step.b * r2 * before);
                }
                out[heads[l] + cosine(l, m)] = now * re;
                if m > 0 {
                    out[heads[l] + sine(l, m)] = now * im;
                }
            }
            (re, im) = (x * re - y * im, x * im + y * re);
        }
    }

    /// Writes ∇H_lm for all l, given the values of [`evaluate`](Self::evaluate) at the same point.
    pub(super) fn gradients(&self, values: &[T], heads: &[usize], out: &mut [[T; 3]]) {
        let zero = T::from_f64(0.0);
        for l in 0..=self.top {
            let below = |m: usize, position: fn(usize, usize) -> usize| {
                if m < l { values[heads[l - 1] + position(l - 1, m)] } else { zero }
            };
            for m in 0..=l {
                let &Step { same, lower, upper, .. } = self.step(l, m);
                let cosine_above = upper * below(m + 1, cosine);
                let sine_above = upper * below(m + 1, sine);
                if m == 0 {
                    out[heads[l] + cosine(l, 0)] =
                        [-cosine_above, -sine_above, same * below(0, cosine)];
                    continue;
                }
                let cosine_below = lower * below(m - 1, cosine);
                let sine_below = if m == 1 { zero } else { lower * below(m - 1, sine) };
                out[heads[l] + cosine(l, m)] = [
                    cosine_below - cosine_above,
                    -sine_below - sine_above,
                    same * below(m, cosine),
                ];
                out[heads[l] + sine(l, m)] =
                    [sine_below - sine_above, cosine_below + cosine_above, same * below(m, sine)];
            }
        }
    }
}

impl<T: Real> Step<T> {
    fn new(l: usize, m: usize) -> Self {
        let (l, m) = (l as f64, m as f64);
        let zero = T::from_f64(0.0);
        if l == 0.0 {
            return Self { a: zero, b: zero, same: zero, lower: zero, upper: zero };
        }
        let (a, b) = if m < l {
            let a = ((4.0 * l * l - 1.0) / (l * l - m * m)).sqrt();
            let below = (l - 1.0) * (l - 1.0);
            (a, a * ((below - m * m).max(0.0) / (4.0 * below - 1.0).max(1.0)).sqrt())
        } else {
            (0.0, 0.0)
        };
        let f = ((2.0 * l + 1.0) / (2.0 * l - 1.0)).sqrt();
        // The cosine of m = 0 is normalised without the √2 of the others.
        let lower_norm = if m == 1.0 { 0.5f64.sqrt() } else { 0.5 };
        let upper_norm = if m == 0.0 { 0.5f64.sqrt() } else { 0.5 };
        Self {
            a: T::from_f64(a),
            b: T::from_f64(b),
            same: T::from_f64(f * (l * l - m * m).sqrt()),
            lower: T::from_f64(lower_norm * f * ((l + m) * (l + m - 1.0)).sqrt()),
            upper: T::from_f64(upper_norm * f * ((l - m) * (l - m - 1.0)).max(0.0).sqrt()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// Each degree at l² in the output.
    fn all(top: usize, x: [f64; 3]) -> (Vec<f64>, Vec<[f64; 3]>) {
        let heads: Vec<_> = (0..=top).map(|l| l * l).collect();
        let solid = SolidHarmonics::new(top);
        let mut values = vec![f64::NAN; (top + 1).pow(2)];
        let mut gradients = vec![[f64::NAN; 3]; values.len()];
        solid.evaluate(x, &heads, &mut values);
        solid.gradients(&values, &heads, &mut gradients);
        (values, gradients)
    }

    #[test]
    fn positions_are_a_permutation() {
        for l in 0..=40 {
            assert_eq!(runs(l).iter().sum::<usize>(), 2 * l + 1);
            let mut positions: Vec<_> =
                (0..=l).map(|m| cosine(l, m)).chain((1..=l).map(|m| sine(l, m))).collect();
            positions.sort_unstable();
            assert!(positions.into_iter().eq(0..2 * l + 1));
        }
    }

    #[test]
    fn low_degrees() {
        let [x, y, z] = [0.3, -0.5, 0.7];
        let (h, _) = all(2, [x, y, z]);
        let pi = std::f64::consts::PI;
        let c1 = (3.0 / (4.0 * pi)).sqrt();
        let c2 = (15.0 / (4.0 * pi)).sqrt();
        let cases = [
            (cosine(0, 0), 1.0 / (4.0 * pi).sqrt()),
            (1 + cosine(1, 0), c1 * z),
            (1 + cosine(1, 1), c1 * x),
            (1 + sine(1, 1), c1 * y),
            (4 + sine(2, 2), c2 * x * y),
            (4 + sine(2, 1), c2 * y * z),
            (4 + cosine(2, 1), c2 * x * z),
            (4 + cosine(2, 2), c2 * (x * x - y * y) / 2.0),
            (4 + cosine(2, 0), (5.0 / (16.0 * pi)).sqrt() * (2.0 * z * z - x * x - y * y)),
        ];
        for (position, expected) in cases {
            assert_relative_eq!(h[position], expected, max_relative = 1e-14);
        }
    }

    #[test]
    fn addition_theorem_of_equal_arguments() {
        // Σ_m Y_lm² = (2l + 1)/4π on the unit sphere, at the poles too.
        for x in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.48, -0.6, 0.64]] {
            let (h, _) = all(40, x);
            for l in 0..=40 {
                let sum: f64 = h[l * l..(l + 1) * (l + 1)].iter().map(|y| y * y).sum();
                let expected = (2 * l + 1) as f64 / (4.0 * std::f64::consts::PI);
                assert_relative_eq!(sum, expected, max_relative = 1e-12);
            }
        }
    }

    #[test]
    fn gradients_agree_with_differences() {
        let x = [0.4, -0.3, 0.6];
        let (_, gradients) = all(6, x);
        let h = 1e-5;
        for k in 0..3 {
            let moved = |by: f64| {
                let mut x = x;
                x[k] += by;
                all(6, x).0
            };
            for ((up, down), gradient) in moved(h).iter().zip(moved(-h)).zip(&gradients) {
                assert!((gradient[k] - (up - down) / (2.0 * h)).abs() < 1e-9);
            }
        }
    }
}
