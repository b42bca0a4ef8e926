//! Interaction lists: which pairs of cells meet through which operator, found by one traversal.

pub(crate) mod cell_mask;
pub(crate) mod grouped;
pub(crate) mod lists;
pub(crate) mod offsets;
pub(crate) mod sampled;
pub(crate) mod traversal;
