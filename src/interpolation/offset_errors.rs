//! The error of interpolating a far field between the nodes of a rule.

use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::entries::{Entries, norm_squared, zero};
use crate::interpolation::far_field::{FarField, centre, products, slope_products};
use crate::interpolation::means::{
    INTERACTION_OFFSETS, Means, corner, facing, is_nearest, largest,
};
use crate::interpolation::probe::sample;
use crate::interpolation::scale::Scale;
use crate::interpolation::tuning::{CLOSER, PER_OFFSET, TEST_SOURCES, TEST_TARGETS};
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Point, Real, Scalar, Vector};
use crate::parallel;

/// Errors relative to what they may be relative to.
pub(crate) struct OffsetErrors {
    /// The mean over all offsets.
    pub(crate) mean: f64,
    /// That of each of the [`interaction_offsets`] by itself, 0 where none is carried.
    pub(crate) each: Vec<f64>,
}

impl OffsetErrors {
    /// From mean squares, as [`Means::of`] takes them.
    pub(crate) fn new(squares: Vec<Option<[f64; 2]>>, scale: Scale) -> Self {
        let own = |squares: &Option<[f64; 2]>| {
            let Some([anywhere, corners]) = *squares else { return 0.0 };
            scale.relative(Means::of([Some([largest([anywhere, corners]); 2])]))
        };
        let each = squares.iter().map(own).collect();
        Self { mean: scale.relative(Means::of(squares)), each }
    }

    /// The larger ones of both.
    pub(crate) fn join(mut self, other: &Self, factor: f64) -> Self {
        for (own, &other) in self.each.iter_mut().zip(&other.each) {
            *own = largest([*own, factor * other]);
        }
        Self { mean: largest([self.mean, factor * other.mean]), ..self }
    }
}

/// A field that is interpolated, and what it is held against.
#[derive(Clone, Copy)]
struct Interpolated<'a, S: Scalar> {
    kernel: &'a Entries<'a, S>,
    exact: &'a Entries<'a, S>,
    rule: &'a Chebyshev<S::Real>,
    /// Whether its derivatives are, in half-widths.
    slopes: bool,
}

impl<T: Real> FarField<T> {
    /// The error, relative to `scale`, of interpolating between the nodes of `rule`, at random targets
    /// from one source per offset, and at the corners from the nearest corner of the nearest cells.
    pub(crate) fn interpolation_error<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        rule: &Chebyshev<T>,
        scale: Scale,
    ) -> OffsetErrors {
        self.relative_error(&Interpolated { kernel, exact: kernel, rule, slopes: false }, scale)
    }

    /// The same of the derivatives of what is interpolated, in half-widths, against `slopes`.
    pub(crate) fn slope_error<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        slopes: &Entries<'_, S>,
        rule: &Chebyshev<T>,
        scale: Scale,
    ) -> OffsetErrors {
        self.relative_error(&Interpolated { kernel, exact: slopes, rule, slopes: true }, scale)
    }

    /// The error of interpolating at each offset, looked at more closely: from a grid of sources to random targets, and
    /// to a grid that covers what corners and edges may hide. The worst source counts, and for a part of what the mean
    /// does.
    pub(crate) fn closer_errors<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        rule: &Chebyshev<T>,
        scale: Scale,
    ) -> Vec<f64> {
        let grid: Vec<Point<T>> = (0..GRID).map(grid_point::<T>).collect();
        let random: Vec<Point<T>> = (0..TEST_TARGETS).map(sample::<T>).collect();
        let interpolated = Interpolated { kernel, exact: kernel, rule, slopes: false };
        let carried = (0..INTERACTION_OFFSETS).filter(|&o| self.carried().has(self.offsets()[o]));
        let mut errors = vec![0.0; INTERACTION_OFFSETS];
        for o in carried {
            let sources: Vec<_> =
                grid.iter().map(|&p| (o, centre::<T>(self.offsets()[o]) + p, 1.0)).collect();
            let worst = |targets: &[Point<T>]| {
                largest(self.squared_errors(&interpolated, targets, &sources).iter().map(|e| e.1))
            };
            let squared = largest([worst(&random), worst(&grid)]);
            errors[o] = scale.relative(Means::of([Some([squared; 2])])) / CLOSER;
        }
        errors
    }

    /// The evaluations and multiply-adds that this takes with n nodes per axis.
    pub(crate) fn closer_costs<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        n: usize,
    ) -> [f64; 2] {
        let sources = GRID * self.offsets().iter().filter(|&&o| self.carried().has(o)).count();
        let targets = GRID + TEST_TARGETS;
        let products = sources * targets * n.pow(3) * kernel.fields * kernel.densities;
        [(sources * (2 * n.pow(3) + targets)) as f64, products as f64]
    }

    fn relative_error<S: Scalar<Real = T>>(
        &self,
        interpolated: &Interpolated<'_, S>,
        scale: Scale,
    ) -> OffsetErrors {
        let mut sources = Vec::new();
        let carried = || self.offsets().iter().enumerate().filter(|(_, o)| self.carried().has(**o));
        for (o, &offset) in carried() {
            let near = offset.iter().all(|o| o.abs() <= 2);
            let count = if near { PER_OFFSET } else { 1 };
            let source = |k| centre::<T>(offset) + sample::<T>(o * PER_OFFSET + k);
            sources.extend((0..count).map(|k| (o, source(k), 1.0 / count as f64)));
        }
        let mut errors = vec![None; INTERACTION_OFFSETS];
        carried().for_each(|(o, _)| errors[o] = Some([0.0; 2]));
        let mut add = |o: usize, part: usize, squared: f64| {
            if let Some(errors) = &mut errors[o] {
                errors[part] += squared;
            }
        };
        let targets: Vec<_> = (0..TEST_TARGETS).map(sample::<T>).collect();
        for (o, squared) in self.squared_errors(interpolated, &targets, &sources) {
            add(o, 0, squared);
        }
        if scale.corners {
            let nearest = carried().filter(|(_, offset)| is_nearest(**offset));
            // Both sides are off there, in the same direction.
            let source = |(o, &offset): (usize, &[i32; 3])| {
                (o, centre::<T>(offset) + corner::<T>(facing(offset, o)), 4.0)
            };
            let corners: Vec<_> = (0..8).map(corner::<T>).collect();
            let sources: Vec<_> = nearest.map(source).collect();
            for (o, squared) in self.squared_errors(interpolated, &corners, &sources) {
                add(o, 1, squared);
            }
        }
        OffsetErrors::new(errors, scale)
    }

    /// The mean square error of interpolating the field of each source at targets, times the source's
    /// factor; with its offset's number.
    fn squared_errors<S: Scalar<Real = T>>(
        &self,
        interpolated: &Interpolated<'_, S>,
        targets: &[Point<T>],
        sources: &[(usize, Point<T>, f64)],
    ) -> Vec<(usize, f64)> {
        let Interpolated { kernel, exact, rule, slopes } = *interpolated;
        let (n, count) = (rule.len(), targets.len());
        // Row i holds what the values at the nodes count in the interpolated value at target i; or those of
        // the three derivatives one after the other.
        let mut weights: Vec<T> = if slopes {
            let along = |axis| targets.iter().flat_map(move |&x| slope_products(x, n, axis));
            (0..3).flat_map(along).collect()
        } else {
            targets.iter().flat_map(|&x| products(x, n)).collect()
        };
        rule.node_weights(&mut weights);
        let weights = Matrix { rows: n.pow(3), columns: weights.len() / n.pow(3), data: weights };
        let weights = weights.transpose().map(S::from_real);
        let [grid, targets] = [rule.grid().collect(), targets.to_vec()]
            .map(|points: Vec<Point<T>>| self.scaled(points));
        let parts: Vec<_> = sources.chunks(TEST_SOURCES).collect();
        let errors = parallel::map(parts.len(), &|part| {
            let sources = parts[part];
            let field = |kernel: &Entries<'_, S>, points: &[Point<T>]| {
                let entries = kernel.fields * kernel.densities;
                let mut values = vec![zero::<S>(); points.len() * entries * sources.len()];
                let each = values.chunks_exact_mut(points.len() * entries).zip(sources);
                each.for_each(|(field, &(_, y, _))| {
                    kernel.write_field(points, y * self.half_width(), field);
                });
                values
            };
            let mut differences = field(exact, &targets);
            let mut values = vec![zero::<S>(); differences.len()];
            S::product(&weights, &field(kernel, &grid), false, &mut values);
            kernel.add_products((weights.columns * values.len()) as f64);
            differences.iter_mut().zip(values).for_each(|(exact, value)| *exact -= value);
            let errors = differences.chunks_exact(differences.len() / sources.len());
            let mean = |(errors, &(o, _, factor)): (&[S], &(usize, Point<T>, f64))| {
                (o, factor * norm_squared(errors) / count as f64)
            };
            errors.zip(sources).map(mean).collect::<Vec<_>>()
        });
        errors.into_iter().flatten().collect()
    }
}

