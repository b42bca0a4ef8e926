//! Sums over blocks of pairs.

use farfield::{Real, dispatch};
use pulp::{Simd, WithSimd};

use crate::machine::batch::{WIDTH, side_by_side, write_all};
use crate::machine::extended::Outermost;
use crate::machine::program::{LANES, Program};
use crate::machine::steps::{fill_constants, registers, run};

/// Targets that are summed for at the same time.
const TARGETS: usize = 32;

/// Σ_j G(x_i, y_j) s_j for all targets of a block and all parts of G: values, and derivatives if there are any.
pub(crate) struct BlockSums<'a, T> {
    /// Gives all entries of all parts, part after part, each row after row.
    pub(crate) program: &'a Program<T>,
    /// How many densities a source sends.
    pub(crate) densities: usize,
    /// How many right-hand sides there are.
    pub(crate) columns: usize,
    /// What holds where points coincide: this times the identity, without derivatives. `None` for what the formula
    /// gives there.
    pub(crate) coincident: Option<T>,
    pub(crate) xs: &'a [[T; 3]],
    pub(crate) ys: &'a [[T; 3]],
    /// What the sources send: for each density, for each column, the numbers of all sources.
    pub(crate) sent: &'a [T],
    /// Where the sums go: for each target, each row of each part, each column.
    pub(crate) sums: &'a mut [T],
}

impl<T: Real> BlockSums<'_, T> {
    /// Adds to the sums. O(targets × sources).
    pub(crate) fn add(self) {
        if !self.ys.is_empty() && !self.program.outputs.is_empty() && self.columns > 0 {
            dispatch(self);
        }
    }

    /// Makes all entries of pairs at one place zero.
    #[inline(never)]
    fn clear(&self, registers: &mut [T], xs: &[[T; 3]], ys: &[[T; 3]]) {
        let width = xs.len().next_multiple_of(WIDTH);
        for (i, j) in coincident_pairs(xs, ys) {
            for register in &self.program.outputs {
                registers[register * LANES + j * width + i] = T::from_f64(0.0);
            }
        }
    }

    /// Adds what holds instead.
    #[inline(never)]
    fn add_coincident(
        &self,
        value: T,
        xs: &[[T; 3]],
        ys: &[[T; 3]],
        first: usize,
        sums: &mut [[T; TARGETS]],
    ) {
        for (i, j) in coincident_pairs(xs, ys) {
            // The rows of values come first.
            for (sums, sent) in sums.iter_mut().zip(self.sent.chunks_exact(self.ys.len())) {
                sums[i] += value * sent[first + j];
            }
        }
    }
}

/// The pairs at one place.
fn coincident_pairs<T: Real>(xs: &[[T; 3]], ys: &[[T; 3]]) -> impl Iterator<Item = (usize, usize)> {
    ys.iter().enumerate().flat_map(move |(j, y)| {
        xs.iter().enumerate().filter(move |(_, x)| *x == y).map(move |(i, _)| (i, j))
    })
}

impl<T: Real> WithSimd for BlockSums<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { program, densities, columns, xs, ys, sent, .. } = self;
        let zero = T::from_f64(0.0);
        let rows = program.outputs.len() / densities * columns;
        let mut registers = registers(program);
        let mut outermost = Outermost::new(program);
        // Entries that are constants are cleared where they stand, and have to be filled in again.
        let constant = program.outputs.iter().any(|output| *output < program.constants.len());
        let mut sums = vec![[zero; TARGETS]; rows];
        for (block, xs) in xs.chunks(TARGETS).enumerate() {
            let width = xs.len().next_multiple_of(WIDTH);
            let mut sides = [[[zero; WIDTH]; 3]; TARGETS / WIDTH];
            for (side, xs) in sides.iter_mut().zip(xs.chunks(WIDTH)) {
                *side = side_by_side(xs);
            }
            let sides = &sides[..width / WIDTH];
            sums.fill([zero; TARGETS]);
            let each = LANES / width;
            for (part, ys) in ys.chunks(each).enumerate() {
                let first = part * each;
                let spread = write_all(&program.inputs, &mut registers, sides, ys);
                run(program, &mut registers, ys.len() * width);
                if !outermost.serve(spread) {
                    // Places beyond the last target hold it again.
                    let pair =
                        |index: usize| (xs[(index % width).min(xs.len() - 1)], ys[index / width]);
                    outermost.see(&mut registers, ys.len() * width, &pair);
                }
                let instead = self.coincident.filter(|_| spread[0] == zero);
                if instead.is_some() {
                    self.clear(&mut registers, xs, ys);
                }
                for (k, &output) in program.outputs.iter().enumerate() {
                    let (row, density) = (k / densities, k % densities);
                    let entries = &registers[output * LANES..][..ys.len() * width];
                    for column in 0..columns {
                        let sums = &mut sums[row * columns + column];
                        let sent = &sent[(density * columns + column) * self.ys.len() + first..];
                        match sides.len() {
                            1 => accumulate::<T, 1>(sums, entries, sent),
                            2 => accumulate::<T, 2>(sums, entries, sent),
                            3 => accumulate::<T, 3>(sums, entries, sent),
                            _ => accumulate::<T, 4>(sums, entries, sent),
                        }
                    }
                }
                if let Some(value) = instead {
                    self.add_coincident(value, xs, ys, first, &mut sums);
                    if constant {
                        fill_constants(program, &mut registers);
                    }
                }
            }
            let targets = self.sums[block * TARGETS * rows..].chunks_exact_mut(rows);
            for (i, (to, _)) in targets.zip(xs).enumerate() {
                to.iter_mut().zip(&sums).for_each(|(to, sums)| *to += sums[i]);
            }
        }
    }
}

/// Adds what an entry makes of what the sources send, to the sums of `SIDES` times [`WIDTH`] targets.
#[inline(always)]
fn accumulate<T: Real, const SIDES: usize>(sums: &mut [T; TARGETS], entries: &[T], sent: &[T]) {
    let Some(sums) = sums.as_chunks_mut::<WIDTH>().0.first_chunk_mut::<SIDES>() else { return };
    let mut so_far = *sums;
    for (entries, &q) in entries.as_chunks::<WIDTH>().0.as_chunks::<SIDES>().0.iter().zip(sent) {
        for (sum, entry) in so_far.iter_mut().zip(entries) {
            for lane in 0..WIDTH {
                sum[lane] += entry[lane] * q;
            }
        }
    }
    *sums = so_far;
}
