//! A small dense matrix.

/// A matrix, column after column.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix<S> {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    pub(crate) data: Vec<S>,
}

impl<S: Copy> Matrix<S> {
    pub(crate) fn from_fn(
        rows: usize,
        columns: usize,
        mut entry: impl FnMut(usize, usize) -> S,
    ) -> Self {
        let mut data = Vec::with_capacity(rows * columns);
        for j in 0..columns {
            data.extend((0..rows).map(|i| entry(i, j)));
        }
        Self { rows, columns, data }
    }

    pub(crate) fn at(&self, i: usize, j: usize) -> S {
        self.data[j * self.rows + i]
    }

    pub(crate) fn column(&self, j: usize) -> &[S] {
        &self.data[j * self.rows..][..self.rows]
    }

    pub(crate) fn transpose(&self) -> Self {
        Self::from_fn(self.columns, self.rows, |i, j| self.at(j, i))
    }

    /// Its first `rows` rows and `columns` columns.
    pub(crate) fn corner(&self, rows: usize, columns: usize) -> Self {
        Self::from_fn(rows, columns, |i, j| self.at(i, j))
    }

    pub(crate) fn map<R>(&self, f: impl FnMut(S) -> R) -> Matrix<R> {
        let data = self.data.iter().copied().map(f).collect();
        Matrix { rows: self.rows, columns: self.columns, data }
    }
}
