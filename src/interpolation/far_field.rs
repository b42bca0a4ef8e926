//! Samples of what a cell receives from afar: the measure of every truncation.

use std::f64::consts::FRAC_PI_2;

use crate::error::Error;
use crate::interpolation::budget::NEIGHBOUR_SHARE;
use crate::interpolation::carried::Carried;
use crate::interpolation::chebyshev::{Chebyshev, derivatives_in_lanes, polynomials};
use crate::interpolation::entries::{Entries, PointOf, norm_squared, zero};
use crate::interpolation::means::{
    INTERACTION_OFFSETS, Means, corner, facing, interaction_offsets, is_nearest, largest, weight,
};
use crate::interpolation::probe::sample;
use crate::interpolation::scale::Scale;
use crate::interpolation::tuning::{
    CLOSER, PER_NEAR_OFFSET, PER_OFFSET, PER_SHELL, SHELL_WEIGHT, TEST_SOURCES, TEST_TARGETS,
};
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Point, Real, Scalar, Vector};
use crate::parallel;

/// The far field of the cell [−h, h]³: the sources that act on it, as seen in half-widths.
pub(crate) struct FarField<T: Real> {
    /// Points and their weights: for each offset of the interaction list in turn, then for the shells.
    sources: Vec<(Point<T>, f64)>,
    /// Where each offset's points start, and the shells'.
    starts: Vec<usize>,
    offsets: Vec<[i32; 3]>,
    half_width: T,
    carried: Carried,
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
    /// Sources in the 316 cells from which a tree's M2L comes, and in shells out to `reach`
    /// half-widths along an axis, from which M2P, P2L and masks may take more: `density` times as many as a kernel
    /// needs whose far field falls into parities. Only what is carried counts.
    pub(crate) fn new(half_width: T, reach: f64, density: usize, carried: Carried) -> Self {
        let (mut sources, mut starts) = (Vec::new(), vec![0]);
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        for (i, &offset) in offsets.iter().enumerate() {
            let near = offset.iter().all(|o| o.abs() <= 2);
            let count = match carried.has(offset) {
                true => density * if near { PER_NEAR_OFFSET } else { PER_OFFSET },
                false => 0,
            };
            sources.extend((0..count).map(|k| {
                let (p, share) =
                    towards_border::<T>(sample::<T>(i * density * PER_NEAR_OFFSET + k));
                (centre::<T>(offset) + p, weight(offset) * share / count as f64)
            }));
            starts.push(sources.len());
        }
        let lists = carried.weight(weight) / INTERACTION_OFFSETS as f64;
        let shell_weight = SHELL_WEIGHT * if lists > 0.0 { lists } else { 1.0 };
        // What is not carried on the level itself comes from nearer by through those above.
        let (mut radius, count) = match carried.is_whole() {
            true => (8.0, density * PER_SHELL),
            false => (4.0, 4 * density * PER_SHELL),
        };
        while radius < reach {
            let shell = (0..count).map(|k| {
                let p = sample::<T>(k).to_array().map(Real::as_f64);
                let largest = p.iter().fold(0.0f64, |a, x| a.max(x.abs()));
                let stretch = (radius * (1.0 + (0.618 * k as f64).fract())).min(reach) / largest;
                let p = Point::<T>::from_array(p.map(|x| T::from_f64(x * stretch)));
                (p, shell_weight / count as f64)
            });
            let comes = |k: usize, p: Point<T>| {
                carried.comes_from_above(p.to_array().map(Real::as_f64), octants(k))
            };
            sources.extend(shell.enumerate().filter(|&(k, (p, _))| comes(k, p)).map(|(_, y)| y));
            radius *= 2.0;
        }
        Self { sources, starts, offsets, half_width, carried }
    }

    /// What is carried.
    pub(crate) fn carried(&self) -> &Carried {
        &self.carried
    }

    /// The sum of the weights of the offsets that are carried; 316 for all of them.
    pub(crate) fn weight(&self) -> f64 {
        self.carried.weight(weight)
    }

    /// How many sources there are.
    pub(crate) fn len(&self) -> usize {
        self.sources.len()
    }

    /// Half the cell's edge.
    pub(crate) fn half_width(&self) -> T {
        self.half_width
    }

    /// The mean square of a pair at each offset that is carried.
    fn sizes<S: Scalar<Real = T>>(&self, kernel: &Entries<'_, S>) -> Vec<Option<f64>> {
        let size = |(i, &offset): (usize, &[i32; 3])| {
            if !self.carried.has(offset) {
                return None;
            }
            let entry = |k: usize| {
                let x = sample::<T>(7 * k + offset[0].unsigned_abs() as usize);
                let y = centre::<T>(offset) + sample::<T>(i * PER_OFFSET + k);
                norm_squared(&self.entry(kernel, x, y))
            };
            Some((0..PER_OFFSET).map(entry).sum::<f64>() / PER_OFFSET as f64)
        };
        self.offsets.iter().enumerate().map(size).collect()
    }

