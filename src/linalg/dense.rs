//! Small dense matrices, on top of `faer`: products that fill the machine's vector units, and the
//! factorisations by which operators are compressed.

use faer::linalg::matmul::matmul;
use faer::prelude::SolveLstsq;
use faer::{Accum, MatMut, MatRef, Par};
use num_complex::Complex;

use crate::dispatch_level::{dispatch, leaving_registers_clean};
use crate::linalg::batched::{Batched, Products};
use crate::linalg::matrix::Matrix;

/// The left half of a factorisation A = U diag(σ) V^H with orthonormal columns, σ descending.
pub struct Svd<S> {
    pub(crate) u: Matrix<S>,
    pub(crate) sigma: Vec<f64>,
}

/// Numbers that dense matrices can be made of: f32, f64 and the complex numbers over them.
pub trait Dense: Copy + Default + Send + Sync + 'static {
    /// C = A B, or C += A B, for C of A.rows × n entries and B of A.columns × n, column after column.
    #[doc(hidden)]
    fn product(a: &Matrix<Self>, b: &[Self], add: bool, c: &mut [Self]);

    /// y = A x, or y += A x if `add`, for every pair of places [x, y]: where x starts in `from`, and y in
    /// `to`.
    #[doc(hidden)]
    fn products(
        a: &Batched<Self>,
        places: &[[usize; 2]],
        add: bool,
        from: &[Self],
        to: &mut [Self],
    );

    /// The thin singular value decomposition; none if it does not converge.
    #[doc(hidden)]
    fn svd(a: &Matrix<Self>) -> Option<Svd<Self>>;

    /// Q and R of A P = Q R, column-pivoted and thin, with the order of the columns that P stands for.
    #[doc(hidden)]
    fn pivoted_qr(a: &Matrix<Self>) -> (Matrix<Self>, Matrix<Self>, Vec<usize>);

    /// The X that minimises ‖A X − B‖ for a tall A of full rank.
    #[doc(hidden)]
    fn least_squares(a: &Matrix<Self>, b: &Matrix<Self>) -> Matrix<Self>;
}

impl<S: Dense> Batched<S> {
    /// y = A x, or y += A x if `add`, for every pair of places [x, y]: where x starts in `from`, and y,
    /// of `height` entries, in `to`.
    pub(crate) fn products(&self, places: &[[usize; 2]], add: bool, from: &[S], to: &mut [S]) {
        S::products(self, places, add, from, to);
    }
}

