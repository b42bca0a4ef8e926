//! From the radiosity of all elements to their irradiance.

mod rounding;
mod radiosity_operator;
mod closing;
mod balance;

pub use balance::Balance;
pub use closing::{Closure, Enclosure};
pub use radiosity_operator::RadiosityOperator;
pub(crate) use rounding::rounding;