    /// Whether the kernel is not finite at an offset that is carried.
    pub(crate) fn not_finite<S: Scalar<Real = T>>(&self, kernel: &Entries<'_, S>) -> Vec<bool> {
        self.sizes(kernel).iter().map(|size| size.is_some_and(|size| !size.is_finite())).collect()
    }

    /// The size of one pair, but at least a fraction of what neighbours exchange.
    pub(crate) fn size<S: Scalar<Real = T>>(&self, kernel: &Entries<'_, S>) -> Means {
        let size = Means::of(self.sizes(kernel).into_iter().map(|size| Some([size?; 2])));
        let neighbour = Point::<T>::from_array([2.0, 0.0, 0.0].map(T::from_f64));
        let near = norm_squared(&self.entry(kernel, Point::<T>::default(), neighbour)).sqrt();
        size.at_least(NEIGHBOUR_SHARE * near)
    }

    /// The far field in the polynomials of the cell: column after column for each density of each
    /// source, component after component down a column. Columns of shells larger than both the model's size and
    /// what their errors are relative to are scaled to that, so that none outweighs the interaction list unless
    /// the scale says so.
    pub(crate) fn columns<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        rule: &Chebyshev<T>,
        scale: Scale,
    ) -> Matrix<S> {
        let size = scale.model.least().max(scale.size / scale.shells);
        let nodes = rule.len().pow(3);
        let rows = nodes * kernel.fields;
        let shells = self.starts[INTERACTION_OFFSETS];
        let grid = self.scaled(rule.grid().collect());
        let mut data = vec![zero::<S>(); rows * kernel.densities * self.sources.len()];
        parallel::for_each_piece(&mut data, rows * kernel.densities, &|i, columns| {
            let (y, weight) = self.sources[i];
            kernel.write_field(&grid, y * self.half_width, columns);
            rule.coefficients(columns);
            let norm = (norm_squared(columns) / kernel.densities as f64).sqrt();
            let shrink = if norm > size { size / norm } else { 1.0 };
            let share = if i >= shells { shrink * scale.shells } else { 1.0 };
            let factor = S::from_real(T::from_f64(weight.sqrt() * share));
            columns.iter_mut().for_each(|entry| *entry *= factor);
        });
        Matrix { rows, columns: kernel.densities * self.sources.len(), data }
    }

    /// Calls `visit` with every entry of the kernel between sample points.
    pub(crate) fn for_each_entry<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        mut visit: impl FnMut(S),
    ) {
        for (i, &(y, _)) in self.sources.iter().enumerate() {
            self.entry(kernel, sample::<T>(i), y).into_iter().for_each(&mut visit);
        }
    }

    /// Where [`columns`](Self::columns) asks for the kernel: the nodes of `rule`, and all sources.
    pub(crate) fn places(&self, rule: &Chebyshev<T>) -> (Vec<Point<T>>, Vec<Point<T>>) {
        let sources = self.sources.iter().map(|&(y, _)| y).collect();
        (self.scaled(rule.grid().collect()), self.scaled(sources))
    }

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
    ///
    /// # Errors
    /// [`Error::OverWork`].
    pub(crate) fn closer_errors<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        rule: &Chebyshev<T>,
        scale: Scale,
    ) -> Result<Vec<f64>, Error> {
        let grid: Vec<Point<T>> = (0..27).map(grid_point::<T>).collect();
        let random: Vec<Point<T>> = (0..TEST_TARGETS).map(sample::<T>).collect();
        let interpolated = Interpolated { kernel, exact: kernel, rule, slopes: false };
        let carried: Vec<usize> =
            (0..INTERACTION_OFFSETS).filter(|&o| self.carried.has(self.offsets[o])).collect();
        let nodes = rule.len().pow(3);
        let evaluations = carried.len() * grid.len() * 2 * nodes;
        kernel.afford(evaluations as f64, (evaluations * TEST_TARGETS) as f64)?;
        let mut errors = vec![0.0; INTERACTION_OFFSETS];
        for o in carried {
            let sources: Vec<_> =
                grid.iter().map(|&p| (o, centre::<T>(self.offsets[o]) + p, 1.0)).collect();
            let worst = |targets: &[Point<T>]| {
                largest(self.squared_errors(&interpolated, targets, &sources).iter().map(|e| e.1))
            };
            let squared = largest([worst(&random), worst(&grid)]);
            errors[o] = scale.relative(Means::of([Some([squared; 2])])) / CLOSER;
        }
        Ok(errors)
    }

    fn relative_error<S: Scalar<Real = T>>(
        &self,
        interpolated: &Interpolated<'_, S>,
        scale: Scale,
    ) -> OffsetErrors {
        let mut sources = Vec::new();
        let carried = || self.offsets.iter().enumerate().filter(|(_, o)| self.carried.has(**o));
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
                    kernel.write_field(points, y * self.half_width, field);
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

    fn scaled(&self, mut points: Vec<Point<T>>) -> Vec<Point<T>> {
        points.iter_mut().for_each(|point| *point = *point * self.half_width);
        points
    }

    fn entry<S: Scalar<Real = T>>(
        &self,
        kernel: &Entries<'_, S>,
        x: PointOf<S>,
        y: PointOf<S>,
    ) -> Vec<S> {
        kernel.at(x * self.half_width, y * self.half_width)
    }
}

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

