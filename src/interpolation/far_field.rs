//! Samples of what a cell receives from afar: the measure of every truncation.

use rayon::prelude::*;

use crate::chebyshev::{Chebyshev, polynomials};
use crate::dense::Matrix;
use crate::probe::{Formula, PointOf, norm_squared, sample, zero};
use crate::real::{Point, Real, Scalar, Vector};

/// Far fields smaller than this fraction of what neighbouring cells exchange are held to its level,
/// not to their own: a kernel that has died out needs no digits.
const NEAR_FRACTION: f64 = 0.1;

/// Sample sources per offset.
const PER_OFFSET: usize = 4;

/// Sample sources in each shell beyond the interaction list.
const PER_SHELL: usize = 48;

/// What weighs a shell as much as the interaction list: for a kernel that does not decay, most of the
/// sum comes from there, through the levels above.
const SHELL_WEIGHT: f64 = 5.0;

/// Sample targets in the cell at which the order is tested.
const TEST_TARGETS: usize = 24;

/// The far field of the cell [−h, h]³: the sources that act on it, as seen in half-widths.
pub(crate) struct FarField<T: Real> {
    /// [`PER_OFFSET`] points in each cell of the interaction list, offset after offset, then the shells.
    points: Vec<Point<T>>,
    offsets: Vec<[i32; 3]>,
    half_width: T,
}

impl<T: Real> FarField<T> {
    /// Sources in the 316 cells from which a tree's M2L comes, and in shells out to `extent`
    /// half-widths, from which M2P, P2L and masks may take more.
    pub(crate) fn new(half_width: T, extent: f64) -> Self {
        let mut points = Vec::new();
        let offsets: Vec<[i32; 3]> = interaction_offsets().collect();
        for (i, o) in offsets.iter().enumerate() {
            let centre = Point::<T>::from_array(o.map(|o| T::from_f64(2.0 * f64::from(o))));
            points.extend((0..PER_OFFSET).map(|k| centre + sample::<T>(i * PER_OFFSET + k)));
        }
        let mut radius = 8.0;
        while radius <= 2.0 * extent {
            points.extend((0..PER_SHELL).map(|k| {
                let p = sample::<T>(k).to_array().map(Real::as_f64);
                let largest = p.iter().fold(0.0f64, |a, x| a.max(x.abs()));
                let stretch = radius * (1.0 + (0.618 * k as f64).fract()) / largest;
                Point::<T>::from_array(p.map(|x| T::from_f64(x * stretch)))
            }));
            radius *= 2.0;
        }
        Self { points, offsets, half_width }
    }

    /// Half the cell's edge.
    pub(crate) fn half_width(&self) -> T {
        self.half_width
    }

    /// The size of one pair that errors are relative to: the root mean square over the interaction
    /// list, or a fraction of what neighbours exchange if that is more.
    pub(crate) fn size<S: Scalar<Real = T>>(&self, kernel: &Formula<'_, S>) -> f64 {
        let sources = &self.points[..INTERACTION_OFFSETS * PER_OFFSET];
        let mut sum = 0.0;
        for (offset, sources) in interaction_offsets().zip(sources.chunks_exact(PER_OFFSET)) {
            for (i, &y) in sources.iter().enumerate() {
                let x = sample::<T>(7 * i + offset[0].unsigned_abs() as usize);
                sum += weight(offset) * norm_squared(&self.entry(kernel, x, y));
            }
        }
        let neighbour = Point::<T>::from_array([2.0, 0.0, 0.0].map(T::from_f64));
        let near = norm_squared(&self.entry(kernel, Point::<T>::default(), neighbour)).sqrt();
        (sum / sources.len() as f64).sqrt().max(NEAR_FRACTION * near)
    }

    /// The far field in the polynomials of the cell: column after column for each density of each
    /// source, component after component down a column. Columns larger than `size` are scaled to it,
    /// so that no shell outweighs the interaction list.
    pub(crate) fn columns<S: Scalar<Real = T>>(
        &self,
        kernel: &Formula<'_, S>,
        rule: &Chebyshev<T>,
        size: f64,
    ) -> Matrix<S> {
        let nodes = rule.len().pow(3);
        let rows = nodes * kernel.fields;
        let mut data = vec![zero::<S>(); rows * kernel.densities * self.points.len()];
        data.par_chunks_mut(rows * kernel.densities).zip(&self.points).enumerate().for_each(
            |(i, (columns, &y))| {
                let mut g = vec![zero::<S>(); kernel.fields * kernel.densities];
                for (a, x) in rule.grid().enumerate() {
                    kernel.write(x * self.half_width, y * self.half_width, &mut g);
                    for (k, &entry) in g.iter().enumerate() {
                        let (field, density) = (k / kernel.densities, k % kernel.densities);
                        columns[density * rows + field * nodes + a] = entry;
                    }
                }
                columns.chunks_exact_mut(nodes).for_each(|field| rule.coefficients(field));
                let factor = match self.offsets.get(i / PER_OFFSET) {
                    Some(&offset) => weight(offset).sqrt(),
                    None => {
                        let norm = (norm_squared(columns) / kernel.densities as f64).sqrt();
                        SHELL_WEIGHT * if norm > size { size / norm } else { 1.0 }
                    }
                };
                let factor = S::from_real(T::from_f64(factor));
                columns.iter_mut().for_each(|entry| *entry *= factor);
            },
        );
        Matrix { rows, columns: kernel.densities * self.points.len(), data }
    }

