//! More kernels that are formulas of two positions; r = |x − y|.

use farfield::{FnKernel, from_fn};
use glam::DVec3;

use crate::formulas::{CONDUCTIVITY, Formula};

/// Matérn's covariance of smoothness 5/2, (1 + s + s²/3) exp(−s) with s = √5 r/h
pub(crate) fn matern(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let scale = 5f64.sqrt() / h;
    from_fn(move |x: DVec3, y: DVec3| {
        let s = scale * x.distance(y);
        (1.0 + s + s * s / 3.0) * (-s).exp()
    })
}

/// √(r² + h²/16)
pub(crate) fn multiquadric(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let shape = h * h / 16.0;
    from_fn(move |x: DVec3, y: DVec3| (x.distance_squared(y) + shape).sqrt())
}

/// r log(r/h)
pub(crate) fn r_log_r(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let formula = move |x: DVec3, y: DVec3| {
        let r = x.distance(y);
        r * (r / h).ln()
    };
    from_fn(formula).skip_coincident()
}

/// 1/(1 + (r/h)²)
pub(crate) fn inverse_quadratic(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let inverse = 1.0 / (h * h);
    from_fn(move |x: DVec3, y: DVec3| 1.0 / (1.0 + inverse * x.distance_squared(y)))
}

/// exp(−(x − y)ᵀ M (x − y)/h²), M full
pub(crate) fn anisotropic_gaussian(h: f64) -> FnKernel<impl Formula<f64>, DVec3, f64> {
    let inverse = 1.0 / (h * h);
    from_fn(move |x: DVec3, y: DVec3| {
        let d = x - y;
        (-inverse * d.dot(CONDUCTIVITY * d)).exp()
    })
}