/// The evaluations and multiply-adds that it takes to find the error of a rule with n nodes per axis.
pub(crate) fn test_costs<S: Scalar>(kernel: &Entries<'_, S>, n: usize) -> [f64; 2] {
    let sources = INTERACTION_OFFSETS + (5usize.pow(3) - 3usize.pow(3)) * (PER_OFFSET - 1);
    let products = sources * n.pow(3) * TEST_TARGETS * kernel.fields * kernel.densities;
    [(sources * (n.pow(3) + TEST_TARGETS)) as f64, products as f64]
}

/// One of 27 points next to the border of [−1, 1]³ and in its centre. Between points on borders a kernel may be what
/// it is nowhere else.
fn grid_point<T: Real>(k: usize) -> Point<T> {
    let place = |k: usize| T::from_f64(0.98 * (k as f64 - 1.0));
    Point::<T>::from_array([k / 9, k / 3 % 3, k % 3].map(place))
}

/// Some octants for each of the levels above a cell, a bit for each axis.
fn octants(k: usize) -> usize {
    k.wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

/// The centre of the cell at an offset, in half-widths.
fn centre<T: Real>(offset: [i32; 3]) -> Point<T> {
    Point::<T>::from_array(offset.map(|o| T::from_f64(2.0 * f64::from(o))))
}

/// From an even distribution over the cell to that of Chebyshev nodes, with what one point then counts:
/// fields of sources at the border are the hardest to represent, and may be all there is.
fn towards_border<T: Real>(p: Point<T>) -> (Point<T>, f64) {
    let angles = p.to_array().map(|x| FRAC_PI_2 * x.as_f64());
    let share = angles.iter().map(|angle| FRAC_PI_2 * angle.cos()).product();
    (Point::<T>::from_array(angles.map(|angle| T::from_f64(angle.sin()))), share)
}

/// T̂_i(x) T̂_j(y) T̂_k(z) in the order of the grid.
pub(crate) fn products<T: Real>(p: Point<T>, n: usize) -> Vec<T> {
    products_along(p, n, [false; 3])
}

/// The derivative of the products along an axis.
pub(crate) fn slope_products<T: Real>(p: Point<T>, n: usize, axis: usize) -> Vec<T> {
    products_along(p, n, [0, 1, 2].map(|a| a == axis))
}

/// Products of the polynomials, or of their derivatives, along each axis.
fn products_along<T: Real>(p: Point<T>, n: usize, slopes: [bool; 3]) -> Vec<T> {
    let p = p.to_array();
    let axes = [0, 1, 2].map(|axis| {
        let mut values = vec![T::from_f64(0.0); n];
        if slopes[axis] {
            derivatives_in_lanes(&[p[axis]], values.as_chunks_mut().0);
        } else {
            polynomials(p[axis], &mut values);
        }
        values
    });
    let [x, y, z] = &axes;
    (0..n.pow(3)).map(|k| x[k / (n * n)] * y[k / n % n] * z[k % n]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::entries::pairwise;
    use glam::DVec3;

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

    #[test]
    fn weights_add_up_to_those_of_the_offsets() {
        let far = FarField::new(1.0, 64.0, 1, Carried::default());
        let lists: f64 = far.sources[..far.starts[INTERACTION_OFFSETS]].iter().map(|s| s.1).sum();
        assert!((lists / INTERACTION_OFFSETS as f64 - 1.0).abs() < 0.02, "{lists}");
    }

    #[test]
    fn columns_hold_the_coefficients_of_the_far_field() {
        let entries = pairwise(1, |x, y, g| g[0] = 1.0 / x.distance(y));
        let kernel = Entries::new(1, 1, &entries);
        let (far, rule) = (FarField::new(0.25, 64.0, 1, Carried::default()), Chebyshev::new(9));
        let scale = Scale::new(far.size(&kernel), std::iter::empty());
        let columns = far.columns(&kernel, &rule, scale);
        let x = DVec3::new(0.3, -0.8, 0.6);
        for (j, (y, weight)) in far.sources.iter().enumerate() {
            let field: f64 =
                products::<f64>(x, 9).iter().zip(columns.column(j)).map(|(t, c)| t * c).sum();
            let exact = 4.0 / x.distance(*y) * weight.sqrt();
            assert!((field - exact).abs() < 1e-5 * exact, "{field} {exact}");
        }
    }
}
