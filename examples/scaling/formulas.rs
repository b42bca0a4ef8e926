//! Kernels that are formulas of two positions; r = |x − y|.

use farfield::{FnKernel, Point, Real, Vector, from_fn};
use glam::{DMat3, DVec3};
use num_complex::Complex;

/// Half the longest side of the bounding box.
pub(crate) fn half_width(points: &[DVec3]) -> f64 {
    let Some(&first) = points.first() else { return 1.0 };
    let (low, high) = points.iter().fold((first, first), |(l, h), &p| (l.min(p), h.max(p)));
    let half = 0.5 * (high - low).max_element();
    if half > 0.0 { half } else { 1.0 }
}

/// exp(−r/h)/r
pub(crate) fn yukawa<T: Real>(h: T) -> FnKernel<impl Formula<T>, Point<T>, T> {
    let formula = move |x: Point<T>, y: Point<T>| {
        let r = (x - y).length_squared().sqrt();
        (-r / h).exp() / r
    };
    from_fn(formula).skip_coincident()
}

/// exp(−(r/h)²)
pub(crate) fn gaussian<T: Real>(h: T) -> FnKernel<impl Formula<T>, Point<T>, T> {
    let inverse = (h * h).recip();
    from_fn(move |x: Point<T>, y: Point<T>| (-inverse * (x - y).length_squared()).exp())
}

/// log(r/h)
pub(crate) fn log(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    from_fn(move |x: DVec3, y: DVec3| (x.distance(y) / h).ln()).skip_coincident()
}

/// (r/h)³
pub(crate) fn cube(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    from_fn(move |x: DVec3, y: DVec3| {
        let r = x.distance(y) / h;
        r * r * r
    })
}

/// exp(ikr)/r with kh = 3
pub(crate) fn helmholtz(
    h: f64,
) -> FnKernel<impl Fn(DVec3, DVec3) -> Complex<f64> + Copy + Send + Sync, DVec3, Complex<f64>> {
    let k = 3.0 / h;
    let wave = move |x: DVec3, y: DVec3| {
        let r = x.distance(y);
        let (sin, cos) = (k * r).sin_cos();
        Complex::new(cos / r, sin / r)
    };
    from_fn(wave).skip_coincident()
}

/// 1/√((x − y)ᵀ M (x − y)), M full: stretched along axes that are not the tree's
pub(crate) fn anisotropic() -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let stretched = |x: DVec3, y: DVec3| {
        let d = x - y;
        1.0 / d.dot(CONDUCTIVITY * d).sqrt()
    };
    from_fn(stretched).skip_coincident()
}

/// A real function of two points.
pub(crate) trait Formula<T: Real>: Fn(Point<T>, Point<T>) -> T + Copy + Send + Sync {}

impl<T: Real, F: Fn(Point<T>, Point<T>) -> T + Copy + Send + Sync> Formula<T> for F {}

/// A positive definite matrix without a zero: no reflection of an axis leaves its form unchanged.
pub(crate) const CONDUCTIVITY: DMat3 = DMat3::from_cols(
    DVec3::new(1.5, 0.3, -0.2),
    DVec3::new(0.3, 1.0, 0.2),
    DVec3::new(-0.2, 0.2, 0.8),
);
