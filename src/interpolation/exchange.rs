//! What blocks of sources send in one direction, and what blocks of targets receive from it.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::interpolation::directions::Direction;
use crate::probe::zero;
use crate::real::Scalar;

/// A pair of cells of one level.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pair {
    pub(crate) source: u32,
    /// Counted from the task's first target.
    pub(crate) target: u16,
    /// Its core, counted over all directions.
    pub(crate) core: u32,
}

/// Sources whose coordinates are computed together.
pub(crate) const BLOCK: usize = 128;

/// The coordinates of all sources in one direction: those of a block's sources one after the other.
pub(crate) struct Coordinates<'a, R> {
    pub(crate) all: &'a [R],
    /// Where those of the first source start, and how far apart blocks are.
    pub(crate) start: usize,
    pub(crate) block_len: usize,
}

/// What a task reads and writes in passing, in one precision.
#[derive(Debug, Default)]
pub(crate) struct Exchange<R> {
    /// The multipoles of a block of sources.
    multipoles: Vec<R>,
    /// What products read and write.
    places: Vec<[usize; 2]>,
    /// What targets receive from one direction, and which of them do.
    received: Vec<R>,
    receives: Vec<bool>,
    /// What they receive from all directions; empty if that is nothing.
    locals: Vec<R>,
}

impl<R: Scalar> Exchange<R> {
    /// Takes in the multipoles of a block of sources.
    pub(crate) fn enter(&mut self, multipoles: impl Iterator<Item = R>) {
        self.multipoles.clear();
        self.multipoles.extend(multipoles);
    }

    /// y = Qᴴ m of the sources that the direction with this number is wanted of: a bit per source for
    /// each direction.
    pub(crate) fn send(
        &mut self,
        number: usize,
        Direction { collect, .. }: &Direction<R>,
        wanted: &[AtomicU32],
        columns: usize,
        sent: &mut [R],
    ) {
        self.places.clear();
        for (i, wanted) in wanted.iter().enumerate() {
            if wanted.load(Relaxed) >> number & 1 == 1 {
                let columns = i * columns..(i + 1) * columns;
                self.places.extend(columns.map(|k| [k * collect.columns, k * collect.height]));
            }
        }
        collect.products(&self.places, false, &self.multipoles, sent);
    }

    /// Forgets what targets have received.
    pub(crate) fn start(&mut self) {
        self.locals.clear();
    }

    /// l_t += P Σ W y for the pairs of one direction with `targets` targets, core by core.
    pub(crate) fn receive(
        &mut self,
        Direction { collect, spread, cores }: &Direction<R>,
        first_core: usize,
        pairs: &[Pair],
        sent: &Coordinates<'_, R>,
        [targets, columns]: [usize; 2],
    ) {
        let Self { places, received, receives, locals, .. } = self;
        if pairs.is_empty() || collect.rows == 0 || spread.columns == 0 {
            return;
        }
        receives.clear();
        receives.resize(targets, false);
        pairs.iter().for_each(|pair| receives[usize::from(pair.target)] = true);
        let len = cores[0].height;
        received.clear();
        received.resize(targets * columns * len, zero::<R>());
        for pairs in pairs.chunk_by(|a, b| a.core == b.core) {
            places.clear();
            for pair in pairs {
                let (s, t) = (pair.source as usize, usize::from(pair.target));
                let block = sent.start + s / BLOCK * sent.block_len;
                places.extend((0..columns).map(|c| {
                    let y = block + (s % BLOCK * columns + c) * collect.height;
                    [y, (t * columns + c) * len]
                }));
            }
            cores[pairs[0].core as usize - first_core].products(places, true, sent.all, received);
        }
        if locals.is_empty() {
            locals.resize(targets * columns * spread.height, zero::<R>());
        }
        places.clear();
        for t in (0..targets).filter(|&t| receives[t]) {
            let columns = t * columns..(t + 1) * columns;
            places.extend(columns.map(|k| [k * len, k * spread.height]));
        }
        spread.products(places, true, received, locals);
    }

    /// Adds what targets have received to their local expansions, `rank` terms per right-hand side.
    pub(crate) fn leave<S: Scalar>(&self, rank: usize, to: &mut [S], leave: impl Fn(R) -> S) {
        let columns = to.len() / rank;
        let height = self.locals.len() / columns.max(1);
        if height > 0 {
            for (to, from) in to.chunks_exact_mut(rank).zip(self.locals.chunks_exact(height)) {
                to.iter_mut().zip(from).for_each(|(l, &from)| *l += leave(from));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::{Fmm, direct, from_fn, probe, relative_l2_error};

    #[test]
    fn all_sources_of_a_level_reach_all_their_targets() {
        let points: Vec<DVec3> = (0..1500).map(probe::sample::<f64>).collect();
        // Half of the space is empty, so that some blocks are asked for in few directions only.
        let points: Vec<DVec3> = points.into_iter().filter(|p| p.x + p.y < 0.3).collect();
        let charges: Vec<f64> = (0..points.len()).map(|i| (i as f64).sin()).collect();
        let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
        for tolerance in [1e-3, 1e-8] {
            let plan = Fmm::builder(kernel).tolerance(tolerance).leaf_size(8);
            let fmm = plan.build(&points, &points).unwrap();
            assert!(fmm.stats().cell_pairs[0] > 10_000);
            let values = fmm.apply(&charges).unwrap();
            let error = relative_l2_error(&values, &direct(&kernel, &points, &charges, &points));
            assert!(error <= tolerance, "{error:e} > {tolerance:e}");
        }
    }
}
