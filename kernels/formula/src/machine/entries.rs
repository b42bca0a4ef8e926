//! Entries of blocks of pairs.

use farfield::{Real, dispatch};
use pulp::{Simd, WithSimd};

use crate::machine::batch::{WIDTH, ends, side_by_side, write};
use crate::machine::extended::Outermost;
use crate::machine::program::{LANES, Program};
use crate::machine::steps::{registers, run};

/// All entries of all pairs of a block: those of the pair (i, j) start at (i n + j) times their number, for n
/// sources.
pub(crate) struct BlockEntries<'a, T> {
    pub(crate) program: &'a Program<T>,
    pub(crate) xs: &'a [[T; 3]],
    pub(crate) ys: &'a [[T; 3]],
    pub(crate) entries: &'a mut [T],
}

impl<T: Real> BlockEntries<'_, T> {
    /// Writes the entries. O(pairs).
    pub(crate) fn write(self) {
        if !self.ys.is_empty() && !self.program.outputs.is_empty() {
            dispatch(self);
        }
    }
}

impl<T: Real> WithSimd for BlockEntries<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { program, xs, ys, entries } = self;
        let mut registers = registers(program);
        let len = program.outputs.len();
        // Pairs in their order: y goes round while x stands.
        let mut pairs = xs.iter().flat_map(|x| ys.iter().map(move |y| (*x, *y)));
        let mut outermost = Outermost::new(program);
        for (part, entries) in entries.chunks_mut(LANES * len).enumerate() {
            let count = entries.len() / len;
            let mut spread = [[T::from_f64(1.0); WIDTH]; 2];
            for (chunk, at) in (0..count).step_by(WIDTH).enumerate() {
                let mut sides = [[[T::from_f64(0.0); 3]; WIDTH]; 2];
                let width = WIDTH.min(count - at);
                for (lane, (x, y)) in pairs.by_ref().take(width).enumerate() {
                    (sides[0][lane], sides[1][lane]) = (x, y);
                }
                let [x, y] = sides.each_ref().map(|side| side_by_side(&side[..width]));
                write(&program.inputs, &mut registers, chunk, [&x, &y], &mut spread);
            }
            run(program, &mut registers, count);
            if !outermost.serve(ends(&spread)) {
                let pair = |index: usize| {
                    let pair = part * LANES + index;
                    (xs[pair / ys.len()], ys[pair % ys.len()])
                };
                outermost.see(&mut registers, count, &pair);
            }
            for (k, output) in program.outputs.iter().enumerate() {
                let found = &registers[output * LANES..][..count];
                let to = entries.iter_mut().skip(k).step_by(len);
                to.zip(found).for_each(|(to, found)| *to = *found);
            }
        }
    }
}
