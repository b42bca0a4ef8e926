//! The power laws |x − y|^(−2λ) for `farfield`: 1/r, 1/r², 1/r⁴ and the squared distance, with one
//! expansion for all of them.
//!
//! ```
//! use farfield_potentials::{HarmonicExpansion, InverseDistance};
//! let kernel = InverseDistance::<f64>::new();
//! let expansion = HarmonicExpansion::with_tolerance(kernel, 1e-6)?;
//! # Ok::<(), farfield::Error>(())
//! ```

mod columns;
mod expansion;
mod exponent;
mod group;
pub mod harmonic;
mod law;
mod near_field;
mod ordinary;
mod output;
mod pair;
mod power_law;
mod reciprocal;
pub mod registers;
mod separable;
mod single;

pub use expansion::HarmonicExpansion;
pub use exponent::{Exponent, MinusFour, MinusOne, MinusTwo, PlusTwo};
pub use output::{Output, Potential, PotentialGradient, WithGradient};
pub use power_law::{InverseDistance, InverseFourth, InverseSquare, PowerLaw, SquaredDistance};
pub use separable::{squared_distance_sum, squared_distance_sum_with_gradient};
