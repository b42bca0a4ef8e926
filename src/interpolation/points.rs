//! P2M and L2P in polynomials: sums over points, four at a time, along padded rows.
//!
//! The array of one column of right-hand sides holds the coefficient of T̂_i(x) T̂_j(y) T̂_k(z) at
//! i · [`row`]`(n)` + j · n + k.

use pulp::{Simd, WithSimd};

use crate::chebyshev::{derivatives, polynomials};
use crate::interpolation::MAX_ORDER;
use crate::interpolation::basis::Basis;
use crate::real::{Real, Scalar};

/// Points that are summed side by side.
const TOGETHER: usize = 4;

/// Rows are padded to a multiple of this many numbers, which are summed in registers.
const LANES: usize = 8;

/// P2M of a cell.
pub(crate) struct Moments<'a, S: Scalar> {
    pub(crate) basis: &'a Basis<S>,
    pub(crate) powers: &'a mut Powers<S::Real>,
    /// Sources in half-widths.
    pub(crate) points: &'a [[S::Real; 3]],
    /// Densities, an array per right-hand side, part and component.
    pub(crate) numbers: &'a [S::Real],
    /// Zeros; Chebyshev moments afterwards.
    pub(crate) arrays: &'a mut [S::Real],
    pub(crate) sums: &'a mut Vec<S>,
    /// What to add to.
    pub(crate) multipole: &'a mut [S],
}

impl<S: Scalar> WithSimd for Moments<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { basis, powers, points, numbers, arrays, sums, multipole } = self;
        if basis.rank() == 0 {
            return;
        }
        powers.add_moments(points, numbers, arrays);
        let len = arrays.len() / (multipole.len() / basis.rank());
        for (m, arrays) in multipole.chunks_exact_mut(basis.rank()).zip(arrays.chunks_exact(len)) {
            let (re, im) = arrays.split_at(len / parts::<S>());
            basis.add_moments(powers.n, [re, if im.is_empty() { re } else { im }], sums, m);
        }
    }
}

/// L2P of a cell, before attributes are applied.
pub(crate) struct Fields<'a, S: Scalar> {
    pub(crate) basis: &'a Basis<S>,
    pub(crate) powers: &'a mut Powers<S::Real>,
    /// Targets in half-widths.
    pub(crate) points: &'a [[S::Real; 3]],
    /// What to add to: fields, an array per right-hand side, part and component; after each those of
    /// the three derivatives, if asked for.
    pub(crate) numbers: &'a mut [S::Real],
    /// Zeros; coefficients afterwards.
    pub(crate) arrays: &'a mut [S::Real],
    pub(crate) local: &'a [S],
    pub(crate) sums: &'a mut Vec<S>,
    pub(crate) gradient: bool,
}

impl<S: Scalar> WithSimd for Fields<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { basis, powers, points, numbers, arrays, local, sums, gradient } = self;
        if basis.rank() == 0 {
            return;
        }
        let len = arrays.len() / (local.len() / basis.rank());
        for (l, arrays) in local.chunks_exact(basis.rank()).zip(arrays.chunks_exact_mut(len)) {
            let (re, im) = arrays.split_at_mut(len / parts::<S>());
            basis.add_coefficients(powers.n, l, sums, [re, im]);
        }
        powers.add_fields(points, arrays, gradient, numbers);
    }
}

/// How many real numbers one number of type `S` is.
pub(crate) const fn parts<S: Scalar>() -> usize {
    if S::COMPLEX { 2 } else { 1 }
}

/// Length of a padded row of n² coefficients.
pub(crate) fn row(n: usize) -> usize {
    (n * n).next_multiple_of(LANES)
}

/// The polynomials at up to four points.
pub(crate) struct Powers<T> {
    n: usize,
    x: [[T; MAX_ORDER]; TOGETHER],
    dx: [[T; MAX_ORDER]; TOGETHER],
    /// T̂_j(y) T̂_k(z), a row per point; then ∂/∂y of it, then ∂/∂z.
    yz: Vec<T>,
}

impl<T: Real> Powers<T> {
    pub(crate) fn new(n: usize) -> Self {
        let zero = T::from_f64(0.0);
        let x = [[zero; MAX_ORDER]; TOGETHER];
        Self { n, x, dx: x, yz: vec![zero; 3 * TOGETHER * row(n)] }
    }

