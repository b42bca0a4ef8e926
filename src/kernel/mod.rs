//! Kernels: what is summed, in which pairs, and by which formula; direct sums, the reference of
//! everything else.

pub(crate) mod borrowed;
pub(crate) mod closure;
pub(crate) mod derivatives;
pub(crate) mod direct;
pub(crate) mod formula;
pub(crate) mod formula_block;
pub(crate) mod formula_cost;
pub(crate) mod formula_kernel;
pub(crate) mod mask;
pub(crate) mod ordinary;
mod outermost;
pub(crate) mod pair_loop;
pub(crate) mod side_by_side;
pub(crate) mod slopes;
pub(crate) mod traits;
mod wide;
pub(crate) mod with_gradient;
