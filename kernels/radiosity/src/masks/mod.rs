//! Which pairs of surfels count: those that face each other and, if asked for, see each other.

mod tally;
mod counts;
mod facing;
mod sampling;
mod asked;
mod visibility;

pub use counts::PairCounts;
pub use facing::Facing;
pub use visibility::Visibility;
