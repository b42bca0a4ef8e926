//! What comes from all images that are not near, for many points: polynomials of the sources, a matrix, and polynomials of
//! the targets.

use crate::interpolation::chebyshev::{derivatives_in_lanes, polynomials};
use crate::interpolation::probe::sample;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Located, Numbers, Point, Real, Scalar, Vector};
use crate::parallel;
use crate::periodic::images::Images;
use crate::periodic::lattice::Lattice;
use crate::periodic::polynomials::Polynomials;

/// F(x − y) = Σ_kl T̂_k(x) M_kl T̂_l(y) in the box, with as few products of Chebyshev polynomials T̂ as matter.
#[derive(Debug)]
pub(super) struct Operator<S: Scalar> {
    centre: Point<S::Real>,
    half_widths: [S::Real; 3],
    /// Polynomials along an axis.
    order: usize,
    /// The degrees of the products.
    terms: Vec<[usize; 3]>,
    /// For each entry of the kernel, row after row: its own M, row after row.
    matrices: Vec<Vec<S>>,
}

/// Polynomials along an axis, at least and at most.
const ORDERS: (usize, usize) = (4, 16);

/// The share of the error that products which are left out may make.
const TRUNCATION_SHARE: f64 = 0.25;

/// Pairs of points at which the matrix is held against what it stands for.
const SAMPLES: usize = 40;

/// Points per parallel task.
const PIECE: usize = 512;

impl<S: Scalar> Operator<S> {
    /// For points of a box; as exact as the sum that it stands for.
    pub(super) fn new(lattice: &Lattice, images: &Images, tolerance: f64) -> Self {
        let Images { sum, error, .. } = images;
        let first = ((3.0 / tolerance).ln() / 6f64.ln()).ceil() as usize;
        let mut order = first.clamp(ORDERS.0, ORDERS.1);
        let (terms, matrices) = loop {
            let (terms, matrices) = matrices(sum, order, TRUNCATION_SHARE * error);
            if order >= ORDERS.1 || error_of(sum, order, &terms, &matrices) <= *error {
                break (terms, matrices);
            }
            order += 2;
        };
        // A complex entry has its parts one after the other.
        let entry = |parts: &[Vec<f64>]| {
            let number = |k: usize| {
                let part = |part: usize| parts.get(part).map_or(0.0, |own| own[k]);
                S::from_parts(S::Real::from_f64(part(0)), S::Real::from_f64(part(1)))
            };
            (0..terms.len() * terms.len()).map(number).collect()
        };
        Self {
            centre: Point::<S::Real>::from_array(lattice.centre.map(S::Real::from_f64)),
            half_widths: lattice.half_widths.map(S::Real::from_f64),
            order,
            matrices: matrices.chunks(S::PARTS).map(entry).collect(),
            terms,
        }
    }

    /// Adds what comes from the images of all sources to the values at some targets. O(N) per product of polynomials.
    pub(super) fn add<K: Kernel<Entry = S, Real = S::Real>>(
        &self,
        kernel: &K,
        (sources, charges): (&[K::Source], &[K::Charge]),
        targets: &[K::Target],
        values: &mut [K::Value],
    ) {
        let moments = self.moments(kernel, sources, charges);
        let locals = self.locals(kernel, &moments);
        let channels = kernel.fields() * kernel.columns();
        let with_slopes = kernel.needs_gradients();
        parallel::for_each_piece(values, PIECE, &|piece, values| {
            let mut polynomials = Products::new(self.order);
            let zero = <S as Numbers>::zero();
            let (mut fields, mut slopes) = (vec![zero; channels], vec![[zero; 3]; channels]);
            for (x, u) in targets[PIECE * piece..].iter().zip(values) {
                polynomials.set(self.normalised(x.position()), with_slopes);
                fields.fill(zero);
                slopes.fill([zero; 3]);
                for (&degrees, locals) in self.terms.iter().zip(locals.chunks_exact(channels)) {
                    let product = S::from_real(polynomials.value(degrees));
                    fields.iter_mut().zip(locals).for_each(|(f, &l)| *f += product * l);
                    if with_slopes {
                        for axis in 0..3 {
                            let slope = polynomials.slope(degrees, axis) / self.half_widths[axis];
                            let slope = S::from_real(slope);
                            slopes.iter_mut().zip(locals).for_each(|(s, &l)| s[axis] += slope * l);
                        }
                    }
                }
                let slopes = if with_slopes { &slopes[..] } else { &[] };
                kernel.value(x, &fields, slopes, u);
            }
        });
    }

