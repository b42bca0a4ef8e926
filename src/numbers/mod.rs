//! Numbers and points: the precisions, what charges and terms can do, random numbers, exact sums.

pub(crate) mod bits;
pub(crate) mod compiled;
pub(crate) mod counted;
pub(crate) mod double_word;
pub(crate) mod dual;
pub(crate) mod extended;
pub(crate) mod lane;
pub mod math;
pub(crate) mod number;
pub(crate) mod points;
pub(crate) mod random;
#[cfg(feature = "ndarray")]
pub(crate) mod rows;
pub(crate) mod scalars;
pub(crate) mod side_by_side;
pub(crate) mod traits;
