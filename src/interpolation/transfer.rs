//! M2L between bases, direction by direction, for many pairs of cells at once.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use rayon::prelude::*;

use crate::expansion::{LevelPairs, OffsetMap};
use crate::interpolation::directions::{
    Bases, DIRECTIONS, Digits, Direction, Place, direction_of, directions,
};
use crate::interpolation::exchange::{BLOCK, Coordinates, Exchange, Pair};
use crate::interpolation::means::{INTERACTION_OFFSETS, interaction_offsets, weight};
use crate::pool::Pool;
use crate::probe::{Formula, zero};
use crate::real::Scalar;

/// The M2L operators of cells of one size.
#[derive(Debug)]
pub(crate) struct Transfers<S: Scalar> {
    directions: Vec<Option<Digits<S>>>,
    places: OffsetMap<Place>,
    /// Places of offsets up to [`NEAR`], by [`near_index`].
    near: Vec<Option<Place>>,
    /// Where each direction's coordinates stand among those of one cell, in its digits, filled up to
    /// whole registers.
    starts: [usize; DIRECTIONS],
    /// How many coordinates one cell has in all directions: in full digits, in single ones; likewise.
    coordinates: [usize; 2],
    /// How many cores the directions before one have.
    core_starts: [usize; DIRECTIONS + 1],
    sent: Pool<Sent<S>>,
    buffers: Pool<Buffers<S>>,
}

/// What all sources send: their coordinates in every direction that is asked for.
#[derive(Debug, Default)]
struct Sent<S: Scalar> {
    /// A bit per source for each direction.
    wanted: Vec<AtomicU32>,
    /// [`BLOCK`] sources after the other: the coordinates in one direction of all of them, then in the
    /// next.
    full: Vec<S>,
    single: Vec<S::Single>,
}

/// What a task writes to in passing.
#[derive(Debug, Default)]
struct Buffers<S: Scalar> {
    found: Vec<Pair>,
    sorted: Vec<Pair>,
    starts: Vec<u32>,
    full: Exchange<S>,
    single: Exchange<S::Single>,
}

/// Offsets of an unmasked tree have no component larger than this.
const NEAR: i32 = 3;

/// Bytes of the local expansions of one task.
const TASK_BYTES: usize = 1 << 19;

impl<S: Scalar> Transfers<S> {
    /// Operators for the given offsets.
    pub(crate) fn new(kernel: &Formula<'_, S>, bases: &Bases<S>, offsets: &[[i32; 3]]) -> Self {
        let (directions, places) = directions(kernel, bases, offsets);
        let (mut coordinates, mut starts) = ([0; 2], [0; DIRECTIONS]);
        let mut core_starts = [0; DIRECTIONS + 1];
        for (d, digits) in directions.iter().enumerate() {
            let (kind, count, cores) = match digits {
                None => (0, 0, 0),
                Some(Digits::Full(own)) => (0, own.collect.height, own.cores.len()),
                Some(Digits::Single(own)) => (1, own.collect.height, own.cores.len()),
            };
            starts[d] = coordinates[kind];
            coordinates[kind] += count;
            core_starts[d + 1] = core_starts[d] + cores;
        }
        let range = -NEAR..=NEAR;
        let mut near = Vec::new();
        for x in range.clone() {
            for y in range.clone() {
                near.extend(range.clone().map(|z| places.get([x, y, z]).copied()));
            }
        }
        let (sent, buffers) = (Pool::default(), Pool::default());
        Self { directions, places, near, starts, coordinates, core_starts, sent, buffers }
    }

    /// The offsets that have an operator.
    pub(crate) fn offsets(&self) -> &[[i32; 3]] {
        self.places.offsets()
    }

