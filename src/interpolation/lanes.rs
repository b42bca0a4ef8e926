//! Arithmetic side by side: whole registers of numbers, in the widest that the machine has.

use pulp::Simd;

use crate::interpolation::entries::zero;
use crate::linalg::matrix::Matrix;
use crate::numbers::lane::LANES;
use crate::numbers::traits::Scalar;

/// a b + c, rounded once where the processor can do that.
#[inline(always)]
pub(crate) fn multiply_add<V: Simd, S: Scalar>(a: S, b: S, c: S) -> S {
    if V::IS_SCALAR { a * b + c } else { num_traits::MulAdd::mul_add(a, b, c) }
}

/// sum += a b, lane by lane.
#[inline(always)]
pub(crate) fn fuse<V: Simd, S: Scalar>(a: &[S; LANES], b: &[S; LANES], sum: &mut [S; LANES]) {
    for ((sum, &a), &b) in sum.iter_mut().zip(a).zip(b) {
        *sum = multiply_add::<V, S>(a, b, *sum);
    }
}

/// The length of a padded row of n² coefficients.
pub(crate) fn row(n: usize) -> usize {
    (n * n).next_multiple_of(LANES)
}

/// A matrix whose columns are filled up with zeros to whole registers: for products with one vector.
#[derive(Debug)]
pub(crate) struct Padded<S> {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    /// Column after column.
    pub(crate) registers: Vec<[S; LANES]>,
}

impl<S: Scalar> Padded<S> {
    pub(crate) fn new(matrix: &Matrix<S>) -> Self {
        let Matrix { rows, columns, .. } = *matrix;
        let mut registers = Vec::with_capacity(rows.div_ceil(LANES) * columns);
        for j in 0..columns {
            registers.extend(matrix.column(j).chunks(LANES).map(|entries| {
                let mut register = [zero::<S>(); LANES];
                register[..entries.len()].copy_from_slice(entries);
                register
            }));
        }
        Self { rows, columns, registers }
    }

    /// A x, handed to `take` piece by piece: the first row of each piece, and its entries.
    #[inline(always)]
    pub(crate) fn product<V: Simd>(&self, x: &[S], mut take: impl FnMut(usize, &[S])) {
        let height = self.rows.div_ceil(LANES);
        let mut first = 0;
        while first < height {
            let rows = self.rows - first * LANES;
            match height - first {
                1 => take(first * LANES, &self.strip::<V, 1>(first, x).as_flattened()[..rows]),
                2 => take(first * LANES, &self.strip::<V, 2>(first, x).as_flattened()[..rows]),
                3 => take(first * LANES, &self.strip::<V, 3>(first, x).as_flattened()[..rows]),
                _ => {
                    let entries = self.strip::<V, 4>(first, x);
                    take(first * LANES, &entries.as_flattened()[..rows.min(4 * LANES)]);
                }
            }
            first += 4;
        }
    }

    /// R registers of A x. Every other column has sums of its own, which need not wait for each other.
    #[inline(always)]
    fn strip<V: Simd, const R: usize>(&self, first: usize, x: &[S]) -> [[S; LANES]; R] {
        let height = self.rows.div_ceil(LANES);
        let mut sums = [[[zero::<S>(); LANES]; R]; 2];
        let columns = self.registers.chunks_exact(2 * height);
        let last = columns.remainder();
        for (columns, x) in columns.zip(x.as_chunks::<2>().0) {
            for (half, sums) in sums.iter_mut().enumerate() {
                let registers = &columns[half * height + first..][..R];
                for (sum, register) in sums.iter_mut().zip(registers) {
                    fuse::<V, S>(register, &[x[half]; LANES], sum);
                }
            }
        }
        let [mut sums, others] = sums;
        if let (Some(registers), Some(&x)) = (last.get(first..first + R), x.last()) {
            for (sum, register) in sums.iter_mut().zip(registers) {
                fuse::<V, S>(register, &[x; LANES], sum);
            }
        }
        for (sum, other) in sums.as_flattened_mut().iter_mut().zip(others.as_flattened()) {
            *sum += *other;
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dispatch_level::DispatchLevel;
    use pulp::WithSimd;

    struct Product<'a>(&'a Padded<f64>, &'a [f64]);

    impl WithSimd for Product<'_> {
        type Output = Vec<f64>;

        fn with_simd<V: Simd>(self, _: V) -> Vec<f64> {
            let mut y = vec![f64::NAN; self.0.rows];
            self.0.product::<V>(self.1, |first, entries| {
                y[first..][..entries.len()].copy_from_slice(entries);
            });
            y
        }
    }

    #[test]
    fn products_with_a_vector_of_any_shape() {
        for (rows, columns) in [(1, 1), (7, 2), (8, 5), (17, 4), (25, 3), (32, 6), (70, 9)] {
            let a = Matrix::from_fn(rows, columns, |i, j| ((3 * i + 7 * j) as f64).sin());
            let x: Vec<f64> = (0..columns).map(|j| (j as f64).cos()).collect();
            let mut y = vec![0.0; rows];
            crate::linalg::dense::Dense::product(&a, &x, false, &mut y);
            for level in DispatchLevel::available() {
                let got = level.run(Product(&Padded::new(&a), &x));
                assert!(crate::relative_l2_error(&got, &y) < 1e-15, "{level}: {rows} × {columns}");
            }
        }
    }
}
