//! The exchange of the y and z axes, from which every rotation of harmonics is made.
//!
//! With P(x, y, z) = (x, z, y), Y_lm(P x) = Σ_m' J^l_mm' Y_lm'(x). A rotation about y is one about z
//! between two exchanges, R_y(−θ) = P R_z(θ) P, and one about z only mixes ±m: no matrix depends on
//! an angle (Pinchon and Hoggan 2007). Parity in y and z leaves one entry in four of J^l.

use farfield::{Numbers, Real};

use super::solid::{cosine, runs, sine};

/// The matrices J^l up to a top degree.
#[derive(Clone, Debug)]
pub(super) struct AxisSwap<T> {
    degrees: Vec<Blocks<T>>,
}

/// The blocks of one J^l between the runs of `solid`: even in y and z both, even in y and odd in z
/// (and its transpose), odd in both. Each is stored row after row.
#[derive(Clone, Debug)]
struct Blocks<T> {
    even: Vec<T>,
    cosine_to_sine: Vec<T>,
    sine_to_cosine: Vec<T>,
    odd: Vec<T>,
}

impl<T: Real> AxisSwap<T> {
    pub(super) fn new(top: usize) -> Self {
        Self { degrees: (0..=top).map(Blocks::new).collect() }
    }

    /// `to` = J^l `from`, for the 2l + 1 terms of one shell.
    pub(super) fn apply<C: Numbers<Real = T>>(&self, l: usize, from: &[C], to: &mut [C]) {
        let [a, b, _, _] = runs(l);
        let blocks = &self.degrees[l];
        let (from_even, from) = from.split_at(a);
        let (from_cosine, from) = from.split_at(b);
        let (from_sine, from_odd) = from.split_at(b);
        let (to_even, to) = to.split_at_mut(a);
        let (to_cosine, to) = to.split_at_mut(b);
        let (to_sine, to_odd) = to.split_at_mut(b);
        product(&blocks.even, from_even, to_even);
        product(&blocks.cosine_to_sine, from_cosine, to_sine);
        product(&blocks.sine_to_cosine, from_sine, to_cosine);
        product(&blocks.odd, from_odd, to_odd);
    }
}

/// `to` = A `from`, A stored row after row.
pub(super) fn product<T: Real, C: Numbers<Real = T>>(a: &[T], from: &[C], to: &mut [C]) {
    if from.is_empty() {
        return;
    }
    for (row, to) in a.chunks_exact(from.len()).zip(to) {
        let mut sum = C::zero();
        for (&a, x) in row.iter().zip(from) {
            sum.add_scaled(a, x);
        }
        *to = sum;
    }
}

impl<T: Real> Blocks<T> {
    fn new(l: usize) -> Self {
        let quarter = QuarterTurn::new(l);
        let mut dense = vec![0.0; (2 * l + 1) * (2 * l + 1)];
        for row in 0..=l {
            // P = (reflection in z) R_x(−π/2), and R_x(−π/2) = R_z(−π/2) R_y(−π/2) R_z(π/2).
            let reflected = if (l + row).is_multiple_of(2) { 1.0 } else { -1.0 };
            let (c, s) = quarter_multiple(row);
            for column in 0..=l {
                let (c_column, s_column) = quarter_multiple(column);
                let (cosines, sines) = quarter.real(row, column);
                let mut set = |i: usize, j: usize, value: f64| {
                    dense[i * (2 * l + 1) + j] = reflected * value;
                };
                let (row_cosine, column_cosine) = (cosine(l, row), cosine(l, column));
                set(row_cosine, column_cosine, c * cosines * c_column + s * sines * s_column);
                if row > 0 && column > 0 {
                    let (row_sine, column_sine) = (sine(l, row), sine(l, column));
                    set(row_sine, column_sine, c * sines * c_column + s * cosines * s_column);
                    set(row_cosine, column_sine, s * sines * c_column - c * cosines * s_column);
                    set(row_sine, column_cosine, c * sines * s_column - s * cosines * c_column);
                } else if row > 0 {
                    set(sine(l, row), column_cosine, -s * cosines * c_column);
                } else if column > 0 {
                    set(row_cosine, sine(l, column), -c * cosines * s_column);
                }
            }
        }
        let [a, b, _, d] = runs(l);
        let block = |i: usize, rows: usize, j: usize, columns: usize| {
            (i..i + rows)
                .flat_map(|i| &dense[i * (2 * l + 1) + j..][..columns])
                .map(|&entry| T::from_f64(entry))
                .collect()
        };
        Self {
            even: block(0, a, 0, a),
            cosine_to_sine: block(a + b, b, a, b),
            sine_to_cosine: block(a, b, a + b, b),
            odd: block(a + 2 * b, d, a + 2 * b, d),
        }
    }
}

