//! Fast multipole sums: u_i = Σ_j K(x_i, y_j) q_j over N points in O(N) instead of O(N²).

mod error;
mod real;
mod geometry;
mod kernel;
mod expansion;
mod mask;

pub use error::{Error, PointSet};
pub use expansion::*;
pub use geometry::*;
pub use kernel::*;
pub use mask::*;
pub use real::{Additive, Linear, Real, Scalar};
