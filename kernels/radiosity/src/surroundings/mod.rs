//! What elements see by rays, whatever form factors say: other fronts, backs, the sky.

mod sides;
mod seen;
mod around;

pub use around::Surroundings;
pub use seen::Seen;
