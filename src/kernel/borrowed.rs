//! A kernel behind a reference or a pointer is a kernel: whoever keeps one can build several plans with it, and still has
//! it if one can't be built. Behind `&dyn` or `Box<dyn>` kernels of many types become one, for which plans are compiled
//! once.

use std::sync::Arc;

use crate::error::Error;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::Point;

/// Hands every question on to the kernel behind a pointer.
macro_rules! behind {
    ($pointer:ty) => {
        impl<K: Kernel + ?Sized> Kernel for $pointer {
            type Real = K::Real;
            type Source = K::Source;
            type Target = K::Target;
            type Charge = K::Charge;
            type Value = K::Value;
            type Entry = K::Entry;

            #[inline(always)]
            fn entries(&self, x: Point<K::Real>, y: Point<K::Real>, g: &mut [K::Entry]) {
                (**self).entries(x, y, g);
            }

            #[inline(always)]
            fn fields(&self) -> usize {
                (**self).fields()
            }

            #[inline(always)]
            fn densities(&self) -> usize {
                (**self).densities()
            }

            #[inline(always)]
            fn columns(&self) -> usize {
                (**self).columns()
            }

            fn check_sizes(&self) -> Result<(), Error> {
                (**self).check_sizes()
            }

            fn charge_len(&self) -> usize {
                (**self).charge_len()
            }

            #[inline(always)]
            fn density(&self, y: &K::Source, q: &K::Charge, d: &mut [K::Entry]) {
                (**self).density(y, q, d);
            }

            #[inline(always)]
            fn value(
                &self,
                x: &K::Target,
                fields: &[K::Entry],
                gradients: &[[K::Entry; 3]],
                u: &mut K::Value,
            ) {
                (**self).value(x, fields, gradients, u);
            }

            #[inline(always)]
            fn needs_gradients(&self) -> bool {
                (**self).needs_gradients()
            }

            fn has_parameters(&self) -> bool {
                // What a trait object is can't be told by its type.
                size_of::<&K>() > size_of::<usize>() || (**self).has_parameters()
            }

            fn identity(&self) -> Option<String> {
                (**self).identity()
            }

            fn pair_seconds(&self, tolerance: f64) -> f64 {
                (**self).pair_seconds(tolerance)
            }

            fn sizes(&self, x: Point<K::Real>, y: Point<K::Real>) -> Option<[f64; 2]> {
                (**self).sizes(x, y)
            }

            #[inline(always)]
            fn entry_gradients(
                &self,
                x: Point<K::Real>,
                y: Point<K::Real>,
                g: &mut [[K::Entry; 3]],
            ) -> Outcome {
                (**self).entry_gradients(x, y, g)
            }

            fn entries_block(
                &self,
                xs: &[Point<K::Real>],
                ys: &[Point<K::Real>],
                g: &mut [K::Entry],
            ) {
                (**self).entries_block(xs, ys, g);
            }

            fn add_block(
                &self,
                xs: &[K::Target],
                ys: &[K::Source],
                qs: &[K::Charge],
                tolerance: f64,
                us: &mut [K::Value],
            ) {
                (**self).add_block(xs, ys, qs, tolerance, us);
            }

            fn add_pairs(
                &self,
                xs: &[K::Target],
                ys: &[K::Source],
                qs: &[K::Charge],
                bits: &[u64],
                tolerance: f64,
                us: &mut [K::Value],
            ) {
                (**self).add_pairs(xs, ys, qs, bits, tolerance, us);
            }
        }
    };
}

behind!(&K);
behind!(Box<K>);
behind!(Arc<K>);
