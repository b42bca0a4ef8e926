//! Rows of arrays as points.

use std::borrow::Cow;

use ndarray::ArrayView2;

use crate::error::Error;
use crate::numbers::traits::Real;

/// The rows of an N × 3 array as points: borrowed where they lie one after the other in memory, copied
/// otherwise. O(N) if copied.
///
/// ```
/// use farfield::{Fmm, from_fn, rows_as_points};
/// use ndarray::array;
///
/// let rows = array![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
/// let points = rows_as_points(rows.view())?;
/// let kernel = from_fn(|[x, ..]: [f64; 3], [y, ..]: [f64; 3]| (x - y).abs());
/// let fmm = Fmm::builder(kernel).build(&points, &points)?;
/// assert_eq!(fmm.apply(&[1.0, 3.0])?, [3.0, 1.0]);
/// # Ok::<(), farfield::Error>(())
/// ```
///
/// # Errors
/// [`Error::LengthMismatch`] unless the array has three columns.
pub fn rows_as_points<T: Real>(rows: ArrayView2<'_, T>) -> Result<Cow<'_, [[T; 3]]>, Error> {
    if rows.ncols() != 3 {
        return Err(Error::LengthMismatch {
            what: "coordinates of a point",
            expected: 3,
            found: rows.ncols(),
        });
    }
    Ok(match rows.to_slice() {
        Some(numbers) => Cow::Borrowed(numbers.as_chunks().0),
        None => rows.rows().into_iter().map(|row| [row[0], row[1], row[2]]).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    #[test]
    fn rows_are_borrowed_where_they_lie_in_order() {
        let rows = array![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
        let points = rows_as_points(rows.view()).unwrap();
        assert!(matches!(points, Cow::Borrowed([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])));
        let columns = array![[1.0, 4.0], [2.0, 5.0], [3.0, 6.0]];
        assert!(
            matches!(rows_as_points(columns.t()).unwrap(), Cow::Owned(copied) if *copied == *points)
        );
        let refused = rows_as_points(columns.view());
        assert!(matches!(refused, Err(Error::LengthMismatch { expected: 3, found: 2, .. })));
    }
}
