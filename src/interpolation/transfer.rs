//! M2L between bases, direction by direction, for many pairs of cells at once.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use num_traits::Float;
use rayon::prelude::*;

use crate::expansion::level_cells::LevelPairs;
use crate::expansion::offset_map::OffsetMap;
use crate::interpolation::bases::Bases;
use crate::interpolation::directions::{Digits, Place, directions};
use crate::interpolation::entries::{Entries, zero};
use crate::interpolation::exchange::{Coordinates, Exchange, Pair};
use crate::interpolation::numbering::Numbering;
use crate::interpolation::probe::power_of_two;
use crate::interpolation::tuning::{EXCHANGE_BLOCK, SWEEP_CHUNK, TASK_BYTES};
use crate::numbers::compiled::Compiled;
use crate::numbers::traits::{Numbers, Real, Scalar};
use crate::parallel;
use crate::parallel::pool::Pool;

/// The M2L operators of cells of one size.
#[derive(Debug)]
pub(crate) struct Transfers<S: Scalar> {
    pub(crate) numbering: Numbering<S>,
    /// What cores are in units of, where they are in single precision.
    pub(crate) unit: S::Real,
    sent: Pool<Sent<S>>,
    buffers: Pool<Buffers<S>>,
}

/// What all sources send: their coordinates in every direction that is asked for.
#[derive(Debug, Default)]
struct Sent<S: Scalar> {
    /// A bit per source for each direction.
    wanted: Vec<AtomicU32>,
    /// [`EXCHANGE_BLOCK`] sources after the other, as [`Coordinates`] has it.
    full: Vec<S>,
    single: Vec<S::Single>,
    /// What `single` is in units of: charges of any size, but for those that are nothing beside others,
    /// stay within the range of single precision.
    unit: S::Real,
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

/// [`Transfers::add_level`].
type AddLevel<S> = fn(
    &Transfers<S>,
    &LevelPairs<'_, <S as Numbers>::Real>,
    <S as Numbers>::Real,
    usize,
    &[S],
    &mut [S],
    &(dyn Fn(usize, usize, &mut [S]) + Sync),
);
static ADD_LEVEL: Compiled<AddLevel<f32>, AddLevel<f64>> =
    Compiled(Transfers::compiled, Transfers::compiled);

impl<S: Scalar> Transfers<S> {
    /// Operators for the given offsets.
    pub(crate) fn new(kernel: &Entries<'_, S>, bases: &Bases<S>, offsets: &[[i32; 3]]) -> Self {
        let (groups, places) = directions(kernel, bases, offsets);
        Self::of(groups, places, bases.unit())
    }

    /// Operators that were made already; single precision is in units of `unit`.
    pub(crate) fn of(groups: Vec<Digits<S>>, places: OffsetMap<Place>, unit: S::Real) -> Self {
        let (sent, buffers) = (Pool::default(), Pool::default());
        Self { numbering: Numbering::new(groups, places), unit, sent, buffers }
    }

    /// The offsets that have an operator.
    pub(crate) fn offsets(&self) -> &[[i32; 3]] {
        self.numbering.places.offsets()
    }

