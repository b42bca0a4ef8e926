//! Integration tests: everything is held against direct summation, target by target.

mod certificate;
mod choice;
mod clouds;
mod command_line;
mod engine;
mod estimate;
mod extension;
mod formulas;
mod kernels;
mod lists;
mod moments;
mod radiosity;
mod translation_theorems;
