//! What went wrong, with which input, and what was expected instead.

use std::fmt;

use crate::dispatch_level::UnknownDispatchLevel;

/// Which of the two point sets an error speaks of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointSet {
    /// The points that carry charges.
    Sources,
    /// The points at which values are asked for.
    Targets,
}

impl fmt::Display for PointSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sources => "source",
            Self::Targets => "target",
        })
    }
}

/// Every way in which the engine refuses an input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A coordinate is NaN or infinite.
    #[error("{set} {index} is at {position:?}: expected finite coordinates")]
    NonFinitePosition {
        /// The set the point belongs to.
        set: PointSet,
        /// Its index in the caller's order.
        index: usize,
        /// Its coordinates.
        position: [f64; 3],
    },
    /// A charge holds a NaN or an infinity.
    #[error("charge {index} is {charge:?}: expected a finite charge")]
    NonFiniteCharge {
        /// Its index in the caller's order.
        index: usize,
        /// Its numbers.
        charge: Vec<f64>,
    },
    /// A sum came out as NaN or infinite although all inputs were finite: the kernel is singular at
    /// a pair that occurs, the type of values does not fit its fields, or the sum overflows.
    #[error(
        "the sum at target {index} is {value:?}: expected a kernel that is finite at every pair that occurs \
         (one that is singular at coincident points must give zero there), a value with as many numbers \
         as the kernel has fields, and sums within the range of numbers"
    )]
    NonFiniteValue {
        /// The target's index in the caller's order.
        index: usize,
        /// The numbers of the sum.
        value: Vec<f64>,
    },
    /// The kernel is NaN or infinite between points of well-separated cells.
    #[error("the kernel is not finite between well-separated points: expected a finite number")]
    NonFiniteKernel,
    /// Between points that extend so far, or so little, the kernel's numbers are beyond the range of the precision.
    #[error(
        "between points that extend over {extent:e} most numbers of the kernel are too small for {precision}: \
         expected points in other units, or another precision"
    )]
    KernelOutOfRange {
        /// The largest edge of the bounding box of all points.
        extent: f64,
        /// The precision, `f32` or `f64`.
        precision: &'static str,
    },
    /// Two inputs that belong together have different lengths.
    #[error("{what}: expected {expected} entries, found {found}")]
    LengthMismatch {
        /// The input that has the wrong length.
        what: &'static str,
        /// The length it must have.
        expected: usize,
        /// The length it has.
        found: usize,
    },
    /// A charge that is a list holds more numbers than the kernel takes.
    #[error("charge {index} has {found} numbers: expected at most {expected}")]
    ChargeTooLong {
        /// Its index in the caller's order.
        index: usize,
        /// The numbers that the kernel takes: as many as it has densities, for each of its columns.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A kernel without fields or without densities has no entries.
    #[error(
        "the kernel has {fields} fields and {densities} densities: expected one of each or more"
    )]
    EmptyKernel {
        /// Its fields.
        fields: usize,
        /// Its densities.
        densities: usize,
    },
    /// The type of charges or values does not have as many numbers as the kernel.
    #[error(
        "a {what} of this kernel has {expected} numbers for each right-hand side: expected a type of as \
         many, or a multiple of it; found one of {found}"
    )]
    KernelSize {
        /// `charge` or `value`.
        what: &'static str,
        /// The numbers that the kernel makes of one right-hand side.
        expected: usize,
        /// The numbers of the type.
        found: usize,
    },
    /// Derivatives are asked for where the kernel has none: a target and a source are at one place, and the kernel counts
    /// such pairs.
    #[error(
        "target {target} and source {from} are at one place, where the kernel has no derivatives: expected such pairs \
         to be skipped or to count as a number, or values alone"
    )]
    NotDifferentiable {
        /// The target's index in the caller's order.
        target: usize,
        /// The source's index in the caller's order.
        from: usize,
    },
    /// Charges are lists of any length, and nothing says how many right-hand sides they hold.
    #[error(
        "charges are lists of numbers: expected the kernel to say how many right-hand sides they hold \
         (`Kernel::columns`, or `FormulaKernel::with_columns`), found none"
    )]
    UnknownColumns,
    /// More points than the engine's 32-bit indices can number.
    #[error("{found} {set}s: expected at most {limit}")]
    TooManyPoints {
        /// The set that is too large.
        set: PointSet,
        /// The largest number allowed.
        limit: usize,
        /// The number given.
        found: usize,
    },
    /// The bounding cube of the points is so large that distances overflow.
    #[error("the points extend over {extent:e}: expected at most {limit:e}")]
    ExtentTooLarge {
        /// The largest edge of the bounding box.
        extent: f64,
        /// The largest edge allowed.
        limit: f64,
    },
    /// A tolerance outside the open interval (0, 1).
    #[error("tolerance {found}: expected a number between 0 and 1, both excluded")]
    InvalidTolerance {
        /// The number given.
        found: f64,
    },
    /// The tolerance can't be met with this kernel, precision and extent.
    #[error(
        "tolerance {requested:e} is out of reach for this kernel here: expected {reachable:e} or more"
    )]
    UnreachableTolerance {
        /// The tolerance asked for.
        requested: f64,
        /// The smallest error seen.
        reachable: f64,
    },
    /// Preparing the expansion takes more than it may, [`Geometry::most_seconds`](crate::Geometry::most_seconds),
    /// or an application does, [`Geometry::most_apply_seconds`](crate::Geometry::most_apply_seconds).
    #[error(
        "the expansion would take more than {needed:.1e} seconds of one core: expected at most {limit:.1e}"
    )]
    OverWork {
        /// The seconds that it may take.
        limit: f64,
        /// The seconds that it needs at least.
        needed: f64,
    },
    /// An expansion order outside the range that its expansion supports.
    #[error("order {found}: expected {min} to {max}")]
    InvalidOrder {
        /// The smallest order allowed.
        min: usize,
        /// The largest order allowed.
        max: usize,
        /// The order given.
        found: usize,
    },
    /// A rule for sampling that can't be followed.
    #[error("{what} of the samples is {found}: expected {expected}")]
    InvalidSampling {
        /// The field of the rule.
        what: &'static str,
        /// What it is.
        found: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// The plan and one workspace would need more memory than they may have.
    #[error("the plan would need about {needed} bytes: expected at most {budget}")]
    OverMemoryBudget {
        /// The bytes that they may have.
        budget: usize,
        /// The bytes that they would need, as [`Estimate::bytes`](crate::Estimate::bytes) foretells.
        needed: usize,
    },
    /// An expansion of the user's own refuses what is asked of it.
    #[error("the expansion can't be prepared: {0}")]
    Expansion(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// A [mask](crate::Mask) says of a pair that it counts by something that is not a share.
    #[error(
        "the pair of target {target} and source {from} counts by {found}: expected a share from 0 to 1"
    )]
    InvalidShare {
        /// The target's index in the caller's order.
        target: usize,
        /// The source's index in the caller's order.
        from: usize,
        /// What the mask says.
        found: f64,
    },
    /// A plan with a mask is given other points, and no mask for them.
    #[error(
        "the plan was built with a mask: expected one for the points that take their place (`Fmm::update_masked`)"
    )]
    MaskNeeded,
    /// A period that is not a length.
    #[error("the period along axis {axis} is {found}: expected a finite number above 0")]
    InvalidPeriod {
        /// 0 for x, 1 for y, 2 for z.
        axis: usize,
        /// The number given.
        found: f64,
    },
    /// Points that are repeated along an axis are farther apart than the period.
    #[error(
        "{set} {index} is at {position} along axis {axis}, and another point at {low}: expected all points within one \
         period of {period}"
    )]
    OutsidePeriod {
        /// The set the point belongs to.
        set: PointSet,
        /// Its index in the caller's order.
        index: usize,
        /// 0 for x, 1 for y, 2 for z.
        axis: usize,
        /// Where it is along the axis.
        position: f64,
        /// Where the first of all points is.
        low: f64,
        /// The period.
        period: f64,
    },
    /// An edge of a box is so much longer than a period of it that very many images are near.
    #[error(
        "{found} images are near, since one edge of the box is so much longer than another: expected at most {limit}"
    )]
    TooManyImages {
        /// The largest number allowed.
        limit: f64,
        /// As many as there would be.
        found: f64,
    },
    /// A kernel is to be repeated that is not one of the difference of two points.
    #[error(
        "the kernel depends on where both points are: expected one of their difference to repeat it"
    )]
    PositionDependent,
    /// The sum of a kernel over the images of a source does not exist, not even for charges that add up to zero.
    #[error(
        "the sum of the kernel over periodic images does not converge: expected a kernel that decays, or one whose images \
         cancel for charges that add up to zero"
    )]
    DivergentImages,
    /// Charges that have to add up to zero do not.
    #[error(
        "charges add up to {net:e} in density {density}, their sizes to {all:e}: expected a sum of zero, without which the \
         sum over periodic images does not converge"
    )]
    NotNeutral {
        /// The density, and the column of it: those of the kernel are numbered one column after the other within each.
        density: usize,
        /// The size of their sum.
        net: f64,
        /// The sum of their sizes.
        all: f64,
    },
    /// What a pair is said to take is not a time.
    #[error("a pair is said to take {found} seconds: expected a number above 0")]
    InvalidPairSeconds {
        /// The number given.
        found: f64,
    },
    /// A [`Watch`](crate::Watch) said that the work shall end.
    #[error("stopped")]
    Stopped,
    /// Cells that are given for a [part](crate::PartLists) of a plan do not make a tree.
    #[error(
        "{set} cell {index}: expected cells level by level along the Morton curve, each with points that the one above \
         it has as well"
    )]
    InvalidCell {
        /// The points that the cells hold.
        set: PointSet,
        /// The first cell that is not as expected.
        index: usize,
    },
    /// A leaf size of zero.
    #[error("leaf size 0: expected at least 1 point per leaf")]
    InvalidLeafSize,
    /// The environment variable that caps the processor's instructions does not name a level.
    #[error(transparent)]
    UnknownDispatchLevel(#[from] UnknownDispatchLevel),
}

/// Errors are equal if they are of one kind and say the same.
impl PartialEq for Error {
    fn eq(&self, other: &Self) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
            && self.to_string() == other.to_string()
    }
}
