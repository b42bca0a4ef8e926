//! The basis of a cell: as few functions as its far field needs.
//!
//! A far field is a vector of coefficients of T̂_i(x) T̂_j(y) T̂_k(z). The singular value decomposition of
//! many of them, U Σ Vᴴ, gives the functions U that matter. A local expansion holds the coordinates l of
//! a field U l; a multipole expansion the moments m = Uᵀ m̃ of densities with Chebyshev moments m̃.

use std::ops::Range;

use pulp::Simd;

use crate::error::Error;
use crate::interpolation::budget::SKELETON_SHARE;
use crate::interpolation::chebyshev::Chebyshev;
use crate::interpolation::entries::{Entries, zero};
use crate::interpolation::far_field::FarField;
use crate::interpolation::lanes::{Padded, row};
use crate::interpolation::means::INTERACTION_OFFSETS;
use crate::interpolation::scale::Scale;
use crate::linalg::dense::{Dense, Svd};
use crate::linalg::matrix::Matrix;
use crate::numbers::traits::{Point, Real, Scalar};
use crate::parallel;

/// Functions on a cell, and the points that determine them.
#[derive(Debug)]
pub(crate) struct Basis<S: Scalar> {
    /// Row k: coefficient k of every function, component after component. Orthonormal columns.
    pub(crate) functions: Matrix<S>,
    /// For each of the eight reflections, the signs it gives to the functions; all + if the kernel has
    /// no parities.
    pub(crate) signs: [Vec<S::Real>; 8],
    /// The parts of one parity each.
    pub(crate) blocks: Vec<Block<S>>,
    pub(crate) skeleton: Skeleton<S>,
}

/// The part of a basis that has one parity.
#[derive(Debug)]
pub(crate) struct Block<S> {
    /// Along which axes its functions are odd, as bits.
    pub(crate) parity: u8,
    /// Where its coefficients stand in the padded arrays of [`points`](super::points), one component's
    /// after the other's.
    pub(crate) places: Vec<u32>,
    /// The first of its functions; the others follow.
    pub(crate) first: usize,
    /// Row k: coefficient k of its functions.
    pub(crate) functions: Padded<S>,
    /// Column k: coefficient k of its functions.
    pub(crate) transposed: Padded<S>,
}

impl<S> Block<S> {
    /// Which functions are its own.
    pub(crate) fn range(&self) -> Range<usize> {
        self.first..self.first + self.functions.columns
    }
}

/// Points in [−1, 1]³ from whose values a field's coordinates follow.
#[derive(Debug)]
pub(crate) struct Skeleton<S: Scalar> {
    pub(crate) points: Vec<Point<S::Real>>,
    /// X: coordinates from values, the points of one component after those of the other.
    pub(crate) from_values: Matrix<S>,
}

/// All singular vectors of a far field, from which bases of any accuracy are cut.
pub(crate) struct Spectrum<S> {
    /// Coefficients of one parity, their singular vectors and values per sample.
    parts: Vec<Part<S>>,
    coefficients: usize,
    components: usize,
}

struct Part<S> {
    parity: u8,
    coefficients: Vec<u32>,
    u: Matrix<S>,
    sigma: Vec<f64>,
}

