//! What the M2L matrices of one direction have in common: their ranges, and what is left of each matrix
//! between them.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use crate::interpolation::bases::Bases;
use crate::interpolation::basis::{adjoint, product, smallest_kept};
use crate::interpolation::budget::SIDE_SHARE;
use crate::interpolation::entries::{Entries, PointOf, zero};
use crate::interpolation::means::weight;
use crate::interpolation::tuning::{MORE_VECTORS, RANGE_REACH};
use crate::linalg::dense::Svd;
use crate::linalg::matrix::Matrix;
use crate::numbers::random::Random;
use crate::numbers::traits::{Point, Real, Scalar, Vector};
use crate::parallel;

/// C_o = S X_t G X_sᵀ S for the offsets o of one group: signs S of the reflection that takes the components
/// of o to their absolute values, and the kernel G between skeletons at that image.
pub(crate) struct Factors<'a, S: Scalar> {
    bases: &'a Bases<S>,
    /// The axes along which the group's directions lie, as bits.
    axes: u8,
    kernel: &'a Entries<'a, S>,
    /// G at each near image, and the sum of the weights of the offsets that it stands for.
    images: Vec<(Matrix<S>, f64)>,
    /// The images, the near ones first.
    known: Vec<[i32; 3]>,
    /// For every offset: its reflection and its image.
    offsets: Vec<(usize, usize)>,
}

/// The coordinates of one side of a group.
pub(crate) struct Side<S> {
    /// Orthonormal columns: what each coordinate stands for.
    pub(crate) functions: Matrix<S>,
    /// Which coordinates there are for each class: the parities along the axes across the directions.
    pub(crate) classes: Vec<(u8, Range<usize>)>,
}

impl<'a, S: Scalar> Factors<'a, S> {
    pub(crate) fn new(
        kernel: &'a Entries<'a, S>,
        bases: &'a Bases<S>,
        axes: u8,
        offsets: &[[i32; 3]],
    ) -> Self {
        let image =
            |&offset: &[i32; 3]| if bases.reflected { offset.map(i32::abs) } else { offset };
        let mut known: Vec<[i32; 3]> = offsets.iter().map(image).collect();
        let key = |image: &[i32; 3]| (image.iter().any(|o| o.abs() > RANGE_REACH), *image);
        known.sort_unstable_by_key(key);
        known.dedup();
        let mut weights = vec![0.0; known.len()];
        let place = |offset: &[i32; 3]| {
            let negative = |axis: usize| usize::from(bases.reflected && offset[axis] < 0) << axis;
            let index = known.partition_point(|known| key(known) < key(&image(offset)));
            weights[index] += weight(*offset);
            (negative(0) | negative(1) | negative(2), index)
        };
        let offsets = offsets.iter().map(place).collect();
        let near = known.partition_point(|image| !key(image).0);
        let near = if near > 0 { near } else { known.len().min(1) };
        let images = parallel::map(near, &|i| (between(kernel, bases, known[i]), weights[i]));
        Self { bases, axes, kernel, images, known, offsets }
    }

    /// P and Q with C_o = P W_o Qᴴ but for a share of the cut-off, and the W_o.
    pub(crate) fn compress(&self) -> (Side<S>, Side<S>, Vec<Matrix<S>>) {
        let Bases { source, target, reflected, .. } = self.bases;
        let p = self.side(false);
        let q = if *reflected && Arc::ptr_eq(source, target) {
            // C_oᵀ = C_{−o} = S C_o S with the signs of all three axes.
            Side {
                functions: signed(&target.signs[7], &p.functions.map(S::conjugate)),
                classes: p.classes.clone(),
            }
        } else {
            self.side(true)
        };
        // Pᴴ S X_t and X_sᵀ S Q
        let from_source = source.skeleton.from_values.transpose();
        let sides = |reflection: usize| {
            let left = adjoint(&signed(&target.signs[reflection], &p.functions));
            let right = signed(&source.signs[reflection], &q.functions);
            [product(&left, &target.skeleton.from_values), product(&from_source, &right)]
        };
        let used = |reflection| self.offsets.iter().any(|&(own, _)| own == reflection);
        let sides: Vec<_> = (0..8).map(|r| used(r).then(|| sides(r))).collect();
        let core = |o: usize| {
            let (reflection, image) = self.offsets[o];
            let [left, right] = sides[reflection].as_ref()?;
            Some(match self.images.get(image) {
                Some((near, _)) => product(&product(left, near), right),
                None => {
                    let far = between(self.kernel, self.bases, self.known[image]);
                    product(&product(left, &far), right)
                }
            })
        };
        let cores = parallel::map(self.offsets.len(), &core).into_iter().flatten().collect();
        (p, q, cores)
    }