    /// Σ_j T̂_l(y_j) S_j q_j: for each product, the densities in every column.
    fn moments<K: Kernel<Entry = S, Real = S::Real>>(
        &self,
        kernel: &K,
        sources: &[K::Source],
        charges: &[K::Charge],
    ) -> Vec<S> {
        let channels = kernel.densities() * kernel.columns();
        let zero = <S as Numbers>::zero();
        let parts = parallel::map(sources.len().div_ceil(PIECE), &|piece| {
            let mut polynomials = Products::new(self.order);
            let (mut sent, mut sums) =
                (vec![zero; channels], vec![zero; self.terms.len() * channels]);
            let own = sources[PIECE * piece..].iter().zip(&charges[PIECE * piece..]).take(PIECE);
            for (y, q) in own {
                polynomials.set(self.normalised(y.position()), false);
                kernel.density(y, q, &mut sent);
                for (&degrees, sums) in self.terms.iter().zip(sums.chunks_exact_mut(channels)) {
                    let product = S::from_real(polynomials.value(degrees));
                    sums.iter_mut().zip(&sent).for_each(|(sum, &d)| *sum += product * d);
                }
            }
            sums
        });
        let mut moments = vec![zero; self.terms.len() * channels];
        for part in parts {
            moments.iter_mut().zip(part).for_each(|(sum, own)| *sum += own);
        }
        moments
    }

    /// Σ_l M_kl m_l: for each product, the fields in every column.
    fn locals<K: Kernel<Entry = S, Real = S::Real>>(&self, kernel: &K, moments: &[S]) -> Vec<S> {
        let (fields, densities, columns) = (kernel.fields(), kernel.densities(), kernel.columns());
        let count = self.terms.len();
        let mut locals = vec![<S as Numbers>::zero(); count * fields * columns];
        parallel::for_each_piece(&mut locals, fields * columns, &|k, locals| {
            for (e, matrix) in self.matrices.iter().enumerate() {
                let (field, density) = (e / densities, e % densities);
                let row = &matrix[k * count..][..count];
                for (&entry, moments) in row.iter().zip(moments.chunks_exact(densities * columns)) {
                    let own = &moments[density * columns..][..columns];
                    let to = &mut locals[field * columns..][..columns];
                    to.iter_mut().zip(own).for_each(|(l, &m)| *l += entry * m);
                }
            }
        });
        locals
    }

    fn normalised(&self, p: Point<S::Real>) -> [S::Real; 3] {
        let from_centre = (p - self.centre).to_array();
        [0, 1, 2].map(|k| from_centre[k] / self.half_widths[k])
    }
}

/// Polynomials of a point along each axis, and their derivatives.
struct Products<T> {
    values: [Vec<T>; 3],
    slopes: [Vec<T>; 3],
}

impl<T: Real> Products<T> {
    fn new(order: usize) -> Self {
        let zero = || [0; 3].map(|_| vec![T::from_f64(0.0); order]);
        Self { values: zero(), slopes: zero() }
    }

    fn set(&mut self, p: [T; 3], with_slopes: bool) {
        for (k, x) in p.into_iter().enumerate() {
            polynomials(x, &mut self.values[k]);
            if with_slopes {
                derivatives_in_lanes(&[x], self.slopes[k].as_chunks_mut().0);
            }
        }
    }

    #[inline(always)]
    fn value(&self, [i, j, k]: [usize; 3]) -> T {
        self.values[0][i] * self.values[1][j] * self.values[2][k]
    }

    #[inline(always)]
    fn slope(&self, degrees: [usize; 3], axis: usize) -> T {
        let factor = |k: usize| {
            let own = if k == axis { &self.slopes[k] } else { &self.values[k] };
            own[degrees[k]]
        };
        factor(0) * factor(1) * factor(2)
    }
}

