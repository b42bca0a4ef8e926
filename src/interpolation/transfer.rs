//! M2L between bases: one small matrix per offset, of as low a rank as the tolerance allows, applied
//! to many pairs of cells at once.

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::dense::{Matrix, Svd};
use crate::expansion::{LevelPairs, OffsetMap};
use crate::interpolation::basis::{Basis, product};
use crate::pool::Pool;
use crate::probe::{Formula, zero};
use crate::real::{Point, Real, Scalar, Vector};

/// The M2L operators of cells of one size.
#[derive(Debug)]
pub(crate) struct Transfers<S: Scalar> {
    matrices: OffsetMap<Arc<Transfer<S>>>,
    /// Where the operators of offsets up to [`NEAR`] stand, by [`near_index`].
    near: Vec<u32>,
    /// Whether offsets are stored without their signs: a reflected offset has the same matrix, with
    /// signs on rows and columns.
    reflected: bool,
    /// For each of the eight reflections, the signs of the source's functions.
    from_signs: [Vec<S::Real>; 8],
    /// Likewise, of the target's.
    to_signs: [Vec<S::Real>; 8],
    buffers: Pool<Buffers<S>>,
}

/// C = Σ_i σ_i u_i v_iᴴ in two parts: what must keep all digits, and what is so small that single
/// precision is enough for the tolerance.
#[derive(Debug)]
struct Transfer<S: Scalar> {
    full: Option<Factors<S>>,
    single: Option<Factors<S::Single>>,
}

/// L R, or L alone where two factors would cost more.
#[derive(Debug)]
struct Factors<S> {
    left: Matrix<S>,
    right: Option<Matrix<S>>,
}

/// A pair of cells of one level.
#[derive(Clone, Copy, Debug)]
struct Pair {
    /// Its operator.
    index: u32,
    source: u32,
    /// Counted from the task's first target.
    target: u16,
    reflection: u8,
}

/// The expansions of a task: multipoles of all sources, locals of its own targets.
struct Cells<'a, S: Scalar> {
    from: &'a [S],
    from_len: usize,
    to: &'a mut [S],
    to_len: usize,
    scale: S::Real,
}

/// What a task writes to in passing.
#[derive(Debug, Default)]
struct Buffers<S: Scalar> {
    found: Vec<Pair>,
    starts: Vec<u32>,
    sorted: Vec<Pair>,
    /// What goes into a product, the middle of two factors, and what comes out.
    full: [Vec<S>; 3],
    single: [Vec<S::Single>; 3],
}

/// Offsets of an unmasked tree have no component larger than this.
const NEAR: i32 = 3;

