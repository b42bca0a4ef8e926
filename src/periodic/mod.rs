//! Sums over points that are repeated along one, two or three axes.

pub(crate) mod builder;

mod blocks;
mod extrapolation;
mod images;
mod lattice;
mod operator;
mod periodicity;
mod polynomials;
mod summed;
