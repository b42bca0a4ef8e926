//! M2L matrices, factored: as low a rank as the tolerance allows, in as few digits as it needs.

use std::ops::Range;

use crate::dense::{Matrix, Svd};
use crate::interpolation::basis::{Basis, product};
use crate::probe::{Formula, zero};
use crate::real::{Point, Real, Scalar, Vector};

/// C = Σ_i σ_i u_i v_iᴴ in two parts: what must keep all digits, and what is so small that single
/// precision is enough for the tolerance.
#[derive(Debug)]
pub(crate) struct Transfer<S: Scalar> {
    pub(crate) full: Option<Factors<S>>,
    pub(crate) single: Option<Factors<S::Single>>,
}

/// L R, or L alone where two factors would cost more.
#[derive(Debug)]
pub(crate) struct Factors<S> {
    left: Matrix<S>,
    right: Option<Matrix<S>>,
}

impl<S: Scalar> Transfer<S> {
    /// C, factored to the lowest rank that leaves out at most `cut`.
    pub(crate) fn new(c: Matrix<S>, cut: f64) -> Self {
        let Some(Svd { u, sigma, v_h }) = decompose(&c, cut) else {
            let full = Factors { left: c, right: None };
            return Self { full: Some(full), single: None };
        };
        let rank = len_without_tail(sigma.len(), cut, |i| sigma[i] * sigma[i]);
        let rounded = |from: usize| {
            let size: f64 = sigma[from..rank].iter().map(|s| s * s).sum();
            SINGLE_ROUNDING * size.sqrt()
        };
        let single = size_of::<S>() > size_of::<S::Single>();
        let full_rank = match single {
            true => (0..rank).find(|&from| rounded(from) <= ROUNDING_SHARE * cut).unwrap_or(rank),
            false => rank,
        };
        let factors = |range: Range<usize>| {
            let count = range.len();
            let left = Matrix::from_fn(u.rows, count, |i, j| {
                let j = range.start + j;
                u.at(i, j) * S::from_real(S::Real::from_f64(sigma[j]))
            });
            let right = Matrix::from_fn(count, v_h.columns, |i, j| v_h.at(range.start + i, j));
            if count * (left.rows + right.columns) < left.rows * right.columns {
                Factors { left, right: Some(right) }
            } else {
                Factors { left: product(&left, &right), right: None }
            }
        };
        let (leading, rest) = (0..full_rank, full_rank..rank);
        Self {
            full: (!leading.is_empty()).then(|| factors(leading)),
            single: (!rest.is_empty()).then(|| factors(rest).to_single()),
        }
    }

    pub(crate) fn rank(&self) -> usize {
        self.full.as_ref().map_or(0, Factors::rank) + self.single.as_ref().map_or(0, Factors::rank)
    }
}

impl<S: Scalar> Factors<S> {
    fn rank(&self) -> usize {
        self.right.as_ref().map_or(self.left.columns, |right| right.rows)
    }

    fn to_single(&self) -> Factors<S::Single> {
        Factors {
            left: self.left.map(S::to_single),
            right: self.right.as_ref().map(|right| right.map(S::to_single)),
        }
    }

    /// z = L R x, column by column.
    pub(crate) fn apply(&self, x: &[S], y: &mut Vec<S>, z: &mut Vec<S>) {
        let (columns, inner) = match &self.right {
            Some(right) => (right.columns, right.rows),
            None => (self.left.columns, 0),
        };
        let count = x.len() / columns;
        z.resize(count * self.left.rows, zero::<S>());
        let Some(right) = &self.right else { return S::product(&self.left, x, false, z) };
        y.resize(count * inner, zero::<S>());
        S::product(right, x, false, y);
        S::product(&self.left, y, false, z);
    }
}

/// The relative error of a product in single precision, root mean square.
const SINGLE_ROUNDING: f64 = 4e-8;

/// The share of a cut-off that rounding may add.
const ROUNDING_SHARE: f64 = 0.5;

/// The singular value decomposition of all of C that exceeds a tenth of `cut`; none if it fails.
fn decompose<S: Scalar>(c: &Matrix<S>, cut: f64) -> Option<Svd<S>> {
    if c.rows == 0 || c.columns == 0 {
        return Some(Svd { u: c.clone(), sigma: Vec::new(), v_h: c.clone() });
    }
    // Pivoted elimination first: the decomposition proper then has few rows.
    let (q, r, order) = S::pivoted_qr(c);
    let row = |i: usize| (0..r.columns).map(|j| r.at(i, j).norm_squared()).sum::<f64>();
    let kept = len_without_tail(r.rows, 0.1 * cut, row);
    if kept == 0 {
        return Some(Svd {
            u: q.corner(q.rows, 0),
            sigma: Vec::new(),
            v_h: c.corner(0, c.columns),
        });
    }
    let mut r_of_c = Matrix::from_fn(kept, c.columns, |_, _| zero::<S>());
    for (j, &column) in order.iter().enumerate() {
        for i in 0..kept {
            r_of_c.data[column * kept + i] = r.at(i, j);
        }
    }
    let Svd { u, sigma, v_h } = S::svd(&r_of_c)?;
    Some(Svd { u: product(&q.corner(q.rows, kept), &u), sigma, v_h })
}

/// C = X_t G X_sᵀ: from the values of the kernel between skeletons.
pub(crate) fn full_matrix<S: Scalar>(
    kernel: &Formula<'_, S>,
    half_width: S::Real,
    offset: [i32; 3],
    source: &Basis<S>,
    target: &Basis<S>,
) -> Matrix<S> {
    let step = offset.map(|o| S::Real::from_f64(2.0 * f64::from(o)));
    let step = Point::<S::Real>::from_array(step);
    let (xs, ys) = (&target.skeleton.points, &source.skeleton.points);
    let rows = xs.len() * kernel.fields;
    let mut values = Matrix::from_fn(rows, ys.len() * kernel.densities, |_, _| zero::<S>());
    let mut g = vec![zero::<S>(); kernel.fields * kernel.densities];
    for (b, &y) in ys.iter().enumerate() {
        for (a, &x) in xs.iter().enumerate() {
            kernel.write((x + step) * half_width, y * half_width, &mut g);
            for (k, &entry) in g.iter().enumerate() {
                let column = k % kernel.densities * ys.len() + b;
                values.data[column * rows + k / kernel.densities * xs.len() + a] = entry;
            }
        }
    }
    let left = product(&target.skeleton.from_values, &values);
    product(&left, &source.skeleton.from_values.transpose())
}

/// The smallest length such that the root of the sum of the squares beyond it is at most `cut`.
fn len_without_tail(len: usize, cut: f64, squared: impl Fn(usize) -> f64) -> usize {
    let mut tail = 0.0;
    (0..len)
        .rev()
        .find(|&i| {
            tail += squared(i);
            tail > cut * cut
        })
        .map_or(0, |i| i + 1)
}
