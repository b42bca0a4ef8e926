//! What the machine can do at most, measured in the same process as everything that is held against it.

use std::hint::black_box;
use std::time::Instant;

use faer::linalg::matmul::matmul;
use faer::traits::ComplexField;
use faer::{Accum, Mat, Par};
use farfield::{Expansion, Interpolation, Numbers, Point, Real, Vector};
use farfield_benches::cli::Precision;
use farfield_benches::clouds::{self, Cloud};

use crate::args::KernelName;
use crate::kernels::{Charge, Summed, Visit, with_kernel};

/// Limits of one thread.
#[derive(Debug)]
pub(crate) struct Limits {
    /// Floating-point operations per second of a large matrix product in f64, and in f32.
    pub(crate) flops: [f64; 2],
    /// Bytes read and written per second by a copy of a large array.
    pub(crate) bandwidth: f64,
    /// Pairs per second of the bare loop.
    pairs: Vec<(KernelName, Precision, f64, f64)>,
}

impl Limits {
    /// Measures matrix products and the copy.
    pub(crate) fn measure() -> Self {
        Self { flops: [flops(1.0f64), flops(1.0f32)], bandwidth: bandwidth(), pairs: Vec::new() }
    }

    /// Measures the bare loop of a kernel at a tolerance; none if there is no such kernel.
    pub(crate) fn add_pairs(
        &mut self,
        name: KernelName,
        precision: Precision,
        gradient: bool,
        tolerance: f64,
    ) -> Option<f64> {
        let mut bare = BareLoop { tolerance, rate: 0.0 };
        if !with_kernel(name, precision, gradient, 0.5, &mut bare) {
            return None;
        }
        self.pairs.push((name, precision, tolerance, bare.rate));
        Some(bare.rate)
    }

    /// Pairs per second of the bare loop.
    pub(crate) fn pairs(&self, name: KernelName, precision: Precision, tolerance: f64) -> f64 {
        let key = (name, precision, tolerance);
        let known = self.pairs.iter().find(|&&(n, p, t, _)| (n, p, t) == key);
        known.map_or(f64::NAN, |&(.., rate)| rate)
    }

    /// Operations per second of a matrix product in this precision.
    pub(crate) fn product(&self, precision: Precision) -> f64 {
        self.flops[usize::from(precision == Precision::F32)]
    }
}

/// All pairs of two large arrays by the kernel's own block sum, to the digits that a plan asks for.
struct BareLoop {
    tolerance: f64,
    rate: f64,
}

/// Points on either side of the bare loop.
const BARE: usize = 4096;

impl Visit for BareLoop {
    fn visit<T: Real, K: Summed<T>, R: Summed<f64>>(&mut self, kernel: K, _reference: R) {
        let tolerance =
            Interpolation::new(kernel).tolerance(self.tolerance).costs(2).pair_tolerance;
        let points: Vec<Point<T>> = clouds::cloud(Cloud::Cube, 2 * BARE)
            .iter()
            .map(|p| Vector::from_array(p.to_array().map(T::from_f64)))
            .collect();
        let (xs, ys) = points.split_at(BARE);
        let qs: Vec<K::Charge> = clouds::charges(BARE).into_iter().map(Charge::of).collect();
        let mut us = vec![K::Value::zero(); BARE];
        let seconds = shortest(|| {
            kernel.add_block(xs, ys, black_box(&qs), tolerance, &mut us);
            black_box(&us);
        });
        self.rate = (BARE * BARE) as f64 / seconds;
    }
}

/// Rows and columns of the product.
const PRODUCT: usize = 1024;

fn flops<T: ComplexField + Copy>(entry: T) -> f64 {
    let (a, b) = (Mat::full(PRODUCT, PRODUCT, entry), Mat::full(PRODUCT, PRODUCT, entry));
    let mut c = Mat::<T>::zeros(PRODUCT, PRODUCT);
    let seconds = shortest(|| {
        matmul(c.as_mut(), Accum::Replace, a.as_ref(), b.as_ref(), entry, Par::Seq);
        black_box(&c);
    });
    2.0 * (PRODUCT as f64).powi(3) / seconds
}

/// Numbers in the array that is copied: 128 MiB, far more than caches hold.
const COPIED: usize = 1 << 24;

fn bandwidth() -> f64 {
    let from = vec![1.0f64; COPIED];
    let mut to = vec![0.0; COPIED];
    let seconds = shortest(|| {
        to.copy_from_slice(black_box(&from));
        black_box(&to);
    });
    2.0 * size_of_val(&from[..]) as f64 / seconds
}

/// Seconds that the fastest of several runs takes: at least three, and for about 0.2 s.
fn shortest(mut run: impl FnMut()) -> f64 {
    run();
    let start = Instant::now();
    let mut shortest = f64::INFINITY;
    let mut runs = 0;
    while runs < 3 || start.elapsed().as_secs_f64() < 0.2 {
        let start = Instant::now();
        run();
        shortest = shortest.min(start.elapsed().as_secs_f64());
        runs += 1;
    }
    shortest
}
