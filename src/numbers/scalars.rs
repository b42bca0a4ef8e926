//! The two precisions and the complex numbers over them.

use glam::{DVec3, Vec3};
use num_complex::Complex;

use crate::numbers::traits::{Real, Scalar, sealed};

macro_rules! scalars {
    ($t:ty, $vector:ty) => {
        impl sealed::Sealed for $t {}
        impl sealed::Sealed for Complex<$t> {}

        impl Scalar for $t {
            const COMPLEX: bool = false;
            #[inline(always)]
            fn from_real(x: $t) -> Self {
                x
            }
            #[inline(always)]
            fn from_parts(re: $t, _: $t) -> Self {
                re
            }
            #[inline(always)]
            fn parts(self) -> [$t; 2] {
                [self, 0.0]
            }
            #[inline(always)]
            fn conjugate(self) -> Self {
                self
            }
            type Single = f32;
            #[inline(always)]
            fn to_single(self) -> f32 {
                self as f32
            }
            #[inline(always)]
            fn from_single(single: f32) -> Self {
                <$t>::from(single)
            }
            #[inline(always)]
            fn modulus(self) -> $t {
                self.abs()
            }
        }

        impl Real for $t {
            type Vector = $vector;
            type Complex = Complex<$t>;
            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn as_f64(self) -> f64 {
                self as f64
            }
        }

        impl Scalar for Complex<$t> {
            const COMPLEX: bool = true;
            #[inline(always)]
            fn from_real(x: $t) -> Self {
                Complex::new(x, 0.0)
            }
            #[inline(always)]
            fn from_parts(re: $t, im: $t) -> Self {
                Complex::new(re, im)
            }
            #[inline(always)]
            fn parts(self) -> [$t; 2] {
                [self.re, self.im]
            }
            #[inline(always)]
            fn conjugate(self) -> Self {
                self.conj()
            }
            type Single = Complex<f32>;
            #[inline(always)]
            fn to_single(self) -> Complex<f32> {
                Complex::new(self.re as f32, self.im as f32)
            }
            #[inline(always)]
            fn from_single(single: Complex<f32>) -> Self {
                Complex::new(<$t>::from(single.re), <$t>::from(single.im))
            }
            #[inline(always)]
            fn modulus(self) -> $t {
                self.norm()
            }
        }
    };
}

scalars!(f32, Vec3);
scalars!(f64, DVec3);
