//! Chebyshev polynomials on [−1, 1]: the coordinates in which interpolation works.
//!
//! The polynomials are normalised, T̂_0 = 1 and T̂_j = √2 T_j, so that they are orthonormal on the n
//! Chebyshev nodes with weights 1/n. Interpolating at the nodes is then projecting onto T̂_0 … T̂_{n−1}:
//! f(x) ≈ Σ_j T̂_j(x) · 1/n Σ_k T̂_j(x_k) f(x_k).

use num_traits::Float;
use pulp::{Simd, WithSimd};

use crate::dispatch_level::dispatch;
use crate::numbers::traits::{Numbers, Point, Real, Scalar, Vector};

/// The nodes x_k = cos((k + ½) π / n) and the polynomials T̂_0 … T̂_{n−1} on them.
#[derive(Clone, Debug)]
pub(crate) struct Chebyshev<T> {
    nodes: Vec<T>,
    /// 1/n · T̂_j(x_k), row j.
    projection: Vec<T>,
    /// For the lower and the upper half: T̂_j(x/2 ∓ ½) = Σ_k A_jk T̂_k(x), row j.
    halves: [Vec<T>; 2],
}

impl<T: Real> Chebyshev<T> {
    /// The rule with `n` ≥ 1 nodes.
    pub(crate) fn new(n: usize) -> Self {
        let angle = |k: usize| (k as f64 + 0.5) * std::f64::consts::PI / n as f64;
        let nodes: Vec<f64> = (0..n).map(|k| angle(k).cos()).collect();
        let mut columns = vec![0.0; n * n];
        for (&x, column) in nodes.iter().zip(columns.chunks_exact_mut(n)) {
            polynomials(x, column);
        }
        let projection = |j: usize, k: usize| columns[k * n + j] / n as f64;
        let halves = [-0.5, 0.5].map(|shift| {
            let mut matrix = vec![0.0; n * n];
            let mut at = vec![0.0; n];
            for (a, &x) in nodes.iter().enumerate() {
                polynomials(0.5 * x + shift, &mut at);
                for (row, &t) in matrix.chunks_exact_mut(n).zip(&at) {
                    for (k, entry) in row.iter_mut().enumerate() {
                        *entry += t * projection(k, a);
                    }
                }
            }
            matrix.into_iter().map(T::from_f64).collect()
        });
        Self {
            projection: (0..n * n).map(|i| T::from_f64(projection(i / n, i % n))).collect(),
            nodes: nodes.into_iter().map(T::from_f64).collect(),
            halves,
        }
    }

    /// Number of nodes, and of polynomials.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The k-th node of the n × n × n grid in [−1, 1]³; the last axis runs fastest.
    pub(crate) fn grid_node(&self, k: usize) -> Point<T> {
        let (n, nodes) = (self.len(), &self.nodes);
        Point::<T>::from_array([nodes[k / (n * n)], nodes[k / n % n], nodes[k % n]])
    }

    /// All nodes of the grid.
    pub(crate) fn grid(&self) -> impl Iterator<Item = Point<T>> {
        (0..self.len().pow(3)).map(|k| self.grid_node(k))
    }

    /// Turns values at the grid's nodes into coefficients of T̂_i(x) T̂_j(y) T̂_k(z), in every array of n³.
    pub(crate) fn coefficients<S: Scalar<Real = T>>(&self, values: &mut [S]) {
        along_axes([&self.projection; 3], false, self.len(), values);
    }

    /// Turns weights of the polynomials into weights of the nodes with the same effect on every f: the
    /// transpose of [`coefficients`](Self::coefficients).
    pub(crate) fn node_weights<S: Scalar<Real = T>>(&self, weights: &mut [S]) {
        along_axes([&self.projection; 3], true, self.len(), weights);
    }

    /// Applies the matrices of the halves that an octant is made of: to moments of the octant, which
    /// become those of the whole; transposed, to a field of the whole, which becomes that of the octant.
    pub(crate) fn shift<S: Scalar<Real = T>>(
        &self,
        octant: usize,
        transposed: bool,
        arrays: &mut [S],
    ) {
        let halves = [0, 1, 2].map(|axis| &self.halves[octant >> axis & 1][..]);
        along_axes(halves, transposed, self.len(), arrays);
    }
}

/// Applies n × n matrices, or their transposes, along the first, second and last axis of every array of
/// n³.
fn along_axes<S: Scalar>(matrices: [&[S::Real]; 3], transposed: bool, n: usize, arrays: &mut [S]) {
    let columns = matrices.map(|matrix| {
        let at = |i: usize| if transposed { matrix[i] } else { matrix[i % n * n + i / n] };
        (0..n * n).map(|i| S::from_real(at(i))).collect::<Vec<S>>()
    });
    dispatch(AlongAxes { columns: columns.each_ref().map(|c| &c[..]), n, arrays });
}

/// to[j] = Σ_k h[j, k] from[k] along each axis in turn, with h by its columns.
struct AlongAxes<'a, S> {
    columns: [&'a [S]; 3],
    n: usize,
    arrays: &'a mut [S],
}

