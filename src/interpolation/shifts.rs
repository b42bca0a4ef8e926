//! M2M and L2L of many cells at once: one matrix product per matrix, whatever the number of cells.

use crate::expansion::Expansion;
use crate::expansion::level_cells::LevelFamilies;
use crate::interpolation::black_box::Interpolation;
use crate::interpolation::entries::zero;
use crate::interpolation::prepared::{Invariant, Prepared};
use crate::interpolation::scratch::{Move, Shifted};
use crate::interpolation::tuning::SHIFTED_TOGETHER;
use crate::kernel::traits::Kernel;
use crate::linalg::matrix::Matrix;
use crate::numbers::compiled::Compiled;
use crate::numbers::traits::Scalar;
use crate::octree::geometry::Cell;
use crate::parallel;

impl<K: Kernel> Interpolation<K> {
    /// M2M, or L2L if `down`, between `child` and its parent.
    pub(super) fn shift(
        &self,
        child: &Cell<K::Real>,
        down: bool,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        let octant = child.octant();
        match &*self.prepared {
            Prepared::Everywhere(everywhere) => {
                let mut shifted = from.to_vec();
                everywhere.rule.shift(octant, down, &mut shifted);
                to.iter_mut().zip(shifted).for_each(|(to, term)| *to += term);
            }
            Prepared::Invariant(invariant) => {
                let lens = [from.len(), to.len()];
                self.shifted.with(Shifted::default, |shifted| {
                    shifted.moves.clear();
                    shifted.moves.push(Move { from: 0, to: 0, octant });
                    invariant.add_shifts(child.level() - 1, down, lens, from, to, shifted);
                });
            }
        }
    }

    /// M2M of a level.
    pub(super) fn shift_up(
        &self,
        families: &LevelFamilies<'_, K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        let Prepared::Invariant(invariant) = &*self.prepared else {
            let len = self.multipole_len(families.level + 1);
            return families.for_each_parent(to, |_, c, to| {
                self.shift(&families.children[c], false, &from[c * len..][..len], to);
            });
        };
        let level = families.level;
        let lens = [self.multipole_len(level + 1), self.multipole_len(level)];
        let parents = SHIFTED_TOGETHER / 8;
        parallel::for_each_piece(to, parents * lens[1], &|task, to| {
            if families.is_stopped() {
                return;
            }
            self.shifted.with(Shifted::default, |shifted| {
                shifted.moves.clear();
                for to in 0..to.len() / lens[1] {
                    let children = families.children_of(task * parents + to);
                    shifted.moves.extend(children.map(|from| Move {
                        from,
                        to,
                        octant: families.children[from].octant(),
                    }));
                }
                invariant.add_shifts(level, false, lens, from, to, shifted);
            });
        });
    }

    /// L2L of a level.
    pub(super) fn shift_down(
        &self,
        families: &LevelFamilies<'_, K::Real>,
        from: &[K::Entry],
        to: &mut [K::Entry],
    ) {
        let lens = [self.local_len(families.level), self.local_len(families.level + 1)];
        let Prepared::Invariant(invariant) = &*self.prepared else {
            return families.for_each_child(to, |p, c, to| {
                let from = &from[p * lens[0]..][..lens[0]];
                self.shift(&families.children[c], true, from, to);
            });
        };
        parallel::for_each_piece(to, SHIFTED_TOGETHER * lens[1], &|task, to| {
            if families.is_stopped() {
                return;
            }
            self.shifted.with(Shifted::default, |shifted| {
                shifted.moves.clear();
                shifted.moves.extend((0..to.len() / lens[1]).filter_map(|to| {
                    let child = task * SHIFTED_TOGETHER + to;
                    let octant = families.children[child].octant();
                    families.parent_of(child).map(|from| Move { from, to, octant })
                }));
                invariant.add_shifts(families.level, true, lens, from, to, shifted);
            });
        });
    }
}

/// [`Invariant::add_shifts`].
type AddShifts<S> = fn(&Invariant<S>, usize, bool, [usize; 2], &[S], &mut [S], &mut Shifted<S>);
static ADD_SHIFTS: Compiled<AddShifts<f32>, AddShifts<f64>> =
    Compiled(Invariant::compiled, Invariant::compiled);

impl<S: Scalar> Invariant<S> {
    /// M2M, or L2L if `down`, between cells of `level` and the next: all of `shifted.moves`, for cells
    /// with `lens` terms.
    pub(crate) fn add_shifts(
        &self,
        level: usize,
        down: bool,
        lens: [usize; 2],
        from: &[S],
        to: &mut [S],
        shifted: &mut Shifted<S>,
    ) {
        let add =
            if const { S::COMPLEX } { Self::compiled } else { ADD_SHIFTS.of::<AddShifts<S>>() };
        add(self, level, down, lens, from, to, shifted);
    }

