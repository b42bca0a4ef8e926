//! Integration tests: everything is held against direct summation, target by target.

mod clouds;
mod engine;
mod extension;
mod lists;
