//! Exact form factors of elements near each other, and where they replace those of centroids.

mod contour;
mod cut;
mod patch;
mod quadrature;
mod neighbours;
mod exchange;
mod corrections;
mod visible;

pub use corrections::Corrections;
pub(crate) use exchange::kappa;
pub use exchange::{Zones, exchange_area};
pub use visible::visible_exchange_area;