impl<S: Scalar> WithSimd for AlongAxes<'_, S> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { columns: [first, second, last], n, arrays } = self;
        let mut from = vec![<S as Numbers>::zero(); n * n * n];
        for array in arrays.chunks_exact_mut(n * n * n) {
            for (columns, inner) in [(first, n * n), (second, n)] {
                from.copy_from_slice(array);
                for (from, to) in
                    from.chunks_exact(n * inner).zip(array.chunks_exact_mut(n * inner))
                {
                    for (j, to) in to.chunks_exact_mut(inner).enumerate() {
                        to.fill(<S as Numbers>::zero());
                        for (k, from) in from.chunks_exact(inner).enumerate() {
                            let h = columns[k * n + j];
                            for (to, &from) in to.iter_mut().zip(from) {
                                *to += h * from;
                            }
                        }
                    }
                }
            }
            from.copy_from_slice(array);
            for (from, to) in from.chunks_exact(n).zip(array.chunks_exact_mut(n)) {
                to.fill(<S as Numbers>::zero());
                for (&from, column) in from.iter().zip(last.chunks_exact(n)) {
                    for (to, &h) in to.iter_mut().zip(column) {
                        *to += h * from;
                    }
                }
            }
        }
    }
}

/// Writes T̂_0(x) … T̂_{n−1}(x).
pub(crate) fn polynomials<T: Float>(x: T, values: &mut [T]) {
    polynomials_in_lanes(&[x], values.as_chunks_mut().0);
}

/// Writes T̂_0(x) … T̂_{n−1}(x) of several x side by side.
#[inline(always)]
pub(crate) fn polynomials_in_lanes<T: Float, const L: usize>(x: &[T; L], values: &mut [[T; L]]) {
    let one = T::one();
    let root_two = (one + one).sqrt();
    // T_{−1} = T_1 = x starts the recurrence T_{j+1} = 2x T_j − T_{j−1}.
    let (mut previous, mut current) = (*x, [one; L]);
    for (j, value) in values.iter_mut().enumerate() {
        for lane in 0..L {
            value[lane] = if j == 0 { one } else { root_two * current[lane] };
            let next = (x[lane] + x[lane]) * current[lane] - previous[lane];
            (previous[lane], current[lane]) = (current[lane], next);
        }
    }
}

/// Writes dT̂_j/dx of several x side by side, by T_j' = j U_{j−1}.
#[inline(always)]
pub(crate) fn derivatives_in_lanes<T: Real, const L: usize>(x: &[T; L], values: &mut [[T; L]]) {
    let root_two = T::SQRT_2();
    let (mut previous, mut second_kind) = ([T::from_f64(-1.0); L], [T::from_f64(0.0); L]);
    for (j, value) in values.iter_mut().enumerate() {
        let factor = root_two * T::from_f64(j as f64);
        for lane in 0..L {
            value[lane] = factor * second_kind[lane];
            let next = (x[lane] + x[lane]) * second_kind[lane] - previous[lane];
            (previous[lane], second_kind[lane]) = (second_kind[lane], next);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::DVec3;

    /// A polynomial of degree 4 and its derivative.
    fn quartic(x: f64) -> (f64, f64) {
        (1.0 + x * (2.0 - x * (3.0 + x * (0.5 - x))), 2.0 - 6.0 * x - 1.5 * x * x + 4.0 * x.powi(3))
    }

    fn cube(p: DVec3) -> f64 {
        quartic(p.x).0 * quartic(0.3 - p.y).0 * quartic(0.5 * p.z).0
    }

    fn coefficients(rule: &Chebyshev<f64>) -> Vec<f64> {
        let mut values: Vec<f64> = rule.grid().map(cube).collect();
        rule.coefficients(&mut values);
        values
    }

    #[test]
    fn polynomials_below_the_order_are_exact() {
        let rule = Chebyshev::<f64>::new(5);
        let coefficients = coefficients(&rule);
        for p in [DVec3::new(-1.0, 0.2, 1.0), DVec3::new(0.7, -0.9, 0.0)] {
            let [mut x, mut y, mut z] = [[0.0; 5]; 3];
            for (values, at) in [(&mut x, p.x), (&mut y, p.y), (&mut z, p.z)] {
                polynomials(at, values);
            }
            let mut sum = 0.0;
            for (i, c) in coefficients.iter().enumerate() {
                sum += c * x[i / 25] * y[i / 5 % 5] * z[i % 5];
            }
            assert_relative_eq!(sum, cube(p), epsilon = 1e-13);
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let (mut d, mut above, mut below) = ([0.0; 7], [0.0; 7], [0.0; 7]);
        for x in [-0.9, 0.0, 0.4] {
            derivatives_in_lanes(&[x], d.as_chunks_mut().0);
            polynomials(x + 1e-6, &mut above);
            polynomials(x - 1e-6, &mut below);
            for j in 0..7 {
                assert_relative_eq!(d[j], (above[j] - below[j]) / 2e-6, epsilon = 1e-7);
            }
        }
    }

    #[test]
    fn halves_express_the_whole() {
        let n = 5;
        let rule = Chebyshev::<f64>::new(n);
        let (mut whole, mut part) = (vec![0.0; n], vec![0.0; n]);
        for (half, shift) in [(0, -0.5), (1, 0.5)] {
            for x in [-1.0, 0.3, 0.8] {
                polynomials(0.5 * x + shift, &mut whole);
                polynomials(x, &mut part);
                for (row, &value) in rule.halves[half].chunks_exact(n).zip(&whole) {
                    let sum: f64 = row.iter().zip(&part).map(|(a, b)| a * b).sum();
                    assert_relative_eq!(sum, value, epsilon = 1e-13);
                }
            }
        }
    }

    #[test]
    fn node_weights_transpose_coefficients() {
        let rule = Chebyshev::<f64>::new(4);
        let value = |i: usize| (i as f64).sin();
        let (mut f, mut w): (Vec<f64>, Vec<f64>) =
            (0..64).map(|i| (value(i), value(i + 99))).unzip();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (values, weights) = (f.clone(), w.clone());
        rule.coefficients(&mut f);
        rule.node_weights(&mut w);
        assert_relative_eq!(dot(&f, &weights), dot(&values, &w), epsilon = 1e-13);
    }
}
