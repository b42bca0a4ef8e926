//! M2L of a whole level: many translations by equal vectors at once.

use farfield::{Cell, LevelPairs, Numbers, Point, Real, Vector};
use rayon::prelude::*;

use super::{Harmonic, Scratch};

/// Level-wide M2L: how finely a level is divided among threads, and the most target cells that a
/// task takes: enough that most batches of equal offsets are full.
const TASKS_PER_THREAD: usize = 4;
const LARGEST_CHUNK: usize = 128;

impl<T: Real> Harmonic<T> {
    /// All M2L translations of one level; each target cell's sum is the same for any number of threads.
    pub fn m2l_level<C: Numbers<Real = T>>(
        &self,
        level: &LevelPairs<'_, T>,
        multipoles: &[C],
        locals: &mut [C],
    ) {
        if size_of::<C>() <= 2 * size_of::<T>() {
            self.m2l_batches::<C, 8>(level, multipoles, locals);
        } else {
            self.m2l_batches::<C, 1>(level, multipoles, locals);
        }
    }

    /// The vector between two cells of one level in half-widths, given it in cells.
    pub fn shift(offset: [i32; 3]) -> Point<T> {
        Point::<T>::from_array(offset.map(|o| T::from_f64(2.0 * f64::from(o))))
    }

    /// The centre of a cell as seen from its parent, in the parent's half-widths.
    pub fn centre_in_parent(child: &Cell<T>) -> Point<T> {
        let high = |axis: usize| child.octant() >> axis & 1 == 1;
        Point::<T>::from_array([0, 1, 2].map(|k| T::from_f64(if high(k) { 0.5 } else { -0.5 })))
    }

    /// M2L with pairs of the same offset side by side as columns of one translation, `LANES` at a
    /// time. A target's sum runs over its offsets in ascending order, whatever its batches hold.
    fn m2l_batches<C: Numbers<Real = T>, const LANES: usize>(
        &self,
        level: &LevelPairs<'_, T>,
        multipoles: &[C],
        locals: &mut [C],
    ) {
        let len = self.len();
        let tasks = TASKS_PER_THREAD * rayon::current_num_threads();
        let chunk = level.targets.len().div_ceil(tasks).clamp(1, LARGEST_CHUNK);
        let zeros = || vec![<[C; LANES]>::zero(); len];
        locals.par_chunks_mut(chunk * len).enumerate().for_each_init(
            || (Scratch::new(self), zeros(), zeros()),
            |(scratch, from, to), (index, locals)| {
                if level.is_stopped() {
                    return;
                }
                let first = chunk * index;
                let mut pairs: Vec<_> = (0..locals.len() / len)
                    .flat_map(|t| level.sources_of(first + t).map(move |s| (t, s)))
                    .map(|(t, s)| (level.sources[s].offset_to(&level.targets[first + t]), t, s))
                    .collect();
                pairs.sort_unstable();
                for same in pairs.chunk_by(|a, b| a.0 == b.0) {
                    let shift = Self::shift(same[0].0);
                    for batch in same.chunks(LANES) {
                        for (lane, &(_, _, s)) in batch.iter().enumerate() {
                            for (from, term) in from.iter_mut().zip(&multipoles[s * len..]) {
                                from[lane] = term.clone();
                            }
                        }
                        to.fill(Numbers::zero());
                        self.m2l(shift, from, to, scratch);
                        for (lane, &(_, t, _)) in batch.iter().enumerate() {
                            for (term, to) in locals[t * len..].iter_mut().zip(to.iter()) {
                                term.accumulate(&to[lane]);
                            }
                        }
                    }
                }
            },
        );
    }
}
