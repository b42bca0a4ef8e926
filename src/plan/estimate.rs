//! What a plan would cost.

/// What a plan would cost, foretold from the trees, a sample of the interaction lists and the
/// [time of a pair](crate::Builder::pair_seconds). Tests hold the bytes to a factor of 1.5. Seconds are rough, and those of as many threads
/// as are at hand with nothing else to do.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Estimate {
    /// The largest number of points in a leaf.
    pub leaf_size: usize,
    /// Number of cells of both trees, counted once if they are shared.
    pub cells: usize,
    /// Pairs of points that would be summed directly.
    pub direct_pairs: f64,
    /// Pairs that the mask would be asked for one by one. What that takes is its own affair, and not in
    /// [`plan_seconds`](Self::plan_seconds).
    pub asked_pairs: f64,
    /// Bytes of trees, points, lists and mask, as [`Stats::plan_bytes`](crate::Stats::plan_bytes). Every
    /// pair that the mask would be asked for counts as a bit: leaves of which all or no pairs turn out
    /// to count need none.
    pub plan_bytes: usize,
    /// Bytes that one application works on, as
    /// [`Stats::workspace_bytes`](crate::Stats::workspace_bytes).
    pub workspace_bytes: usize,
    /// Seconds to build the plan, but for the expansion's operators, which don't depend on the number
    /// of points.
    pub plan_seconds: f64,
    /// Seconds of an application in the near field.
    pub near_seconds: f64,
    /// Seconds of an application in expansions; the roughest of all, and rather too low.
    pub far_seconds: f64,
    /// Seconds of the sum over all pairs, one by one.
    pub direct_seconds: f64,
}

impl Estimate {
    /// Bytes of the plan and one workspace. The expansion's operators are not among them.
    pub fn bytes(&self) -> usize {
        self.plan_bytes + self.workspace_bytes
    }

    /// Seconds of an application.
    pub fn apply_seconds(&self) -> f64 {
        self.near_seconds + self.far_seconds
    }
}
