//! Ranks that are threads of one process: for tests, and to see what many ranks would send.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use crate::transport::{Transport, TransportError, Volume};

/// Calls `work` on as many ranks, each in a thread of its own; returns what they return, in the order of ranks.
///
/// ```
/// use farfield_mpi::{Transport, on_threads};
///
/// let sums = on_threads(3, |ranks| {
///     let all = ranks.gather(&[ranks.rank() as u64])?;
///     Ok::<u64, farfield_mpi::TransportError>(all.iter().flatten().sum())
/// });
/// assert_eq!(sums, vec![Ok(3); 3]);
/// ```
///
/// # Panics
/// If `work` does on any rank. The other ranks' waiting ends with an error.
pub fn on_threads<R: Send>(size: usize, work: impl Fn(&ThreadTransport) -> R + Sync) -> Vec<R> {
    let (senders, receivers): (Vec<_>, Vec<_>) = (0..size).map(|_| channel()).unzip();
    let senders: Arc<[Sender<Message>]> = senders.into();
    thread::scope(|scope| {
        let start = |(rank, receiver)| {
            let (senders, work) = (Arc::clone(&senders), &work);
            scope.spawn(move || {
                let waiting = (0..senders.len()).map(|_| VecDeque::new()).collect();
                let gone = vec![false; senders.len()];
                let inbox = RefCell::new(Inbox { receiver, waiting, gone });
                work(&ThreadTransport { rank, senders, inbox, volume: Cell::default() })
            })
        };
        let ranks: Vec<_> = receivers.into_iter().enumerate().map(start).collect();
        let join = |rank: thread::ScopedJoinHandle<'_, R>| {
            rank.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        ranks.into_iter().map(join).collect()
    })
}

/// A rank that is a thread, and reaches the others by channels.
#[derive(Debug)]
pub struct ThreadTransport {
    rank: usize,
    senders: Arc<[Sender<Message>]>,
    inbox: RefCell<Inbox>,
    volume: Cell<Volume>,
}

/// What a rank sends to another.
#[derive(Debug)]
struct Message {
    from: usize,
    /// None once it sends nothing more.
    words: Option<Vec<u64>>,
}

/// What a rank has received.
#[derive(Debug)]
struct Inbox {
    receiver: Receiver<Message>,
    /// From each rank, what was not asked for yet.
    waiting: Vec<VecDeque<Vec<u64>>>,
    gone: Vec<bool>,
}

impl Inbox {
    /// The next message from a rank.
    fn next(&mut self, from: usize) -> Result<Vec<u64>, TransportError> {
        loop {
            if let Some(words) = self.waiting[from].pop_front() {
                return Ok(words);
            }
            if self.gone[from] {
                return Err(TransportError::Gone { rank: from });
            }
            match self.receiver.recv() {
                Ok(Message { from, words: Some(words) }) => self.waiting[from].push_back(words),
                Ok(Message { from, words: None }) => self.gone[from] = true,
                Err(_) => return Err(TransportError::Gone { rank: from }),
            }
        }
    }
}

impl Transport for ThreadTransport {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.senders.len()
    }

    fn exchange(&self, messages: Vec<Vec<u64>>) -> Result<Vec<Vec<u64>>, TransportError> {
        let (expected, found) = (self.size(), messages.len());
        if found != expected {
            return Err(TransportError::Messages { expected, found });
        }
        let (mut own, mut volume) = (Vec::new(), self.volume.get());
        for (to, words) in messages.into_iter().enumerate() {
            if to == self.rank {
                own = words;
                continue;
            }
            volume.messages += u64::from(!words.is_empty());
            volume.words += words.len() as u64;
            // A rank that is gone is met when its answer is missed.
            let _ = self.senders[to].send(Message { from: self.rank, words: Some(words) });
        }
        self.volume.set(volume);
        let mut inbox = self.inbox.borrow_mut();
        let mut receive = |from: usize| {
            if from == self.rank { Ok(std::mem::take(&mut own)) } else { inbox.next(from) }
        };
        (0..expected).map(&mut receive).collect()
    }

    fn volume(&self) -> Volume {
        self.volume.get()
    }
}

impl Drop for ThreadTransport {
    fn drop(&mut self) {
        for (_, sender) in self.senders.iter().enumerate().filter(|(to, _)| *to != self.rank) {
            let _ = sender.send(Message { from: self.rank, words: None });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_arrives_where_it_was_sent() {
        for size in [1, 2, 5] {
            let arrived = on_threads(size, |ranks| {
                let own = ranks.rank() as u64;
                let mut all = Vec::new();
                for round in 0..3 {
                    let message = |q: u64| vec![own; (round * q) as usize];
                    let messages = (0..size as u64).map(message).collect();
                    all.push(ranks.exchange(messages).unwrap());
                }
                (all, ranks.volume())
            });
            for (rank, (all, volume)) in arrived.iter().enumerate() {
                for (round, messages) in all.iter().enumerate() {
                    for (from, words) in messages.iter().enumerate() {
                        assert_eq!(*words, vec![from as u64; round * rank]);
                    }
                }
                let others: usize = (0..size).filter(|q| *q != rank).sum();
                assert_eq!(volume.words, 3 * others as u64);
            }
        }
    }

    #[test]
    fn a_rank_that_is_gone_is_named_and_waited_for_no_longer() {
        let errors = on_threads(4, |ranks| {
            if ranks.rank() == 2 {
                return None;
            }
            ranks.gather(&[1]).err()
        });
        let gone = Some(TransportError::Gone { rank: 2 });
        assert_eq!(errors, [gone.clone(), gone.clone(), None, gone]);
    }

    #[test]
    fn messages_for_too_few_ranks_are_refused() {
        let errors = on_threads(2, |ranks| ranks.exchange(vec![Vec::new()]).err());
        assert_eq!(errors, vec![Some(TransportError::Messages { expected: 2, found: 1 }); 2]);
    }
}
