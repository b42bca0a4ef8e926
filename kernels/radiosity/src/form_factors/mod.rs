//! Exact form factors of elements near each other, and where they replace those of centroids.

mod contour;
mod cut;
mod patch;
mod quadrature;
mod neighbours;
mod exchange;
mod corrections;

pub use corrections::Corrections;
pub(crate) use exchange::kappa;
pub use exchange::{Zones, exchange_area};
