//! Numbers, complex numbers, vectors, arrays and lists as a few numbers side by side.

use glam::{DVec3, Vec3};
use num_complex::Complex;

use crate::numbers::traits::{Numbers, Real, Scalar};

macro_rules! numbers {
    ($t:ty, $vector:ty) => {
        impl Numbers for $t {
            type Real = $t;
            const LEN: usize = 1;
            #[inline(always)]
            fn zero() -> Self {
                0.0
            }
            #[inline(always)]
            fn get(&self, _: usize) -> $t {
                *self
            }
            #[inline(always)]
            fn set(&mut self, _: usize, number: $t) {
                *self = number;
            }
            #[inline(always)]
            fn norm(&self) -> f64 {
                self.as_f64().abs()
            }
        }

        impl Numbers for $vector {
            type Real = $t;
            const LEN: usize = 3;
            #[inline(always)]
            fn zero() -> Self {
                <$vector>::ZERO
            }
            #[inline(always)]
            fn get(&self, index: usize) -> $t {
                self[index]
            }
            #[inline(always)]
            fn set(&mut self, index: usize, number: $t) {
                self[index] = number;
            }
        }
    };
}

numbers!(f32, Vec3);
numbers!(f64, DVec3);

impl<T: Real> Numbers for Complex<T> {
    type Real = T;
    const LEN: usize = 2;
    #[inline(always)]
    fn zero() -> Self {
        Complex::new(T::from_f64(0.0), T::from_f64(0.0))
    }
    #[inline(always)]
    fn get(&self, index: usize) -> T {
        if index == 0 { self.re } else { self.im }
    }
    #[inline(always)]
    fn set(&mut self, index: usize, number: T) {
        *(if index == 0 { &mut self.re } else { &mut self.im }) = number;
    }
}

impl<V: Numbers, const N: usize> Numbers for [V; N] {
    type Real = V::Real;
    const LEN: usize = N * V::LEN;
    #[inline(always)]
    fn zero() -> Self {
        std::array::from_fn(|_| V::zero())
    }
    #[inline(always)]
    fn get(&self, index: usize) -> V::Real {
        self[index / V::LEN].get(index % V::LEN)
    }
    #[inline(always)]
    fn set(&mut self, index: usize, number: V::Real) {
        self[index / V::LEN].set(index % V::LEN, number);
    }
    // Item by item, which compilers turn into whole registers more readily than number by number.
    #[inline(always)]
    fn accumulate(&mut self, other: &Self) {
        for (a, b) in self.iter_mut().zip(other) {
            a.accumulate(b);
        }
    }
    #[inline(always)]
    fn subtract(&mut self, other: &Self) {
        for (a, b) in self.iter_mut().zip(other) {
            a.subtract(b);
        }
    }
    #[inline(always)]
    fn add_scaled<S: Scalar<Real = V::Real>>(&mut self, scale: S, other: &Self) {
        if S::COMPLEX && V::LEN % 2 == 1 {
            for i in 0..Self::LEN / 2 {
                self.set_column(i, self.column::<S>(i) + scale * other.column::<S>(i));
            }
            return;
        }
        for (a, b) in self.iter_mut().zip(other) {
            a.add_scaled(scale, b);
        }
    }
    #[inline(always)]
    fn is_finite(&self) -> bool {
        self.iter().all(V::is_finite)
    }
    #[inline(always)]
    fn norm_squared(&self) -> f64 {
        self.iter().map(V::norm_squared).sum()
    }
}

impl<T: Real> Numbers for Vec<T> {
    type Real = T;
    const LEN: usize = 0;
    fn zero() -> Self {
        Vec::new()
    }
    fn get(&self, index: usize) -> T {
        self.as_slice().get(index).copied().unwrap_or(T::from_f64(0.0))
    }
    fn set(&mut self, index: usize, number: T) {
        if index >= self.as_slice().len() {
            self.resize(index + 1, T::from_f64(0.0));
        }
        self[index] = number;
    }
    fn len(&self) -> usize {
        self.as_slice().len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_complex_numbers_are_scaled_by_both_kinds_of_numbers() {
        let one = [Complex::new(1.0, 2.0); 2];
        let mut real = one;
        real.add_scaled(2.0, &one);
        assert_eq!(real, [Complex::new(3.0, 6.0); 2]);
        let mut complex = one;
        complex.add_scaled(Complex::i(), &one);
        assert_eq!(complex, [Complex::new(-1.0, 3.0); 2]);
        let mut pairs = [1.0, 2.0, 1.0, 2.0];
        pairs.add_scaled(Complex::i(), &[1.0, 2.0, 1.0, 2.0]);
        assert_eq!(pairs, [-1.0, 3.0, -1.0, 3.0]);
        assert_eq!(one.norm_squared(), 10.0);
        assert!(!Numbers::is_finite(&[Complex::new(1.0, f64::NAN)]));
    }

    #[test]
    fn vectors_of_numbers_grow_as_they_are_written_to() {
        let mut sum = Vec::<f64>::zero();
        sum.accumulate(&vec![1.0, 2.0]);
        sum.add_scaled(3.0, &vec![0.0, 0.0, 1.0]);
        sum.subtract(&Vec::zero());
        assert_eq!((sum.clone(), sum.norm()), (vec![1.0, 2.0, 3.0], 14f64.sqrt()));
    }

    #[test]
    fn norms_stay_in_the_range_of_numbers() {
        for unit in [5e-320, 1e-200, 1.0, 1e200, 1e307] {
            let norm =
                [[Complex::new(3.0 * unit, 0.0); 2], [Complex::new(0.0, 4.0 * unit); 2]].norm();
            assert!((norm / (50f64.sqrt() * unit) - 1.0).abs() < 1e-3, "{unit:e}: {norm:e}");
            assert_eq!(DVec3::new(0.0, -2.0 * unit, 0.0).norm(), 2.0 * unit);
        }
        assert_eq!([0.0f32; 3].norm(), 0.0);
        assert!([1e300, f64::NAN].norm().is_nan() && [1e-300, f64::NAN].norm().is_nan());
    }
}
