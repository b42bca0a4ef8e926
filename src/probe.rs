//! Looking at a kernel from outside: what holds is measured on sample points, never declared.

use num_traits::Float;

use crate::chebyshev::Chebyshev;
use crate::expansion::Geometry;
use crate::geometry::Cube;
use crate::kernel::PointKernel;
use crate::real::{Additive, Point, Real, Scalar, Vector};

/// Sample points per cell.
const SAMPLES: usize = 12;

/// Far fields smaller than this fraction of what neighbouring cells exchange are held to its level,
/// not to their own: a kernel that has died out needs no digits.
const NEAR_FRACTION: f64 = 0.1;

/// Whether K(x + s, y + s) = K(x, y) to round-off for sample pairs and shifts within `root`.
pub(crate) fn translation_invariant<K: PointKernel>(kernel: &K, root: &Cube<K::Real>) -> bool {
    let len = K::FIELDS * K::DENSITIES;
    let (mut here, mut there) = (vec![zero::<K>(); len], vec![zero::<K>(); len]);
    let h = root.half_width();
    let tolerance = <K::Real as Float>::epsilon().as_f64().sqrt();
    (0..SAMPLES).all(|i| {
        let [x, y, shift] = [3 * i, 3 * i + 1, 3 * i + 2].map(|k| sample::<K::Real>(k) * h);
        let (x, y) = (root.centre() + x, root.centre() + y);
        kernel.entries(x, y, &mut here);
        kernel.entries(x + shift, y + shift, &mut there);
        let (mut difference, mut size) = (0.0f64, 0.0f64);
        for (&a, &b) in here.iter().zip(&there) {
            difference += (a - b).norm_squared();
            size += a.norm_squared() + b.norm_squared();
        }
        difference.sqrt() <= tolerance * size.sqrt()
    })
}

/// The largest relative error, over levels and directions, of interpolating the kernel between cells
/// that are barely well separated: what a pair of cells at integer distance 2 along an axis loses.
pub(crate) fn interpolation_error<K: PointKernel>(
    kernel: &K,
    rule: &Chebyshev<K::Real>,
    geometry: &Geometry<K::Real>,
) -> f64 {
    let mut worst = 0.0f64;
    for level in &geometry.levels {
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut direction = [0.0; 3];
                direction[axis] = sign;
                let pair = Pair { kernel, rule, root: &geometry.root, direction };
                worst = worst.max(pair.error(level.half_width));
            }
        }
    }
    worst
}

/// The i-th point of a low-discrepancy sequence in [−1, 1]³ (Roberts' R₃).
fn sample<T: Real>(i: usize) -> Point<T> {
    const STEPS: [f64; 3] =
        [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];
    Point::<T>::from_array(
        STEPS.map(|a| T::from_f64(2.0 * (0.5 + a * (i + 1) as f64).fract() - 1.0)),
    )
}

fn zero<K: PointKernel>() -> K::Entry {
    K::Entry::from_real(K::Real::from_f64(0.0))
}

/// A source cell at the root's centre and a target cell some cells away along an axis.
struct Pair<'a, K: PointKernel> {
    kernel: &'a K,
    rule: &'a Chebyshev<K::Real>,
    root: &'a Cube<K::Real>,
    direction: [f64; 3],
}

