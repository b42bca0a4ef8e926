//! The kernels, each with the one in double precision that judges it.

use farfield::{Point, PointKernel, Real, from_fn};
use farfield_potentials::{InverseDistance, InverseFourth, PotentialGradient};
use glam::{DMat3, DVec3};
use num_complex::Complex;

use crate::args::{KernelName, Precision};

/// A kernel between bare points whose charges and values a measurement can read.
pub(crate) trait Summed<T: Real>:
    PointKernel<Real = T, Source = Point<T>, Target = Point<T>, Charge: Charge, Value: Value> + Copy
{
}

impl<T: Real, K> Summed<T> for K where
    K: PointKernel<Real = T, Source = Point<T>, Target = Point<T>, Charge: Charge, Value: Value>
        + Copy
{
}

/// What is done with a kernel, whatever its type.
pub(crate) trait Visit {
    /// `reference` is the same kernel in double precision.
    fn visit<T: Real, K: Summed<T>, R: Summed<f64>>(&mut self, kernel: K, reference: R);
}

/// Calls `visit` with the kernel of the given name for a cloud of half-width `h`; false if there is
/// no such kernel in this precision, or none with a gradient.
pub(crate) fn with_kernel(
    name: KernelName,
    precision: Precision,
    gradient: bool,
    h: f64,
    visit: &mut impl Visit,
) -> bool {
    use KernelName as K;
    match (name, precision, gradient) {
        (K::InverseDistance, _, _) => {
            let (f32s, f64s) = (InverseDistance::<f32>::new(), InverseDistance::<f64>::new());
            match (precision, gradient) {
                (Precision::F64, false) => visit.visit(f64s, f64s),
                (Precision::F64, true) => visit.visit(f64s.with_gradient(), f64s.with_gradient()),
                (Precision::F32, false) => visit.visit(f32s, f64s),
                (Precision::F32, true) => visit.visit(f32s.with_gradient(), f64s.with_gradient()),
            }
        }
        (K::InverseFourth, _, _) => {
            let (f32s, f64s) = (InverseFourth::<f32>::new(), InverseFourth::<f64>::new());
            match (precision, gradient) {
                (Precision::F64, false) => visit.visit(f64s, f64s),
                (Precision::F64, true) => visit.visit(f64s.with_gradient(), f64s.with_gradient()),
                (Precision::F32, false) => visit.visit(f32s, f64s),
                (Precision::F32, true) => visit.visit(f32s.with_gradient(), f64s.with_gradient()),
            }
        }
        (_, Precision::F32, _) | (_, _, true) => return false,
        (K::Yukawa, ..) => {
            let kernel = from_fn(move |x: DVec3, y: DVec3| {
                let r = x.distance(y);
                (-r / h).exp() / r
            });
            visit.visit(kernel.skip_coincident(), kernel.skip_coincident());
        }
        (K::Gaussian, ..) => {
            let inverse = 1.0 / (h * h);
            let formula = move |x: DVec3, y: DVec3| (-inverse * x.distance_squared(y)).exp();
            visit.visit(from_fn(formula), from_fn(formula));
        }
        (K::Log, ..) => {
            let formula = move |x: DVec3, y: DVec3| (x.distance(y) / h).ln();
            let kernel = from_fn(formula).skip_coincident();
            visit.visit(kernel, kernel);
        }
        (K::R3, ..) => {
            let cube = move |x: DVec3, y: DVec3| {
                let r = x.distance(y) / h;
                r * r * r
            };
            visit.visit(from_fn(cube), from_fn(cube));
        }
        (K::Helmholtz, ..) => {
            let k = 3.0 / h;
            let wave = move |x: DVec3, y: DVec3| {
                let r = x.distance(y);
                let (sin, cos) = (k * r).sin_cos();
                Complex::new(cos / r, sin / r)
            };
            let kernel = from_fn(wave).skip_coincident();
            visit.visit(kernel, kernel);
        }
        (K::Anisotropic, ..) => {
            let stretched = |x: DVec3, y: DVec3| {
                let d = x - y;
                1.0 / d.dot(CONDUCTIVITY * d).sqrt()
            };
            let kernel = from_fn(stretched).skip_coincident();
            visit.visit(kernel, kernel);
        }
    }
    true
}

/// Half the longest side of the bounding box.
pub(crate) fn half_width(points: &[DVec3]) -> f64 {
    let Some(&first) = points.first() else { return 1.0 };
    let (low, high) = points.iter().fold((first, first), |(l, h), &p| (l.min(p), h.max(p)));
    let half = 0.5 * (high - low).max_element();
    if half > 0.0 { half } else { 1.0 }
}

/// A positive definite matrix without a zero: no reflection of an axis leaves its form unchanged.
const CONDUCTIVITY: DMat3 = DMat3::from_cols(
    DVec3::new(1.5, 0.3, -0.2),
    DVec3::new(0.3, 1.0, 0.2),
    DVec3::new(-0.2, 0.2, 0.8),
);

/// What a source carries.
pub(crate) trait Charge {
    /// The charge of this size.
    fn of(q: f64) -> Self;
}

/// What a target receives.
pub(crate) trait Value {
    /// Real and imaginary part of the potential.
    fn potential(&self) -> [f64; 2];
    /// The gradient, zero if there is none.
    fn gradient(&self) -> [f64; 3];
}

impl Charge for Complex<f64> {
    fn of(q: f64) -> Self {
        q.into()
    }
}

macro_rules! real {
    ($t:ty) => {
        impl Charge for $t {
            fn of(q: f64) -> Self {
                Real::from_f64(q)
            }
        }

        impl Value for $t {
            fn potential(&self) -> [f64; 2] {
                [self.as_f64(), 0.0]
            }

            fn gradient(&self) -> [f64; 3] {
                [0.0; 3]
            }
        }
    };
}

real!(f32);
real!(f64);

impl Value for Complex<f64> {
    fn potential(&self) -> [f64; 2] {
        [self.re, self.im]
    }

    fn gradient(&self) -> [f64; 3] {
        [0.0; 3]
    }
}

impl<T: Real> Value for PotentialGradient<T> {
    fn potential(&self) -> [f64; 2] {
        [self.potential.as_f64(), 0.0]
    }

    fn gradient(&self) -> [f64; 3] {
        self.gradient.map(Real::as_f64)
    }
}
