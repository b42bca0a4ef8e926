//! M2L between bases: one small matrix per offset, applied to many pairs of cells at once.

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::expansion::{LevelPairs, OffsetMap};
use crate::interpolation::basis::Basis;
use crate::interpolation::factors::{Factors, Transfer, full_matrix};
use crate::pool::Pool;
use crate::probe::{Formula, zero};
use crate::real::Scalar;

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

/// Where an offset stands in [`Transfers::near`], if it is near.
#[inline]
fn near_index(offset: [i32; 3]) -> Option<usize> {
    let near = offset.iter().all(|o| (-NEAR..=NEAR).contains(o));
    near.then(|| offset.iter().fold(0, |index, o| index * (2 * NEAR + 1) + (o + NEAR)) as usize)
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
