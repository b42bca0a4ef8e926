//! From characters to a graph of operations, or to an error that points at one of them.

pub(crate) mod error;
pub(crate) mod names;
pub(crate) mod parameters;
pub(crate) mod parser;
pub(crate) mod tokens;
