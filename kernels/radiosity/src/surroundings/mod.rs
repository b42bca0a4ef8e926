//! What elements see by rays, whatever form factors say: other fronts, backs, the sky.

mod sides;
mod seen;
mod around;
mod daylight;

pub use around::Surroundings;
pub use daylight::{Daylight, Sky};
pub use seen::Seen;
