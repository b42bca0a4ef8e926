//! Kernels from text, as their users meet them. One program: what it needs of the engine is compiled once.

mod extents;
mod fmm;
mod plans;
mod ready;
mod texts;
mod values;
