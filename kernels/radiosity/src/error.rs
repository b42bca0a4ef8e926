//! What went wrong, with which input, and what was expected instead.

use std::convert::Infallible;

/// Every way in which this crate refuses an input or gives up on a solution.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A surfel's position has a coordinate that is NaN or infinite.
    #[error("surfel {index} is at {position:?}: expected finite coordinates")]
    InvalidPosition {
        /// Index of the surfel.
        index: usize,
        /// Its position.
        position: [f64; 3],
    },
    /// A surfel's normal isn't a finite unit vector.
    #[error("surfel {index} has the normal {normal:?}: expected a unit vector")]
    InvalidNormal {
        /// Index of the surfel.
        index: usize,
        /// Its normal.
        normal: [f64; 3],
    },
    /// A surfel's area isn't positive and finite.
    #[error("surfel {index} has the area {area}: expected a positive finite number")]
    InvalidArea {
        /// Index of the surfel.
        index: usize,
        /// Its area.
        area: f64,
    },
    /// Corners that don't make a patch.
    #[error("a patch with corners at {corners:?}: expected {expected}")]
    InvalidPatch {
        /// The corners.
        corners: Vec<[f64; 3]>,
        /// What they must be or have.
        expected: &'static str,
    },
    /// A reflectance outside the interval [0, 1].
    #[error("surfel {index} has the reflectance {found} in band {band}: expected 0 to 1")]
    InvalidReflectance {
        /// Index of the surfel.
        index: usize,
        /// Index of the band.
        band: usize,
        /// The reflectance.
        found: f64,
    },
    /// An emission that is negative, NaN or infinite.
    #[error(
        "surfel {index} has the emission {found} in band {band}: expected a finite number, 0 or more"
    )]
    InvalidEmission {
        /// Index of the surfel.
        index: usize,
        /// Index of the band.
        band: usize,
        /// The emission.
        found: f64,
    },
    /// A vertex of an occluder has a coordinate that is NaN or infinite.
    #[error("vertex {vertex} of triangle {index} is at {position:?}: expected finite coordinates")]
    InvalidVertex {
        /// Index of the triangle.
        index: usize,
        /// Which of its vertices: 0, 1 or 2.
        vertex: usize,
        /// Its position.
        position: [f64; 3],
    },
    /// More occluder triangles than 32-bit indices can number.
    #[error("{found} triangles: expected fewer than 4294967296")]
    TooManyTriangles {
        /// The number given.
        found: usize,
    },
    /// Row sums that can't be mended within the limit.
    #[error(
        "the form factors of element {index} would have to change by a factor of {:.3} to close its \
         row: expected a change of {limit} at most; elements are missing, turned the wrong way or \
         too coarse", 1.0 + change
    )]
    NotClosable {
        /// Index of the element.
        index: usize,
        /// The relative change.
        change: f64,
        /// The largest change allowed.
        limit: f64,
    },
    /// Rows of a closed part that no scaling makes sum to 1.
    #[error(
        "the form factors of element {index} still sum to {row_sum:.4} when those of all others are \
         closed as well as they can be: expected 1; elements are missing, turned the wrong way or too \
         coarse"
    )]
    NotClosed {
        /// Index of the element.
        index: usize,
        /// What its row sums to.
        row_sum: f64,
    },
    /// A closed part that is lit and absorbs nothing: no radiosity is its solution.
    #[error(
        "surfaces that close a room are lit in band {band}, and none of them absorbs anything: expected \
         one of a reflectance below 1"
    )]
    NothingAbsorbs {
        /// Index of the band.
        band: usize,
    },
    /// A tolerance that is no share of anything.
    #[error("the tolerance {found}: expected a number between 0 and 1, both excluded")]
    InvalidTolerance {
        /// The tolerance.
        found: f64,
    },
    /// A direction that is none.
    #[error("the {what} is {found:?}: expected a finite vector other than zero")]
    InvalidDirection {
        /// What it is the direction of.
        what: &'static str,
        /// The vector.
        found: [f64; 3],
    },
    /// Two inputs that belong together have different lengths.
    #[error("{what}: expected {expected} entries, one per surfel, found {found}")]
    LengthMismatch {
        /// The input that has the wrong length.
        what: &'static str,
        /// The length it must have.
        expected: usize,
        /// The length it has.
        found: usize,
    },
    /// The residual of a solver grows without bound.
    #[error(
        "the radiosity equation diverged: relative residual {residual:e} after {iterations} \
         iterations; expected reflectances times row sums of the form factors below 1"
    )]
    Diverged {
        /// Iterations made.
        iterations: usize,
        /// The relative residual reached.
        residual: f64,
    },
    /// Conjugate gradients met a direction in which the radiosity equation only gains light.
    #[error(
        "the radiosity equation is not positive definite in band {band}, found after {iterations} \
         iterations; expected reflectances times row sums of the form factors below 1"
    )]
    NotPositiveDefinite {
        /// Iterations made.
        iterations: usize,
        /// Index of the band.
        band: usize,
    },
    /// A solution in which a surface takes light away, to which no bounces of light lead.
    #[error(
        "the radiosity of surfel {index} comes out as {found} in band {band}: expected 0 or more, and \
         reflectances times row sums of the form factors below 1"
    )]
    NegativeRadiosity {
        /// Index of the surfel.
        index: usize,
        /// Index of the band.
        band: usize,
        /// The radiosity.
        found: f64,
    },
    /// A solver did not reach its tolerance within the iterations it was given.
    #[error(
        "the radiosity equation did not converge: relative residual {residual:e} after \
         {iterations} iterations, expected {tolerance:e} or less"
    )]
    NotConverged {
        /// Iterations made.
        iterations: usize,
        /// The relative residual reached.
        residual: f64,
        /// The residual that was to be reached.
        tolerance: f64,
    },
    /// A solver got no further before it reached its tolerance: the tolerance asks for more digits than
    /// the sums have.
    #[error(
        "the radiosity equation stagnated: the relative residual {residual:e} was not improved on until \
         iteration {iterations}; expected {tolerance:e} or less, but rounding of the sums may leave \
         {floor:e}"
    )]
    Stagnated {
        /// Iterations made.
        iterations: usize,
        /// The least relative residual reached.
        residual: f64,
        /// The residual that was to be reached.
        tolerance: f64,
        /// The residual that rounding may leave: no smaller tolerance is met for certain.
        floor: f64,
    },
    /// The engine's refusal of a sum.
    #[error(transparent)]
    Sum(#[from] farfield::Error),
}

impl From<Infallible> for Error {
    fn from(never: Infallible) -> Self {
        match never {}
    }
}

/// Whether an input has one entry for each surfel.
pub(crate) fn check_length(what: &'static str, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected { Ok(()) } else { Err(Error::LengthMismatch { what, expected, found }) }
}