/// Products in the type itself; factorisations, which are set-up, in its double precision. Those of complex numbers
/// are compiled where they are used (`inline`), which is seldom.
macro_rules! dense {
    ($(#[$compiled:meta])? $t:ty, $zero:expr, $one:expr, $widen:expr, $narrow:expr) => {
        impl Dense for $t {
            $(#[$compiled])?
            fn product(a: &Matrix<Self>, b: &[Self], add: bool, c: &mut [Self]) {
                if a.rows == 0 || a.columns == 0 {
                    if !add {
                        c.fill($zero);
                    }
                    return;
                }
                let n = b.len() / a.columns;
                let b = MatRef::from_column_major_slice(b, a.columns, n);
                let c = MatMut::from_column_major_slice_mut(c, a.rows, n);
                let accum = if add { Accum::Add } else { Accum::Replace };
                leaving_registers_clean(|| matmul(c, accum, view(a), b, $one, Par::Seq));
            }

            $(#[$compiled])?
            fn products(
                matrix: &Batched<Self>,
                places: &[[usize; 2]],
                add: bool,
                from: &[Self],
                to: &mut [Self],
            ) {
                dispatch(Products { matrix, places, add, from, to });
            }

            $(#[$compiled])?
            fn svd(a: &Matrix<Self>) -> Option<Svd<Self>> {
                let a = a.map($widen);
                let svd = leaving_registers_clean(|| view(&a).thin_svd()).ok()?;
                let sigma = svd.S().column_vector().iter().map(|&s| Complex::from(s).re);
                Some(Svd { u: owned(svd.U()).map($narrow), sigma: sigma.collect() })
            }

            $(#[$compiled])?
            fn pivoted_qr(a: &Matrix<Self>) -> (Matrix<Self>, Matrix<Self>, Vec<usize>) {
                let a = a.map($widen);
                let (q, qr) = leaving_registers_clean(|| {
                    let qr = view(&a).col_piv_qr();
                    (qr.compute_thin_Q(), qr)
                });
                let (order, _) = qr.P().arrays();
                let [q, r] = [owned(q.as_ref()), owned(qr.thin_R())];
                (q.map($narrow), r.map($narrow), order.to_vec())
            }

            $(#[$compiled])?
            fn least_squares(a: &Matrix<Self>, b: &Matrix<Self>) -> Matrix<Self> {
                let (a, b) = (a.map($widen), b.map($widen));
                let x = leaving_registers_clean(|| view(&a).col_piv_qr().solve_lstsq(view(&b)));
                owned(x.as_ref()).map($narrow)
            }
        }
    };
}

dense!(f64, 0.0, 1.0, |x| x, |x| x);
dense!(f32, 0.0, 1.0, f64::from, |x| x as f32);
dense!(#[inline] Complex<f64>, Complex::ZERO, Complex::ONE, |x| x, |x| x);
dense!(
    #[inline]
    Complex<f32>,
    Complex::ZERO,
    Complex::ONE,
    |x: Self| Complex::new(f64::from(x.re), f64::from(x.im)),
    |x: Complex<f64>| Complex::new(x.re as f32, x.im as f32)
);

fn view<S>(a: &Matrix<S>) -> MatRef<'_, S> {
    MatRef::from_column_major_slice(&a.data, a.rows, a.columns)
}

fn owned<S: Copy>(a: MatRef<'_, S>) -> Matrix<S> {
    Matrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn sample(rows: usize, columns: usize) -> Matrix<Complex<f64>> {
        Matrix::from_fn(rows, columns, |i, j| {
            Complex::new(((3 * i + 7 * j) as f64).sin(), ((5 * i + j) as f64).cos())
        })
    }

    fn product(a: &Matrix<Complex<f64>>, b: &Matrix<Complex<f64>>) -> Matrix<Complex<f64>> {
        let mut c = Matrix::from_fn(a.rows, b.columns, |_, _| Complex::default());
        Dense::product(a, &b.data, false, &mut c.data);
        c
    }

    fn assert_close(a: &Matrix<Complex<f64>>, b: &Matrix<Complex<f64>>) {
        for (a, b) in a.data.iter().zip(&b.data) {
            assert_relative_eq!(a.re, b.re, epsilon = 1e-12);
            assert_relative_eq!(a.im, b.im, epsilon = 1e-12);
        }
    }

    #[test]
    fn products_sum_over_the_inner_index_and_add() {
        let (a, b) = (sample(3, 4), sample(4, 2));
        let by_hand = Matrix::from_fn(3, 2, |i, j| {
            (0..4).map(|k| a.at(i, k) * b.at(k, j)).sum::<Complex<f64>>()
        });
        let mut c = product(&a, &b);
        assert_close(&c, &by_hand);
        Dense::product(&a, &b.data, true, &mut c.data);
        assert_close(&c, &by_hand.map(|x| x + x));
    }

    #[test]
    fn factors_multiply_to_the_matrix() {
        let a = sample(5, 3);
        let Svd { u, sigma } = Dense::svd(&a).unwrap();
        assert!(sigma.is_sorted_by(|a, b| a >= b));
        // diag(σ) V^H = U^H A: its rows are orthogonal and as long as σ, and U takes it back to A.
        let adjoint = |a: &Matrix<Complex<f64>>| a.transpose().map(|x| x.conj());
        let rows = product(&adjoint(&u), &a);
        assert_close(&product(&u, &rows), &a);
        let squares =
            Matrix::from_fn(
                3,
                3,
                |i, j| if i == j { sigma[i].powi(2).into() } else { Complex::ZERO },
            );
        assert_close(&product(&rows, &adjoint(&rows)), &squares);

        let (q, r, order) = Dense::pivoted_qr(&a);
        assert_close(&product(&q, &r), &Matrix::from_fn(5, 3, |i, j| a.at(i, order[j])));
    }

    #[test]
    fn least_squares_finds_what_was_multiplied() {
        let (a, x) = (sample(6, 3), sample(3, 2));
        assert_close(&Dense::least_squares(&a, &product(&a, &x)), &x);
    }
}
