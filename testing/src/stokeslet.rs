//! A kernel whose charges and values are vectors.

use farfield::{Coordinates, Difference, Formula, FormulaKernel, Number, from_formula};
use glam::DVec3;

/// The slow flow that forces cause: K(x, y) = 1/r + d dᵀ/r³, d = x − y, a 3 × 3 matrix; 0 at r = 0.
#[derive(Clone, Copy, Debug)]
pub struct Stokeslet;

/// The kernel of the [`Stokeslet`], for forces and flows of three components.
pub fn stokeslet() -> FormulaKernel<Stokeslet, DVec3, [f64; 3]> {
    from_formula(Stokeslet).skip_coincident()
}

impl Formula for Stokeslet {
    type Of = Difference;
    type Entry<N: Number> = N;

    #[inline(always)]
    fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [N]) {
        let inverse = d.length().recip();
        let along = d.to_array().map(|component| component * inverse);
        for (k, entry) in g.iter_mut().enumerate() {
            let (i, j) = (k / 3, k % 3);
            let unit = if i == j { 1.0 } else { 0.0 };
            *entry = (along[i] * along[j] + unit) * inverse;
        }
    }

    fn fields(&self) -> usize {
        3
    }

    fn densities(&self) -> usize {
        3
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield::Interpolation;
    use farfield::conformance::{Samples, check, check_kernel};

    #[test]
    fn the_matrix_is_the_kernel_and_obeys_the_laws_of_expansions() {
        let samples = Samples {
            source: |p: DVec3, _| p,
            target: |p: DVec3, _| p,
            charge: |i| [1.0, -2.0, 0.5].map(|q| q + (i as f64).cos()),
        };
        check_kernel(&stokeslet(), &samples, 1e-14).unwrap();
        check(Interpolation::new(stokeslet()).order(7), &samples, 1e-3).unwrap();
    }
}
