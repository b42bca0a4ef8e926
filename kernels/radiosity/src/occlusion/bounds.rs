//! Axis-aligned bounding boxes.

use farfield::{Point, Real, Vector};
use glam::DVec3;

/// The smallest axis-aligned box around some points; inside out if there are none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds<T> {
    pub(crate) low: [T; 3],
    pub(crate) high: [T; 3],
}

impl<T: Real> Bounds<T> {
    /// The box that holds nothing.
    pub(crate) fn empty() -> Self {
        Self { low: [T::infinity(); 3], high: [T::neg_infinity(); 3] }
    }

    /// The box around `points`.
    pub(crate) fn of(points: impl IntoIterator<Item = [T; 3]>) -> Self {
        points.into_iter().fold(Self::empty(), |bounds, p| bounds.union(&Self { low: p, high: p }))
    }

    /// The box around both.
    pub(crate) fn union(&self, other: &Self) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    /// Whether it holds nothing.
    pub(crate) fn is_empty(&self) -> bool {
        self.low[0] > self.high[0]
    }

    /// The box grown by `margin` on every side.
    pub(crate) fn grown(&self, margin: T) -> Self {
        Self { low: self.low.map(|c| c - margin), high: self.high.map(|c| c + margin) }
    }

    /// Whether the two closed boxes have a point in common.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }

    /// Its corners.
    pub(crate) fn corners(&self) -> [Point<T>; 8] {
        std::array::from_fn(|corner| {
            let end = |k: usize| if corner >> k & 1 == 1 { self.high[k] } else { self.low[k] };
            Point::<T>::from_array([end(0), end(1), end(2)])
        })
    }

    /// Its longest chord: no two points of it are further apart.
    pub(crate) fn diagonal(&self) -> T {
        let chord = Point::<T>::from_array(self.high) - Point::<T>::from_array(self.low);
        chord.length_squared().sqrt()
    }

    /// The largest coordinate in it, by absolute value.
    pub(crate) fn farthest(&self) -> T {
        self.low.iter().chain(&self.high).fold(T::from_f64(0.0), |far, c| far.max(c.abs()))
    }

    /// Half of its surface area; 0 if it is empty.
    pub(crate) fn half_area(&self) -> T {
        let zero = T::from_f64(0.0);
        let [a, b, c] = std::array::from_fn(|k| (self.high[k] - self.low[k]).max(zero));
        a * b + b * c + c * a
    }

    /// The least and the greatest n·(x − p) over its points x.
    ///
    /// Rounded just as an inner product is, and rounding is monotone: the n·(x − p) computed for a
    /// point x of the box never leaves the computed interval.
    #[inline]
    pub(crate) fn extent_along(&self, n: [T; 3], p: [T; 3]) -> (T, T) {
        let ends: [_; 3] = std::array::from_fn(|k| {
            let low = n[k] * (self.low[k] - p[k]);
            let high = n[k] * (self.high[k] - p[k]);
            if low < high { (low, high) } else { (high, low) }
        });
        let [a, b, c] = ends;
        (a.0 + b.0 + c.0, a.1 + b.1 + c.1)
    }
}

/// A line origin + t·direction, t ≥ 0, ready for tests against boxes.
pub(crate) struct Slabs {
    origin: [f64; 3],
    inverse: [f64; 3],
}

impl Slabs {
    /// The line from `origin` along `direction`, of any length.
    pub(crate) fn new(origin: DVec3, direction: DVec3) -> Self {
        Self { origin: origin.to_array(), inverse: direction.to_array().map(f64::recip) }
    }

    /// Whether the piece t ∈ [0, end] meets a box.
    ///
    /// Along an axis that the line is parallel to, both parameters are infinite; 0·∞ arises only on
    /// the border of a box, which the margin keeps away from anything that counts.
    #[inline(always)]
    pub(crate) fn meets(&self, bounds: &Bounds<f64>, end: f64) -> bool {
        let (mut enter, mut leave) = (0.0, end);
        for k in 0..3 {
            let low = (bounds.low[k] - self.origin[k]) * self.inverse[k];
            let high = (bounds.high[k] - self.origin[k]) * self.inverse[k];
            // Comparisons, not f64::min and max: those also sort out NaN and cost twice the time.
            let (near, far) = if low < high { (low, high) } else { (high, low) };
            enter = if near > enter { near } else { enter };
            leave = if far < leave { far } else { leave };
        }
        enter <= leave
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_spans_its_points() {
        let bounds = Bounds::of([[0.0, 5.0, 1.0], [2.0, 3.0, 1.0]]);
        assert_eq!(bounds, Bounds { low: [0.0, 3.0, 1.0], high: [2.0, 5.0, 1.0] });
        assert_eq!(bounds.diagonal(), 8f64.sqrt());
        assert_eq!(bounds.half_area(), 4.0);
        assert_eq!(bounds.extent_along([1.0, -1.0, 0.0], [1.0, 0.0, 0.0]), (-6.0, -2.0));
        assert_eq!(Bounds::<f64>::empty().half_area(), 0.0);
    }

    #[test]
    fn boxes_that_touch_overlap() {
        let unit = Bounds { low: [0.0; 3], high: [1.0; 3] };
        let next = Bounds { low: [1.0, 0.0, 0.0], high: [2.0, 1.0, 1.0] };
        assert!(unit.overlaps(&next) && next.overlaps(&unit));
        assert!(!unit.overlaps(&next.grown(-0.1)));
        assert!(!unit.overlaps(&Bounds::empty()));
    }
}
