//! Long work that Ctrl-C can end.

use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use farfield::Watch;
use pyo3::prelude::*;

/// The time between two looks at Python's signals.
const INTERVAL: Duration = Duration::from_millis(100);

/// Does work on another thread, while this one, which may be the one that Python's signals come to, looks at them. What
/// a handler of signals raises ends the work, and comes back: `KeyboardInterrupt`, as a rule.
pub(crate) fn interruptible<R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Watch) -> R + Send,
) -> PyResult<R> {
    let watch = Watch::new();
    let (found, raised) = py.detach(|| {
        thread::scope(|scope| {
            // Ends when the work does, or panics.
            let (end, ended) = channel::<()>();
            let watch = &watch;
            let worker = scope.spawn(move || {
                let _end = end;
                work(watch)
            });
            let mut raised = None;
            while ended.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                if raised.is_none() {
                    raised = Python::attach(|py| py.check_signals()).err();
                    if raised.is_some() {
                        watch.stop();
                    }
                }
            }
            (worker.join().unwrap_or_else(|panic| resume_unwind(panic)), raised)
        })
    });
    raised.map_or(Ok(found), Err)
}