/// M of each function in products of `order` polynomials along an axis, and the degrees of those that make more than
/// `cut` of a difference.
fn matrices(sum: &Polynomials, order: usize, cut: f64) -> (Vec<[usize; 3]>, Vec<Vec<f64>>) {
    let along_axis = in_both(sum.order, order);
    let whole = |function: usize| sum.product(function, [0; 3].map(|_| &along_axis[..]));
    let products = order.pow(3);
    let degrees = |k: usize| [k / (order * order), k / order % order, k % order];
    // Where the entry of two products stands among those that `whole` gives.
    let place = |row: [usize; 3], column: [usize; 3]| {
        let [x, y, z] = [0, 1, 2].map(|axis| row[axis] * order + column[axis]);
        (x * order * order + y) * order * order + z
    };
    let mut squares = vec![0.0; products];
    for function in 0..sum.functions() {
        let whole = whole(function);
        let own = parallel::map(products, &|k| {
            let of_both = |l: usize| {
                let (k, l) = (degrees(k), degrees(l));
                whole[place(k, l)].powi(2) + whole[place(l, k)].powi(2)
            };
            (0..products).map(of_both).sum::<f64>()
        });
        squares.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
    }
    let mut ascending: Vec<usize> = (0..products).collect();
    ascending.sort_by(|&a, &b| squares[a].total_cmp(&squares[b]));
    let mut left_out = 0.0;
    let is_little = |&&k: &&usize| {
        left_out += squares[k];
        left_out <= cut * cut
    };
    let little = ascending.iter().take_while(is_little).count();
    let mut kept = ascending.split_off(little);
    kept.sort_unstable();
    let terms: Vec<[usize; 3]> = kept.into_iter().map(degrees).collect();
    let of_function = |function: usize| {
        let whole = whole(function);
        let rows = terms.iter().flat_map(|&row| terms.iter().map(move |&column| (row, column)));
        rows.map(|(row, column)| whole[place(row, column)]).collect()
    };
    let matrices = (0..sum.functions()).map(of_function).collect();
    (terms, matrices)
}

/// T̂_p((x − y)/2) = Σ_kl C_klp T̂_k(x) T̂_l(y), for k and l below `order` and p below `most`; p runs fastest.
fn in_both(most: usize, order: usize) -> Vec<f64> {
    // At the nodes of enough polynomials; then from values to coefficients, for x and for y.
    let nodes = most.max(order);
    let node = |k: usize| ((k as f64 + 0.5) * std::f64::consts::PI / nodes as f64).cos();
    let mut at_nodes = vec![0.0; nodes * nodes];
    for (k, row) in at_nodes.chunks_exact_mut(nodes).enumerate() {
        polynomials(node(k), row);
    }
    let mut difference = vec![0.0; most];
    let mut half = vec![0.0; nodes * order * most];
    for i in 0..nodes {
        for j in 0..nodes {
            polynomials(0.5 * (node(i) - node(j)), &mut difference);
            for l in 0..order {
                let weight = at_nodes[j * nodes + l] / nodes as f64;
                let to = &mut half[(i * order + l) * most..][..most];
                to.iter_mut().zip(&difference).for_each(|(to, t)| *to += weight * t);
            }
        }
    }
    let mut both = vec![0.0; order * order * most];
    for i in 0..nodes {
        for k in 0..order {
            let weight = at_nodes[i * nodes + k] / nodes as f64;
            let to = &mut both[k * order * most..][..order * most];
            let from = &half[i * order * most..][..order * most];
            to.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
        }
    }
    both
}

/// The largest error of matrices between some points of the box, corners among them.
fn error_of(sum: &Polynomials, order: usize, terms: &[[usize; 3]], matrices: &[Vec<f64>]) -> f64 {
    let corner = |i: usize| [0, 1, 2].map(|k| if i >> k & 1 == 0 { -1.0 } else { 1.0 });
    let place = |i: usize| {
        if i < 8 { corner(i) } else { Vector::to_array(sample::<f64>(i)) }
    };
    let errors = parallel::map(SAMPLES, &|i| {
        // A corner faces another across the box.
        let (x, y) = (place(i), if i < 8 { place(7 - i) } else { place(i + SAMPLES) });
        let products = [x, y].map(|p| {
            let mut products = Products::new(order);
            products.set(p, false);
            terms.iter().map(|&degrees| products.value(degrees)).collect::<Vec<f64>>()
        });
        let d = [0, 1, 2].map(|k| 0.5 * (x[k] - y[k]) * sum.half_widths[k]);
        let exact = sum.at(d);
        let error = matrices.iter().zip(exact).map(|(matrix, exact)| {
            let rows = matrix.chunks_exact(terms.len().max(1)).zip(&products[0]);
            let found: f64 = rows
                .map(|(row, x)| x * row.iter().zip(&products[1]).map(|(m, y)| m * y).sum::<f64>())
                .sum();
            (found - exact).abs()
        });
        error.fold(0.0, f64::max)
    });
    errors.into_iter().fold(0.0, f64::max)
}
