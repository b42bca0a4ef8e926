//! A bar on the terminal, with the time left; nothing where standard error isn't one.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use farfield::{Phase, Watch};
use indicatif::{ProgressBar, ProgressStyle};

/// Steps of a bar.
const STEPS: u64 = 1000;
/// The time between two looks.
const INTERVAL: Duration = Duration::from_millis(100);

/// Shows how far some work has come while it is done.
pub(super) fn shown<V>(watch: &Watch, work: impl FnOnce() -> V) -> V {
    let _bar = Bar::of(watch);
    work()
}

/// Shows how far some work has come until it is dropped.
struct Bar {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Bar {
    /// Shows what is watched.
    fn of(watch: &Watch) -> Self {
        let style = ProgressStyle::with_template("{msg:<22} [{bar:40}] {percent:>3} %  {eta} left")
            .expect("the template is valid")
            .progress_chars("=> ");
        let bar = ProgressBar::new(STEPS).with_style(style);
        let (end, ended) = channel();
        let watch = watch.clone();
        let thread = thread::spawn(move || {
            let mut shown = None;
            while ended.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                let progress = watch.progress();
                if shown.replace(progress.phase) != Some(progress.phase) {
                    bar.reset();
                    bar.set_message(words(progress.phase));
                }
                bar.set_position((progress.fraction * STEPS as f64) as u64);
            }
            bar.finish_and_clear();
        });
        Self { end: Some(end), thread: Some(thread) }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            // Nothing hangs on what it showed.
            drop(thread.join());
        }
    }
}

fn words(phase: Phase) -> &'static str {
    match phase {
        Phase::Tree => "sorting points",
        Phase::Lists => "finding pairs of cells",
        Phase::Operators => "preparing operators",
        Phase::Terms => "summing from afar",
        _ => "summing",
    }
}
