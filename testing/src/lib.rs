//! What the tests and the benchmarks share: point clouds, seeded random numbers and kernels.

pub mod clouds;
pub mod damage;
pub mod formulas;
pub mod stokeslet;
