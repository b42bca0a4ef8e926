//! The harmonic expansion of the power laws |x − y|^(−2λ): basis functions and their translations.
//!
//! For |y| < |x| and any real λ,
//!
//! ```text
//! |x − y|^(−2λ) = Σ_k S_k(x) R_k(y),        k = (n, l, m),  l = n − 2j,  |m| ≤ l,
//! R_nlm(y) = |y|^n Y_lm(y/|y|)                                  regular,  a polynomial of degree n
//! S_nlm(x) = e_n^j |x|^(−n−2λ) Y_lm(x/|x|)                      singular
//! e_n^j    = 4π (λ)_{n−j} (λ−½)_j / ((3/2)_{n−j} j!)            (a)_k the Pochhammer symbol
//! ```
//!
//! where Y_lm are *real* orthonormal spherical harmonics (without the Condon–Shortley phase; m < 0
//! stands for the sine), so that real charges have real moments. Only terms with e_n^j ≠ 0 are kept:
//! (p+1)² for λ = ½, where l = n; five for the squared distance, λ = −1; all polynomials of degree
//! ≤ p otherwise. Each of these sets is closed under translation.
//!
//! A multipole expansion is M_k = Σ_j R_k(y_j) q_j, its field Σ_k S_k(x) M_k. A local expansion has
//! terms L_k = Σ_j S_k(y_j) q_j and the field Σ_k L_k R_k(x).
//!
//! All lengths are meant to be in units of a cell's half-width, where the terms are of order one;
//! nothing here knows about scene units.

mod basis;
mod coupling;
mod level;
mod shift;
mod solid;
mod swap;
mod translation;

use farfield::{Error, Real};
use rayon::prelude::*;

use shift::AxialShift;
use solid::SolidHarmonics;
use swap::AxisSwap;

pub use translation::Scratch;

/// The highest order of an expansion.
pub const MAX_ORDER: usize = 56;

/// Indices of one term of an expansion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// Degree of the regular function as a polynomial, 0 ≤ n ≤ p.
    pub n: usize,
    /// Degree of the spherical harmonic, n − l even.
    pub l: usize,
    /// Order of the spherical harmonic, |m| ≤ l; negative for sin |m|φ.
    pub m: i32,
}

/// Basis functions and translation operators of |x − y|^(−2λ) to a given order.
#[derive(Clone, Debug)]
pub struct Harmonic<T> {
    lambda: f64,
    order: usize,
    len: usize,
    /// By ascending n, then l.
    shells: Vec<Shell<T>>,
    /// For each l, where the terms of shell (l, l) start.
    heads: Vec<usize>,
    solid: SolidHarmonics<T>,
    swap: AxisSwap<T>,
    /// By ascending m.
    axial: Vec<AxialShift<T>>,
}

/// The 2l + 1 terms that share n and l.
#[derive(Clone, Copy, Debug)]
struct Shell<T> {
    n: usize,
    l: usize,
    start: usize,
    /// Where shell (n − 2, l) starts; `start` if n = l.
    below: usize,
    /// e_n^j, with j = (n − l)/2.
    weight: T,
}

impl<T: Real> Harmonic<T> {
    /// The expansion of |x − y|^(−2λ) up to degree `order`.
    ///
    /// λ is any finite number; one that isn't finite gives terms that aren't finite.
    ///
    /// # Errors
    /// [`Error::InvalidOrder`] if `order` exceeds [`MAX_ORDER`].
    pub fn new(lambda: f64, order: usize) -> Result<Self, Error> {
        if order > MAX_ORDER {
            return Err(Error::InvalidOrder { min: 0, max: MAX_ORDER, found: order });
        }
        let mut shells: Vec<Shell<T>> = Vec::new();
        let mut heads = Vec::new();
        let mut len = 0;
        for n in 0..=order {
            for l in (n % 2..=n).step_by(2) {
                let e = weight(lambda, n, (n - l) / 2);
                if e == 0.0 {
                    continue;
                }
                if l == n {
                    heads.push(len);
                }
                let below = shells.iter().rfind(|shell| shell.l == l).map_or(len, |s| s.start);
                shells.push(Shell { n, l, start: len, below, weight: T::from_f64(e) });
                len += 2 * l + 1;
            }
        }
        let top = heads.len() - 1;
        let axial =
            (0..=top).into_par_iter().map(|m| AxialShift::new(lambda, m, &shells)).collect();
        Ok(Self {
            lambda,
            order,
            len,
            shells,
            heads,
            solid: SolidHarmonics::new(top),
            swap: AxisSwap::new(top),
            axial,
        })
    }

