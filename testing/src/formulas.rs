//! Kernels that are formulas of two positions; r = |x − y|.

use farfield::{FnKernel, Point, Real, Vector, from_fn};
use glam::{DMat3, DVec3};
use num_complex::Complex;

/// exp(−r/h)/r
pub fn yukawa<T: Real>(h: T) -> FnKernel<impl Formula<T>, Point<T>, T> {
    let formula = move |x: Point<T>, y: Point<T>| {
        let r = (x - y).length_squared().sqrt();
        (-r / h).exp() / r
    };
    from_fn(formula).skip_coincident()
}

/// exp(−(r/h)²)
pub fn gaussian<T: Real>(h: T) -> FnKernel<impl Formula<T>, Point<T>, T> {
    let inverse = (h * h).recip();
    from_fn(move |x: Point<T>, y: Point<T>| (-inverse * (x - y).length_squared()).exp())
}

/// log(r/h)
pub fn log(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    from_fn(move |x: DVec3, y: DVec3| (x.distance(y) / h).ln()).skip_coincident()
}

/// (r/h)³
pub fn cube(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    from_fn(move |x: DVec3, y: DVec3| {
        let r = x.distance(y) / h;
        r * r * r
    })
}

/// exp(ikr)/r with kh = 3
pub fn helmholtz(
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
pub fn anisotropic() -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let stretched = |x: DVec3, y: DVec3| {
        let d = x - y;
        1.0 / d.dot(CONDUCTIVITY * d).sqrt()
    };
    from_fn(stretched).skip_coincident()
}

/// Matérn's covariance of smoothness 5/2, (1 + s + s²/3) exp(−s) with s = √5 r/h
pub fn matern(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let scale = 5f64.sqrt() / h;
    from_fn(move |x: DVec3, y: DVec3| {
        let s = scale * x.distance(y);
        (1.0 + s + s * s / 3.0) * (-s).exp()
    })
}

/// √(r² + h²/16)
pub fn multiquadric(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let shape = h * h / 16.0;
    from_fn(move |x: DVec3, y: DVec3| (x.distance_squared(y) + shape).sqrt())
}

/// r log(r/h)
pub fn r_log_r(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let formula = move |x: DVec3, y: DVec3| {
        let r = x.distance(y);
        r * (r / h).ln()
    };
    from_fn(formula).skip_coincident()
}

/// 1/(1 + (r/h)²)
pub fn inverse_quadratic(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let inverse = 1.0 / (h * h);
    from_fn(move |x: DVec3, y: DVec3| 1.0 / (1.0 + inverse * x.distance_squared(y)))
}

/// exp(−(x − y)ᵀ M (x − y)/h²), M full
pub fn anisotropic_gaussian(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let inverse = 1.0 / (h * h);
    from_fn(move |x: DVec3, y: DVec3| {
        let d = x - y;
        (-inverse * d.dot(CONDUCTIVITY * d)).exp()
    })
}

/// A real function of two points.
pub trait Formula<T: Real>: Fn(Point<T>, Point<T>) -> T + Copy + Send + Sync {}

impl<T: Real, F: Fn(Point<T>, Point<T>) -> T + Copy + Send + Sync> Formula<T> for F {}

/// A positive definite matrix without a zero: no reflection of an axis leaves its form unchanged.
const CONDUCTIVITY: DMat3 = DMat3::from_cols(
    DVec3::new(1.5, 0.3, -0.2),
    DVec3::new(0.3, 1.0, 0.2),
    DVec3::new(-0.2, 0.2, 0.8),
);