/// The entry of an offset without an operator.
const UNKNOWN: u32 = u32::MAX;

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
        Self::with(matrices, reflected, source, target)
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
        Self::with(matrices, self.reflected, source, target)
    }

    fn with(
        matrices: OffsetMap<Arc<Transfer<S>>>,
        reflected: bool,
        source: &Basis<S>,
        target: &Basis<S>,
    ) -> Self {
        let (from_signs, to_signs) = (source.signs.clone(), target.signs.clone());
        let buffers = Pool::default();
        let mut all = Self { matrices, near: Vec::new(), reflected, from_signs, to_signs, buffers };
        let range = -NEAR..=NEAR;
        for x in range.clone() {
            for y in range.clone() {
                for z in range.clone() {
                    let index = all.matrices.index(all.stored([x, y, z]));
                    all.near.push(index.map_or(UNKNOWN, |index| index as u32));
                }
            }
        }
        all
    }

    /// l += s C m for one pair of cells; whether the offset is known.
    pub(crate) fn add(&self, offset: [i32; 3], scale: S::Real, m: &[S], l: &mut [S]) -> bool {
        let Some((index, reflection)) = self.find(offset) else { return false };
        let mut cells = Cells { from: m, from_len: m.len(), to_len: l.len(), to: l, scale };
        let pair = Pair { index, source: 0, target: 0, reflection };
        self.add_batch(&[pair], &mut cells, &mut Buffers::default());
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
        let [from_len, to_len] = [&self.from_signs, &self.to_signs].map(|s| s[0].len() * columns);
        if from_len == 0 || to_len == 0 {
            return;
        }
        let task_cells = (TASK_BYTES / (to_len * size_of::<S>())).clamp(16, 512);
        let batch = (BATCH_BYTES / (from_len.max(to_len) * size_of::<S>())).clamp(8, 1024);
        locals.par_chunks_mut(task_cells * to_len).enumerate().for_each(|(task, to)| {
            let first = task * task_cells;
            self.buffers.with(Buffers::default, |buffers| {
                let mut sorted = std::mem::take(&mut buffers.sorted);
                self.sort(pairs, first, to.len() / to_len, buffers, &mut sorted, |s, t| {
                    other(s, first + t, &mut to[t * to_len..][..to_len]);
                });
                let mut cells = Cells { from: multipoles, from_len, to, to_len, scale };
                for one_operator in sorted.chunk_by(|a, b| a.index == b.index) {
                    for pairs in one_operator.chunks(batch) {
                        self.add_batch(pairs, &mut cells, buffers);
                    }
                }
                buffers.sorted = sorted;
            });
        });
    }

    /// One operator on many pairs.
    fn add_batch(&self, pairs: &[Pair], cells: &mut Cells<'_, S>, buffers: &mut Buffers<S>) {
        let transfer = &self.matrices.values()[pairs[0].index as usize];
        if let Some(factors) = &transfer.full {
            self.add_product(factors, pairs, cells, &mut buffers.full, |m| m, |l| l);
        }
        if let Some(factors) = &transfer.single {
            let Buffers { single, .. } = buffers;
            self.add_product(factors, pairs, cells, single, S::to_single, S::from_single);
        }
    }

    /// The matrix product, in the precision of its factors.
    fn add_product<R: Scalar>(
        &self,
        factors: &Factors<R>,
        pairs: &[Pair],
        cells: &mut Cells<'_, S>,
        [x, y, z]: &mut [Vec<R>; 3],
        enter: impl Fn(S) -> R,
        leave: impl Fn(R) -> S,
    ) {
        Arch::new().dispatch(Gather { cells, pairs, signs: &self.from_signs, enter, x });
        factors.apply(x, y, z);
        Arch::new().dispatch(Scatter { cells, pairs, signs: &self.to_signs, leave, z });
    }

    /// The pairs of `count` targets from `first` on, operator by operator; calls `other(source, target)`
    /// for those without one.
    fn sort(
        &self,
        pairs: &LevelPairs<'_, S::Real>,
        first: usize,
        count: usize,
        Buffers { found, starts, .. }: &mut Buffers<S>,
        sorted: &mut Vec<Pair>,
        mut other: impl FnMut(usize, usize),
    ) {
        found.clear();
        starts.clear();
        starts.resize(self.matrices.values().len() + 1, 0);
        for t in 0..count {
            let target = &pairs.targets[first + t];
            for s in pairs.sources_of(first + t) {
                match self.find(pairs.sources[s].offset_to(target)) {
                    Some((index, reflection)) => {
                        let (source, target) = (s as u32, t as u16);
                        found.push(Pair { index, source, target, reflection });
                        starts[index as usize + 1] += 1;
                    }
                    None => other(s, t),
                }
            }
        }
        for index in 1..starts.len() {
            starts[index] += starts[index - 1];
        }
        sorted.clear();
        sorted.extend_from_slice(found);
        for &pair in &*found {
            let next = &mut starts[pair.index as usize];
            sorted[*next as usize] = pair;
            *next += 1;
        }
    }

    /// The operator of an offset and the reflection to take it by.
    fn find(&self, offset: [i32; 3]) -> Option<(u32, u8)> {
        let index = match near_index(offset) {
            Some(near) => self.near[near],
            None => self.matrices.index(self.stored(offset))? as u32,
        };
        let reflection = match self.reflected {
            true => (0..3).map(|axis| u8::from(offset[axis] < 0) << axis).sum(),
            false => 0,
        };
        (index != UNKNOWN).then_some((index, reflection))
    }

    /// The offset under which the operator of `offset` is stored.
    fn stored(&self, offset: [i32; 3]) -> [i32; 3] {
        if self.reflected { offset.map(i32::abs) } else { offset }
    }

    /// Mean rank over the operators.
    pub(crate) fn mean_rank(&self) -> f64 {
        let ranks: usize = self.matrices.values().iter().map(|transfer| transfer.rank()).sum();
        ranks as f64 / self.matrices.values().len().max(1) as f64
    }
}