    /// l += s C m for one pair of cells; whether the offset is known.
    pub(crate) fn add(&self, offset: [i32; 3], scale: S::Real, m: &[S], l: &mut [S]) -> bool {
        let Some(place) = self.find(offset) else { return false };
        match &self.directions[usize::from(place.direction)] {
            None => {}
            Some(Digits::Full(direction)) => {
                add_one(direction, place.core, m, l, |m| m, |l| l * S::from_real(scale));
            }
            Some(Digits::Single(direction)) => {
                let leave = |l| S::from_single(l) * S::from_real(scale);
                add_one(direction, place.core, m, l, S::to_single, leave);
            }
        }
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
        let [from_len, to_len] =
            [multipoles.len() / pairs.sources.len(), locals.len() / pairs.targets.len()];
        if from_len == 0 || to_len == 0 {
            return;
        }
        let task_cells = (TASK_BYTES / (to_len * size_of::<S>())).clamp(16, 512);
        self.sent.with(Sent::default, |sent| {
            self.send(pairs, columns, from_len, multipoles, sent);
            locals.par_chunks_mut(task_cells * to_len).enumerate().for_each(|(task, to)| {
                let first = task * task_cells;
                self.buffers.with(Buffers::default, |buffers| {
                    self.sort(pairs, first, to.len() / to_len, buffers, |s, t| {
                        other(s, first + t, &mut to[t * to_len..][..to_len]);
                    });
                    self.receive(columns, scale, sent, to_len, to, buffers);
                });
            });
        });
    }

    /// The coordinates y = Qᴴ m of all sources in the directions of their targets.
    fn send(
        &self,
        pairs: &LevelPairs<'_, S::Real>,
        columns: usize,
        from_len: usize,
        multipoles: &[S],
        sent: &mut Sent<S>,
    ) {
        let Sent { wanted, full, single } = sent;
        wanted.clear();
        wanted.resize_with(pairs.sources.len(), AtomicU32::default);
        (0..pairs.targets.len()).into_par_iter().for_each(|t| {
            let target = &pairs.targets[t];
            for s in pairs.sources_of(t) {
                let bit = 1 << direction_of(pairs.sources[s].offset_to(target));
                if wanted[s].load(Relaxed) & bit == 0 {
                    wanted[s].fetch_or(bit, Relaxed);
                }
            }
        });
        let blocks = pairs.sources.len().div_ceil(BLOCK);
        let [full_len, single_len] = self.coordinates.map(|count| (BLOCK * count * columns).max(1));
        full.resize(blocks * full_len, zero::<S>());
        single.resize(blocks * single_len, zero::<S::Single>());
        let outputs = full.par_chunks_mut(full_len).zip(single.par_chunks_mut(single_len));
        let inputs = multipoles.par_chunks(BLOCK * from_len).zip(wanted.par_chunks(BLOCK));
        outputs.zip(inputs).for_each(|((full, single), (multipoles, wanted))| {
            self.buffers.with(Buffers::default, |buffers| {
                let Buffers { full: in_full, single: in_single, .. } = buffers;
                if self.coordinates[0] > 0 {
                    in_full.enter(multipoles.iter().copied());
                }
                if self.coordinates[1] > 0 {
                    in_single.enter(multipoles.iter().map(|&m| m.to_single()));
                }
                for (d, digits) in self.directions.iter().enumerate() {
                    let start = BLOCK * self.starts[d] * columns;
                    match digits {
                        None => {}
                        Some(Digits::Full(direction)) => {
                            in_full.send(d, direction, wanted, columns, &mut full[start..]);
                        }
                        Some(Digits::Single(direction)) => {
                            in_single.send(d, direction, wanted, columns, &mut single[start..]);
                        }
                    }
                }
            });
        });
    }

    /// l_t += s Σ P W y for the sorted pairs of a task.
    fn receive(
        &self,
        columns: usize,
        scale: S::Real,
        sent: &Sent<S>,
        to_len: usize,
        to: &mut [S],
        Buffers { sorted, full, single, .. }: &mut Buffers<S>,
    ) {
        let mut rest = &sorted[..];
        let block_lens = self.coordinates.map(|count| BLOCK * count * columns);
        let counts = [to.len() / to_len, columns];
        full.start();
        single.start();
        for (d, digits) in self.directions.iter().enumerate() {
            let end = rest.partition_point(|p| (p.core as usize) < self.core_starts[d + 1]);
            let (pairs, others) = rest.split_at(end);
            rest = others;
            let (first_core, start) = (self.core_starts[d], BLOCK * self.starts[d] * columns);
            match digits {
                None => {}
                Some(Digits::Full(direction)) => {
                    let y = Coordinates { all: &sent.full, start, block_len: block_lens[0] };
                    full.receive(direction, first_core, pairs, &y, counts);
                }
                Some(Digits::Single(direction)) => {
                    let y = Coordinates { all: &sent.single, start, block_len: block_lens[1] };
                    single.receive(direction, first_core, pairs, &y, counts);
                }
            }
        }
        let (rank, scale) = (to_len / columns, S::from_real(scale));
        full.leave(rank, to, |l| l * scale);
        single.leave(rank, to, |l| S::from_single(l) * scale);
    }

