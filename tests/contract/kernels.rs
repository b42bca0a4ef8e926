//! Kernels that the engine knows nothing about, in units of a length of 1.

use glam::{DVec3, Vec3};
use num_complex::Complex;

/// A formula between two points.
pub(crate) type Formula<P, V> = fn(P, P) -> V;

/// Real kernels by name. As function pointers, all are one type.
pub(crate) const REALS: [(&str, Formula<DVec3, f64>); 14] = [
    ("1/r", |x, y| 1.0 / x.distance(y)),
    ("1/r⁴", |x, y| x.distance_squared(y).powi(-2)),
    ("1/r⁶", |x, y| x.distance_squared(y).powi(-3)),
    ("dipole", |x, y| (x - y).x / x.distance(y).powi(3)),
    ("Yukawa", |x, y| (-2.0 * x.distance(y)).exp() / x.distance(y)),
    ("Gaussian", |x, y| (-4.0 * x.distance_squared(y)).exp()),
    ("Matérn 3/2", |x, y| {
        let r = 3.0 * x.distance(y);
        (1.0 + r) * (-r).exp()
    }),
    ("1/(1+r²)", |x, y| 1.0 / (1.0 + x.distance_squared(y))),
    ("multiquadric", |x, y| (1.0 + 4.0 * x.distance_squared(y)).sqrt()),
    ("log r", |x, y| x.distance(y).ln()),
    ("r log r", |x, y| {
        let r = x.distance(y);
        r * r.ln()
    }),
    ("r²", |x, y| x.distance_squared(y)),
    ("r³", |x, y| x.distance(y).powi(3)),
    ("anisotropic Gaussian", |x, y| {
        let d = x - y;
        (-(3.0 * d.x * d.x + d.y * d.y + 2.0 * d.z * d.z + d.x * d.y - 0.5 * d.y * d.z)).exp()
    }),
];

/// Waves of one and of eight periods across the cube [−1, 1]³. As function pointers, both are one type.
pub(crate) const LONG_WAVE: Formula<DVec3, Complex<f64>> = |x, y| wave(3.0, x, y);
pub(crate) const SHORT_WAVE: Formula<DVec3, Complex<f64>> = |x, y| wave(25.0, x, y);

/// exp(ikr)/r
fn wave(k: f64, x: DVec3, y: DVec3) -> Complex<f64> {
    let r = x.distance(y);
    Complex::cis(k * r) / r
}

/// A formula by name, in single and in double precision.
pub(crate) type Single = (&'static str, Formula<Vec3, f32>, Formula<DVec3, f64>);

/// Kernels in single precision, each beside the same formula in double precision, which judges it.
pub(crate) const SINGLES: [Single; 5] = [
    ("1/r", |x, y| 1.0 / x.distance(y), |x, y| 1.0 / x.distance(y)),
    ("1/r⁴", |x, y| x.distance_squared(y).powi(-2), |x, y| x.distance_squared(y).powi(-2)),
    (
        "Gaussian",
        |x, y| (-4.0 * x.distance_squared(y)).exp(),
        |x, y| (-4.0 * x.distance_squared(y)).exp(),
    ),
    (
        "multiquadric",
        |x, y| (1.0 + 4.0 * x.distance_squared(y)).sqrt(),
        |x, y| (1.0 + 4.0 * x.distance_squared(y)).sqrt(),
    ),
    (
        "1/(1+r²)",
        |x, y| 1.0 / (1.0 + x.distance_squared(y)),
        |x, y| 1.0 / (1.0 + x.distance_squared(y)),
    ),
];
