//! The library against exact values: factors of known bodies, and whole solutions.

mod bodies;
mod convergence;
mod daylight;
mod factors;
mod generated;
mod operators;
mod properties;
mod solutions;
