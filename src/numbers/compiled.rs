//! Generic functions that know of no kernel, compiled in this crate.
//!
//! Generic code is compiled anew in every crate that calls it. Set-up and much of an application know nothing of a
//! kernel but its type of numbers, and are most of what a program with one kernel would have to compile. Here
//! they are compiled for real numbers; programs with complex kernels, which are rare, compile what they need.

use std::any::Any;

/// One generic function for `f32` and for `f64`: in a `static`, which is what has it compiled here.
pub(crate) struct Compiled<F32, F64>(pub(crate) F32, pub(crate) F64);

impl<F32: 'static, F64: 'static> Compiled<F32, F64> {
    /// The function of type `F`, which is one of the two.
    pub(crate) fn of<F: Copy + 'static>(&self) -> F {
        let functions: [&dyn Any; 2] = [&self.0, &self.1];
        let found = functions.into_iter().find_map(|function| function.downcast_ref());
        *found.expect("real numbers are f32 or f64")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_are_found_by_their_type() {
        type Double<T> = fn(T) -> T;
        static DOUBLE: Compiled<Double<f32>, Double<f64>> = Compiled(|x| x + x, |x| 2.0 * x);
        assert_eq!((DOUBLE.of::<Double<f32>>()(1.5), DOUBLE.of::<Double<f64>>()(0.1)), (3.0, 0.2));
    }
}
