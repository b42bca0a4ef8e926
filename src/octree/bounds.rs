//! The box around points, and the root cube of what is in it.

use crate::error::{Error, PointSet};
use crate::numbers::traits::{Located, Numbers, Point, Real, Vector};
use crate::octree::geometry::Cube;
use crate::parallel;

impl<T: Real> Cube<T> {
    /// The root cube of points of which `low` and `high` are the smallest and the largest coordinates.
    ///
    /// # Errors
    /// [`Error::ExtentTooLarge`] if distances between them overflow.
    pub fn around_box(low: [T; 3], high: [T; 3]) -> Result<Self, Error> {
        Bounds { low, high }.root_cube(None)
    }
}

/// The smallest box around a set of points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds<T> {
    low: [T; 3],
    high: [T; 3],
}

impl<T: Real> Bounds<T> {
    /// The box around `points`, which belong to `set`; an error if a coordinate is not finite or if
    /// there are too many points.
    pub(crate) fn new<P: Located<Real = T>>(set: PointSet, points: &[P]) -> Result<Self, Error> {
        let limit = u32::MAX as usize / 2;
        if points.len() > limit {
            return Err(Error::TooManyPoints { set, limit, found: points.len() });
        }
        let finite = |p: &P| p.position().is_finite();
        let chunks = parallel::map(points.len().div_ceil(CHUNK), &|chunk| {
            let points = &points[CHUNK * chunk..];
            let points = &points[..points.len().min(CHUNK)];
            let bounds = Self::around(points.iter().map(Located::position));
            (bounds, points.iter().all(finite))
        });
        let nothing = (Self::around(std::iter::empty()), true);
        let both = |(a, x): (Self, bool), (b, y)| (a.join(b), x && y);
        let (bounds, all_finite) = chunks.into_iter().fold(nothing, both);
        if all_finite {
            return Ok(bounds);
        }
        let index = points.iter().take_while(|p| finite(p)).count();
        let position = points[index].position().to_array().map(Real::as_f64);
        Err(Error::NonFinitePosition { set, index, position })
    }

    /// The box around those finite points that `counts` holds for. O(N).
    pub(crate) fn of<P: Located<Real = T>>(
        points: &[P],
        counts: &(dyn Fn(Point<T>) -> bool + Sync),
    ) -> Self {
        let chunks = parallel::map(points.len().div_ceil(CHUNK), &|chunk| {
            let points = points[CHUNK * chunk..].iter().take(CHUNK).map(Located::position);
            Self::around(points.filter(|p| counts(*p)))
        });
        chunks.into_iter().fold(Self::around(std::iter::empty()), Self::join)
    }

    /// The box around both.
    pub(crate) fn join(self, other: Self) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    /// The root cube of everything in the box: around its centre, but for directions in which it is thin. What is
    /// thin would lie along the borders of cells on every level, and most cells would be divided for nothing; a
    /// third of the way through the root it lies a third of the way through each cell, from one side or the other.
    ///
    /// With a `unit`, the half-width is that times a power of two, as far as the range of numbers allows.
    pub(crate) fn root_cube(&self, unit: Option<T>) -> Result<Cube<T>, Error> {
        let Self { low, high } = self;
        if low[0] > high[0] {
            return Ok(Cube::new(Point::<T>::default(), T::from_f64(1.0)));
        }
        let half = T::from_f64(0.5);
        let centre: [T; 3] = std::array::from_fn(|k| half * low[k] + half * high[k]);
        let extents: [T; 3] =
            std::array::from_fn(|k| (high[k] - centre[k]).max(centre[k] - low[k]));
        let half_width = extents.into_iter().fold(T::from_f64(0.0), |a, b| a.max(b));
        let limit = largest_half_width::<T>();
        if half_width > limit {
            let extent = (0..3).map(|k| high[k].as_f64() - low[k].as_f64()).fold(0.0, f64::max);
            return Err(Error::ExtentTooLarge { extent, limit: 2.0 * limit.as_f64() });
        }
        let half_width = unit.and_then(|unit| in_units(half_width, unit)).unwrap_or(half_width);
        let aside = half_width / T::from_f64(3.0);
        let centre = std::array::from_fn(|k| {
            let is_thin = extents[k] < half_width * T::from_f64(THIN);
            if is_thin { centre[k] + aside } else { centre[k] }
        });
        Ok(Cube::new(Point::<T>::from_array(centre), half_width))
    }

