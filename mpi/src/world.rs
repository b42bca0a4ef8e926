//! Ranks that are processes, which MPI connects.

use std::cell::Cell;
use std::fmt;

use mpi::Count;
use mpi::collective::SystemOperation;
use mpi::datatype::{Partition, PartitionMut};
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, CommunicatorCollectives};

use crate::transport::{Transport, TransportError, Volume};

/// A rank that is a process, and reaches the others by MPI.
///
/// Nobody waits for a process that panics: all are aborted then.
pub struct MpiTransport {
    communicator: SimpleCommunicator,
    volume: Cell<Volume>,
}

impl MpiTransport {
    /// The ranks of a communicator, such as `mpi::initialize().unwrap().world()`. Nothing else may use it for collective
    /// calls meanwhile.
    pub fn new(communicator: SimpleCommunicator) -> Self {
        Self { communicator, volume: Cell::default() }
    }
}

impl Transport for MpiTransport {
    fn rank(&self) -> usize {
        self.communicator.rank() as usize
    }

    fn size(&self) -> usize {
        self.communicator.size() as usize
    }

    fn exchange(&self, messages: Vec<Vec<u64>>) -> Result<Vec<Vec<u64>>, TransportError> {
        let (rank, size) = (self.rank(), self.size());
        if messages.len() != size {
            return Err(TransportError::Messages { expected: size, found: messages.len() });
        }
        let lengths: Vec<u64> = messages.iter().map(|words| words.len() as u64).collect();
        let mut arriving = vec![0u64; size];
        self.communicator.all_to_all_into(&lengths[..], &mut arriving[..]);
        // All ranks have to know where one has more than MPI can count.
        let [own, most] =
            [lengths.iter().sum::<u64>().max(arriving.iter().sum()), Count::MAX as u64];
        let mut largest = 0u64;
        self.communicator.all_reduce_into(&own, &mut largest, SystemOperation::max());
        if largest > most {
            return Err(TransportError::TooLong { words: largest, limit: most });
        }
        let mut volume = self.volume.get();
        for (_, length) in lengths.iter().enumerate().filter(|(to, _)| *to != rank) {
            volume.messages += u64::from(*length > 0);
            volume.words += length;
        }
        self.volume.set(volume);
        let sent = messages.concat();
        let mut arrived = vec![0u64; arriving.iter().sum::<u64>() as usize];
        let counts = |lengths: &[u64]| lengths.iter().map(|&n| n as Count).collect::<Vec<_>>();
        let starts = |lengths: &[u64]| {
            let start = |next: &mut u64, &n: &u64| {
                let start = *next;
                *next += n;
                Some(start as Count)
            };
            lengths.iter().scan(0, start).collect::<Vec<Count>>()
        };
        {
            let from = Partition::new(&sent[..], counts(&lengths), starts(&lengths));
            let mut to = PartitionMut::new(&mut arrived[..], counts(&arriving), starts(&arriving));
            self.communicator.all_to_all_varcount_into(&from, &mut to);
        }
        let mut rest = &arrived[..];
        let take = |&length: &u64| {
            let (own, others) = rest.split_at(length as usize);
            rest = others;
            own.to_vec()
        };
        Ok(arriving.iter().map(take).collect())
    }

    fn volume(&self) -> Volume {
        self.volume.get()
    }
}

impl Drop for MpiTransport {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.communicator.abort(1);
        }
    }
}

impl fmt::Debug for MpiTransport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = f.debug_struct("MpiTransport");
        text.field("rank", &self.rank()).field("size", &self.size()).finish_non_exhaustive()
    }
}