    /// Calls `visit` with every entry of the kernel between sample points.
    pub(crate) fn for_each_entry<S: Scalar<Real = T>>(
        &self,
        kernel: &Formula<'_, S>,
        mut visit: impl FnMut(S),
    ) {
        for (i, &y) in self.points.iter().enumerate() {
            self.entry(kernel, sample::<T>(i), y).into_iter().for_each(&mut visit);
        }
    }

    /// How many columns of [`columns`](Self::columns) stem from the interaction list.
    pub(crate) fn interaction_columns(&self, densities: usize) -> usize {
        INTERACTION_OFFSETS * PER_OFFSET * densities
    }

    /// The root mean square error, relative to `size`, of interpolating between the nodes of `rule`:
    /// one source per offset, at random targets.
    pub(crate) fn interpolation_error<S: Scalar<Real = T>>(
        &self,
        kernel: &Formula<'_, S>,
        rule: &Chebyshev<T>,
        size: f64,
    ) -> f64 {
        let n = rule.len();
        let nodes = n.pow(3);
        let values: Vec<Vec<T>> = (0..TEST_TARGETS).map(|i| products(sample::<T>(i), n)).collect();
        let errors: f64 = (0..INTERACTION_OFFSETS)
            .into_par_iter()
            .map(|o| {
                let y = self.points[o * PER_OFFSET];
                let entries = kernel.fields * kernel.densities;
                let mut coefficients = vec![zero::<S>(); nodes * entries];
                for (a, x) in rule.grid().enumerate() {
                    for (k, g) in self.entry(kernel, x, y).into_iter().enumerate() {
                        coefficients[k * nodes + a] = g;
                    }
                }
                coefficients.chunks_exact_mut(nodes).for_each(|entry| rule.coefficients(entry));
                let mut errors = 0.0;
                for (i, values) in values.iter().enumerate() {
                    let mut difference = self.entry(kernel, sample::<T>(i), y);
                    for (d, entry) in difference.iter_mut().zip(coefficients.chunks_exact(nodes)) {
                        for (&c, &value) in entry.iter().zip(values) {
                            *d -= c * S::from_real(value);
                        }
                    }
                    errors += weight(self.offsets[o]) * norm_squared(&difference);
                }
                errors
            })
            .collect::<Vec<f64>>()
            .iter()
            .sum();
        if errors == 0.0 {
            return 0.0;
        }
        (errors / (INTERACTION_OFFSETS * TEST_TARGETS) as f64).sqrt() / size
    }

    fn entry<S: Scalar<Real = T>>(
        &self,
        kernel: &Formula<'_, S>,
        x: PointOf<S>,
        y: PointOf<S>,
    ) -> Vec<S> {
        kernel.at(x * self.half_width, y * self.half_width)
    }
}

/// T̂_i(x) T̂_j(y) T̂_k(z) in the order of the grid.
pub(crate) fn products<T: Real>(p: Point<T>, n: usize) -> Vec<T> {
    let axes = p.to_array().map(|x| {
        let mut values = vec![T::from_f64(0.0); n];
        polynomials(x, &mut values);
        values
    });
    let [x, y, z] = &axes;
    (0..n.pow(3)).map(|k| x[k / (n * n)] * y[k / n % n] * z[k % n]).collect()
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn error(f: fn(f64) -> f64, n: usize, half_width: f64) -> f64 {
        let entries = |x: DVec3, y: DVec3, g: &mut [f64]| g[0] = f(x.distance(y));
        let kernel = Formula::new(1, 1, &entries);
        let far = FarField::new(half_width, 8.0);
        far.interpolation_error(&kernel, &Chebyshev::new(n), far.size(&kernel))
    }

    #[test]
    fn there_are_316_offsets() {
        assert_eq!(interaction_offsets().count(), INTERACTION_OFFSETS);
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
    fn columns_hold_the_coefficients_of_the_far_field() {
        let entries = |x: DVec3, y: DVec3, g: &mut [f64]| g[0] = 1.0 / x.distance(y);
        let kernel = Formula::new(1, 1, &entries);
        let (far, rule) = (FarField::new(0.25, 20.0), Chebyshev::new(9));
        let columns = far.columns(&kernel, &rule, f64::INFINITY);
        let x = DVec3::new(0.3, -0.8, 0.6);
        for (j, y) in far.points.iter().enumerate() {
            let field: f64 =
                products::<f64>(x, 9).iter().zip(columns.column(j)).map(|(t, c)| t * c).sum();
            let list = far.offsets.get(j / PER_OFFSET);
            let factor = list.map_or(SHELL_WEIGHT, |&offset| weight(offset).sqrt());
            let exact = 4.0 / x.distance(*y) * factor;
            assert!((field - exact).abs() < 1e-5 * exact, "{field} {exact}");
        }
    }
}
