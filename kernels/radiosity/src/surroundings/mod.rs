//! What elements see by rays, whatever form factors say: other fronts, backs, the sky.

mod sides;
mod seen;
mod surroundings;

pub use seen::Seen;
pub use surroundings::Surroundings;