    /// The least order, from `least` on, whose `error` is at most `tolerance`.
    ///
    /// # Errors
    /// [`Error::InvalidTolerance`] unless 0 < `tolerance` < 1; [`Error::UnreachableTolerance`] if
    /// [`MAX_ORDER`] doesn't suffice.
    pub fn order_for(
        tolerance: f64,
        least: usize,
        error: impl Fn(usize) -> f64,
    ) -> Result<usize, Error> {
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(Error::InvalidTolerance { found: tolerance });
        }
        let unreachable =
            || Error::UnreachableTolerance { requested: tolerance, reachable: error(MAX_ORDER) };
        (least..=MAX_ORDER).find(|&order| error(order) <= tolerance).ok_or_else(unreachable)
    }

    /// The exponent's λ.
    pub fn lambda(&self) -> f64 {
        self.lambda
    }

    /// The order p: the highest degree n.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Number of terms.
    #[expect(clippy::len_without_is_empty, reason = "there always is the term of degree 0")]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Multiply-adds of one M2L translation of real terms.
    pub fn m2l_work(&self) -> usize {
        let turns = 4 * 4 * self.len;
        let exchanges: usize =
            self.shells.iter().map(|shell| 4 * (shell.l * (shell.l + 1) + 1)).sum();
        let shifts: usize = self.axial.iter().map(|axial| 2 * axial.shells.len().pow(2)).sum();
        turns + exchanges + shifts
    }

    /// Seconds of one core that M2L takes for a leaf and its share of the cells above, with a full
    /// interaction list: 8/7 of that of 189 pairs of cells.
    pub fn leaf_seconds(&self, columns: usize) -> f64 {
        let work = (columns * self.m2l_work()) as f64;
        189.0 * 8.0 / 7.0 * work * MULTIPLY_ADD_SECONDS
    }

    /// The terms in their order of storage.
    pub fn terms(&self) -> impl Iterator<Item = Term> + '_ {
        self.shells.iter().flat_map(|shell| {
            let mut terms = vec![Term { n: shell.n, l: shell.l, m: 0 }; 2 * shell.l + 1];
            for m in 1..=shell.l {
                terms[solid::cosine(shell.l, m)].m = m as i32;
                terms[solid::sine(shell.l, m)].m = -(m as i32);
            }
            terms
        })
    }
}

/// e_n^j = 4π (λ)_{n−j} (λ−½)_j / ((3/2)_{n−j} j!).
fn weight(lambda: f64, n: usize, j: usize) -> f64 {
    let mut e = 4.0 * std::f64::consts::PI;
    for i in 0..n - j {
        e *= (lambda + i as f64) / (1.5 + i as f64);
    }
    for i in 0..j {
        e *= (lambda - 0.5 + i as f64) / (1.0 + i as f64);
    }
    e
}

/// Seconds that M2L takes for a multiply-add, measured on a core with AVX-512.
const MULTIPLY_ADD_SECONDS: f64 = 2e-10;

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn weights_of_the_inverse_fourth_power() {
        // Hausner 1997, in units of 4π.
        let expected = [
            (0, 0, 1.0),
            (1, 0, 4.0 / 3.0),
            (2, 0, 8.0 / 5.0),
            (2, 1, 2.0),
            (3, 0, 64.0 / 35.0),
            (3, 1, 12.0 / 5.0),
            (4, 0, 128.0 / 63.0),
            (4, 1, 96.0 / 35.0),
            (4, 2, 3.0),
        ];
        for (n, j, e) in expected {
            let found = weight(2.0, n, j) / (4.0 * std::f64::consts::PI);
            assert_relative_eq!(found, e, max_relative = 1e-14);
        }
    }

    #[test]
    fn only_terms_that_occur_are_kept() {
        for order in [0, 1, 5, 12] {
            let count = |lambda| Harmonic::<f64>::new(lambda, order).unwrap().len();
            assert_eq!(count(0.5), (order + 1).pow(2));
            assert_eq!(count(1.0), (order + 1) * (order + 2) * (order + 3) / 6);
            assert_eq!(count(2.0), count(1.0));
            assert_eq!(count(-1.0), [1, 4, 5][order.min(2)]);
            assert_eq!(count(0.0), 1);
        }
    }

    #[test]
    fn every_term_is_listed_once() {
        let harmonic = Harmonic::<f32>::new(2.0, 7).unwrap();
        let mut terms: Vec<_> = harmonic.terms().map(|t| (t.n, t.l, t.m)).collect();
        assert_eq!(terms.len(), harmonic.len());
        terms.sort_unstable();
        terms.dedup();
        assert_eq!(terms.len(), harmonic.len());
        assert!(terms.iter().all(|&(n, l, m)| (n - l) % 2 == 0 && m.unsigned_abs() as usize <= l));
    }

    #[test]
    fn orders_above_the_highest_are_refused() {
        let refused = Error::InvalidOrder { min: 0, max: MAX_ORDER, found: MAX_ORDER + 1 };
        assert_eq!(Harmonic::<f64>::new(0.5, MAX_ORDER + 1).unwrap_err(), refused);
    }
}
