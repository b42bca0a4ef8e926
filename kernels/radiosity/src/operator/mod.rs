//! From the radiosity of all elements to their irradiance.

mod rounding;
mod radiosity_operator;
mod closing;

pub use closing::{Closure, Enclosure};
pub use radiosity_operator::RadiosityOperator;
pub(crate) use rounding::rounding;
