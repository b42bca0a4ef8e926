//! Pairs of points, brought to the registers of a program.

use farfield::Real;

use crate::machine::program::{Inputs, LANES};

/// Pairs that are written at once: as many as the widest registers hold in double precision.
pub(crate) const WIDTH: usize = 8;

/// Coordinates of several points side by side, one axis after the other.
pub(crate) type Side<T> = [[T; WIDTH]; 3];

/// The least and the greatest r² so far, lane by lane.
pub(crate) type Spread<T> = [[T; WIDTH]; 2];

/// The chunks of a register.
type Chunks<'a, T> = &'a mut [[T; WIDTH]];

/// Some points, [`WIDTH`] at most. Places beyond the last hold it again.
#[inline(always)]
pub(crate) fn side_by_side<T: Real>(points: &[[T; 3]]) -> Side<T> {
    let mut side = [[T::from_f64(0.0); WIDTH]; 3];
    for lane in 0..WIDTH {
        let p = points[lane.min(points.len() - 1)];
        for axis in 0..3 {
            side[axis][lane] = p[axis];
        }
    }
    side
}

/// Brings all pairs of some targets and sources to the registers, target by target for each source. Gives the least and
/// the greatest of 1 and all r².
#[inline(always)]
pub(crate) fn write_all<T: Real>(
    inputs: &Inputs,
    registers: &mut [T],
    xs: &[Side<T>],
    ys: &[[T; 3]],
) -> [T; 2] {
    let mut spread = [[T::from_f64(1.0); WIDTH]; 2];
    for (to, y) in register(registers, inputs.squared_distance).chunks_exact_mut(xs.len()).zip(ys) {
        for (to, x) in to.iter_mut().zip(xs) {
            squared_distance(to, x, &[[y[0]; WIDTH], [y[1]; WIDTH], [y[2]; WIDTH]], &mut spread);
        }
    }
    for axis in 0..3 {
        if inputs.difference[axis].is_some() {
            let to = register(registers, inputs.difference[axis]);
            for (to, y) in to.chunks_exact_mut(xs.len()).zip(ys) {
                for (to, x) in to.iter_mut().zip(xs) {
                    let mut d = x[axis];
                    for d in &mut d {
                        *d -= y[axis];
                    }
                    *to = d;
                }
            }
        }
        if inputs.target[axis].is_some() {
            let to = register(registers, inputs.target[axis]);
            for to in to.chunks_exact_mut(xs.len()).take(ys.len()) {
                to.iter_mut().zip(xs).for_each(|(to, x)| *to = x[axis]);
            }
        }
        if inputs.source[axis].is_some() {
            let to = register(registers, inputs.source[axis]);
            for (to, y) in to.chunks_exact_mut(xs.len()).zip(ys) {
                to.fill([y[axis]; WIDTH]);
            }
        }
    }
    ends(&spread)
}

/// The least and the greatest of all lanes.
#[inline(always)]
pub(crate) fn ends<T: Real>(spread: &Spread<T>) -> [T; 2] {
    let [mut least, mut greatest] = [spread[0][0], spread[1][0]];
    for (&low, &high) in spread[0].iter().zip(&spread[1]) {
        least = if low < least { low } else { least };
        greatest = if high > greatest { high } else { greatest };
    }
    [least, greatest]
}

/// Brings some pairs to the lanes of a chunk.
#[inline(always)]
pub(crate) fn write<T: Real>(
    inputs: &Inputs,
    registers: &mut [T],
    chunk: usize,
    [x, y]: [&Side<T>; 2],
    spread: &mut Spread<T>,
) {
    let to = register(registers, inputs.squared_distance);
    squared_distance(&mut to[chunk], x, y, spread);
    for axis in 0..3 {
        if inputs.difference[axis].is_some() {
            let to = &mut register(registers, inputs.difference[axis])[chunk];
            for lane in 0..WIDTH {
                to[lane] = x[axis][lane] - y[axis][lane];
            }
        }
        if inputs.target[axis].is_some() {
            register(registers, inputs.target[axis])[chunk] = x[axis];
        }
        if inputs.source[axis].is_some() {
            register(registers, inputs.source[axis])[chunk] = y[axis];
        }
    }
}

/// |x − y|², and the smallest and the greatest so far.
#[inline(always)]
fn squared_distance<T: Real>(
    to: &mut [T; WIDTH],
    x: &Side<T>,
    y: &Side<T>,
    [least, greatest]: &mut Spread<T>,
) {
    // Axis by axis, and written at the end: so it is compiled for all lanes at once.
    let mut square = [T::from_f64(0.0); WIDTH];
    for axis in 0..3 {
        for lane in 0..WIDTH {
            let d = x[axis][lane] - y[axis][lane];
            square[lane] += d * d;
        }
    }
    for lane in 0..WIDTH {
        least[lane] = if square[lane] < least[lane] { square[lane] } else { least[lane] };
        greatest[lane] = if square[lane] > greatest[lane] { square[lane] } else { greatest[lane] };
    }
    *to = square;
}

#[inline(always)]
fn register<T>(registers: &mut [T], register: Option<usize>) -> Chunks<'_, T> {
    let first = register.unwrap_or(0) * LANES;
    registers[first..][..LANES].as_chunks_mut().0
}
