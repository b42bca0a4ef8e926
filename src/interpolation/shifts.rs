//! M2M and L2L of many cells at once: one matrix product per matrix, whatever the number of cells.

use crate::dense::Matrix;
use crate::interpolation::prepared::Invariant;
use crate::probe::zero;
use crate::real::Scalar;

/// S_to A S_from: a matrix with signs on its columns and rows.
pub(crate) struct Shift<'a, S: Scalar> {
    pub(crate) matrix: &'a Matrix<S>,
    /// Tells matrices of one level apart.
    pub(crate) index: usize,
    /// The diagonals of S_from and S_to.
    pub(crate) signs: [&'a [S::Real]; 2],
}

/// One cell's shift, from terms to terms of two arrays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Move {
    pub(crate) from: usize,
    pub(crate) to: usize,
    pub(crate) octant: usize,
}

/// What shifts write to in passing.
#[derive(Debug, Default)]
pub(crate) struct Shifted<S> {
    pub(crate) moves: Vec<Move>,
    x: Vec<S>,
    z: Vec<S>,
}

/// Cells that are shifted together: enough to make a product worth while, few enough for a cache.
pub(crate) const TOGETHER: usize = 96;

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
        Shifted { moves, x, z }: &mut Shifted<S>,
    ) {
        let shift = |it: &Move| self.shift(level, it.octant, down);
        moves.sort_by_key(|it| shift(it).index);
        for moves in moves.chunk_by(|a, b| shift(a).index == shift(b).index) {
            let matrix = shift(&moves[0]).matrix;
            if matrix.rows == 0 || matrix.columns == 0 {
                continue;
            }
            x.clear();
            for it in moves {
                let signs = shift(it).signs[0];
                let terms = &from[it.from * lens[0]..][..lens[0]];
                for column in terms.chunks_exact(signs.len()) {
                    x.extend(column.iter().zip(signs).map(|(&x, &sign)| x * S::from_real(sign)));
                }
            }
            z.resize(moves.len() * lens[1], zero::<S>());
            S::product(matrix, x, false, z);
            for (it, z) in moves.iter().zip(z.chunks_exact(lens[1])) {
                let signs = shift(it).signs[1];
                let terms = &mut to[it.to * lens[1]..][..lens[1]];
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