    /// l += s C m for one pair of cells; whether the offset is known.
    pub(crate) fn add(&self, offset: [i32; 3], scale: S::Real, m: &[S], l: &mut [S]) -> bool {
        let Some(place) = self.numbering.find(offset) else { return false };
        match &self.numbering.groups[usize::from(place.group)] {
            Digits::Full(group) => {
                group.add_one(place, m, l, |m| m, |l| l * S::from_real(scale));
            }
            Digits::Single(group) => {
                let unit = power_of_two(largest(m));
                let shrink = S::from_real(unit.recip());
                let leave = |l| self.in_full(l, unit) * S::from_real(scale);
                group.add_one(place, m, l, |m| (m * shrink).to_single(), leave);
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
        let add = if const { S::COMPLEX } { Self::compiled } else { ADD_LEVEL.of::<AddLevel<S>>() };
        add(self, pairs, scale, columns, multipoles, locals, other);
    }

    fn compiled(
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
            parallel::for_each_piece(locals, task_cells * to_len, &|task, to| {
                if pairs.is_stopped() {
                    return;
                }
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
        let Sent { wanted, full, single, unit } = sent;
        let elsewhere = S::Real::from_f64(pairs.largest_elsewhere);
        *unit = S::Real::from_f64(1.0);
        if self.numbering.coordinates[1] > 0 {
            *unit = power_of_two(Float::max(largest(multipoles), elsewhere));
        }
        let shrink = S::from_real(unit.recip());
        wanted.clear();
        wanted.resize_with(pairs.sources.len(), AtomicU32::default);
        parallel::for_each(pairs.targets.len(), &|t| {
            let target = &pairs.targets[t];
            for s in pairs.sources_of(t) {
                let Some(place) = self.numbering.find(pairs.sources[s].offset_to(target)) else {
                    continue;
                };
                let bit = 1 << self.numbering.direction(place);
                if wanted[s].load(Relaxed) & bit == 0 {
                    wanted[s].fetch_or(bit, Relaxed);
                }
            }
        });
        let blocks = pairs.sources.len().div_ceil(EXCHANGE_BLOCK);
        let [full_len, single_len] =
            self.numbering.coordinates.map(|count| (EXCHANGE_BLOCK * count * columns).max(1));
        full.resize(blocks * full_len, zero::<S>());
        single.resize(blocks * single_len, zero::<S::Single>());
        let outputs = full.par_chunks_mut(full_len).zip(single.par_chunks_mut(single_len));
        let inputs =
            multipoles.par_chunks(EXCHANGE_BLOCK * from_len).zip(wanted.par_chunks(EXCHANGE_BLOCK));
        outputs.zip(inputs).for_each(|((full, single), (multipoles, wanted))| {
            if pairs.is_stopped() {
                return;
            }
            self.buffers.with(Buffers::default, |buffers| {
                let Buffers { full: in_full, single: in_single, .. } = buffers;
                if self.numbering.coordinates[0] > 0 {
                    in_full.enter(multipoles.iter().copied());
                }
                if self.numbering.coordinates[1] > 0 {
                    in_single.enter(multipoles.iter().map(|&m| (m * shrink).to_single()));
                }
                for (g, digits) in self.numbering.groups.iter().enumerate() {
                    let (first, start) = (
                        self.numbering.firsts[g],
                        EXCHANGE_BLOCK * self.numbering.starts[g] * columns,
                    );
                    match digits {
                        Digits::Full(group) => {
                            in_full.send(first, group, wanted, columns, &mut full[start..]);
                        }
                        Digits::Single(group) => {
                            in_single.send(first, group, wanted, columns, &mut single[start..]);
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
        let block_lens = self.numbering.coordinates.map(|count| EXCHANGE_BLOCK * count * columns);
        let counts = [to.len() / to_len, columns, to_len / columns];
        full.start();
        single.start();
        for (g, digits) in self.numbering.groups.iter().enumerate() {
            let core_starts = &self.numbering.core_starts
                [self.numbering.firsts[g]..=self.numbering.firsts[g + 1]];
            let end = core_starts[core_starts.len() - 1];
            let (pairs, others) = rest.split_at(rest.partition_point(|p| (p.core as usize) < end));
            rest = others;
            let start = EXCHANGE_BLOCK * self.numbering.starts[g] * columns;
            match digits {
                Digits::Full(group) => {
                    let y = Coordinates { all: &sent.full, start, block_len: block_lens[0] };
                    full.receive(group, core_starts, pairs, &y, counts);
                }
                Digits::Single(group) => {
                    let y = Coordinates { all: &sent.single, start, block_len: block_lens[1] };
                    single.receive(group, core_starts, pairs, &y, counts);
                }
            }
        }
        let scale = S::from_real(scale);
        full.leave(to, |l| l * scale);
        single.leave(to, |l| self.in_full(l, sent.unit) * scale);
    }

    /// What targets receive in single precision, of multipoles in units of `unit`.
    fn in_full(&self, l: S::Single, unit: S::Real) -> S {
        S::from_single(l) * S::from_real(unit) * S::from_real(self.unit)
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
        starts.resize(self.numbering.core_starts[self.numbering.core_starts.len() - 1] + 1, 0);
        for t in 0..count {
            let target = &pairs.targets[first + t];
            for s in pairs.sources_of(first + t) {
                match self.numbering.find(pairs.sources[s].offset_to(target)) {
                    Some(place) => {
                        let core = self.numbering.core_starts[self.numbering.direction(place)]
                            as u32
                            + place.core;
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
}

/// The largest part of these numbers.
fn largest<S: Scalar>(numbers: &[S]) -> S::Real {
    // Numbers without a sign are in the order of their bits.
    let largest = AtomicU64::new(0);
    parallel::for_each(numbers.len().div_ceil(SWEEP_CHUNK), &|chunk| {
        let numbers = numbers[SWEEP_CHUNK * chunk..].iter().take(SWEEP_CHUNK);
        let parts = numbers.flat_map(|number| number.parts());
        let own = parts.fold(0.0, |largest, part| f64::max(largest, part.as_f64().abs()));
        largest.fetch_max(own.to_bits(), Relaxed);
    });
    S::Real::from_f64(f64::from_bits(largest.into_inner()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::basis::Spectrum;
    use crate::interpolation::carried::Carried;
    use crate::interpolation::chebyshev::Chebyshev;
    use crate::interpolation::entries::pairwise;
    use crate::interpolation::far_field::FarField;
    use crate::interpolation::means::interaction_offsets;
    use crate::interpolation::scale::Scale;
    use crate::octree::geometry::{Cell, Cube};
    use crate::parallel::watch::Watch;
    use glam::DVec3;
    use std::sync::Arc;

    #[test]
    fn a_pair_alone_and_a_pair_of_a_level_are_the_same() {
        let entries = pairwise(1, |x, y, g| g[0] = 1.0 / x.distance(y));
        let (kernel, rule) = (Entries::new(1, 1, &entries), Chebyshev::new(4));
        let far = FarField::new(1.0 / 32.0, 32.0, 1, Carried::default());
        let scale = Scale::new(far.size(&kernel), std::iter::empty());
        let spectrum = Spectrum::new(&kernel, Some(&[0]), &far, &rule, scale).unwrap();
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        let root = Cube::new(DVec3::splat(0.5), 0.5);
        // So coarse a cut-off leaves some parities without a function, some without a coordinate.
        for cut in [1e-2, 1e-3, 1e-6].map(|share| share / far.half_width()) {
            let basis = Arc::new(spectrum.basis(cut, &rule));
            let (source, target) = (Arc::clone(&basis), Arc::clone(&basis));
            let bases =
                Bases { half_width: far.half_width(), source, target, reflected: true, cut };
            let transfers = Transfers::new(&kernel, &bases, &offsets);
            let m: Vec<f64> = (0..2 * basis.rank()).map(|i| (i as f64 + 0.5).sin()).collect();
            for &offset in &offsets {
                let mut alone = vec![0.0; m.len()];
                assert!(transfers.add(offset, 2.0, &m, &mut alone));
                let cell = |at: [i32; 3]| Cell::new(&root, 4, at.map(|x| x as u64));
                let pairs = LevelPairs {
                    weight: 1.0,
                    level: 4,
                    sources: &[cell([8; 3])],
                    targets: &[cell(offset.map(|o| 8 + o))],
                    starts: &[0, 1],
                    list: &[0],
                    first_source: 0,
                    largest_elsewhere: 0.0,
                    watch: &Watch::default(),
                };
                let mut level = vec![0.0; m.len()];
                transfers.add_level(&pairs, 2.0, 2, &m, &mut level, &|_, _, _| unreachable!());
                let size = alone.iter().fold(0.0f64, |a, l| a.max(l.abs()));
                for (a, b) in alone.iter().zip(&level) {
                    assert!((a - b).abs() <= 1e-5 * size, "{offset:?}: {a} {b}");
                }
                assert!(size > 0.0);
            }
        }
    }
}
