//! Formulas evaluated for many pairs side by side: a list of instructions, each of which goes through a block of
//! pairs that stays in the first-level cache.

pub(crate) mod batch;
pub(crate) mod cost;
pub(crate) mod entries;
pub(crate) mod extended;
pub(crate) mod program;
pub(crate) mod steps;
pub(crate) mod sums;
