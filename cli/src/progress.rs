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
    residuals: RefCell<Vec<Curve>>,
}

/// The residuals of a solution: of every so manieth step, so that there are never too many.
#[derive(Debug)]
struct Curve {
    every: usize,
    steps: usize,
    residuals: Vec<(usize, f64)>,
}

/// Residuals that a curve has at most.
const MOST_RESIDUALS: usize = 1000;

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
        Self { quiet, ..Self::default() }
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

    /// Begins another solution, of which residuals follow.
    pub(crate) fn begin_residuals(&self) {
        let curve = Curve { every: 1, steps: 0, residuals: Vec::new() };
        self.residuals.borrow_mut().push(curve);
    }

    /// Takes note of a residual of the latest solution.
    pub(crate) fn add_residual(&self, step: usize, residual: f64) {
        let mut curves = self.residuals.borrow_mut();
        let Some(curve) = curves.last_mut() else { return };
        if curve.steps.is_multiple_of(curve.every) {
            curve.residuals.push((step, residual));
        }
        curve.steps += 1;
        if curve.residuals.len() > MOST_RESIDUALS {
            let mut number = 0;
            curve.residuals.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            curve.every *= 2;
        }
    }

    /// The residuals of all solutions since this was asked last, step by step.
    pub(crate) fn take_residuals(&self) -> Vec<Vec<(usize, f64)>> {
        self.residuals.take().into_iter().map(|curve| curve.residuals).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_of_many_steps_are_thinned_evenly() {
        let progress = Progress::new(true);
        progress.add_residual(0, 1.0);
        for steps in [3, 10_000] {
            progress.begin_residuals();
            (0..steps).for_each(|step| progress.add_residual(step, 1.0 / (1 + step) as f64));
        }
        let [few, many] = &progress.take_residuals()[..] else { panic!("two solutions") };
        assert_eq!(few[..], [(0, 1.0), (1, 0.5), (2, 1.0 / 3.0)]);
        assert!((MOST_RESIDUALS / 2..=MOST_RESIDUALS).contains(&many.len()));
        let every = many[1].0;
        assert!(many.iter().enumerate().all(|(k, &(step, _))| step == k * every));
        assert!(progress.take_residuals().is_empty());
    }
}