    /// A root cube of which that cube is a cell, around everything in the box; none if it would be too large.
    /// The corner of the cell is the centre, so that both are numbers of few digits.
    pub(crate) fn root_cube_around(&self, cell: &Cube<T>) -> Option<Cube<T>> {
        let mut half_width = cell.half_width();
        let centre = cell.centre() + Point::<T>::from_array([half_width; 3]);
        let c = centre.to_array();
        let reach = |k: usize| (self.high[k] - c[k]).max(c[k] - self.low[k]);
        let farthest = reach(0).max(reach(1)).max(reach(2));
        while half_width < farthest {
            half_width *= T::from_f64(2.0);
        }
        (half_width <= largest_half_width()).then(|| Cube::new(centre, half_width))
    }

    /// The box around finite points.
    fn around(points: impl Iterator<Item = Point<T>>) -> Self {
        let mut bounds = Self { low: [T::infinity(); 3], high: [T::neg_infinity(); 3] };
        for p in points {
            for (k, x) in p.to_array().into_iter().enumerate() {
                bounds.low[k] = if x < bounds.low[k] { x } else { bounds.low[k] };
                bounds.high[k] = if x > bounds.high[k] { x } else { bounds.high[k] };
            }
        }
        bounds
    }
}

/// The smallest number that is no less than `half_width` and differs from `unit` by a power of two, if both are
/// ordinary numbers.
fn in_units<T: Real>(half_width: T, unit: T) -> Option<T> {
    let exponent = (half_width.as_f64() / unit.as_f64()).log2().ceil();
    let found = T::from_f64(unit.as_f64() * exponent.exp2());
    // The quotient may have been rounded down to a power of two.
    let found = if found < half_width { found + found } else { found };
    let least = T::min_positive_value() * T::from_f64(UNITS_FROM_ZERO);
    (found >= least && found <= largest_half_width()).then_some(found)
}

/// The half-width up to which no sum of a few coordinates overflows.
fn largest_half_width<T: Real>() -> T {
    T::max_value() * T::from_f64(0.125)
}

/// Points per task of a sweep over all of them.
const CHUNK: usize = 4096;

/// Half-widths that are given in units are so many of the smallest normal numbers or more: smaller ones are raised.
const UNITS_FROM_ZERO: f64 = (1u64 << 32) as f64;

/// Up to which share of the longest extent another one is thin.
const THIN: f64 = 1.0 / 16.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::morton::KEY_LEVELS;
    use glam::DVec3;

    #[test]
    fn an_extent_that_overflows_is_refused() {
        let points = [DVec3::X * 1e308, DVec3::X * -1e308];
        let bounds = Bounds::new(PointSet::Sources, &points).unwrap();
        assert!(matches!(bounds.root_cube(None), Err(Error::ExtentTooLarge { .. })));
    }

    #[test]
    fn what_is_thin_does_not_lie_along_borders_of_cells() {
        for z in [0.0, -3.7, 1e6] {
            let points: Vec<DVec3> = (0..500)
                .map(|i| DVec3::splat(f64::from(i)).map(f64::sin) * DVec3::new(1.0, 1e-4, 0.0))
                .map(|p| p + DVec3::Z * z)
                .collect();
            let bounds = Bounds::new(PointSet::Sources, &points).unwrap();
            let root = bounds.root_cube(None).unwrap();
            for p in &points {
                let place = root.locate(*p);
                for level in 1..8 {
                    let fraction = |axis: usize| {
                        let within = (1u64 << (KEY_LEVELS - level)) - 1;
                        (place[axis] & within) as f64 / within as f64
                    };
                    assert!([1, 2].iter().all(|&axis| (0.25..0.75).contains(&fraction(axis))));
                }
            }
        }
    }
}
