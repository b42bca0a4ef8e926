//! What the laws are tried on.

/// How to make the points and charges of a kernel: each closure is given an index, so that
/// attributes can vary from point to point.
#[derive(Clone, Copy, Debug)]
pub struct Samples<S, X, Q> {
    /// A source at a point.
    pub source: S,
    /// A target at a point.
    pub target: X,
    /// A charge.
    pub charge: Q,
}
