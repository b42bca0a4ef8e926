//! M2L between bases: one small matrix per offset, of as low a rank as the tolerance allows, applied
//! to many pairs of cells at once.

use std::sync::Arc;

use rayon::prelude::*;

use crate::dense::{Matrix, Svd};
use crate::expansion::{LevelPairs, OffsetMap};
use crate::interpolation::basis::{Basis, product};
use crate::probe::{Formula, zero};
use crate::real::{Point, Real, Scalar, Vector};

/// The M2L operators of cells of one size.
#[derive(Debug)]
pub(crate) struct Transfers<S: Scalar> {
    matrices: OffsetMap<Arc<Transfer<S>>>,
    /// Whether offsets are stored without their signs: a reflected offset has the same matrix, with
    /// signs on rows and columns.
    reflected: bool,
    /// For each of the eight reflections, the signs of the source's functions.
    from_signs: [Vec<S::Real>; 8],
    /// Likewise, of the target's.
    to_signs: [Vec<S::Real>; 8],
}

/// C = L R, or C alone where factors would cost more.
#[derive(Debug)]
struct Transfer<S> {
    left: Matrix<S>,
    right: Option<Matrix<S>>,
}

/// A pair of cells of one level.
#[derive(Clone, Copy)]
struct Pair {
    source: u32,
    /// Counted from the task's first target.
    target: u16,
    reflection: u8,
}

/// Bytes of the local expansions of one task.
const TASK_BYTES: usize = 1 << 18;

/// Bytes of one side of a batch: both sides and the operator stay in a core's cache.
const BATCH_BYTES: usize = 1 << 18;

impl<S: Scalar> Transfers<S> {
    /// Operators for the given offsets, each off by at most `cut` (Frobenius norm).
    pub(crate) fn new(
        kernel: &Formula<'_, S>,
        half_width: S::Real,
        source: &Basis<S>,
        target: &Basis<S>,
        reflected: bool,
        offsets: impl Iterator<Item = [i32; 3]>,
        cut: f64,
    ) -> Self {
        let offsets: Vec<[i32; 3]> =
            offsets.map(|o| if reflected { o.map(i32::abs) } else { o }).collect();
        let matrices = OffsetMap::build(&offsets, |offset| {
            Arc::new(Transfer::new(full_matrix(kernel, half_width, offset, source, target), cut))
        });
        let (from_signs, to_signs) = (source.signs.clone(), target.signs.clone());
        Self { matrices, reflected, from_signs, to_signs }
    }

    /// The same operators and those for further offsets.
    pub(crate) fn extended(
        &self,
        kernel: &Formula<'_, S>,
        half_width: S::Real,
        source: &Basis<S>,
        target: &Basis<S>,
        offsets: &[[i32; 3]],
        cut: f64,
    ) -> Self {
        let far: Vec<[i32; 3]> = offsets.iter().map(|&o| self.stored(o)).collect();
        let known = self.matrices.offsets();
        let matrices = OffsetMap::build(&[known, &far].concat(), |offset| {
            self.matrices.get(offset).cloned().unwrap_or_else(|| {
                let c = full_matrix(kernel, half_width, offset, source, target);
                Arc::new(Transfer::new(c, cut))
            })
        });
        let (from_signs, to_signs) = (source.signs.clone(), target.signs.clone());
        Self { matrices, reflected: self.reflected, from_signs, to_signs }
    }

    /// l += s C m for one pair of cells; whether the offset is known.
    pub(crate) fn add(&self, offset: [i32; 3], scale: S::Real, m: &[S], l: &mut [S]) -> bool {
        let Some((index, reflection)) = self.find(offset) else { return false };
        let (mut x, mut y, mut z) = (Vec::new(), Vec::new(), vec![zero::<S>(); l.len()]);
        push_signed(m, &self.from_signs[reflection], &mut x);
        self.matrices.values()[index].apply(&x, &mut y, &mut z);
        add_signed(scale, &z, &self.to_signs[reflection], l);
        true
    }

    /// l_t += s Σ_s C m_s for all pairs of one level; pairs whose offset is not known go to `other`,
    /// as source, target and the target's terms.
    pub(crate) fn add_level(
        &self,
        pairs: &LevelPairs<'_, S::Real>,
        scale: S::Real,
        columns: usize,
        multipoles: &[S],
        locals: &mut [S],
        other: &(dyn Fn(usize, usize, &mut [S]) + Sync),
    ) {
        let [from, to] = [&self.from_signs[0], &self.to_signs[0]].map(|s| s.len() * columns);
        if from == 0 || to == 0 {
            return;
        }
        let cells = (TASK_BYTES / (to * size_of::<S>())).clamp(16, 512);
        let batch = (BATCH_BYTES / (from.max(to) * size_of::<S>())).clamp(8, 1024);
        locals.par_chunks_mut(cells * to).enumerate().for_each(|(task, locals)| {
            let first = task * cells;
            let (sorted, starts) = self.sort(pairs, first, locals.len() / to, |s, t| {
                other(s, first + t, &mut locals[t * to..][..to]);
            });
            let (mut x, mut y, mut z) = (Vec::new(), Vec::new(), Vec::new());
            for (index, range) in starts.windows(2).enumerate() {
                for pairs in sorted[range[0] as usize..range[1] as usize].chunks(batch) {
                    x.clear();
                    for pair in pairs {
                        let m = &multipoles[pair.source as usize * from..][..from];
                        push_signed(m, &self.from_signs[pair.reflection as usize], &mut x);
                    }
                    z.resize(pairs.len() * to, zero::<S>());
                    self.matrices.values()[index].apply(&x, &mut y, &mut z);
                    for (pair, z) in pairs.iter().zip(z.chunks_exact(to)) {
                        let l = &mut locals[pair.target as usize * to..][..to];
                        add_signed(scale, z, &self.to_signs[pair.reflection as usize], l);
                    }
                }
            }
        });
    }

