//! The error of a level's operators, measured between points of its cells.

use rayon::prelude::*;

use crate::dense::Matrix;
use crate::interpolation::basis::{Basis, product};
use crate::interpolation::level::{LevelOperators, Request};
use crate::interpolation::means::{Means, corner, facing, interaction_offsets, is_nearest};
use crate::interpolation::operators::shift_in_place;
use crate::probe::{sample, zero};
use crate::real::{Additive, Point, Real, Scalar, Vector};

/// Random points per cell.
const POINTS: usize = 32;

/// How many levels below have the same corner: a cluster there goes through all of them.
const CORNER_LEVELS: usize = 4;

impl<S: Scalar> Request<'_, S> {
    /// The error between random points, and between a corner and those nearest to it, relative to the
    /// scale: that of P2M, M2L and L2P; if all levels are like this one, from and to its children, M2M
    /// and L2L included.
    pub(crate) fn check(&self, level: &LevelOperators<S>) -> f64 {
        let (fields, densities) = (self.kernel.fields, self.kernel.densities);
        let [from, to] = [&level.bases.source, &level.bases.target];
        let random = |first: usize| (0..POINTS).map(|i| sample::<S::Real>(first + i)).collect();
        let anywhere = [
            self.probes(from, densities, random(1000), 1),
            self.probes(to, fields, random(1000 + POINTS), 1),
        ];
        let corners = || (0..8).map(corner::<S::Real>).collect();
        let corners = self.scale.grows().then(|| {
            [
                self.probes(from, densities, corners(), CORNER_LEVELS),
                self.probes(to, fields, corners(), CORNER_LEVELS),
            ]
        });
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        let errors: Vec<[f64; 2]> = offsets
            .par_iter()
            .enumerate()
            .map(|(i, &offset)| {
                let error = self.squared_error(level, offset, &anywhere, 0..POINTS);
                let corner = facing(offset, i);
                let corners = corners
                    .as_ref()
                    .filter(|_| is_nearest(offset))
                    .map(|corners| self.squared_error(level, offset, corners, corner..corner + 1));
                [error, corners.unwrap_or(0.0)]
            })
            .collect();
        Means::of(errors).relative_to(self.scale)
    }

    /// Points of a cell, with their moments: if all levels are alike, by way of as many levels of
    /// children, the one in octant i mod 8 each time.
    fn probes(
        &self,
        basis: &Basis<S>,
        components: usize,
        points: Vec<Point<S::Real>>,
        levels: usize,
    ) -> Probes<S> {
        let n = self.rule.len();
        let levels = if self.homogeneous { levels } else { 0 };
        let moments: Vec<Vec<S>> = (0..points.len() * components)
            .into_par_iter()
            .map(|k| {
                let (i, component) = (k / components, k % components);
                let mut moments = basis.moments_at(points[i], component, n);
                for _ in 0..levels {
                    let mut shifted = basis.chebyshev_moments(&moments);
                    shift_in_place(self.rule, i % 8, false, &mut shifted);
                    moments = basis.moments_of(&shifted);
                }
                moments
            })
            .collect();
        let columns = moments.len();
        let moments = Matrix { rows: basis.rank(), columns, data: moments.concat() };
        let half = S::Real::from_f64(0.5);
        let in_parent = |(i, p): (usize, Point<S::Real>)| {
            (0..levels).fold(p, |p, _| (p + corner::<S::Real>(i % 8)) * half)
        };
        Probes { points: points.into_iter().enumerate().map(in_parent).collect(), moments }
    }

    /// The mean of Σ |G − Tᵀ C M|² over all targets and a range of sources.
    fn squared_error(
        &self,
        level: &LevelOperators<S>,
        offset: [i32; 3],
        [sources, targets]: &[Probes<S>; 2],
        range: std::ops::Range<usize>,
    ) -> f64 {
        let (fields, densities) = (self.kernel.fields, self.kernel.densities);
        let (from, to) = (&sources.moments, &targets.moments);
        let columns = range.start * densities..range.end * densities;
        let m = &from.data[columns.start * from.rows..columns.end * from.rows];
        let mut l = vec![zero::<S>(); to.rows * columns.len()];
        level.transfers.add(offset, S::Real::from_f64(1.0), m, &mut l);
        let l = Matrix { rows: to.rows, columns: columns.len(), data: l };
        let values = product(&to.transpose(), &l);
        let step = offset.map(|o| S::Real::from_f64(2.0 * f64::from(o)));
        let step = Point::<S::Real>::from_array(step);
        let h = self.far.half_width();
        let mut errors = 0.0;
        for (b, &y) in sources.points[range.clone()].iter().enumerate() {
            for (a, &x) in targets.points.iter().enumerate() {
                for (k, exact) in self.kernel.at((x + step) * h, y * h).into_iter().enumerate() {
                    let value =
                        values.at(a * fields + k / densities, b * densities + k % densities);
                    errors += Additive::norm_squared(&(value - exact));
                }
            }
        }
        errors / (range.len() * targets.points.len()) as f64
    }
}

/// Points and their moments.
struct Probes<S: Scalar> {
    points: Vec<Point<S::Real>>,
    /// Column after column: the components of each point.
    moments: Matrix<S>,
}
