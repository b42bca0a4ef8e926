//! The inner loops of P2M and L2P: rows of coefficients side by side.

use pulp::Simd;

use crate::interpolation::lanes::{fuse, multiply_add};
use crate::interpolation::tuning::POINTS_TOGETHER;
use crate::numbers::lane::LANES;
use crate::numbers::traits::Real;

/// moments_r += Σ_p x_rp yz_p for some rows, over the first `count` points.
#[inline(always)]
pub(crate) fn add_rows<V: Simd, T: Real, const R: usize>(
    x: &[[T; POINTS_TOGETHER]; R],
    yz: &[T],
    count: usize,
    row: usize,
    moments: &mut [T],
) {
    for lanes in (0..row).step_by(LANES) {
        let mut sums: [[T; LANES]; R] =
            std::array::from_fn(|r| std::array::from_fn(|lane| moments[r * row + lanes + lane]));
        for p in 0..count.min(POINTS_TOGETHER) {
            let yz: &[T] = &yz[p * row + lanes..][..LANES];
            for (sums, x) in sums.iter_mut().zip(x) {
                for (sum, &yz) in sums.iter_mut().zip(yz) {
                    *sum = multiply_add::<V, T>(x[p], yz, *sum);
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            moments[r * row + lanes..][..LANES].copy_from_slice(sums);
        }
    }
}

/// Adds R rows of coefficients from the j-th on, times T̂_j(y) T̂_k(z), T̂_j'(y) T̂_k(z) and
/// T̂_j(y) T̂_k'(z).
#[inline(always)]
pub(crate) fn along_rows<V: Simd, T: Real, const R: usize, const GRADIENT: bool>(
    c: &[T],
    j: usize,
    [y, dy, z, dz]: [&[[T; LANES]]; 4],
    along: &mut [[T; LANES]; 3],
) {
    let over_z = over_rows::<V, T, R>(c, z);
    let slopes = if GRADIENT { over_rows::<V, T, R>(c, dz) } else { over_z };
    for r in 0..R {
        fuse::<V, T>(&over_z[r], &y[j + r], &mut along[0]);
        if GRADIENT {
            fuse::<V, T>(&over_z[r], &dy[j + r], &mut along[1]);
            fuse::<V, T>(&slopes[r], &y[j + r], &mut along[2]);
        }
    }
}

/// y z for one register of z.
#[inline(always)]
pub(crate) fn multiply<T: Real>(y: T, z: &[T], to: &mut [T]) {
    for (to, &z) in to[..LANES].iter_mut().zip(&z[..LANES]) {
        *to = y * z;
    }
}

/// Σ_k c_rk z_k for some rows of coefficients, at every lane.
#[inline(always)]
fn over_rows<V: Simd, T: Real, const R: usize>(c: &[T], z: &[[T; LANES]]) -> [[T; LANES]; R] {
    let n = z.len();
    let mut rows = [&c[..n]; R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = &c[r * n..][..n];
    }
    let mut sums = [[T::from_f64(0.0); LANES]; R];
    for (k, z) in z.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(&rows) {
            fuse::<V, T>(z, &[row[k]; LANES], sum);
        }
    }
    sums
}
