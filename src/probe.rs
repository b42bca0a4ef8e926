//! Looking at a kernel from outside: what holds is measured on sample points, never declared.

use num_traits::Float;

use crate::chebyshev::{Chebyshev, Weights};
use crate::expansion::Level;
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

/// The degree α with K(s x, s y) = s^α K(x, y) for all sample pairs and s = 2, 4, to round-off, if there
/// is one. Assumes translation invariance.
pub(crate) fn homogeneity<K: PointKernel>(kernel: &K, root: &Cube<K::Real>) -> Option<f64> {
    let h = root.half_width();
    let tolerance = <K::Real as Float>::epsilon().as_f64().sqrt();
    let entries = |d: Point<K::Real>, scale: f64| {
        let mut g = vec![zero::<K>(); K::FIELDS * K::DENSITIES];
        kernel.entries(d * K::Real::from_f64(scale), Point::<K::Real>::default(), &mut g);
        g
    };
    let differences = || (0..SAMPLES).map(|i| sample::<K::Real>(i) * h);
    let first = differences().next()?;
    let degree =
        0.5 * (norm_squared(&entries(first, 2.0)) / norm_squared(&entries(first, 1.0))).log2();
    let holds = |d| {
        let here = entries(d, 1.0);
        [2.0f64, 4.0].into_iter().all(|scale| {
            let factor = K::Entry::from_real(K::Real::from_f64(scale.powf(degree)));
            let there = entries(d, scale);
            let deviation: Vec<_> =
                here.iter().zip(&there).map(|(&a, &b)| b - factor * a).collect();
            norm_squared(&deviation) <= tolerance * tolerance * norm_squared(&there)
        })
    };
    (degree.is_finite() && differences().all(holds)).then_some(degree)
}

/// The largest relative error, over levels and directions, of interpolating the kernel between cells
/// that are barely well separated: what a pair of cells at integer distance 2 along an axis loses.
pub(crate) fn interpolation_error<K: PointKernel>(
    kernel: &K,
    rule: &Chebyshev<K::Real>,
    root: &Cube<K::Real>,
    levels: &[Level<K::Real>],
) -> f64 {
    let mut worst = 0.0f64;
    for level in levels {
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut direction = [0.0; 3];
                direction[axis] = sign;
                let pair = Pair { kernel, rule, root, direction };
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
        let len = K::FIELDS * K::DENSITIES;
        let (mut g, mut difference) = (vec![zero::<K>(); len], vec![zero::<K>(); len]);
        let (mut errors, mut size) = (0.0f64, 0.0f64);
        for (p_is_target, centre, points, others) in
            [(false, cell, &ys, &xs), (true, far, &xs, &ys)]
        {
            let entries = |p, o, g: &mut [K::Entry]| match p_is_target {
                true => self.kernel.entries(p, o, g),
                false => self.kernel.entries(o, p, g),
            };
            let nodes = self.nodes(centre, half_width);
            for (i, &p) in points.iter().enumerate() {
                let weights = self.weights(if p_is_target { i + SAMPLES } else { i });
                for &o in others {
                    entries(p, o, &mut difference);
                    size += 0.5 * norm_squared(&difference);
                    for (&node, &weight) in nodes.iter().zip(&weights) {
                        entries(node, o, &mut g);
                        for (d, &g) in difference.iter_mut().zip(&g) {
                            *d -= g * K::Entry::from_real(weight);
                        }
                    }
                    errors += norm_squared(&difference);
                }
            }
        }
        self.kernel.entries(cell + self.step(2.0, half_width), cell, &mut g);
        let pairs = (SAMPLES * SAMPLES) as f64;
        let size = (size / pairs).sqrt().max(NEAR_FRACTION * norm_squared(&g).sqrt());
        if errors == 0.0 { 0.0 } else { (errors / pairs).sqrt() / size }
    }

    fn step(&self, half_widths: f64, half_width: K::Real) -> Point<K::Real> {
        let direction = self.direction.map(|d| K::Real::from_f64(half_widths * d));
        Point::<K::Real>::from_array(direction) * half_width
    }

    /// Weights of all n³ nodes at the i-th sample point.
    fn weights(&self, i: usize) -> Vec<K::Real> {
        let mut weights = Weights::new(self.rule.len());
        weights.set(self.rule, sample::<K::Real>(i));
        weights.products().collect()
    }

    fn nodes(&self, centre: Point<K::Real>, half_width: K::Real) -> Vec<Point<K::Real>> {
        let node = |k| centre + self.rule.grid_node(k) * half_width;
        (0..self.rule.len().pow(3)).map(node).collect()
    }
}

fn zero<K: PointKernel>() -> K::Entry {
    <K::Entry as Additive>::zero()
}

fn norm_squared<S: Scalar>(g: &[S]) -> f64 {
    g.iter().map(Additive::norm_squared).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::from_fn;
    use glam::DVec3;

    fn error<K: PointKernel<Real = f64>>(kernel: &K, n: usize, half_width: f64) -> f64 {
        let root = Cube::new(DVec3::ZERO, 4.0 * half_width);
        let levels = [Level { level: 2, half_width, offsets: vec![] }];
        interpolation_error(kernel, &Chebyshev::new(n), &root, &levels)
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
    fn homogeneity_is_seen_and_its_absence_too() {
        let root = Cube::new(DVec3::ZERO, 2.0);
        let cubic = from_fn(|x: DVec3, y: DVec3| (x - y).x / x.distance(y).powi(4));
        approx::assert_relative_eq!(homogeneity(&cubic, &root).unwrap(), -3.0, epsilon = 1e-12);
        let yukawa = from_fn(|x: DVec3, y: DVec3| (-1e-3 * x.distance(y)).exp() / x.distance(y));
        assert_eq!(homogeneity(&yukawa, &root), None);
        let zero = from_fn(|_: DVec3, _: DVec3| 0.0);
        assert_eq!(homogeneity(&zero, &root), None);
    }

    #[test]
    fn the_error_falls_with_the_order_and_vanishes_for_polynomials() {
        let inverse = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y));
        let error_at = |n| error(&inverse, n, 0.5);
        let [three, six, nine] = [3, 6, 9].map(error_at);
        assert!(three < 0.1 && six < 1e-2 * three && nine < 1e-2 * six);
        let squared = from_fn(|x: DVec3, y: DVec3| x.distance_squared(y));
        assert!(error(&squared, 3, 0.5) < 1e-14);
    }

    #[test]
    fn a_kernel_that_has_died_out_needs_no_digits() {
        let gaussian = from_fn(|x: DVec3, y: DVec3| (-x.distance_squared(y)).exp());
        assert!(error(&gaussian, 2, 50.0) < 1e-6);
    }
}
