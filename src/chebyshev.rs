//! Interpolation at Chebyshev nodes of the first kind on [−1, 1] and on tensor grids of them: pure
//! numerics.

use crate::real::{Point, Real, Vector};

/// The nodes x_k = cos((k + ½) π / n) and what is needed to interpolate at them.
#[derive(Clone, Debug)]
pub(crate) struct Chebyshev<T> {
    nodes: Vec<T>,
    /// (2 − δ_j0)/n · T_j(x_k), row k.
    transform: Vec<T>,
    /// For the lower and the upper half: S_k at node a of the half, row a.
    halves: [Vec<T>; 2],
}

impl<T: Real> Chebyshev<T> {
    /// The rule with `n` ≥ 1 nodes.
    pub(crate) fn new(n: usize) -> Self {
        let angle = |k: usize| (k as f64 + 0.5) * std::f64::consts::PI / n as f64;
        let nodes: Vec<T> = (0..n).map(|k| T::from_f64(angle(k).cos())).collect();
        let transform = (0..n * n)
            .map(|i| {
                let (k, j) = (i / n, i % n);
                let factor = if j == 0 { 1.0 } else { 2.0 };
                T::from_f64(factor / n as f64 * (j as f64 * angle(k)).cos())
            })
            .collect();
        let mut rule = Self { nodes, transform, halves: [Vec::new(), Vec::new()] };
        for (half, shift) in [(0, -0.5), (1, 0.5)] {
            let mut matrix = vec![T::from_f64(0.0); n * n];
            for (a, row) in matrix.chunks_exact_mut(n).enumerate() {
                let x = T::from_f64(0.5) * rule.nodes[a] + T::from_f64(shift);
                rule.weights(x, row);
            }
            rule.halves[half] = matrix;
        }
        rule
    }

    /// Number of nodes.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The k-th node of the n × n × n grid in [−1, 1]³; the last axis runs fastest.
    pub(crate) fn grid_node(&self, k: usize) -> Point<T> {
        let (n, nodes) = (self.len(), &self.nodes);
        Point::<T>::from_array([nodes[k / (n * n)], nodes[k / n % n], nodes[k % n]])
    }

    /// The matrix that takes values at the nodes to values at the nodes of the lower (0) or upper
    /// (1) half, row after row.
    pub(crate) fn half(&self, half: usize) -> &[T] {
        &self.halves[half]
    }

    /// Writes S_k(x) = 1/n + 2/n Σ_{j≥1} T_j(x_k) T_j(x): the weight of node k at x.
    pub(crate) fn weights(&self, x: T, weights: &mut [T]) {
        let n = self.len();
        for (weight, row) in weights.iter_mut().zip(self.transform.chunks_exact(n)) {
            let (mut previous, mut polynomial) = (x, T::from_f64(1.0));
            let mut sum = T::from_f64(0.0);
            for &factor in row {
                sum += factor * polynomial;
                let next = x * polynomial + x * polynomial - previous;
                previous = polynomial;
                polynomial = next;
            }
            *weight = sum;
        }
    }

    /// Writes dS_k/dx, by T_j' = j U_{j−1}.
    pub(crate) fn derivatives(&self, x: T, derivatives: &mut [T]) {
        let n = self.len();
        for (derivative, row) in derivatives.iter_mut().zip(self.transform.chunks_exact(n)) {
            let (mut previous, mut second_kind) = (T::from_f64(0.0), T::from_f64(1.0));
            let mut sum = T::from_f64(0.0);
            for (j, &factor) in row.iter().enumerate().skip(1) {
                sum += factor * T::from_f64(j as f64) * second_kind;
                let next = x * second_kind + x * second_kind - previous;
                previous = second_kind;
                second_kind = next;
            }
            *derivative = sum;
        }
    }
}

/// Interpolation weights of all nodes of a cell at one point.
pub(crate) struct Weights<T> {
    axes: [Vec<T>; 3],
}

impl<T: Real> Weights<T> {
    pub(crate) fn new(n: usize) -> Self {
        Self { axes: std::array::from_fn(|_| vec![T::from_f64(0.0); n]) }
    }

    /// Takes the weights at `p`, in normalised coordinates.
    pub(crate) fn set(&mut self, rule: &Chebyshev<T>, p: Point<T>) {
        for (weights, x) in self.axes.iter_mut().zip(p.to_array()) {
            rule.weights(x, weights);
        }
    }

    /// Replaces the weights along one axis by their derivatives at `p`.
    pub(crate) fn differentiate(&mut self, rule: &Chebyshev<T>, axis: usize, p: Point<T>) {
        rule.derivatives(p.to_array()[axis], &mut self.axes[axis]);
    }

    /// The products w_i w_j w_k in the order of the nodes.
    pub(crate) fn products(&self) -> impl Iterator<Item = T> {
        let [x, y, z] = &self.axes;
        x.iter().flat_map(move |&wx| {
            y.iter().flat_map(move |&wy| {
                let wxy = wx * wy;
                z.iter().map(move |&wz| wxy * wz)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// A polynomial of degree 4 and its derivative.
    fn quartic(x: f64) -> (f64, f64) {
        (1.0 + x * (2.0 - x * (3.0 + x * (0.5 - x))), 2.0 - 6.0 * x - 1.5 * x * x + 4.0 * x.powi(3))
    }

    fn interpolate(weights: &[f64], values: &[f64]) -> f64 {
        weights.iter().zip(values).map(|(w, v)| w * v).sum()
    }

    #[test]
    fn polynomials_below_the_order_are_exact() {
        let rule = Chebyshev::<f64>::new(5);
        let values: Vec<f64> = rule.nodes.iter().map(|&x| quartic(x).0).collect();
        let mut weights = [0.0; 5];
        for x in [-1.0, -0.3, 0.0, 0.77, 1.0] {
            rule.weights(x, &mut weights);
            assert_relative_eq!(interpolate(&weights, &values), quartic(x).0, epsilon = 1e-14);
            rule.derivatives(x, &mut weights);
            assert_relative_eq!(interpolate(&weights, &values), quartic(x).1, epsilon = 1e-13);
        }
    }

    #[test]
    fn halves_move_values_to_the_nodes_of_the_half() {
        let rule = Chebyshev::<f64>::new(5);
        let values: Vec<f64> = rule.nodes.iter().map(|&x| quartic(x).0).collect();
        for (half, shift) in [(0, -0.5), (1, 0.5)] {
            for (a, row) in rule.half(half).chunks_exact(5).enumerate() {
                let exact = quartic(0.5 * rule.nodes[a] + shift).0;
                assert_relative_eq!(interpolate(row, &values), exact, epsilon = 1e-14);
            }
        }
    }

    #[test]
    fn one_node_is_the_constant() {
        let rule = Chebyshev::<f32>::new(1);
        let mut weights = [0.0; 1];
        rule.weights(0.3, &mut weights);
        assert_eq!(weights, [1.0]);
        rule.derivatives(0.3, &mut weights);
        assert_eq!(weights, [0.0]);
    }
}