/// The evaluations and multiply-adds that it takes to find the error of a rule with n nodes per axis.
pub(crate) fn test_costs<S: Scalar>(kernel: &Entries<'_, S>, n: usize) -> [f64; 2] {
    let sources = INTERACTION_OFFSETS + (5usize.pow(3) - 3usize.pow(3)) * (PER_OFFSET - 1);
    let products = sources * n.pow(3) * TEST_TARGETS * kernel.fields * kernel.densities;
    [(sources * (n.pow(3) + TEST_TARGETS)) as f64, products as f64]
}

/// Points of a grid that covers a cell.
const GRID: usize = 27;

/// One of [`GRID`] points next to the border of [−1, 1]³ and in its centre. Between points on borders a kernel may be what
/// it is nowhere else.
fn grid_point<T: Real>(k: usize) -> Point<T> {
    let place = |k: usize| T::from_f64(0.98 * (k as f64 - 1.0));
    Point::<T>::from_array([k / 9, k / 3 % 3, k % 3].map(place))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::carried::Carried;
    use crate::interpolation::entries::pairwise;

    fn error(f: fn(f64) -> f64, n: usize, half_width: f64) -> f64 {
        let entries = pairwise(1, |x, y, g| g[0] = f(x.distance(y)));
        let kernel = Entries::new(1, 1, &entries);
        let far = FarField::new(half_width, 32.0, 1, Carried::default());
        far.interpolation_error(
            &kernel,
            &Chebyshev::new(n),
            Scale::new(far.size(&kernel), std::iter::empty()),
        )
        .mean
    }

    #[test]
    fn the_error_falls_with_the_order_and_vanishes_for_polynomials() {
        let [four, six, eight] = [4, 6, 8].map(|n| error(|r| 1.0 / r, n, 0.5));
        assert!(four < 1e-3 && six < 0.05 * four && eight < 0.05 * six, "{four} {six} {eight}");
        assert!(error(|r| r * r, 3, 0.5) < 1e-14);
    }

    #[test]
    fn a_kernel_that_has_died_out_needs_no_digits() {
        assert!(error(|r| (-r * r).exp(), 2, 50.0) < 1e-6);
    }
}
