//! The error of a level's operators, measured between points of its cells.

use crate::interpolation::basis::{Basis, product};
use crate::interpolation::far_field::products;
use crate::interpolation::level::{LevelOperators, Request};
use crate::interpolation::means::{Means, corner, facing, interaction_offsets, is_nearest};
use crate::interpolation::probe::{sample, zero};
use crate::interpolation::tuning::{CHECK_POINTS, CORNER_LEVELS};
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Numbers, Point, Real, Scalar, Vector};
use crate::parallel;

impl<S: Scalar> Request<'_, S> {
    /// The error between random points, and between a corner and those nearest to it, relative to the
    /// scale: that of P2M, M2L and L2P; if all levels are like this one, from and to its children, M2M
    /// and L2L included.
    pub(crate) fn check(&self, level: &LevelOperators<S>) -> f64 {
        let (fields, densities) = (self.kernel.fields, self.kernel.densities);
        let [from, to] = [&level.bases.source, &level.bases.target];
        let random =
            |first: usize| (0..CHECK_POINTS).map(|i| sample::<S::Real>(first + i)).collect();
        let anywhere = [
            self.probes(from, densities, random(1000), 1),
            self.probes(to, fields, random(1000 + CHECK_POINTS), 1),
        ];
        let corners = || (0..8).map(corner::<S::Real>).collect();
        let corners = self.scale.grows().then(|| {
            [
                self.probes(from, densities, corners(), CORNER_LEVELS),
                self.probes(to, fields, corners(), CORNER_LEVELS),
            ]
        });
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        let errors: Vec<[f64; 2]> = parallel::map(offsets.len(), &|i| {
            let error = self.squared_error(level, offsets[i], &anywhere, 0..CHECK_POINTS);
            let corner = facing(offsets[i], i);
            let corners = corners
                .as_ref()
                .filter(|_| is_nearest(offsets[i]))
                .map(|corners| self.squared_error(level, offsets[i], corners, corner..corner + 1));
            [error, corners.unwrap_or(0.0)]
        });
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
        let nodes = self.rule.len().pow(3);
        let levels = if self.homogeneous { levels } else { 0 };
        let (functions, transposed) = (&basis.functions, basis.functions.transpose());
        // m = Uᵀ m̃ of unit densities in each component.
        let rows = nodes * components;
        let columns = points.len() * components;
        let mut unit = Matrix { rows, columns, data: vec![zero::<S>(); rows * columns] };
        for (k, moments) in unit.data.chunks_exact_mut(rows).enumerate() {
            let values = products(points[k / components], self.rule.len());
            let own = &mut moments[k % components * nodes..];
            own.iter_mut().zip(values).for_each(|(m, value)| *m = S::from_real(value));
        }
        let mut moments = product(&transposed, &unit);
        for _ in 0..levels {
            // conj(U) m: the moments that a multipole expansion stands for.
            let mut shifted = product(&functions.map(S::conjugate), &moments);
            for (k, shifted) in shifted.data.chunks_exact_mut(rows).enumerate() {
                self.rule.shift(k / components % 8, false, shifted);
            }
            moments = product(&transposed, &shifted);
        }
        let half = S::Real::from_f64(0.5);
        let in_parent = |(i, p): (usize, Point<S::Real>)| {
            (0..levels).fold(p, |p, _| (p + corner::<S::Real>(i % 8)) * half)
        };
        let points = points.into_iter().enumerate().map(in_parent).collect();
        Probes { points, transposed: moments.transpose(), moments }
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
        let (from, to) = (&sources.moments, &targets.transposed);
        let columns = range.start * densities..range.end * densities;
        let m = &from.data[columns.start * from.rows..columns.end * from.rows];
        let mut l = vec![zero::<S>(); to.columns * columns.len()];
        level.transfers.add(offset, S::Real::from_f64(1.0), m, &mut l);
        let l = Matrix { rows: to.columns, columns: columns.len(), data: l };
        let values = product(to, &l);
        let step = offset.map(|o| S::Real::from_f64(2.0 * f64::from(o)));
        let step = Point::<S::Real>::from_array(step);
        let h = self.far.half_width();
        let (mut errors, mut g) = (0.0, vec![zero::<S>(); fields * densities]);
        for (b, &y) in sources.points[range.clone()].iter().enumerate() {
            for (a, &x) in targets.points.iter().enumerate() {
                self.kernel.write((x + step) * h, y * h, &mut g);
                for (k, &exact) in g.iter().enumerate() {
                    let value =
                        values.at(a * fields + k / densities, b * densities + k % densities);
                    errors += Numbers::norm_squared(&(value - exact));
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
    transposed: Matrix<S>,
}
