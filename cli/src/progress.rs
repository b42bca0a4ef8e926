//! Bars on the terminal; nothing where standard error isn't one, or when quiet.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Steps of a bar.
const STEPS: u64 = 1000;

/// The phases of a run: what they show, and how long they took.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    quiet: bool,
    seconds: RefCell<BTreeMap<&'static str, f64>>,
}

/// A phase that is going on; its time counts when it is dropped.
#[derive(Debug)]
pub(crate) struct Bar<'a> {
    bar: ProgressBar,
    phase: &'static str,
    start: Instant,
    progress: &'a Progress,
}

impl Progress {
    /// Nothing so far.
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet, seconds: RefCell::default() }
    }

    /// A phase with a bar and the time left.
    pub(crate) fn bar(&self, phase: &'static str) -> Bar<'_> {
        let style = ProgressStyle::with_template("{msg:<12} [{bar:40}] {percent:>3} %  {eta} left")
            .expect("the template is valid")
            .progress_chars("=> ");
        self.start(phase, ProgressBar::new(STEPS).with_style(style))
    }

    /// A phase of unknown length, with the time spent.
    pub(crate) fn spinner(&self, phase: &'static str) -> Bar<'_> {
        let style = ProgressStyle::with_template("{msg:<12} {spinner}  {elapsed}")
            .expect("the template is valid");
        let bar = self.start(phase, ProgressBar::new_spinner().with_style(style));
        if !self.quiet {
            bar.bar.enable_steady_tick(Duration::from_millis(100));
        }
        bar
    }

    /// The seconds that each phase took.
    pub(crate) fn seconds(&self) -> BTreeMap<&'static str, f64> {
        self.seconds.borrow().clone()
    }

    fn start(&self, phase: &'static str, bar: ProgressBar) -> Bar<'_> {
        if self.quiet {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        Bar { bar: bar.with_message(phase), phase, start: Instant::now(), progress: self }
    }
}

impl Bar<'_> {
    /// Moves the bar to a fraction.
    pub(crate) fn show(&self, fraction: f64) {
        self.bar.set_position((fraction * STEPS as f64) as u64);
    }

    /// A function that does, from any thread.
    pub(crate) fn shower(&self) -> impl Fn(f64) + Sync + use<> {
        let bar = self.bar.clone();
        move |fraction| bar.set_position((fraction * STEPS as f64) as u64)
    }
}

impl Drop for Bar<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        let seconds = self.start.elapsed().as_secs_f64();
        *self.progress.seconds.borrow_mut().entry(self.phase).or_default() += seconds;
    }
}
