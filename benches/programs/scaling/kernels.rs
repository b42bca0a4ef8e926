//! The kernels, each with the one in double precision that judges it.

use farfield::{Kernel, Point, Real};
use farfield_benches::cli::Precision;
use farfield_potentials::{InverseDistance, InverseFourth, PotentialGradient};
use farfield_testing::formulas::{anisotropic, cube, gaussian, helmholtz, log, yukawa};
use num_complex::Complex;

use crate::args::KernelName;

/// A kernel between bare points whose charges and values a measurement can read.
pub(crate) trait Summed<T: Real>:
    Kernel<Real = T, Source = Point<T>, Target = Point<T>, Charge: Charge, Value: Value> + Copy
{
}

impl<T: Real, K> Summed<T> for K where
    K: Kernel<Real = T, Source = Point<T>, Target = Point<T>, Charge: Charge, Value: Value> + Copy
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
        (K::Yukawa, ..) => same(visit, yukawa(h)),
        (K::Gaussian, ..) => same(visit, gaussian(h)),
        (K::Log, ..) => same(visit, log(h)),
        (K::R3, ..) => same(visit, cube(h)),
        (K::Helmholtz, ..) => same(visit, helmholtz(h)),
        (K::Anisotropic, ..) => same(visit, anisotropic()),
    }
    true
}

/// A kernel that judges itself.
fn same<K: Summed<f64>>(visit: &mut impl Visit, kernel: K) {
    visit.visit(kernel, kernel);
}

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
