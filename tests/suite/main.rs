//! Integration tests: everything is held against direct summation, target by target.

mod any_kernel;
mod certificate;
mod choice;
mod engine;
mod estimate;
mod extension;
mod formulas;
mod kernels;
mod lists;
mod masks;
mod moments;
mod moving;
mod operator_store;
mod periodic;
mod radiosity;
mod sizes;
mod translation_theorems;
mod uneven_kernels;
mod units;
mod whole_sums;
mod written_once;

use farfield::{FnKernel, from_fn};
use glam::{DVec3, Vec3};

/// A formula as a function pointer, so that all kernels given by one are compiled once.
type Formula<P, T> = fn(P, P) -> T;

fn plain(formula: Formula<DVec3, f64>) -> FnKernel<Formula<DVec3, f64>, DVec3, f64> {
    from_fn(formula)
}

fn single(formula: Formula<Vec3, f32>) -> FnKernel<Formula<Vec3, f32>, Vec3, f32> {
    from_fn(formula)
}