    fn compiled(
        &self,
        level: usize,
        down: bool,
        lens: [usize; 2],
        from: &[S],
        to: &mut [S],
        Shifted { moves, x, z }: &mut Shifted<S>,
    ) {
        let shift = |one: &Move| self.shift(level, one.octant, down);
        // Sorting in place, where a stable sort would allocate.
        moves.sort_unstable_by_key(|one| (shift(one).index, one.from, one.to));
        for moves in moves.chunk_by(|a, b| shift(a).index == shift(b).index) {
            let matrix = shift(&moves[0]).matrix;
            if matrix.rows == 0 || matrix.columns == 0 {
                continue;
            }
            x.clear();
            for one in moves {
                let signs = shift(one).signs[0];
                let terms = &from[one.from * lens[0]..][..lens[0]];
                for column in terms.chunks_exact(signs.len()) {
                    x.extend(column.iter().zip(signs).map(|(&x, &sign)| x * S::from_real(sign)));
                }
            }
            columns_alike(matrix, x, z);
            for (one, z) in moves.iter().zip(z.chunks_exact(lens[1])) {
                let signs = shift(one).signs[1];
                let terms = &mut to[one.to * lens[1]..][..lens[1]];
                for (column, z) in
                    terms.chunks_exact_mut(signs.len()).zip(z.chunks_exact(signs.len()))
                {
                    for ((term, &z), &sign) in column.iter_mut().zip(z).zip(signs) {
                        *term += z * S::from_real(sign);
                    }
                }
            }
        }
    }
}

/// Columns are multiplied by as many at a time, or a multiple of that.
const TOGETHER: usize = 8;

/// Products of at most as many multiply-adds are formed in another way than larger ones.
const SMALL_PRODUCT: usize = 1 << 12;

/// Z = A X for columns that stand one after the other. Each comes out to the same bits whatever other columns there are, and
/// however many: which cells are shifted together is then nothing to any of them. Zeros fill up the last columns.
fn columns_alike<S: Scalar>(matrix: &Matrix<S>, x: &mut Vec<S>, z: &mut Vec<S>) {
    let Matrix { rows, columns, .. } = *matrix;
    let count = (x.len() / columns).next_multiple_of(TOGETHER);
    x.resize(count * columns, zero::<S>());
    z.resize(count * rows, zero::<S>());
    let is_small = rows * columns * TOGETHER <= SMALL_PRODUCT;
    let together = if is_small { TOGETHER } else { count };
    let (x, z) = (x.chunks(together * columns), z.chunks_mut(together * rows));
    x.zip(z).for_each(|(x, z)| S::product(matrix, x, false, z));
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_complex::Complex;

    fn check<S: Scalar>(number: impl Fn(usize) -> S) {
        for (rows, columns) in [
            (1, 1),
            (1, 30),
            (30, 1),
            (2, 3),
            (8, 8),
            (13, 21),
            (22, 23),
            (24, 24),
            (47, 50),
            (64, 64),
            (100, 90),
            (150, 200),
        ] {
            let matrix = Matrix::from_fn(rows, columns, |i, j| number(7 * i + 3 * j));
            let all: Vec<S> = (0..97 * columns).map(|k| number(5 * k + 1)).collect();
            let mut expected = Vec::new();
            for x in all.chunks_exact(columns) {
                let mut z = Vec::new();
                columns_alike(&matrix, &mut x.to_vec(), &mut z);
                expected.extend_from_slice(&z[..rows]);
            }
            for count in [2, 3, 7, 8, 9, 12, 31, 96, 97] {
                for first in [0, 97 - count] {
                    let (mut x, mut z) =
                        (all[first * columns..][..count * columns].to_vec(), Vec::new());
                    columns_alike(&matrix, &mut x, &mut z);
                    let expected = &expected[first * rows..][..count * rows];
                    assert!(z[..count * rows] == *expected, "{rows} x {columns}, {count} columns");
                }
            }
        }
    }

    #[test]
    fn a_column_is_nothing_to_the_others() {
        let number = |k: usize| (0.37 * (k + 1) as f64).sin();
        check(number);
        check(|k| number(k) as f32);
        check(|k| Complex::new(number(k), number(k + 5)));
        check(|k| Complex::new(number(k) as f32, number(k + 5) as f32));
    }
}
