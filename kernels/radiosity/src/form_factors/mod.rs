//! Exact form factors of elements near each other, and where they replace those of centroids.

mod contour;
mod cut;
mod patch;
mod quadrature;
mod neighbours;
mod exchange;
mod corrections;

pub use corrections::{Corrections, Zones};
pub use exchange::exchange_area;
pub(crate) use exchange::kappa;
