//! Samples of what a cell receives from afar: the measure of every truncation.

use std::f64::consts::FRAC_PI_2;

use crate::interpolation::budget::NEIGHBOUR_SHARE;
use crate::interpolation::carried::Carried;
use crate::interpolation::chebyshev::{Chebyshev, derivatives_in_lanes, polynomials};
use crate::interpolation::entries::{Entries, PointOf, norm_squared, zero};
use crate::interpolation::means::{INTERACTION_OFFSETS, Means, interaction_offsets, weight};
use crate::interpolation::probe::sample;
use crate::interpolation::scale::Scale;
use crate::interpolation::tuning::{PER_NEAR_OFFSET, PER_OFFSET, PER_SHELL, SHELL_WEIGHT};
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

impl<T: Real> FarField<T> {
    /// Sources in the 316 cells from which a tree's M2L comes, and in shells out to `reach`
    /// half-widths along an axis, from which M2P, P2L and masks may take more: `density` times as many as a kernel
    /// needs whose far field falls into parities. Only what is carried counts.
    pub(crate) fn new(half_width: T, reach: f64, density: usize, carried: Carried) -> Self {
        let (mut sources, mut starts) = (Vec::new(), vec![0]);
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        for (i, &offset) in offsets.iter().enumerate() {
            let near = offset.iter().all(|o| o.abs() <= 2);
            let all = density * if near { PER_NEAR_OFFSET } else { PER_OFFSET };
            let count = if carried.has(offset) { all } else { 0 };
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
        let is_whole = carried.is_whole();
        let mut radius = if is_whole { 8.0 } else { 4.0 };
        let count = density * PER_SHELL * if is_whole { 1 } else { 4 };
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

    /// Only the sources in shells that are farther away than `reach`.
    pub(crate) fn beyond(mut self, reach: f64) -> Self {
        let shells = self.sources.split_off(self.starts[INTERACTION_OFFSETS]);
        let distance = |p: Point<T>| {
            p.to_array().into_iter().fold(0.0f64, |largest, x| largest.max(x.as_f64().abs()))
        };
        // What lay at the end of the shells that were there is among them.
        let is_beyond = |(p, _): &(Point<T>, f64)| distance(*p) > reach;
        self.sources = shells.into_iter().filter(is_beyond).collect();
        self.starts.fill(0);
        self
    }

    /// The offsets of the interaction list.
    pub(crate) fn offsets(&self) -> &[[i32; 3]] {
        &self.offsets
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
            // What is the same all over a cell has no slope, and would hide the slopes of what grows with distance.
            let first = usize::from(scale.slopes && i >= shells);
            let fields = columns.chunks_exact(nodes).map(|field| norm_squared(&field[first..]));
            let norm = (fields.sum::<f64>() / kernel.densities as f64).sqrt();
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

    /// Points in half-widths, in the lengths of the kernel.
    pub(crate) fn scaled(&self, mut points: Vec<Point<T>>) -> Vec<Point<T>> {
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

/// Some octants for each of the levels above a cell, a bit for each axis.
fn octants(k: usize) -> usize {
    k.wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

/// The centre of the cell at an offset, in half-widths.
pub(crate) fn centre<T: Real>(offset: [i32; 3]) -> Point<T> {
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
