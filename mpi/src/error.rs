//! What went wrong, on whichever rank.

use crate::transport::TransportError;

/// Every way in which a sum over many ranks is refused. All ranks return the same error, but for
/// [`Transport`](Self::Transport).
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The first rank, of those that have one, refuses its input: what it says names the input as
    /// [`farfield::Error`] does, by its index on that rank.
    #[error("rank {rank}: {reason}")]
    Refused {
        /// That rank.
        rank: usize,
        /// What it says.
        reason: String,
    },
    /// Ranks choose or round differently.
    #[error("rank {rank} has {found} for the {what}: expected {expected}, as rank 0 has")]
    Unlike {
        /// The first rank that is not as rank 0 is.
        rank: usize,
        /// In what: the [instructions](farfield::DispatchLevel) used, or a choice.
        what: &'static str,
        /// What that rank has.
        found: String,
        /// What rank 0 has.
        expected: String,
    },
    /// More points on all ranks together than places of 32 bits can number.
    #[error("{found} points on all ranks together: expected at most {limit}")]
    TooManyPoints {
        /// The largest number allowed.
        limit: usize,
        /// The number given.
        found: usize,
    },
    /// A rank can't reach another.
    #[error(transparent)]
    Transport(#[from] TransportError),
}