impl<K: PointKernel> Pair<'_, K> {
    fn error(&self, half_width: K::Real) -> f64 {
        let cell = self.root.centre();
        let far = cell + self.step(4.0, half_width);
        let points = |centre, first| -> Vec<_> {
            (first..first + SAMPLES).map(|i| centre + sample::<K::Real>(i) * half_width).collect()
        };
        let (ys, xs) = (points(cell, 0), points(far, SAMPLES));
        let mut errors = 0.0f64;
        let mut size = 0.0f64;
        for (side, (centre, points, others)) in
            [(cell, &ys, &xs), (far, &xs, &ys)].into_iter().enumerate()
        {
            let entries = |p, o| if side == 0 { self.entries(o, p) } else { self.entries(p, o) };
            for (i, &p) in points.iter().enumerate() {
                let weights = self.weights(i + side * SAMPLES);
                for &o in others {
                    let mut difference = entries(p, o);
                    size += 0.5 * difference.iter().map(|g| g.norm_squared()).sum::<f64>();
                    for (node, &weight) in self.nodes(centre, half_width).zip(&weights) {
                        for (d, g) in difference.iter_mut().zip(entries(node, o)) {
                            *d -= g * K::Entry::from_real(weight);
                        }
                    }
                    errors += difference.iter().map(|g| g.norm_squared()).sum::<f64>();
                }
            }
        }
        let pairs = (SAMPLES * SAMPLES) as f64;
        let near = self.entries(cell + self.step(2.0, half_width), cell);
        let near = near.iter().map(|g| g.norm_squared()).sum::<f64>().sqrt();
        let size = (size / pairs).sqrt().max(NEAR_FRACTION * near);
        if errors == 0.0 { 0.0 } else { (errors / pairs).sqrt() / size }
    }

    fn step(&self, half_widths: f64, half_width: K::Real) -> Point<K::Real> {
        let direction = self.direction.map(|d| K::Real::from_f64(half_widths * d));
        Point::<K::Real>::from_array(direction) * half_width
    }

    fn entries(&self, x: Point<K::Real>, y: Point<K::Real>) -> Vec<K::Entry> {
        let mut g = vec![zero::<K>(); K::FIELDS * K::DENSITIES];
        self.kernel.entries(x, y, &mut g);
        g
    }

    /// Weights of all n³ nodes at the i-th sample point.
    fn weights(&self, i: usize) -> Vec<K::Real> {
        let n = self.rule.len();
        let axes = sample::<K::Real>(i).to_array().map(|x| {
            let mut weights = vec![K::Real::from_f64(0.0); n];
            self.rule.weights(x, &mut weights);
            weights
        });
        (0..n * n * n).map(|k| axes[0][k / (n * n)] * axes[1][k / n % n] * axes[2][k % n]).collect()
    }

    fn nodes(
        &self,
        centre: Point<K::Real>,
        half_width: K::Real,
    ) -> impl Iterator<Item = Point<K::Real>> {
        let (n, nodes) = (self.rule.len(), self.rule.nodes());
        (0..n * n * n).map(move |k| {
            let node = [nodes[k / (n * n)], nodes[k / n % n], nodes[k % n]];
            centre + Point::<K::Real>::from_array(node) * half_width
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expansion::Level;
    use crate::kernel::from_fn;
    use glam::DVec3;

    fn geometry(half_width: f64) -> Geometry<f64> {
        let root = Cube::new(DVec3::ZERO, 4.0 * half_width);
        Geometry { root, levels: vec![Level { level: 2, half_width, offsets: vec![] }] }
    }

    #[test]
    fn invariance_is_seen_and_its_absence_too() {
        let root = Cube::new(DVec3::new(3.0, 0.0, -1.0), 2.0);
        let invariant = from_fn(|x: DVec3, y: DVec3| (x - y).x.exp());
        assert!(translation_invariant(&invariant, &root));
        let variant = from_fn(|x: DVec3, y: DVec3| (x - y).x.exp() * (1.0 + 1e-3 * x.y));
        assert!(!translation_invariant(&variant, &root));
    }

    #[test]
    fn the_error_falls_with_the_order_and_vanishes_for_polynomials() {
        let inverse = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y));
        let error = |n| interpolation_error(&inverse, &Chebyshev::new(n), &geometry(0.5));
        assert!(error(3) < 0.1 && error(6) < 1e-2 * error(3) && error(9) < 1e-2 * error(6));
        let squared = from_fn(|x: DVec3, y: DVec3| x.distance_squared(y));
        assert!(interpolation_error(&squared, &Chebyshev::new(3), &geometry(0.5)) < 1e-14);
    }

    #[test]
    fn a_kernel_that_has_died_out_needs_no_digits() {
        let gaussian = from_fn(|x: DVec3, y: DVec3| (-x.distance_squared(y)).exp());
        assert!(interpolation_error(&gaussian, &Chebyshev::new(2), &geometry(50.0)) < 1e-6);
    }
}
