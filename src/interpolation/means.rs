//! Means over the interaction list, which errors and what they are relative to have in common.

use crate::numbers::traits::{Point, Real, Vector};

/// The number of [`interaction_offsets`].
pub(crate) const INTERACTION_OFFSETS: usize = 7 * 7 * 7 - 3 * 3 * 3;

/// The offsets of an unmasked tree: children of neighbours that are not neighbours.
pub(crate) fn interaction_offsets() -> impl Iterator<Item = [i32; 3]> {
    (0..343i32)
        .map(|k| [k / 49 - 3, k / 7 % 7 - 3, k % 7 - 3])
        .filter(|o| o.iter().any(|o| o.abs() > 1))
}

/// How often an offset occurs in an unmasked tree, on average over the interaction list: a cell has
/// sources three cells away on one side only, the side on which it lies in its parent.
pub(crate) fn weight(offset: [i32; 3]) -> f64 {
    let share: f64 = offset.iter().map(|o| if o.abs() == 3 { 0.5 } else { 1.0 }).product();
    share * INTERACTION_OFFSETS as f64 / 189.0
}

/// Root mean squares over the interaction list, in three parts.
///
/// A kernel that grows with distance is smallest, and interpolated worst, in the nearest cells, and
/// these may hold all sources, or all of them in a corner, where polynomials are largest: a mean over
/// the whole list does not speak for them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Means {
    all: f64,
    nearest: f64,
    /// Between corners of the nearest cells.
    corners: f64,
}

impl Means {
    /// The means of squares between random points and between corners, one pair for each of the
    /// [`interaction_offsets`] in their order; none for those that do not count.
    pub(crate) fn of(squares: impl IntoIterator<Item = Option<[f64; 2]>>) -> Self {
        let mut sums = [[0.0; 2]; 3];
        for (offset, squares) in interaction_offsets().zip(squares) {
            let Some([anywhere, corners]) = squares else { continue };
            let parts = [anywhere, anywhere, corners];
            let count = if is_nearest(offset) { 3 } else { 1 };
            for ([sum, weights], squared) in sums.iter_mut().zip(parts).take(count) {
                *sum += weight(offset) * squared;
                *weights += weight(offset);
            }
        }
        // Where no offset counts, the others speak for all.
        let [all, of_nearest, of_corners] =
            sums.map(|[sum, weights]: [f64; 2]| (weights > 0.0).then(|| (sum / weights).sqrt()));
        let all = all.unwrap_or(0.0);
        Self { all, nearest: of_nearest.unwrap_or(all), corners: of_corners.unwrap_or(all) }
    }

    /// No mean less than `floor`.
    pub(crate) fn at_least(self, floor: f64) -> Self {
        let Self { all, nearest, corners } = self;
        let [all, nearest, corners] = [all, nearest, corners].map(|mean| mean.max(floor));
        Self { all, nearest, corners }
    }

    /// The mean over the whole list.
    pub(crate) fn all(self) -> f64 {
        self.all
    }

    /// The smaller mean between random points.
    pub(crate) fn least(self) -> f64 {
        self.all.min(self.nearest)
    }

    /// The largest of the means that count: that over all, and others if asked for.
    pub(crate) fn worst(self, nearest: bool, corners: bool) -> f64 {
        let Self { all, nearest: of_nearest, corners: of_corners } = self;
        let of_nearest = if nearest || corners { of_nearest } else { 0.0 };
        largest([all, of_nearest, if corners { of_corners } else { 0.0 }])
    }

    /// Whether this is the size of a kernel that grows with distance.
    pub(crate) fn grows(self) -> bool {
        self.nearest < self.all
    }
}

/// The largest of some numbers, 0 if there are none; NaN if one of them is.
pub(crate) fn largest(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let larger = |a: f64, b: f64| if b > a || b.is_nan() { b } else { a };
    numbers.into_iter().fold(0.0, larger)
}

/// Whether a cell counts as one of the nearest: those within √5 cells.
pub(crate) fn is_nearest(offset: [i32; 3]) -> bool {
    offset.iter().map(|o| o * o).sum::<i32>() <= 5
}

/// The corners of [−1, 1]³.
pub(crate) fn corner<T: Real>(i: usize) -> Point<T> {
    let end = |axis: usize| T::from_f64(if i >> axis & 1 == 0 { -1.0 } else { 1.0 });
    Point::<T>::from_array([0, 1, 2].map(end))
}

/// The corner of a source cell that is nearest to the target cell; one of them if there are several.
pub(crate) fn facing(offset: [i32; 3], any: usize) -> usize {
    let end = |axis: usize| match offset[axis].signum() {
        0 => any & 1 << axis,
        side => usize::from(side < 0) << axis,
    };
    end(0) | end(1) | end(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_316_offsets() {
        assert_eq!(interaction_offsets().count(), INTERACTION_OFFSETS);
    }

    #[test]
    fn weights_make_up_the_list_of_one_cell() {
        let cells: f64 = interaction_offsets().map(weight).sum();
        assert!((cells - INTERACTION_OFFSETS as f64).abs() < 1e-9);
    }

    #[test]
    fn what_grows_with_distance_is_measured_where_it_is_least() {
        let distance = |o: [i32; 3]| o.iter().map(|o| f64::from(o * o)).sum::<f64>();
        let size = Means::of(interaction_offsets().map(|o| Some([distance(o).powi(3); 2])));
        assert!(size.nearest < 0.3 * size.all && size.least() == size.nearest);
        let errors = Means::of(interaction_offsets().map(|_| Some([1.0, 49.0])));
        assert!(
            (errors.worst(false, true) - 7.0).abs() < 1e-12 && (errors.all() - 1.0).abs() < 1e-12
        );
    }
}
