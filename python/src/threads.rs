//! The threads that work for Python, while Python goes on.

use std::sync::OnceLock;

use farfield::Watch;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::exceptions::InputError;
use crate::interrupt::interruptible;

/// The threads of a plan.
pub(crate) struct Threads {
    pool: Option<ThreadPool>,
    /// How many were asked for.
    pub(crate) count: Option<usize>,
    /// The process whose threads they are: a fork has none of them.
    process: u32,
}

/// The process that has the threads of the default.
static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();

/// Pairs that are summed so soon that nobody can interrupt it.
const FEW_PAIRS: usize = 1 << 20;

impl Threads {
    pub(crate) fn new(count: Option<usize>) -> PyResult<Self> {
        let process = std::process::id();
        let is_forked = *FIRST_PROCESS.get_or_init(|| process) != process;
        let pool = if count.is_some() || is_forked {
            // As many as there are cores, if it is not said.
            let pool = ThreadPoolBuilder::new().num_threads(count.unwrap_or(0)).build();
            Some(pool.map_err(|error| InputError::new_err(error.to_string()))?)
        } else {
            None
        };
        Ok(Self { pool, count, process })
    }

    /// Does work for so many pairs without holding up other threads of Python. Where it takes long, Python's signals are
    /// looked at meanwhile.
    pub(crate) fn run<R: Send>(
        &self,
        py: Python<'_>,
        pairs: usize,
        work: impl FnOnce(&Watch) -> R + Send,
    ) -> PyResult<R> {
        if self.process != std::process::id() {
            return Err(InputError::new_err(
                "the plan was made before this process was forked: expected one that is made in it",
            ));
        }
        let work = |watch: &Watch| match &self.pool {
            Some(pool) => pool.install(|| work(watch)),
            None => work(watch),
        };
        if pairs <= FEW_PAIRS {
            Ok(py.detach(|| work(&Watch::default())))
        } else {
            interruptible(py, work)
        }
    }
}
