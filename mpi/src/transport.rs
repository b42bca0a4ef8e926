//! How ranks reach each other.

use std::ops::Sub;

/// The ranks of one sum: processes, or threads that stand for them.
///
/// Every method that sends is collective: all ranks call it, in the same order, or the others get an error once a rank is
/// gone. Messages are words of 64 bits.
pub trait Transport {
    /// The number of this rank, below [`size`](Self::size).
    fn rank(&self) -> usize;

    /// How many ranks there are.
    fn size(&self) -> usize;

    /// Sends `messages[q]` to each rank q, and returns what each rank has sent here, in the order of ranks. What a rank
    /// sends to itself stays there.
    ///
    /// # Errors
    /// [`TransportError`] if a rank can't be reached, or there is not one message for each.
    fn exchange(&self, messages: Vec<Vec<u64>>) -> Result<Vec<Vec<u64>>, TransportError>;

    /// What this rank has sent to others so far.
    fn volume(&self) -> Volume;

    /// Sends the same words to all ranks, and returns what each has sent, in the order of ranks.
    ///
    /// # Errors
    /// As [`exchange`](Self::exchange).
    fn gather(&self, words: &[u64]) -> Result<Vec<Vec<u64>>, TransportError> {
        self.exchange(vec![words.to_vec(); self.size()])
    }
}

/// How much a rank has sent to others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Volume {
    /// Messages that were not empty.
    pub messages: u64,
    /// Words of 64 bits in them.
    pub words: u64,
}

impl Sub for Volume {
    type Output = Self;

    /// What was sent since `earlier`.
    fn sub(self, earlier: Self) -> Self {
        Self { messages: self.messages - earlier.messages, words: self.words - earlier.words }
    }
}

/// Why ranks don't reach each other.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TransportError {
    /// A rank has ended while others wait for it.
    #[error("rank {rank} is gone: expected a message from it")]
    Gone {
        /// That rank.
        rank: usize,
    },
    /// A rank sends or receives more words at once than the transport can count.
    #[error("{words} words to or from one rank at once: expected at most {limit}")]
    TooLong {
        /// The number of words.
        words: u64,
        /// The largest number allowed.
        limit: u64,
    },
    /// There is not one message for each rank.
    #[error("{found} messages: expected one for each of {expected} ranks")]
    Messages {
        /// The number of ranks.
        expected: usize,
        /// The number of messages.
        found: usize,
    },
}