    /// m̃ += Σ_p T̂(y_p) d_p for every column: `densities` holds the columns of all points one after the
    /// other, `moments` the columns' arrays.
    #[inline(always)]
    pub(crate) fn add_moments(&mut self, points: &[[T; 3]], densities: &[T], moments: &mut [T]) {
        let (n, row) = (self.n, row(self.n));
        for (i, four) in points.chunks(TOGETHER).enumerate() {
            self.set(four, false);
            let b: [&[T]; TOGETHER] = std::array::from_fn(|p| &self.yz[p * row..][..row]);
            let columns = densities.chunks_exact(points.len());
            for (moments, densities) in moments.chunks_exact_mut(n * row).zip(columns) {
                // The last points of a short group are repeated without weight.
                let d: [T; TOGETHER] = std::array::from_fn(|p| match p < four.len() {
                    true => densities[i * TOGETHER + p],
                    false => T::from_f64(0.0),
                });
                for (a, moments) in moments.chunks_exact_mut(row).enumerate() {
                    let w: [T; TOGETHER] = std::array::from_fn(|p| d[p] * self.x[p][a]);
                    let products = b[0].iter().zip(b[1]).zip(b[2]).zip(b[3]);
                    for (m, (((&b0, &b1), &b2), &b3)) in moments.iter_mut().zip(products) {
                        *m += (w[0] * b0 + w[1] * b1) + (w[2] * b2 + w[3] * b3);
                    }
                }
            }
        }
    }

    /// f_p += Σ T̂(x_p) f̃ for every column of coefficients f̃: `fields` holds the columns of all points
    /// one after the other. With `gradients`, four columns each: f and its derivatives in half-widths.
    #[inline(always)]
    pub(crate) fn add_fields(
        &mut self,
        points: &[[T; 3]],
        coefficients: &[T],
        gradients: bool,
        fields: &mut [T],
    ) {
        let row = row(self.n);
        let parts: usize = if gradients { 4 } else { 1 };
        let count = points.len();
        for (i, four) in points.chunks(TOGETHER).enumerate() {
            self.set(four, gradients);
            for (c, coefficients) in coefficients.chunks_exact(self.n * row).enumerate() {
                for part in 0..parts {
                    let x = if part == 1 { &self.dx } else { &self.x };
                    let yz = &self.yz[part.saturating_sub(1) * TOGETHER * row..][..TOGETHER * row];
                    let sums = contract(self.n, row, x, yz, coefficients);
                    let field = &mut fields[(c * parts + part) * count + i * TOGETHER..];
                    for (field, sum) in field.iter_mut().zip(&sums[..four.len()]) {
                        *field += *sum;
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn set(&mut self, points: &[[T; 3]], gradients: bool) {
        let (n, row) = (self.n, row(self.n));
        let zero = T::from_f64(0.0);
        for p in 0..TOGETHER {
            let [x, y, z] = points[p.min(points.len() - 1)];
            let (mut ty, mut tz) = ([zero; MAX_ORDER], [zero; MAX_ORDER]);
            polynomials(x, &mut self.x[p][..n]);
            polynomials(y, &mut ty[..n]);
            polynomials(z, &mut tz[..n]);
            outer(&ty[..n], &tz[..n], &mut self.yz[p * row..][..row]);
            if gradients {
                let (mut dy, mut dz) = ([zero; MAX_ORDER], [zero; MAX_ORDER]);
                derivatives(x, &mut self.dx[p][..n]);
                derivatives(y, &mut dy[..n]);
                derivatives(z, &mut dz[..n]);
                outer(&dy[..n], &tz[..n], &mut self.yz[(TOGETHER + p) * row..][..row]);
                outer(&ty[..n], &dz[..n], &mut self.yz[(2 * TOGETHER + p) * row..][..row]);
            }
        }
    }
}

#[inline(always)]
fn outer<T: Real>(y: &[T], z: &[T], yz: &mut [T]) {
    for (yz, &y) in yz.chunks_exact_mut(z.len()).zip(y) {
        for (yz, &z) in yz.iter_mut().zip(z) {
            *yz = y * z;
        }
    }
}

/// Σ_i x_i Σ_jk c_ijk (yz)_jk at four points.
#[inline(always)]
fn contract<T: Real>(
    n: usize,
    row: usize,
    x: &[[T; MAX_ORDER]; TOGETHER],
    yz: &[T],
    coefficients: &[T],
) -> [T; TOGETHER] {
    let zero = T::from_f64(0.0);
    let mut sums = [[zero; LANES]; TOGETHER];
    for lanes in (0..row).step_by(LANES) {
        let mut along_x = [[zero; LANES]; TOGETHER];
        for i in 0..n {
            let c = &coefficients[i * row + lanes..][..LANES];
            for (sum, x) in along_x.iter_mut().zip(x) {
                for (sum, &c) in sum.iter_mut().zip(c) {
                    *sum += x[i] * c;
                }
            }
        }
        for (p, (sum, along_x)) in sums.iter_mut().zip(&along_x).enumerate() {
            let b = &yz[p * row + lanes..][..LANES];
            for ((sum, &a), &b) in sum.iter_mut().zip(along_x).zip(b) {
                *sum += a * b;
            }
        }
    }
    sums.map(|lanes| lanes.into_iter().fold(zero, |sum, lane| sum + lane))
}
