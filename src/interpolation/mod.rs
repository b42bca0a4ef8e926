//! The black-box expansion of any point kernel: interpolation, compressed to numerical rank.

pub(crate) mod bases;
pub(crate) mod basis;
pub(crate) mod black_box;
pub(crate) mod budget;
pub(crate) mod by_kernel;
pub(crate) mod cache;
pub(crate) mod chebyshev;
pub(crate) mod check;
pub(crate) mod cost;
pub(crate) mod densities;
pub(crate) mod directions;
pub(crate) mod exchange;
pub(crate) mod expansion;
pub(crate) mod far_field;
pub(crate) mod lanes;
pub(crate) mod level;
pub(crate) mod means;
pub(crate) mod operators;
pub(crate) mod points;
pub(crate) mod prepared;
pub(crate) mod probe;
pub(crate) mod ranges;
pub(crate) mod scratch;
pub(crate) mod shifts;
pub(crate) mod transfer;
pub(crate) mod tuning;
