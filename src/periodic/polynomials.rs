//! Smooth functions of the difference of two points of a box, in Chebyshev polynomials.

use crate::interpolation::chebyshev::polynomials;

/// Σ_pqr f_pqr T̂_p(d_x / h_x) T̂_q(d_y / h_y) T̂_r(d_z / h_z), with `order` polynomials along each axis, for several functions.
#[derive(Clone, Debug)]
pub(super) struct Polynomials {
    pub(super) order: usize,
    /// Half the edges of the box of differences.
    pub(super) half_widths: [f64; 3],
    /// `order`³ for one function after the other; the last axis runs fastest.
    pub(super) coefficients: Vec<f64>,
}

impl Polynomials {
    /// How many functions there are.
    pub(super) fn functions(&self) -> usize {
        self.coefficients.len() / self.order.pow(3)
    }

    /// All functions at a place.
    pub(super) fn at(&self, d: [f64; 3]) -> Vec<f64> {
        let rows: [Vec<f64>; 3] = std::array::from_fn(|k| {
            let mut row = vec![0.0; self.order];
            polynomials(d[k] / self.half_widths[k], &mut row);
            row
        });
        (0..self.functions()).map(|f| self.product(f, [&rows[0], &rows[1], &rows[2]])[0]).collect()
    }

    /// Σ_pqr f_pqr A_ip B_jq C_kr of a function, for matrices with a column for each polynomial; k runs fastest.
    pub(super) fn product(&self, function: usize, matrices: [&[f64]; 3]) -> Vec<f64> {
        let n = self.order;
        let coefficients = &self.coefficients[function * n.pow(3)..][..n.pow(3)];
        // The last axis, which becomes the first of what is summed next; and so each in turn.
        let last = along_last(coefficients, n, matrices[2]);
        let middle = along_last(&last, n, matrices[1]);
        along_last(&middle, n, matrices[0])
    }
}

/// From t[…, r] to Σ_r C_kr t[…, r] with k as the first index.
fn along_last(tensor: &[f64], n: usize, matrix: &[f64]) -> Vec<f64> {
    let rest = tensor.len() / n;
    let mut product = vec![0.0; matrix.len() / n * rest];
    for (row, sums) in matrix.chunks_exact(n).zip(product.chunks_exact_mut(rest)) {
        for (sum, own) in sums.iter_mut().zip(tensor.chunks_exact(n)) {
            *sum = own.iter().zip(row).map(|(t, c)| t * c).sum();
        }
    }
    product
}
