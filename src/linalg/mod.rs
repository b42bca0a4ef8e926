//! Small dense matrices and their products.

pub(crate) mod batched;
pub(crate) mod dense;
pub(crate) mod matrix;
