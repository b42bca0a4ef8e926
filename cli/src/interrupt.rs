//! Ctrl-C: ends a run at once while there is nothing to keep, and with what it has from then on.

use std::io::{self, Write};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether a run is to end with what it has.
#[derive(Debug, Default)]
pub(crate) struct Interrupt {
    holds: AtomicBool,
    asked: AtomicBool,
}

impl Interrupt {
    /// One that Ctrl-C asks, for the rest of the program, which is this command.
    ///
    /// # Errors
    /// If the system doesn't tell of Ctrl-C.
    pub(crate) fn by_ctrl_c(command: &'static str) -> Result<Arc<Self>, ctrlc::Error> {
        let interrupt = Arc::new(Self::default());
        let asked = Arc::clone(&interrupt);
        ctrlc::set_handler(move || {
            let goes_on = asked.ask();
            let what = if goes_on {
                "what is done will be written; once more ends at once"
            } else {
                "nothing more is written"
            };
            // Below the bar, if any. Whoever reads this may have gone away.
            drop(writeln!(io::stderr(), "\nfarfield {command}: interrupted: {what}"));
            if !goes_on {
                std::process::exit(EXIT_CODE);
            }
        })?;
        Ok(interrupt)
    }

    /// Says whether there is something to keep from now on.
    pub(crate) fn hold(&self, holds: bool) {
        self.holds.store(holds, Ordering::SeqCst);
    }

    /// Asks the run to end. Whether it will by itself: not if it was asked before, or holds nothing.
    pub(crate) fn ask(&self) -> bool {
        !self.asked.swap(true, Ordering::SeqCst) && self.holds.load(Ordering::SeqCst)
    }

    /// Whether the run is asked to end.
    pub(crate) fn is_asked(&self) -> bool {
        self.asked.load(Ordering::SeqCst)
    }

    /// The same for solvers.
    pub(crate) fn flow(&self) -> ControlFlow<()> {
        if self.is_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// 128 + SIGINT, as shells have it.
const EXIT_CODE: i32 = 130;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_request_spares_what_is_held_and_the_second_nothing() {
        let interrupt = Interrupt::default();
        assert!(interrupt.flow().is_continue());
        interrupt.hold(true);
        assert!(interrupt.ask() && interrupt.flow().is_break());
        assert!(!interrupt.ask() && interrupt.is_asked());
        let planning = Interrupt::default();
        planning.hold(true);
        planning.hold(false);
        assert!(!planning.ask());
    }
}