    /// The pairs of `count` targets from `first` on, operator by operator, and where each operator's
    /// start; calls `other(source, target)` for those without one.
    fn sort(
        &self,
        pairs: &LevelPairs<'_, S::Real>,
        first: usize,
        count: usize,
        mut other: impl FnMut(usize, usize),
    ) -> (Vec<Pair>, Vec<u32>) {
        let mut found = Vec::new();
        let mut starts = vec![0u32; self.matrices.values().len() + 1];
        for t in 0..count {
            let target = &pairs.targets[first + t];
            for s in pairs.sources_of(first + t) {
                let Some((index, reflection)) = self.find(pairs.sources[s].offset_to(target)) else {
                    other(s, t);
                    continue;
                };
                let reflection = reflection as u8;
                found.push((index as u32, Pair { source: s as u32, target: t as u16, reflection }));
                starts[index + 1] += 1;
            }
        }
        for index in 0..self.matrices.values().len() {
            starts[index + 1] += starts[index];
        }
        let mut next = starts.clone();
        let mut sorted = vec![Pair { source: 0, target: 0, reflection: 0 }; found.len()];
        for (index, pair) in found {
            sorted[next[index as usize] as usize] = pair;
            next[index as usize] += 1;
        }
        (sorted, starts)
    }

    /// The operator of an offset and the reflection to take it by.
    fn find(&self, offset: [i32; 3]) -> Option<(usize, usize)> {
        let reflection = match self.reflected {
            true => (0..3).filter(|&axis| offset[axis] < 0).map(|axis| 1 << axis).sum(),
            false => 0,
        };
        Some((self.matrices.index(self.stored(offset))?, reflection))
    }

    /// The offset under which the operator of `offset` is stored.
    fn stored(&self, offset: [i32; 3]) -> [i32; 3] {
        if self.reflected { offset.map(i32::abs) } else { offset }
    }

    /// Mean rank over the operators.
    pub(crate) fn mean_rank(&self) -> f64 {
        let rank = |t: &Arc<Transfer<S>>| t.right.as_ref().map_or(t.left.columns, |r| r.rows);
        let ranks: usize = self.matrices.values().iter().map(rank).sum();
        ranks as f64 / self.matrices.values().len().max(1) as f64
    }
}

impl<S: Scalar> Transfer<S> {
    /// C, factored to the lowest rank that leaves out at most `cut`.
    fn new(c: Matrix<S>, cut: f64) -> Self {
        if c.rows == 0 || c.columns == 0 {
            return Self { left: c, right: None };
        }
        // Pivoted elimination first: the decomposition proper then has few rows.
        let (q, r, order) = S::pivoted_qr(&c);
        let row = |i: usize| (0..r.columns).map(|j| r.at(i, j).norm_squared()).sum::<f64>();
        let kept = len_without_tail(r.rows, 0.1 * cut, row);
        let mut r_of_c = Matrix::from_fn(kept, c.columns, |_, _| zero::<S>());
        for (j, &column) in order.iter().enumerate() {
            for i in 0..kept {
                r_of_c.data[column * kept + i] = r.at(i, j);
            }
        }
        let Some(Svd { u, sigma, v_h }) = (kept > 0).then(|| S::svd(&r_of_c)).flatten() else {
            return Self { left: q.corner(q.rows, kept), right: Some(r_of_c) };
        };
        let rank = len_without_tail(sigma.len(), cut, |i| sigma[i] * sigma[i]);
        if rank * (c.rows + c.columns) >= c.rows * c.columns {
            return Self { left: c, right: None };
        }
        let scaled = Matrix::from_fn(kept, rank, |i, j| {
            u.at(i, j) * S::from_real(S::Real::from_f64(sigma[j]))
        });
        let left = product(&q.corner(q.rows, kept), &scaled);
        Self { left, right: Some(v_h.corner(rank, v_h.columns)) }
    }

    /// z = C x, column by column.
    fn apply(&self, x: &[S], y: &mut Vec<S>, z: &mut [S]) {
        let Some(right) = &self.right else { return S::product(&self.left, x, false, z) };
        y.resize(right.rows * (x.len() / right.columns), zero::<S>());
        S::product(right, x, false, y);
        S::product(&self.left, y, false, z);
    }
}

/// C = X_t G X_sᵀ: from the values of the kernel between skeletons.
fn full_matrix<S: Scalar>(
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

/// Appends the terms of all columns with signs.
#[inline]
pub(crate) fn push_signed<S: Scalar>(terms: &[S], signs: &[S::Real], to: &mut Vec<S>) {
    for column in terms.chunks_exact(signs.len()) {
        to.extend(column.iter().zip(signs).map(|(&term, &sign)| term * S::from_real(sign)));
    }
}

/// Adds the terms of all columns with signs, scaled.
#[inline]
pub(crate) fn add_signed<S: Scalar>(scale: S::Real, terms: &[S], signs: &[S::Real], to: &mut [S]) {
    for (to, column) in to.chunks_exact_mut(signs.len()).zip(terms.chunks_exact(signs.len())) {
        for ((to, &term), &sign) in to.iter_mut().zip(column).zip(signs) {
            *to += term * S::from_real(scale * sign);
        }
    }
}
