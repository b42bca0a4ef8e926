//! What sums over growing blocks lack, from how a kernel decays.

use num_traits::Float;

use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Real, l2_norm};
use crate::periodic::summed::Summed;

/// How a kernel behaves far away.
#[derive(Clone, Copy, Debug)]
pub(super) struct Decay {
    /// α + D, if it is like a power r^α there; none if it dies out.
    exponent: Option<f64>,
    parity: Parity,
    dimensions: usize,
}

/// What becomes of a kernel if a difference changes its sign.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Parity {
    Even,
    Odd,
    Neither,
}

/// A kernel that decays by more digits than this power of the distance dies out.
const STEEPEST: f64 = -24.0;

/// At how many periods a kernel is looked at.
const FAR: f64 = 1024.0;

impl Decay {
    /// Looks at a kernel far away, and at both sides of the origin.
    pub(super) fn of<K: Kernel>(summed: &Summed<'_, K>) -> Self {
        let dimensions = summed.lattice.dimensions();
        let longest = summed.lattice.periods.into_iter().flatten().fold(0.0, f64::max);
        let size = |scale: f64| {
            let d = [0.71, 0.53, 0.97].map(|x| x * scale * longest);
            l2_norm(summed.at(d).into_iter())
        };
        let sizes = [FAR, 2.0 * FAR, 4.0 * FAR].map(size);
        let slopes = [(sizes[1] / sizes[0]).log2(), (sizes[2] / sizes[1]).log2()];
        let is_power = slopes.iter().all(|slope| slope.is_finite() && *slope > STEEPEST);
        // Simple fractions are what formulas mean; what is no power yet is near one.
        let epsilon = <K::Real as Float>::epsilon().as_f64().sqrt();
        let is_exact = (slopes[0] - slopes[1]).abs() < epsilon;
        let fine = if is_exact { 840.0 } else { 4.0 };
        let exponent = is_power.then(|| (slopes[1] * fine).round() / fine + dimensions as f64);
        Self { exponent, parity: parity(summed), dimensions }
    }

    /// Whether the part of degree 0 in the difference has a finite sum.
    pub(super) fn constant_is_finite(&self) -> bool {
        self.parity == Parity::Odd || self.exponent.is_none_or(|exponent| exponent < 0.0)
    }

    /// Whether the parts of degree 1 or 2 depend on the shape of the blocks.
    pub(super) fn depends_on_shape(&self) -> bool {
        let degree = if self.parity == Parity::Even { 2.0 } else { 1.0 };
        self.dimensions == 3 && self.exponent.is_some_and(|exponent| exponent - degree >= 0.0)
    }

    /// The powers of a block's edge that its sum lacks from that degree on, the largest first.
    pub(super) fn exponents(&self, degree: usize) -> Vec<f64> {
        let Some(exponent) = self.exponent else { return Vec::new() };
        let (first, step) = match self.parity {
            Parity::Even => (degree.next_multiple_of(2), 2),
            Parity::Odd => (1, 2),
            Parity::Neither if degree == 0 => (0, 2),
            Parity::Neither => (degree, 1),
        };
        (0..64).map(|k| exponent - (first + k * step) as f64).collect()
    }
}

/// Sums over blocks each three times as large as the one before, without those powers of their edges: as many of them
/// as there are sums, less one. A part that grows with the logarithm of the edge stays.
pub(super) fn extrapolated(sums: &[Vec<f64>], exponents: &[f64]) -> Vec<f64> {
    let mut sums = sums.to_vec();
    for exponent in exponents.iter().filter(|exponent| exponent.abs() > 1e-9) {
        if sums.len() == 1 {
            break;
        }
        let factor = 3f64.powf(*exponent);
        let without = |pair: &[Vec<f64>]| {
            let both = pair[0].iter().zip(&pair[1]);
            both.map(|(a, b)| b + (b - a) * factor / (1.0 - factor)).collect()
        };
        sums = sums.windows(2).map(without).collect();
    }
    sums.pop().unwrap_or_default()
}

fn parity<K: Kernel>(summed: &Summed<'_, K>) -> Parity {
    let epsilon = <K::Real as Float>::epsilon().as_f64().powf(0.8);
    let h = summed.lattice.half_widths;
    let holds = |sign: f64| {
        [[0.9, 0.4, -0.6], [-0.3, 0.7, 0.8], [0.5, -0.8, 0.35]].into_iter().all(|d: [f64; 3]| {
            let d: [f64; 3] = [0, 1, 2].map(|k| 2.0 * d[k] * h[k]);
            let (here, there) = (summed.at(d), summed.at(d.map(|x| -x)));
            let rest = here.iter().zip(&there).map(|(a, b)| a - sign * b);
            l2_norm(rest) <= epsilon * l2_norm(here.iter().copied())
        })
    };
    if holds(1.0) {
        Parity::Even
    } else if holds(-1.0) {
        Parity::Odd
    } else {
        Parity::Neither
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_powers_are_taken_out() {
        // 7 and three powers of 3, one of which grows.
        let sum =
            |s: i32| vec![7.0 + 2.0 * 9f64.powi(s) - 3.0 * 9f64.powi(-s) + 0.5 * 81f64.powi(-s)];
        let sums: Vec<Vec<f64>> = (0..4).map(sum).collect();
        let found = extrapolated(&sums, &[2.0, 0.0, -2.0, -4.0, -6.0]);
        assert!((found[0] - 7.0).abs() < 1e-10, "{found:?}");
        assert_eq!(extrapolated(&sums[..1], &[2.0]), sums[0]);
    }
}
