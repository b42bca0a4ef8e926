//! Counting from many threads.

use std::sync::atomic::{AtomicU64, Ordering};

/// A counter that many threads can add to at full speed: each to a cache line of its own.
#[derive(Debug, Default)]
pub(crate) struct Tally([Lane; 16]);

/// One cache line of a [`Tally`].
#[derive(Debug, Default)]
#[repr(align(128))]
struct Lane(AtomicU64);

impl Tally {
    pub(crate) fn add(&self, n: u64) {
        let lane = rayon::current_thread_index().unwrap_or(0) % self.0.len();
        self.0[lane].0.fetch_add(n, Ordering::Relaxed);
    }

    pub(crate) fn total(&self) -> u64 {
        self.0.iter().map(|lane| lane.0.load(Ordering::Relaxed)).sum()
    }
}
