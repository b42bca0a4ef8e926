//! Bars on the terminal; nothing where standard error isn't one.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// Steps of a bar that shows a fraction.
pub(crate) const FINE: u64 = 1000;

/// A bar for `steps` steps with the time left.
pub(crate) fn bar(phase: &'static str, steps: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:<12} [{bar:40}] {percent:>3} %  {eta} left")
        .expect("the template is valid")
        .progress_chars("=> ");
    ProgressBar::new(steps).with_style(style).with_message(phase)
}

/// Moves a bar of [`FINE`] steps to a fraction.
pub(crate) fn show(bar: &ProgressBar, fraction: f64) {
    bar.set_position((fraction * FINE as f64) as u64);
}

/// A spinner for work of unknown length, with the time spent.
pub(crate) fn spinner(phase: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:<12} {spinner}  {elapsed}")
        .expect("the template is valid");
    let spinner = ProgressBar::new_spinner().with_style(style).with_message(phase);
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}