    /// A basis of A = [w_o C_o …], or of the adjoints, but for a share of the cut-off per matrix.
    ///
    /// Taken from products of A with random vectors, twice as many as there will be columns or more, of
    /// which each has the expected squared norm of A (Halko, Martinsson and Tropp, "Finding structure
    /// with randomness", SIAM Review 53, 2011). With an offset comes its reflection across the
    /// directions, of which the matrix has the same rows but for signs: so each class of rows has a basis
    /// of its own, and one offset stands for all its images.
    fn side(&self, adjoint: bool) -> Side<S> {
        let basis = if adjoint { &self.bases.source } else { &self.bases.target };
        let across = self.bases.across(self.axes);
        let mut rows: BTreeMap<u8, Vec<usize>> = BTreeMap::new();
        for block in &basis.blocks {
            rows.entry(block.parity & across).or_default().extend(block.range());
        }
        let most = rows.values().map(Vec::len).max().unwrap_or(0);
        let squares: f64 = self.images.iter().map(|(_, weight)| weight).sum();
        let expected = basis.rank() / if self.bases.reflected { 3 } else { 2 };
        let mut width = most.min(expected) + MORE_VECTORS;
        loop {
            let sketch = self.sketch(adjoint, width);
            let cut = SIDE_SHARE * self.bases.cut * (squares * width as f64).sqrt();
            let part = |rows: &Vec<usize>| {
                let part = Matrix::from_fn(rows.len(), width, |i, j| sketch.at(rows[i], j));
                leading(&part, 0.1 * cut)
            };
            let vectors: Vec<Svd<S>> = rows.values().map(part).collect();
            let least =
                smallest_kept(vectors.iter().flat_map(|svd| svd.sigma.iter().copied()), cut);
            let kept = |svd: &Svd<S>| svd.sigma.iter().filter(|&&sigma| sigma >= least).count();
            let ranks: Vec<usize> = vectors.iter().map(kept).collect();
            if width < most + MORE_VECTORS && ranks.iter().any(|rank| 2 * rank > width) {
                width = most + MORE_VECTORS;
                continue;
            }
            let rank = ranks.iter().sum();
            let mut functions = Matrix::from_fn(basis.rank(), rank, |_, _| zero::<S>());
            let (mut classes, mut first) = (Vec::new(), 0);
            for (((&class, rows), Svd { u, .. }), rank) in rows.iter().zip(vectors).zip(ranks) {
                for j in 0..rank {
                    for (&row, &entry) in rows.iter().zip(u.column(j)) {
                        let entry = if adjoint { entry.conjugate() } else { entry };
                        functions.data[(first + j) * basis.rank() + row] = entry;
                    }
                }
                classes.push((class, first..first + rank));
                first += rank;
            }
            return Side { functions, classes };
        }
    }

    /// Σ_o w_o C_o Ω_o, or with the transposes, for `width` random vectors each and one offset of each
    /// image.
    fn sketch(&self, transposed: bool, width: usize) -> Matrix<S> {
        let Bases { source, target, .. } = self.bases;
        let (from, to) = if transposed { (target, source) } else { (source, target) };
        let charges = from.skeleton.from_values.transpose();
        let (rows, mut numbers) = (to.skeleton.from_values.columns, Random::new(0));
        let mut values = Matrix { rows, columns: width, data: vec![zero::<S>(); rows * width] };
        for (image, weight) in &self.images {
            let vectors = Matrix::from_fn(charges.columns, width, |_, _| {
                S::from_real(S::Real::from_f64(weight.sqrt() * numbers.centred()))
            });
            let charges = product(&charges, &vectors);
            if transposed {
                S::product(&image.transpose(), &charges.data, true, &mut values.data)
            } else {
                S::product(image, &charges.data, true, &mut values.data)
            }
        }
        product(&to.skeleton.from_values, &values)
    }
}

/// The kernel between the skeletons of two cells.
pub(crate) fn between<S: Scalar>(
    kernel: &Entries<'_, S>,
    bases: &Bases<S>,
    offset: [i32; 3],
) -> Matrix<S> {
    let [xs, ys] = skeletons(bases, offset);
    let rows = xs.len() * kernel.fields;
    let columns = ys.len() * kernel.densities;
    let mut values = Matrix { rows, columns, data: vec![zero::<S>(); rows * columns] };
    let mut field = vec![zero::<S>(); rows * kernel.densities];
    for (b, &y) in ys.iter().enumerate() {
        kernel.write_field(&xs, y, &mut field);
        for (density, field) in field.chunks_exact(rows.max(1)).enumerate() {
            let start = (density * ys.len() + b) * rows;
            values.data[start..start + rows].copy_from_slice(field);
        }
    }
    values
}