impl<S: Scalar> Transfer<S> {
    /// C, factored to the lowest rank that leaves out at most `cut`.
    fn new(c: Matrix<S>, cut: f64) -> Self {
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
        let factors = |range: std::ops::Range<usize>| {
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

    fn rank(&self) -> usize {
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
    fn apply(&self, x: &[S], y: &mut Vec<S>, z: &mut Vec<S>) {
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

/// Where an offset stands in [`Transfers::near`], if it is near.
#[inline]
fn near_index(offset: [i32; 3]) -> Option<usize> {
    let near = offset.iter().all(|o| (-NEAR..=NEAR).contains(o));
    near.then(|| offset.iter().fold(0, |index, o| index * (2 * NEAR + 1) + (o + NEAR)) as usize)
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

/// Brings the multipoles of pairs together, with signs: the right-hand side of a product.
struct Gather<'a, 'c, S: Scalar, R, F> {
    cells: &'a Cells<'c, S>,
    pairs: &'a [Pair],
    signs: &'a [Vec<S::Real>; 8],
    enter: F,
    x: &'a mut Vec<R>,
}

impl<S: Scalar, R: Scalar, F: Fn(S) -> R> WithSimd for Gather<'_, '_, S, R, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { cells: Cells { from, from_len, .. }, pairs, signs, enter, x } = self;
        x.resize(pairs.len() * from_len, zero::<R>());
        for (pair, x) in pairs.iter().zip(x.chunks_exact_mut(*from_len)) {
            let m = &from[pair.source as usize * from_len..][..*from_len];
            signed(m, &signs[pair.reflection as usize], &enter, x);
        }
    }
}

/// Adds the columns of a product to the locals of pairs, with signs.
struct Scatter<'a, 'c, S: Scalar, R, F> {
    cells: &'a mut Cells<'c, S>,
    pairs: &'a [Pair],
    signs: &'a [Vec<S::Real>; 8],
    leave: F,
    z: &'a [R],
}

impl<S: Scalar, R: Scalar, F: Fn(R) -> S> WithSimd for Scatter<'_, '_, S, R, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { cells: Cells { to, to_len, scale, .. }, pairs, signs, leave, z } = self;
        for (pair, z) in pairs.iter().zip(z.chunks_exact(*to_len)) {
            let l = &mut to[pair.target as usize * *to_len..][..*to_len];
            add_signed(*scale, z, &signs[pair.reflection as usize], &leave, l);
        }
    }
}

/// Writes the terms of all columns with signs, each passed through `f`.
#[inline(always)]
pub(crate) fn signed<S: Scalar, R>(
    terms: &[S],
    signs: &[S::Real],
    f: impl Fn(S) -> R,
    to: &mut [R],
) {
    for (to, column) in to.chunks_exact_mut(signs.len()).zip(terms.chunks_exact(signs.len())) {
        for ((to, &term), &sign) in to.iter_mut().zip(column).zip(signs) {
            *to = f(term * S::from_real(sign));
        }
    }
}

/// Adds the terms of all columns with signs, each passed through `f` and scaled.
#[inline(always)]
pub(crate) fn add_signed<S: Scalar, R: Copy>(
    scale: S::Real,
    terms: &[R],
    signs: &[S::Real],
    f: impl Fn(R) -> S,
    to: &mut [S],
) {
    for (to, column) in to.chunks_exact_mut(signs.len()).zip(terms.chunks_exact(signs.len())) {
        for ((to, &term), &sign) in to.iter_mut().zip(column).zip(signs) {
            *to += f(term) * S::from_real(scale * sign);
        }
    }
}