impl<S: Scalar> Spectrum<S> {
    /// The singular vectors of the far field, parity by parity if its components have parities.
    pub(crate) fn new(
        kernel: &Entries<'_, S>,
        component_parities: Option<&[u8]>,
        far: &FarField<S::Real>,
        rule: &Chebyshev<S::Real>,
        scale: Scale,
    ) -> Result<Self, Error> {
        let n = rule.len();
        let parts = if component_parities.is_some() { 8.0 } else { 1.0 };
        let [evaluations, decomposition] = spectrum_costs(kernel, far, n, parts);
        kernel.afford(evaluations, decomposition)?;
        let columns = far.columns(kernel, rule, scale);
        kernel.spend(decomposition)?;
        let parity_of = |k: usize| {
            let Some(parities) = component_parities else { return 0 };
            let (component, k) = (k / n.pow(3), k % n.pow(3));
            let odd = [k / (n * n), k / n % n, k % n].map(|degree| (degree % 2) as u8);
            parities[component] ^ (odd[0] | odd[1] << 1 | odd[2] << 2)
        };
        // Only shells where nothing is carried at all.
        let weight = far.weight();
        let samples = if weight > 0.0 { weight } else { INTERACTION_OFFSETS as f64 };
        let per_sample = 1.0 / samples.sqrt();
        let part = |parity: usize| {
            let parity = parity as u8;
            let coefficients: Vec<u32> =
                (0..columns.rows as u32).filter(|&k| parity_of(k as usize) == parity).collect();
            if coefficients.is_empty() {
                return None;
            }
            let rows = Matrix::from_fn(coefficients.len(), columns.columns, |i, j| {
                columns.at(coefficients[i] as usize, j)
            });
            let Some(Svd { u, sigma }) = S::svd(&rows) else {
                return Some(Err(Error::NonFiniteKernel));
            };
            let sigma = sigma.into_iter().map(|s| s * per_sample).collect();
            Some(Ok(Part { parity, coefficients, u, sigma }))
        };
        let parts = parallel::map(8, &part).into_iter().flatten().collect::<Result<_, _>>()?;
        Ok(Self { parts, coefficients: columns.rows, components: kernel.fields })
    }

    /// How many functions it takes to leave out at most `cut`.
    pub(crate) fn rank(&self, cut: f64) -> usize {
        let sigma = || self.parts.iter().flat_map(|part| part.sigma.iter().copied());
        let floor = smallest_kept(sigma(), cut);
        sigma().filter(|&s| s >= floor).count()
    }

    /// The fewest functions that leave out at most `cut`, root mean square per sample; their skeleton.
    pub(crate) fn basis(&self, cut: f64, rule: &Chebyshev<S::Real>) -> Basis<S> {
        let (functions, parities, blocks) = self.functions(cut, rule.len());
        let (fine, ..) = self.functions(SKELETON_SHARE * cut, rule.len());
        let skeleton = if functions.columns == 0 {
            Skeleton { points: Vec::new(), from_values: functions.transpose() }
        } else {
            Skeleton::new(&functions, &fine, self.components, rule)
        };
        Basis { functions, signs: signs(&parities), blocks, skeleton }
    }

    fn functions(&self, cut: f64, n: usize) -> (Matrix<S>, Vec<u8>, Vec<Block<S>>) {
        let floor =
            smallest_kept(self.parts.iter().flat_map(|part| part.sigma.iter().copied()), cut);
        let ranks: Vec<usize> =
            self.parts.iter().map(|p| p.sigma.iter().filter(|&&s| s >= floor).count()).collect();
        let rank = ranks.iter().sum();
        let mut functions = Matrix::from_fn(self.coefficients, rank, |_, _| zero::<S>());
        let mut parities = Vec::with_capacity(rank);
        let mut blocks = Vec::with_capacity(self.parts.len());
        for (part, rank) in self.parts.iter().zip(ranks) {
            let first = parities.len();
            parities.resize(first + rank, part.parity);
            for j in 0..rank {
                let column = (first + j) * self.coefficients;
                for (&k, &entry) in part.coefficients.iter().zip(part.u.column(j)) {
                    functions.data[column + k as usize] = entry;
                }
            }
            let places = part.coefficients.iter().map(|&k| place(k as usize, n) as u32).collect();
            let own = part.u.corner(part.coefficients.len(), rank);
            let [functions, transposed] = [Padded::new(&own), Padded::new(&own.transpose())];
            blocks.push(Block { parity: part.parity, places, first, functions, transposed });
        }
        (functions, parities, blocks)
    }
}