/// The points of the skeletons of two cells: of targets and of sources.
pub(crate) fn skeletons<S: Scalar>(bases: &Bases<S>, offset: [i32; 3]) -> [Vec<PointOf<S>>; 2] {
    let step = offset.map(|o| S::Real::from_f64(2.0 * f64::from(o)));
    let step = Point::<S::Real>::from_array(step);
    let [ys, xs] = [&bases.source, &bases.target].map(|basis| basis.skeleton.points.iter());
    let xs = xs.map(|&x| (x + step) * bases.half_width).collect();
    [xs, ys.map(|&y| y * bases.half_width).collect()]
}

/// S A
fn signed<S: Scalar>(signs: &[S::Real], a: &Matrix<S>) -> Matrix<S> {
    Matrix::from_fn(a.rows, a.columns, |i, j| S::from_real(signs[i]) * a.at(i, j))
}

/// The singular value decomposition of all of A but `cut`.
fn leading<S: Scalar>(a: &Matrix<S>, cut: f64) -> Svd<S> {
    // Pivoted elimination first: the decomposition proper then has few rows. The order of columns is
    // nothing to left singular vectors.
    let (q, r, _) = S::pivoted_qr(a);
    let row = |i: usize| (0..r.columns).map(|j| r.at(i, j).norm_squared()).sum::<f64>();
    let kept = len_without_tail(r.rows, cut, row);
    let q = q.corner(q.rows, kept);
    match S::svd(&r.corner(kept, r.columns)) {
        Some(Svd { u, sigma }) => Svd { u: product(&q, &u), sigma },
        // Without a decomposition, every direction is kept.
        None => Svd { u: q, sigma: vec![f64::INFINITY; kept] },
    }
}

/// The smallest length such that the root of the sum of the squares beyond it is at most `cut`.
fn len_without_tail(len: usize, cut: f64, squared: impl Fn(usize) -> f64) -> usize {
    let mut tail = 0.0;
    (0..len)
        .rev()
        .find(|&i| {
            tail += squared(i);
            tail > cut * cut
        })
        .map_or(0, |i| i + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::basis::Spectrum;
    use crate::interpolation::carried::Carried;
    use crate::interpolation::chebyshev::Chebyshev;
    use crate::interpolation::entries::pairwise;
    use crate::interpolation::far_field::FarField;
    use crate::interpolation::probe::parities;
    use crate::interpolation::scale::Scale;
    use glam::DVec3;

    /// The largest ‖C_o − P W_o Qᴴ‖ of the offsets of one direction, relative to the cut-off; the rank.
    fn worst(kernel: fn(DVec3) -> f64, reflected: bool, cut: f64) -> (f64, usize) {
        let entries = pairwise(1, |x, y, g| g[0] = kernel(x - y));
        let (kernel, rule) = (Entries::new(1, 1, &entries), Chebyshev::new(7));
        let far = FarField::new(0.5, 32.0, if reflected { 1 } else { 2 }, Carried::default());
        let parities = parities(&kernel, 0.5).map(|parities| parities.fields);
        assert_eq!(parities.is_some(), reflected);
        let basis = |kernel: &Entries<'_, f64>| {
            let scale = Scale::new(far.size(kernel), std::iter::empty());
            let spectrum = Spectrum::new(kernel, parities.as_deref(), &far, &rule, scale);
            Arc::new(spectrum.unwrap().basis(cut, &rule))
        };
        let target = basis(&kernel);
        let source = if reflected { Arc::clone(&target) } else { basis(&kernel.transpose()) };
        let bases = Bases { half_width: 0.5, source, target, reflected, cut };
        let offsets = [[2, 0, 0], [2, 0, 1], [2, 0, -1], [2, -1, 1], [3, 1, -1]];
        let (p, q, cores) = Factors::new(&kernel, &bases, 1, &offsets).compress();
        let errors = offsets.iter().zip(&cores).map(|(&offset, core)| {
            let values = between(&kernel, &bases, offset);
            let left = product(&bases.target.skeleton.from_values, &values);
            let c = product(&left, &bases.source.skeleton.from_values.transpose());
            let pwq = product(&product(&p.functions, core), &adjoint(&q.functions));
            let squares = c.data.iter().zip(&pwq.data).map(|(a, b)| (a - b).powi(2));
            squares.sum::<f64>().sqrt() / cut
        });
        (errors.fold(0.0, f64::max), p.functions.columns)
    }

    #[test]
    fn factors_make_up_the_matrices_but_for_the_cut_off() {
        let isotropic = |d: DVec3| 1.0 / d.length();
        let skew = |d: DVec3| 1.0 / (d.length_squared() + 0.4 * d.x * d.y + 0.3 * d.x).sqrt();
        for (kernel, reflected) in [(isotropic as fn(DVec3) -> f64, true), (skew, false)] {
            for (cut, ranks) in [(1e-1, 1..4), (1e-2, 2..10), (1e-5, 20..90)] {
                let (worst, rank) = worst(kernel, reflected, cut);
                assert!(worst < 8.0 && ranks.contains(&rank), "{cut}: {worst} {rank}");
            }
        }
    }
}
