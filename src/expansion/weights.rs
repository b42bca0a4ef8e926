//! What brings the entries of a kernel to one size.

use crate::numbers::traits::{Real, Scalar};

/// What the rows and columns of G are multiplied by, so that none outweighs the others: a_i G_ij b_j.
///
/// Charges and dipoles, or values and their derivatives, are measured in different units. An error that is small
/// beside one of them may be large beside another. All are powers of two, so that weights round nothing.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Weights {
    /// a, one for each field; none if all weights are 1.
    pub fields: Vec<f64>,
    /// b, one for each density; none if all weights are 1.
    pub densities: Vec<f64>,
}

impl Weights {
    /// Whether all are 1.
    pub fn are_even(&self) -> bool {
        self.fields.is_empty()
    }

    /// Both, one after the other.
    pub(crate) fn and(&self, other: &Self) -> Self {
        let product = |own: &[f64], other: &[f64]| -> Vec<f64> {
            match (own, other) {
                ([], all) | (all, []) => all.to_vec(),
                (own, other) => own.iter().zip(other).map(|(a, b)| a * b).collect(),
            }
        };
        Self {
            fields: product(&self.fields, &other.fields),
            densities: product(&self.densities, &other.densities),
        }
    }

    /// Multiplies matrices of so many rows that are given one after the other; those of derivatives have three rows
    /// for each field.
    pub(crate) fn apply<S: Scalar>(&self, rows: usize, entries: &mut [S]) {
        if self.are_even() {
            return;
        }
        let (each, columns) = (rows / self.fields.len(), self.densities.len());
        for matrix in entries.chunks_exact_mut(rows * columns) {
            for (i, row) in matrix.chunks_exact_mut(columns).enumerate() {
                let a = self.fields[i / each];
                row.iter_mut().zip(&self.densities).for_each(|(g, b)| *g *= weight::<S>(a * b));
            }
        }
    }
}

/// Multiplies, or divides if `inverse`, the components of an array by their weights: pieces of `len` numbers, component
/// after component and again from the first. Nothing if there are no weights.
pub(crate) fn weigh<S: Scalar>(weights: &[f64], inverse: bool, len: usize, numbers: &mut [S]) {
    if weights.is_empty() || len == 0 {
        return;
    }
    for numbers in numbers.chunks_exact_mut(weights.len() * len) {
        for (numbers, own) in numbers.chunks_exact_mut(len).zip(weights) {
            let own = weight::<S>(if inverse { own.recip() } else { *own });
            numbers.iter_mut().for_each(|number| *number *= own);
        }
    }
}

fn weight<S: Scalar>(weight: f64) -> S {
    S::from_real(S::Real::from_f64(weight))
}
