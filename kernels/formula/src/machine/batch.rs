//! Pairs of points, brought to the registers of a program.

use farfield::Real;

use crate::machine::program::{Inputs, LANES};

/// Pairs that are written at once: as many as the widest registers hold in double precision.
pub(crate) const WIDTH: usize = 8;

/// Coordinates of several points side by side, one axis after the other.
pub(crate) type Side<T> = [[T; WIDTH]; 3];

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

/// Brings all pairs of some targets and sources to the registers, target by target for each source. Says whether some
/// of them are at one place, or so near that the square of their distance vanishes.
#[inline(always)]
pub(crate) fn write_all<T: Real>(
    inputs: &Inputs,
    registers: &mut [T],
    xs: &[Side<T>],
    ys: &[[T; 3]],
) -> bool {
    let mut least = [T::from_f64(1.0); WIDTH];
    for (to, y) in register(registers, inputs.squared_distance).chunks_exact_mut(xs.len()).zip(ys) {
        for (to, x) in to.iter_mut().zip(xs) {
            squared_distance(to, x, &[[y[0]; WIDTH], [y[1]; WIDTH], [y[2]; WIDTH]], &mut least);
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
    least.contains(&T::from_f64(0.0))
}

/// Brings some pairs to the lanes of a chunk.
#[inline(always)]
pub(crate) fn write<T: Real>(
    inputs: &Inputs,
    registers: &mut [T],
    chunk: usize,
    x: &Side<T>,
    y: &Side<T>,
) {
    let to = register(registers, inputs.squared_distance);
    squared_distance(&mut to[chunk], x, y, &mut [T::from_f64(1.0); WIDTH]);
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

/// |x − y|², and the smallest so far.
#[inline(always)]
fn squared_distance<T: Real>(
    to: &mut [T; WIDTH],
    x: &Side<T>,
    y: &Side<T>,
    least: &mut [T; WIDTH],
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
    }
    *to = square;
}

#[inline(always)]
fn register<T>(registers: &mut [T], register: Option<usize>) -> Chunks<'_, T> {
    let first = register.unwrap_or(0) * LANES;
    registers[first..][..LANES].as_chunks_mut().0
}
