//! What the programs of this package and `benches/peers` share.

pub mod cli;
pub mod clouds;
pub mod operators;
