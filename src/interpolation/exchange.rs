//! What blocks of sources send in the directions of a group, and what blocks of targets receive from
//! there.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use pulp::{Simd, WithSimd};

use crate::dispatch_level::dispatch;
use crate::interpolation::directions::Group;
use crate::interpolation::entries::zero;
use crate::interpolation::tuning::EXCHANGE_BLOCK;
use crate::numbers::traits::Scalar;

/// A pair of cells of one level.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pair {
    pub(crate) source: u32,
    /// Counted from the task's first target.
    pub(crate) target: u16,
    /// Its core, counted over all directions.
    pub(crate) core: u32,
}

/// The coordinates of all sources in one precision. Those of a block's sources in the directions of one
/// group stand together, source after source and direction after direction.
pub(crate) struct Coordinates<'a, R> {
    pub(crate) all: &'a [R],
    /// How many numbers a block of sources has.
    pub(crate) block_len: usize,
    /// Where those of a group start.
    pub(crate) start: usize,
}

/// What a task reads and writes in passing, in one precision.
#[derive(Debug, Default)]
pub(crate) struct Exchange<R> {
    /// The multipoles of a block of sources.
    multipoles: Vec<R>,
    /// What products read and write.
    places: Vec<[usize; 2]>,
    /// Which targets receive anything from a group, and what: by direction, then by parity class.
    receives: Vec<bool>,
    received: Vec<R>,
    /// What they receive from all groups; empty if that is nothing.
    locals: Vec<R>,
}

impl<R: Scalar> Exchange<R> {
    /// Takes in the multipoles of a block of sources.
    pub(crate) fn enter(&mut self, multipoles: impl Iterator<Item = R>) {
        self.multipoles.clear();
        self.multipoles.extend(multipoles);
    }

    /// y = Qᴴ m in all directions of a group, of which the first has this number, for the sources that
    /// any of them is wanted of: a bit per source for each direction.
    pub(crate) fn send(
        &mut self,
        first: usize,
        group: &Group<R>,
        wanted: &[AtomicU32],
        columns: usize,
        sent: &mut [R],
    ) {
        let Self { multipoles, places, .. } = self;
        let (members, height) = (group.members(), group.heights[0]);
        if group.ranks[0] == 0 {
            return;
        }
        let from_len = multipoles.len() / (wanted.len() * columns);
        let directions = ((1 << members) - 1) << first;
        places.clear();
        for (i, wanted) in wanted.iter().enumerate() {
            if wanted.load(Relaxed) & directions != 0 {
                for k in i * columns..(i + 1) * columns {
                    places.push([k * from_len, k * members * height]);
                }
            }
        }
        for part in &group.collect {
            let to = &mut sent[part.class * height + part.coordinate..];
            part.matrix.products(places, false, &multipoles[part.first..], to);
        }
        let starts = places.iter().map(|[_, y]| *y);
        dispatch(Reflections { sums: sent, starts, members, len: height });
    }

    /// Forgets what targets have received.
    pub(crate) fn start(&mut self) {
        self.locals.clear();
    }

    /// l_t += P Σ W y for the pairs of a group with `targets` targets, core by core. `core_starts` are
    /// the first cores of the group's directions, `to_len` the terms of a target per right-hand side.
    pub(crate) fn receive(
        &mut self,
        group: &Group<R>,
        core_starts: &[usize],
        pairs: &[Pair],
        sent: &Coordinates<'_, R>,
        [targets, columns, to_len]: [usize; 3],
    ) {
        let Self { places, receives, received, locals, .. } = self;
        if pairs.is_empty() || group.ranks.contains(&0) {
            return;
        }
        let members = group.members();
        let [y_len, z_len] = group.heights.map(|height| members * height);
        receives.clear();
        receives.resize(targets, false);
        received.clear();
        received.resize(targets * columns * z_len, zero::<R>());
        for pairs in pairs.chunk_by(|a, b| a.core == b.core) {
            let core = pairs[0].core as usize;
            let member = core_starts[1..members].partition_point(|&start| start <= core);
            places.clear();
            for pair in pairs {
                let (s, t) = (pair.source as usize, usize::from(pair.target));
                receives[t] = true;
                let y = s / EXCHANGE_BLOCK * sent.block_len + s % EXCHANGE_BLOCK * columns * y_len;
                for c in 0..columns {
                    places.push([y + c * y_len, (t * columns + c) * z_len]);
                }
            }
            let from = &sent.all[sent.start + member * group.heights[0]..];
            let to = &mut received[member * group.heights[1]..];
            group.cores[core - core_starts[member]].products(places, true, from, to);
        }
        if locals.is_empty() {
            // Zeros are added beyond the rows of a matrix, after the last target as well.
            let most = group.spread.iter().map(|part| part.matrix.height).max().unwrap_or(0);
            locals.resize(targets * columns * to_len + most, zero::<R>());
        }
        places.clear();
        for t in (0..targets).filter(|&t| receives[t]) {
            for k in t * columns..(t + 1) * columns {
                places.push([k * z_len, k * to_len]);
            }
        }
        let starts = places.iter().map(|[z, _]| *z);
        dispatch(Reflections { sums: received, starts, members, len: group.heights[1] });
        for part in &group.spread {
            let from = &received[part.class * group.heights[1] + part.coordinate..];
            part.matrix.products(places, true, from, &mut locals[part.first..]);
        }
    }

    /// Adds what targets have received to their local expansions.
    pub(crate) fn leave<S: Scalar>(&self, to: &mut [S], leave: impl Fn(R) -> S) {
        to.iter_mut().zip(&self.locals).for_each(|(l, &from)| *l += leave(from));
    }
}

/// From sums by parity class to sums by reflection, or back: Σ_c (−1)^|c ∧ r| s_c for every r, of
/// `members` sums of `len` numbers from each start on.
struct Reflections<'a, R, I> {
    sums: &'a mut [R],
    starts: I,
    members: usize,
    len: usize,
}

impl<R: Scalar, I: Iterator<Item = usize>> WithSimd for Reflections<'_, R, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        for start in self.starts {
            let sums = &mut self.sums[start..][..self.members * self.len];
            let mut step = self.len;
            while step < sums.len() {
                for both in sums.chunks_exact_mut(2 * step) {
                    let (even, odd) = both.split_at_mut(step);
                    for (even, odd) in even.iter_mut().zip(odd) {
                        (*even, *odd) = (*even + *odd, *even - *odd);
                    }
                }
                step *= 2;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::interpolation::probe;
    use crate::{Fmm, direct, from_fn, relative_l2_error};

    #[test]
    fn all_sources_of_a_level_reach_all_their_targets() {
        let points: Vec<DVec3> = (0..1500).map(probe::sample::<f64>).collect();
        // Half of the space is empty, so that some blocks are asked for in few directions only.
        let points: Vec<DVec3> = points.into_iter().filter(|p| p.x + p.y < 0.3).collect();
        let charges: Vec<f64> = (0..points.len()).map(|i| (i as f64).sin()).collect();
        let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
        for tolerance in [0.3, 0.03, 1e-3, 1e-8] {
            let plan = Fmm::builder(kernel).tolerance(tolerance).leaf_size(8);
            let fmm = plan.build(&points, &points).unwrap();
            assert!(fmm.report().stats.cell_pairs[0] > 10_000);
            let values = fmm.apply(&charges).unwrap();
            let error =
                relative_l2_error(&values, &direct(&kernel, &points, &charges, &points).unwrap());
            assert!(error <= tolerance, "{error:e} > {tolerance:e}");
        }
    }
}