    /// The pairs of `count` targets from `first` on, core by core; calls `other(source, target)` for
    /// those without one.
    fn sort(
        &self,
        pairs: &LevelPairs<'_, S::Real>,
        first: usize,
        count: usize,
        Buffers { found, sorted, starts, .. }: &mut Buffers<S>,
        mut other: impl FnMut(usize, usize),
    ) {
        found.clear();
        starts.clear();
        starts.resize(self.core_starts[DIRECTIONS] + 1, 0);
        for t in 0..count {
            let target = &pairs.targets[first + t];
            for s in pairs.sources_of(first + t) {
                match self.find(pairs.sources[s].offset_to(target)) {
                    Some(Place { direction, core }) => {
                        let core = self.core_starts[usize::from(direction)] as u32 + core;
                        found.push(Pair { source: s as u32, target: t as u16, core });
                        starts[core as usize + 1] += 1;
                    }
                    None => other(s, t),
                }
            }
        }
        for index in 1..starts.len() {
            starts[index] += starts[index - 1];
        }
        sorted.resize(found.len(), Pair::default());
        for &pair in &*found {
            let next = &mut starts[pair.core as usize];
            sorted[*next as usize] = pair;
            *next += 1;
        }
    }

    fn find(&self, offset: [i32; 3]) -> Option<Place> {
        match near_index(offset) {
            Some(near) => self.near[near],
            None => self.places.get(offset).copied(),
        }
    }

    /// Multiply-adds for one target cell in a uniform tree, its share of what sources send included.
    pub(crate) fn multiply_adds(&self) -> f64 {
        let sizes = self.directions.iter().map(|digits| match digits {
            None => [0; 4],
            Some(Digits::Full(own)) => own.sizes(),
            Some(Digits::Single(own)) => own.sizes(),
        });
        let sizes: Vec<[usize; 4]> = sizes.collect();
        let sides = sizes.iter().map(|[from, y, z, to]| (from * y + z * to) as f64).sum::<f64>();
        let cores = interaction_offsets().map(|offset| {
            let [_, y, z, _] = sizes[direction_of(offset)];
            weight(offset) * (y * z) as f64
        });
        sides + 189.0 / INTERACTION_OFFSETS as f64 * cores.sum::<f64>()
    }

    /// Mean number of coordinates of a direction, each offset counted.
    pub(crate) fn mean_rank(&self) -> f64 {
        let rank = |place: &Place| match &self.directions[usize::from(place.direction)] {
            None => 0,
            Some(Digits::Full(direction)) => direction.collect.rows,
            Some(Digits::Single(direction)) => direction.collect.rows,
        };
        let ranks: usize = self.places.values().iter().map(rank).sum();
        ranks as f64 / self.places.values().len().max(1) as f64
    }
}

/// Where an offset stands in [`Transfers::near`], if it is near.
#[inline]
fn near_index(offset: [i32; 3]) -> Option<usize> {
    let near = offset.iter().all(|o| (-NEAR..=NEAR).contains(o));
    near.then(|| offset.iter().fold(0, |index, o| index * (2 * NEAR + 1) + (o + NEAR)) as usize)
}

/// l += P W Qᴴ m for one pair.
fn add_one<S: Scalar, R: Scalar>(
    Direction { collect, spread, cores }: &Direction<R>,
    core: u32,
    m: &[S],
    l: &mut [S],
    enter: impl Fn(S) -> R,
    leave: impl Fn(R) -> S,
) {
    if collect.rows == 0 || spread.columns == 0 {
        return;
    }
    let core = &cores[core as usize];
    let mut y = vec![zero::<R>(); collect.height];
    let mut z = vec![zero::<R>(); core.height];
    let mut out = vec![zero::<R>(); spread.height];
    for (m, l) in m.chunks_exact(collect.columns).zip(l.chunks_exact_mut(spread.rows)) {
        let m: Vec<R> = m.iter().map(|&m| enter(m)).collect();
        collect.products(&[[0, 0]], false, &m, &mut y);
        core.products(&[[0, 0]], false, &y, &mut z);
        spread.products(&[[0, 0]], false, &z, &mut out);
        l.iter_mut().zip(&out).for_each(|(l, &out)| *l += leave(out));
    }
}