/// The evaluations and multiply-adds of a [`Spectrum`] with n nodes per axis whose far field falls into
/// so many parts.
pub(crate) fn spectrum_costs<S: Scalar>(
    kernel: &Entries<'_, S>,
    far: &FarField<S::Real>,
    n: usize,
    parts: f64,
) -> [f64; 2] {
    let tall = (n.pow(3) * kernel.fields) as f64 / parts;
    let wide = (far.len() * kernel.densities) as f64;
    // A reduction to two diagonals, and its way back.
    let decomposition = 2.0 * parts * tall * tall.min(wide) * (wide + 2.0 * tall);
    [(n.pow(3) * far.len()) as f64, decomposition]
}

impl<S: Scalar> Basis<S> {
    /// The basis of all polynomials, with the grid as its skeleton: for kernels that look different from
    /// place to place.
    pub(crate) fn full(rule: &Chebyshev<S::Real>, components: usize) -> Self {
        let len = rule.len().pow(3) * components;
        let functions = Matrix { rows: len, columns: len, data: Vec::new() };
        let skeleton = Skeleton { points: rule.grid().collect(), from_values: functions.clone() };
        Self { functions, signs: signs(&vec![0; len]), blocks: Vec::new(), skeleton }
    }

    /// m += Uᵀ m̃ for one right-hand side of Chebyshev moments in padded arrays: the real parts, and the
    /// imaginary ones if there are any.
    #[inline(always)]
    pub(crate) fn add_moments<V: Simd>(
        &self,
        n: usize,
        parts: [&[S::Real]; 2],
        sums: &mut Vec<S>,
        m: &mut [S],
    ) {
        if self.is_full() {
            for (k, m) in m.iter_mut().enumerate() {
                let place = place(k, n);
                *m += S::from_parts(parts[0][place], parts[1][place]);
            }
        }
        for block in &self.blocks {
            let m = &mut m[block.first..];
            sums.clear();
            sums.extend(
                block.places.iter().map(|&place| {
                    S::from_parts(parts[0][place as usize], parts[1][place as usize])
                }),
            );
            block.transposed.product::<V>(sums, |first, own| {
                for (m, &own) in m[first..].iter_mut().zip(own) {
                    *m += own;
                }
            });
        }
    }

    /// f̃ += U l for one right-hand side of coefficients in padded arrays: the real parts, and the
    /// imaginary ones if there are any.
    #[inline(always)]
    pub(crate) fn add_coefficients<V: Simd>(
        &self,
        n: usize,
        l: &[S],
        [re, im]: [&mut [S::Real]; 2],
    ) {
        let mut add = |place: usize, sum: S| {
            let parts = sum.parts();
            re[place] += parts[0];
            if S::COMPLEX {
                im[place] += parts[1];
            }
        };
        if self.is_full() {
            l.iter().enumerate().for_each(|(k, &l)| add(place(k, n), l));
        }
        for block in &self.blocks {
            let l = &l[block.first..][..block.functions.columns];
            block.functions.product::<V>(l, |first, sums| {
                for (&place, &sum) in block.places[first..].iter().zip(sums) {
                    add(place as usize, sum);
                }
            });
        }
    }

    /// How many functions.
    pub(crate) fn rank(&self) -> usize {
        self.functions.columns
    }

    /// Charges at the skeleton's points with the same far field as the multipole expansion `m`: Xᵀ m for
    /// every column.
    pub(crate) fn skeleton_charges(&self, rule: &Chebyshev<S::Real>, m: &[S]) -> Vec<S> {
        let x = &self.skeleton.from_values;
        if self.is_full() {
            let mut charges = m.to_vec();
            charges.chunks_exact_mut(rule.len().pow(3)).for_each(|array| rule.node_weights(array));
            return charges;
        }
        let columns = m.len() / x.rows.max(1);
        let mut charges = vec![zero::<S>(); columns * x.columns];
        S::product(&x.transpose(), m, false, &mut charges);
        charges
    }

