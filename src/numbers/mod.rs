//! Numbers and points: the precisions, what charges and terms can do, random numbers, exact sums.

pub(crate) mod bits;
pub(crate) mod double_word;
pub(crate) mod random;
pub(crate) mod real;
