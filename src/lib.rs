//! Fast multipole sums: u_i = Σ_j K(x_i, y_j) q_j over N points in O(N) instead of O(N²).

mod chebyshev;
pub mod conformance;
mod error;
mod exact;
mod expansion;
mod fmm;
mod geometry;
mod interpolation;
mod kernel;
mod lists;
mod mask;
mod passes;
mod probe;
mod real;
mod tree;

pub use error::{Error, PointSet};
pub use expansion::*;
pub use fmm::*;
pub use geometry::*;
pub use interpolation::*;
pub use kernel::*;
pub use mask::*;
pub use real::{Additive, Linear, Real, Scalar};
