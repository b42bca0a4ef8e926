//! Which law does not hold.

use crate::error::Error;

/// A law that does not hold.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Violation {
    /// The expansion could not be prepared.
    #[error("prepare: {0}")]
    Prepare(#[from] Error),
    /// An operator is not additive in its input or overwrites its output.
    #[error("{operator} {fault}: relative deviation {deviation:e}, expected at most {bound:e}")]
    Operator {
        /// The operator.
        operator: &'static str,
        /// What it does wrong.
        fault: &'static str,
        /// By how much.
        deviation: f64,
        /// The largest deviation allowed.
        bound: f64,
    },
    /// A chain of operators does not reproduce direct summation.
    #[error(
        "{chain} at offset {offset:?}: relative l2 error {error:e} against direct summation, \
         expected at most {bound:e}"
    )]
    Chain {
        /// The operators, in order.
        chain: &'static str,
        /// From source to target cell, in cells.
        offset: [i32; 3],
        /// The error.
        error: f64,
        /// The largest error allowed.
        bound: f64,
    },
    /// An operator that declined has changed its output.
    #[error("{operator} declined but changed its output")]
    DeclinedWithOutput {
        /// The operator.
        operator: &'static str,
    },
}