    /// l += X f for values of a field at the skeleton's points, for every column.
    pub(crate) fn add_skeleton_values(
        &self,
        rule: &Chebyshev<S::Real>,
        mut values: Vec<S>,
        l: &mut [S],
    ) {
        if self.is_full() {
            values.chunks_exact_mut(rule.len().pow(3)).for_each(|array| rule.coefficients(array));
            for (l, value) in l.iter_mut().zip(values) {
                *l += value;
            }
            return;
        }
        S::product(&self.skeleton.from_values, &values, true, l);
    }

    /// Whether it is the basis of all polynomials, whose matrices are not stored.
    pub(crate) fn is_full(&self) -> bool {
        self.functions.data.is_empty() && self.functions.columns > 0
    }
}

impl<S: Scalar> Skeleton<S> {
    /// Nodes at which the functions of `fine`, which begin with those of every block of `coarse`, are
    /// most different, by column-pivoted elimination; coordinates in `coarse` by least squares.
    fn new(
        coarse: &Matrix<S>,
        fine: &Matrix<S>,
        components: usize,
        rule: &Chebyshev<S::Real>,
    ) -> Self {
        let nodes = rule.len().pow(3);
        // Values of the fine functions at the nodes: coefficients → values is n³ times the transpose of
        // values → coefficients.
        let scale = S::from_real(S::Real::from_f64(nodes as f64));
        let mut values = fine.clone();
        for field in values.data.chunks_exact_mut(nodes) {
            rule.node_weights(field);
            field.iter_mut().for_each(|value| *value *= scale);
        }
        let (_, _, order) = S::pivoted_qr(&values.transpose());
        let mut chosen: Vec<usize> = order[..fine.columns].iter().map(|k| k % nodes).collect();
        chosen.sort_unstable();
        chosen.dedup();
        let at_chosen = Matrix::from_fn(components * chosen.len(), fine.columns, |i, j| {
            values.at(i / chosen.len() * nodes + chosen[i % chosen.len()], j)
        });
        // coarse = fine · (fineᴴ coarse), so coordinates follow by the same product.
        let points: Vec<_> = chosen.iter().map(|&k| rule.grid_node(k)).collect();
        let identity = Matrix::from_fn(at_chosen.rows, at_chosen.rows, |i, j| {
            if i == j { S::from_real(S::Real::from_f64(1.0)) } else { zero::<S>() }
        });
        let fine_coordinates = S::least_squares(&at_chosen, &identity);
        let from_fine = product(&adjoint(coarse), fine);
        Self { points, from_values: product(&from_fine, &fine_coordinates) }
    }
}

/// The smallest singular value that must be kept so that the root of the sum of the squares of those
/// below it is at most `cut`.
pub(crate) fn smallest_kept(sigma: impl Iterator<Item = f64>, cut: f64) -> f64 {
    let mut sigma: Vec<f64> = sigma.collect();
    sigma.sort_unstable_by(f64::total_cmp);
    let mut left_out = 0.0;
    for &s in &sigma {
        left_out += s * s;
        if left_out > cut * cut {
            return s;
        }
    }
    f64::INFINITY
}

/// Where coefficient k stands in padded arrays.
#[inline(always)]
fn place(k: usize, n: usize) -> usize {
    k / (n * n) * row(n) + k % (n * n)
}

/// For each of the eight reflections, the signs of functions with these parities.
fn signs<T: Real>(parities: &[u8]) -> [Vec<T>; 8] {
    std::array::from_fn(|reflection| {
        let odd = |parity: u8| (parity & reflection as u8).count_ones() % 2 == 1;
        parities.iter().map(|&p| T::from_f64(if odd(p) { -1.0 } else { 1.0 })).collect()
    })
}

/// A B
pub(crate) fn product<S: Scalar>(a: &Matrix<S>, b: &Matrix<S>) -> Matrix<S> {
    let mut c =
        Matrix { rows: a.rows, columns: b.columns, data: vec![zero::<S>(); a.rows * b.columns] };
    <S as Dense>::product(a, &b.data, false, &mut c.data);
    c
}

/// Aᴴ
pub(crate) fn adjoint<S: Scalar>(a: &Matrix<S>) -> Matrix<S> {
    a.transpose().map(S::conjugate)
}
