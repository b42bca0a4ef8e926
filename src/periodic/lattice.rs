//! The box that is repeated, and which of its images are near.

use crate::error::{Error, PointSet};
use crate::numbers::traits::{Located, Real, Vector};
use crate::octree::bounds::Bounds;
use crate::periodic::blocks::within;

/// A box with a period along some axes.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    pub(super) periods: [Option<f64>; 3],
    /// Its centre.
    pub(super) centre: [f64; 3],
    /// Half its edges: half a period, or half the extent of the points along an axis without one.
    pub(super) half_widths: [f64; 3],
    /// How many images to either side are near, along each axis: at least as many as make the gap to all others as
    /// wide as the box.
    pub(super) near: [usize; 3],
}

/// The extent of a box along an axis is at least this share of its shortest period.
const LEAST_EXTENT: f64 = 1.0 / 16.0;

/// By how much points may be farther apart than a period, in units of rounding.
const ROUNDING: f64 = 16.0;

/// Near images, at most.
const MOST_IMAGES: f64 = (1u64 << 15) as f64;

impl Lattice {
    /// The box of some points.
    ///
    /// # Errors
    /// A period that is none, points that are not finite, or that are farther apart than a period, or a box with one edge
    /// so much longer than another that there would be too many near images.
    pub(super) fn new<S: Located, X: Located<Real = S::Real>>(
        periods: [Option<f64>; 3],
        sources: &[S],
        targets: &[X],
    ) -> Result<Self, Error> {
        for (axis, period) in periods.into_iter().enumerate() {
            if let Some(found) = period.filter(|l| !(*l > 0.0 && l.is_finite())) {
                return Err(Error::InvalidPeriod { axis, found });
            }
        }
        Bounds::new(PointSet::Sources, sources)?;
        Bounds::new(PointSet::Targets, targets)?;
        let of_sources = places(PointSet::Sources, sources);
        let places = || of_sources.clone().chain(places(PointSet::Targets, targets));
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for (_, _, p) in places() {
            for k in 0..3 {
                (low[k], high[k]) = (low[k].min(p[k]), high[k].max(p[k]));
            }
        }
        if low[0] > high[0] {
            (low, high) = ([0.0; 3], [0.0; 3]);
        }
        for (axis, period) in periods.into_iter().enumerate() {
            let Some(period) = period else { continue };
            let epsilon = <S::Real as num_traits::Float>::epsilon().as_f64();
            let rounding = ROUNDING * epsilon * (low[axis].abs() + high[axis].abs() + period);
            let end = low[axis] + period;
            let is_outside = |p: &[f64; 3]| p[axis] > end + rounding;
            if let Some((set, index, p)) = places().find(|(_, _, p)| is_outside(p)) {
                let (position, low) = (p[axis], low[axis]);
                return Err(Error::OutsidePeriod { set, index, axis, position, low, period });
            }
        }
        let shortest = periods.into_iter().flatten().fold(f64::INFINITY, f64::min);
        let shortest = if shortest < f64::INFINITY { shortest } else { 1.0 };
        let edge = |k: usize| {
            periods[k].unwrap_or_else(|| (high[k] - low[k]).max(LEAST_EXTENT * shortest))
        };
        let edges = [edge(0), edge(1), edge(2)];
        let longest = edges.into_iter().fold(0.0, f64::max);
        let near = |k: usize| periods[k].map_or(0.0, |l| (longest / l * (1.0 - 1e-9)).ceil());
        let near = [near(0), near(1), near(2)];
        let found: f64 = near.iter().map(|sides| 2.0 * sides + 1.0).product();
        if found > MOST_IMAGES {
            return Err(Error::TooManyImages { limit: MOST_IMAGES, found });
        }
        Ok(Self {
            periods,
            centre: [0, 1, 2].map(|k| 0.5 * low[k] + 0.5 * high[k]),
            half_widths: edges.map(|edge| 0.5 * edge),
            near: near.map(|sides| sides as usize),
        })
    }

    pub(super) fn is_periodic(&self) -> [bool; 3] {
        self.periods.map(|period| period.is_some())
    }

    /// How many axes are periodic.
    pub(super) fn dimensions(&self) -> usize {
        self.periods.iter().flatten().count()
    }

    /// Where an image is.
    pub(super) fn place(&self, image: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| image[k] * self.periods[k].unwrap_or(0.0))
    }

    /// Where the near images are, the box itself first.
    pub(super) fn near_places(&self) -> Vec<[f64; 3]> {
        let mut images = within(self.near);
        let middle = images.len() / 2;
        images.swap(0, middle);
        images.into_iter().map(|image| self.place(image)).collect()
    }
}

/// The places of some points, with what errors call them.
fn places<P: Located>(
    set: PointSet,
    points: &[P],
) -> impl Iterator<Item = (PointSet, usize, [f64; 3])> + Clone {
    let place = |p: &P| p.position().to_array().map(Real::as_f64);
    points.iter().enumerate().map(move |(index, p)| (set, index, place(p)))
}