/// (cos mπ/2, sin mπ/2).
fn quarter_multiple(m: usize) -> (f64, f64) {
    [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][m % 4]
}

/// Wigner's d^l(π/2), whose entries are integers but for their norm:
///
/// d^l_m'm(π/2) = 2^(−l) (−1)^(m'−m) √(C(2l, l+m) / C(2l, l+m')) [z^(l−m')] (1−z)^(l+m) (1+z)^(l−m)
///
/// The integers are at most C(80, 40) < 2^77 and are formed exactly.
struct QuarterTurn {
    l: usize,
    /// For each m from −l to l the coefficients of z^0 to z^2l.
    powers: Vec<Vec<i128>>,
}

impl QuarterTurn {
    fn new(l: usize) -> Self {
        let powers = (0..=2 * l)
            .map(|minus| {
                let mut coefficients = vec![0; 2 * l + 1];
                coefficients[0] = 1;
                for factor in 0..2 * l {
                    for k in (1..=2 * l).rev() {
                        let below = coefficients[k - 1];
                        coefficients[k] += if factor < minus { -below } else { below };
                    }
                }
                coefficients
            })
            .collect();
        Self { l, powers }
    }

    /// d^l_m'm(π/2).
    fn complex(&self, m_prime: i32, m: i32) -> f64 {
        let at = |m: i32| (self.l as i32 + m) as usize;
        // (1 + z)^(2l) holds the binomials C(2l, ·).
        let binomial = |m: i32| self.powers[0][at(m)] as f64;
        let sign = if (m_prime - m) % 2 == 0 { 1.0 } else { -1.0 };
        let norm = (binomial(m) / binomial(m_prime)).sqrt() / (self.l as f64).exp2();
        sign * norm * self.powers[at(m)][at(-m_prime)] as f64
    }

    /// The cosine and the sine entry, row and column ≥ 0, of Y_l(R_y(−π/2) x) in the real basis.
    /// (The sine entry means nothing where one of them is 0.)
    fn real(&self, row: usize, column: usize) -> (f64, f64) {
        let (row, column) = (row as i32, column as i32);
        let sign = |m: i32| if m % 2 == 0 { 1.0 } else { -1.0 };
        let plus = self.complex(column, row);
        let minus = sign(column) * self.complex(-column, row);
        let norm = match (row, column) {
            (0, 0) => 0.5,
            (0, _) | (_, 0) => 0.5f64.sqrt(),
            _ => 1.0,
        };
        (sign(row + column) * norm * (plus + minus), sign(row + column) * (plus - minus))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harmonic::solid::SolidHarmonics;

    const TOP: usize = 40;

    fn harmonics(x: [f64; 3]) -> Vec<f64> {
        let heads: Vec<_> = (0..=TOP).map(|l| l * l).collect();
        let mut values = vec![0.0; (TOP + 1).pow(2)];
        SolidHarmonics::new(TOP).evaluate(x, &heads, &mut values);
        values
    }

    #[test]
    fn harmonics_of_exchanged_axes() {
        let swap = AxisSwap::new(TOP);
        let [x, y, z] = [0.36, -0.48, 0.8];
        let (here, there) = (harmonics([x, y, z]), harmonics([x, z, y]));
        for l in 0..=TOP {
            let shell = l * l..(l + 1) * (l + 1);
            let mut swapped = vec![0.0; 2 * l + 1];
            swap.apply(l, &here[shell.clone()], &mut swapped);
            for (swapped, expected) in swapped.iter().zip(&there[shell]) {
                assert!((swapped - expected).abs() < 2e-14, "l = {l}: {swapped} {expected}");
            }
        }
    }

    #[test]
    fn exchanging_twice_changes_nothing() {
        let swap = AxisSwap::new(TOP);
        for l in 0..=TOP {
            for i in 0..=2 * l {
                let mut unit = vec![0f64; 2 * l + 1];
                unit[i] = 1.0;
                let (mut once, mut twice) = (vec![0.0; 2 * l + 1], vec![0.0; 2 * l + 1]);
                swap.apply(l, &unit, &mut once);
                swap.apply(l, &once, &mut twice);
                assert!(unit.iter().zip(&twice).all(|(a, b)| (a - b).abs() < 1e-14));
            }
        }
    }
}
