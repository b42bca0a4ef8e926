//! Shifts along the z axis by one unit of length.

use farfield::Real;

use super::coupling::axial_gaunt;
use super::solid::{cosine, sine};
use super::{MAX_ORDER, Shell, weight};

/// For one |m|, how a regular and a singular function of order m look from a point one unit away
/// along z. Shifts along z leave m alone and treat sine and cosine alike, and other distances only
/// put powers of the distance in front.
#[derive(Clone, Debug)]
pub(super) struct AxialShift<T> {
    /// The shells with l ≥ m, by ascending n.
    pub(super) shells: Vec<AxialShell>,
    pub(super) m: usize,
    /// Row after row, R_i(ẑ + y) = Σ_{i' ≤ i} A_ii' R_i'(y): the lower triangle.
    pub(super) regular: Vec<T>,
    /// Column after column, S_i(ẑ + y) = Σ_i' B_ii' R_i'(y): the full square.
    pub(super) singular: Vec<T>,
}

/// Where the terms ±m of one shell lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct AxialShell {
    pub(super) n: usize,
    pub(super) cosine: usize,
    /// Unused for m = 0.
    pub(super) sine: usize,
}

impl<T: Real> AxialShift<T> {
    pub(super) fn new(lambda: f64, m: usize, shells: &[Shell<T>]) -> Self {
        let shells: Vec<_> = shells.iter().filter(|shell| shell.l >= m).collect();
        let top = shells.iter().map(|shell| shell.l).max().unwrap_or(m);
        let width = top - m + 1;
        let couplings: Vec<_> = (0..width * width)
            .map(|pair| axial_gaunt(m + pair / width, m + pair % width, m))
            .collect();
        let coupling = |l: usize, big_l: usize| &couplings[(l - m) * width + big_l - m][..];

        let mut regular = Vec::with_capacity(shells.len() * (shells.len() + 1) / 2);
        for (i, from) in shells.iter().enumerate() {
            for to in &shells[..=i] {
                let (nu, s) = (from.n as f64, (to.n - to.l) / 2);
                let a = coefficient(nu, from.l, to.l, s, coupling(to.l, from.l));
                regular.push(T::from_f64(a));
            }
        }
        let mut singular = Vec::with_capacity(shells.len() * shells.len());
        let weights: Vec<_> =
            shells.iter().map(|from| weight(lambda, from.n, (from.n - from.l) / 2)).collect();
        for to in &shells {
            for (from, e) in shells.iter().zip(&weights) {
                let (nu, s) = (-(from.n as f64) - 2.0 * lambda, (to.n - to.l) / 2);
                let a = coefficient(nu, from.l, to.l, s, coupling(to.l, from.l));
                singular.push(T::from_f64(e * a));
            }
        }
        let shells = shells
            .into_iter()
            .map(|shell| AxialShell {
                n: shell.n,
                cosine: shell.start + cosine(shell.l, m),
                sine: shell.start + sine(shell.l, m),
            })
            .collect();
        Self { shells, m, regular, singular }
    }
}

/// The coefficient of |y|^n Y_l^m(ŷ), n = l + 2s, in |x|^ν Y_L^m(x̂) at x = ẑ + y (Sack 1964):
///
/// ```text
/// a   = c_ls Λ_s Σ_l2 G D,                        l2 = |l − L|, …, l + L in steps of 2
/// c_ls = 4π / ((2s)!! (2l+2s+1)!!)
/// Λ_s = Π_{i<s} (ν − 2i − L)(ν − 2i + L + 1)
/// D   = Π_{i<t} (ν' + L + 1 − 2i) · Π_{i<l−t} (ν' − L − 2i),    ν' = ν − 2s,  t = (l + L − l2)/2
/// ```
///
/// with 4π G in `gaunt`.
fn coefficient(nu: f64, big_l: usize, l: usize, s: usize, gaunt: &[f64]) -> f64 {
    let degree = big_l as f64;
    let mut front = 1.0;
    for i in 1..=s {
        let before = nu - 2.0 * (i - 1) as f64;
        front *= (before - degree) * (before + degree + 1.0) / (2 * i) as f64;
    }
    for i in 0..l + s {
        front /= (2 * i + 3) as f64;
    }
    let nu = nu - 2.0 * s as f64;
    // Π_{i<k} (ν' − L − 2i) for k = 0, …, l
    let mut falling = [1.0; MAX_ORDER + 1];
    for i in 0..l {
        falling[i + 1] = falling[i] * (nu - degree - 2.0 * i as f64);
    }
    let mut sum = 0.0;
    let mut rising = 1.0;
    for t in 0..=l.min(big_l) {
        sum += gaunt[gaunt.len() - 1 - 2 * t] * rising * falling[l - t];
        rising *= nu + degree + 1.0 - 2.0 * t as f64;
    }
    front * sum
}
