//! What was done, how long it took and how far it is from the truth.

use std::fmt;

use serde::Serialize;

/// One run, as it is written in JSON. Times in seconds, errors relative in the l2 norm.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    /// Number of sources.
    pub(crate) points: usize,
    /// Number of targets.
    pub(crate) targets: usize,
    /// Kernel, by its name on the command line.
    pub(crate) kernel: String,
    /// Whether gradients were summed too.
    pub(crate) gradient: bool,
    /// Whether second derivatives were.
    pub(crate) hessian: bool,
    /// Scheme, by its name on the command line.
    pub(crate) scheme: String,
    /// Precision of the arithmetic.
    pub(crate) precision: String,
    /// Threads computed with.
    pub(crate) threads: usize,
    /// The error asked for, unless an order was.
    pub(crate) tolerance: Option<f64>,
    /// Expansion of the far field, by its name on the command line.
    pub(crate) expansion: String,
    /// Order of the harmonic expansion, or nodes per axis of the interpolation, for power laws.
    pub(crate) order: Option<usize>,
    /// Seconds from points to plan, operators included.
    pub(crate) plan_s: f64,
    /// Seconds from charges to values: the median of `repeat` runs.
    pub(crate) apply_s: f64,
    /// How often the sum was run.
    pub(crate) repeat: usize,
    /// Error of the potential at the sampled targets.
    pub(crate) relative_l2_error: f64,
    /// Error of the gradient at the sampled targets, if there is one.
    pub(crate) gradient_relative_l2_error: Option<f64>,
    /// Error of the second derivatives at the sampled targets, if there are any.
    pub(crate) hessian_relative_l2_error: Option<f64>,
    /// Number of targets at which the errors were measured.
    pub(crate) sampled_targets: usize,
    /// Most multipole terms of a cell.
    pub(crate) terms_per_cell: usize,
    /// Cells of the tree, or of both trees.
    pub(crate) cells: usize,
    /// Deepest level of the tree; the root is level 0.
    pub(crate) depth: usize,
    /// Most points in a leaf.
    pub(crate) leaf_size: usize,
    /// Largest resident set of the process until the sums were done, where the system tells.
    pub(crate) peak_memory_bytes: Option<u64>,
}

impl Report {
    /// The largest of the errors.
    pub(crate) fn error(&self) -> f64 {
        let derivatives = [self.gradient_relative_l2_error, self.hessian_relative_l2_error];
        derivatives.into_iter().flatten().fold(self.relative_l2_error, f64::max)
    }

    /// Whether the error asked for, if one was, is exceeded.
    pub(crate) fn misses_tolerance(&self) -> bool {
        self.tolerance.is_some_and(|tolerance| self.error() > tolerance)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match (self.hessian, self.gradient) {
            (true, _) => ", its gradient and its second derivatives",
            (false, true) => " and its gradient",
            (false, false) => "",
        };
        writeln!(f, "{}{what}, {} points on {} targets", self.kernel, self.points, self.targets)?;
        write!(f, "  {}, {}, threads: {}", self.scheme, self.precision, self.threads)?;
        if self.scheme != "direct" {
            let (expansion, terms) = (&self.expansion, self.terms_per_cell);
            write!(f, ", {expansion}")?;
            if let Some(order) = self.order {
                write!(f, " of order {order}")?;
            }
            write!(f, ", terms per cell: {terms}")?;
        }
        writeln!(f)?;
        writeln!(
            f,
            "  {} cells, depth {}, at most {} points in a leaf",
            self.cells, self.depth, self.leaf_size
        )?;
        writeln!(f, "  plan   {:.4} s", self.plan_s)?;
        writeln!(f, "  apply  {:.4} s, median of {}", self.apply_s, self.repeat)?;
        write!(f, "  error  {:.2e}", self.relative_l2_error)?;
        if let Some(error) = self.gradient_relative_l2_error {
            write!(f, ", of the gradient {error:.2e}")?;
        }
        if let Some(error) = self.hessian_relative_l2_error {
            write!(f, ", of the second derivatives {error:.2e}")?;
        }
        writeln!(f, ", relative l2 at {} sampled targets", self.sampled_targets)?;
        match self.peak_memory_bytes {
            Some(bytes) => writeln!(f, "  memory {:.1} MB at most", bytes as f64 / 1e6),
            None => Ok(()),
        }
    }
}
