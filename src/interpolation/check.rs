//! The error of a level's operators, measured between points of its cells.

use crate::interpolation::basis::{Basis, product};
use crate::interpolation::entries::{Entries, zero};
use crate::interpolation::far_field::{products, slope_products};
use crate::interpolation::level::{LevelOperators, Request};
use crate::interpolation::means::{corner, facing, interaction_offsets, is_nearest};
use crate::interpolation::offset_errors::OffsetErrors;
use crate::interpolation::probe::sample;
use crate::interpolation::scale::Scale;
use crate::interpolation::slopes::Slopes;
use crate::interpolation::tuning::{CHECK_POINTS, CORNER_LEVELS, SLOPE_LEVELS};
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Numbers, Point, Real, Scalar, Vector};
use crate::parallel;

impl<S: Scalar> Request<'_, S> {
    /// The error between random points, and between a corner and those nearest to it, relative to the
    /// scale: that of P2M, M2L and L2P; if all levels are like this one, from and to its children, M2M
    /// and L2L included.
    pub(crate) fn check(&self, level: &LevelOperators<S>) -> OffsetErrors {
        let values = self.error(level, self.kernel, self.scale, false);
        match self.slopes {
            Some(Slopes { entries, scale, weight }) => {
                values.join(&self.error(level, entries, *scale, true), *weight)
            }
            None => values,
        }
    }

    /// The error of values, or of derivatives, against `exact`.
    fn error(
        &self,
        level: &LevelOperators<S>,
        exact: &Entries<'_, S>,
        scale: Scale,
        slopes: bool,
    ) -> OffsetErrors {
        let [from, to] = [&level.bases.source, &level.bases.target];
        let both = |[sources, targets]: [Vec<Point<S::Real>>; 2], levels: usize| {
            let densities = self.kernel.densities;
            [
                self.probes(from, densities, sources, levels, false),
                self.probes(to, self.kernel.fields, targets, levels, slopes),
            ]
        };
        let random =
            |first: usize| (0..CHECK_POINTS).map(|i| sample::<S::Real>(first + i)).collect();
        let levels = if slopes { SLOPE_LEVELS } else { 1 };
        let anywhere = both([1000, 1000 + CHECK_POINTS].map(random), levels);
        let corners = || (0..8).map(corner::<S::Real>).collect();
        let corners = scale.corners.then(|| both([corners(), corners()], CORNER_LEVELS));
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        let errors = parallel::map(offsets.len(), &|i| {
            if !self.far.carried().has(offsets[i]) {
                return None;
            }
            let error = self.squared_error(level, exact, offsets[i], &anywhere, 0..CHECK_POINTS);
            let corner = facing(offsets[i], i);
            let corners = corners.as_ref().filter(|_| is_nearest(offsets[i])).map(|corners| {
                self.squared_error(level, exact, offsets[i], corners, corner..corner + 1)
            });
            Some([error, corners.unwrap_or(0.0)])
        });
        OffsetErrors::new(errors, scale)
    }

    /// Points of a cell, with their moments, or with those of derivatives along the three axes: if all
    /// levels are alike, by way of as many levels of children, the one in octant i mod 8 each time.
    fn probes(
        &self,
        basis: &Basis<S>,
        components: usize,
        points: Vec<Point<S::Real>>,
        levels: usize,
        slopes: bool,
    ) -> Probes<S> {
        let n = self.rule.len();
        let nodes = n.pow(3);
        let levels = if self.homogeneous { levels } else { 0 };
        let axes = if slopes { 3 } else { 1 };
        let (functions, transposed) = (&basis.functions, basis.functions.transpose());
        // m = Uᵀ m̃ of unit densities in each component.
        let rows = nodes * components;
        let each = components * axes;
        let columns = points.len() * each;
        let mut unit = Matrix { rows, columns, data: vec![zero::<S>(); rows * columns] };
        // A child's derivatives in half-widths of the cell.
        let steeper = S::Real::from_f64(if slopes { 2f64.powi(levels as i32) } else { 1.0 });
        for (k, moments) in unit.data.chunks_exact_mut(rows).enumerate() {
            let (p, component, axis) = (points[k / each], k % each / axes, k % axes);
            let values: Vec<S::Real> =
                if slopes { slope_products(p, n, axis) } else { products(p, n) };
            let own = &mut moments[component * nodes..];
            own.iter_mut().zip(values).for_each(|(m, v)| *m = S::from_real(v * steeper));
        }
        let mut moments = product(&transposed, &unit);
        for _ in 0..levels {
            // conj(U) m: the moments that a multipole expansion stands for.
            let mut shifted = product(&functions.map(S::conjugate), &moments);
            for (k, shifted) in shifted.data.chunks_exact_mut(rows).enumerate() {
                self.rule.shift(k / each % 8, false, shifted);
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
        exact: &Entries<'_, S>,
        offset: [i32; 3],
        [sources, targets]: &[Probes<S>; 2],
        range: std::ops::Range<usize>,
    ) -> f64 {
        let (fields, densities) = (exact.fields, exact.densities);
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
        let xs: Vec<Point<S::Real>> = targets.points.iter().map(|&x| (x + step) * h).collect();
        let len = fields * densities;
        let (mut errors, mut g) = (0.0, vec![zero::<S>(); xs.len() * len]);
        for (b, &y) in sources.points[range.clone()].iter().enumerate() {
            exact.write(&xs, y * h, &mut g);
            for (k, &exact) in g.iter().enumerate() {
                let (a, k) = (k / len, k % len);
                let value = values.at(a * fields + k / densities, b * densities + k % densities);
                errors += Numbers::norm_squared(&(value - exact));
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
