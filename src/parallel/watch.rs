//! Looking on while something is computed, and stopping it.

use std::fmt;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use crate::error::Error;

/// Which part of the work is under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Phase {
    /// Sorting the points into trees.
    Tree,
    /// Finding the interaction lists and asking the mask for single pairs.
    Lists,
    /// Preparing the expansion's operators.
    Operators,
    /// Of an application: from charges to multipole and local terms.
    Terms,
    /// Of an application: from local terms, multipole terms and near sources to values; all of direct sums.
    Values,
}

const PHASES: [Phase; 5] =
    [Phase::Tree, Phase::Lists, Phase::Operators, Phase::Terms, Phase::Values];

/// How far some work has come.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Progress {
    /// The part under way.
    pub phase: Phase,
    /// How much of that part is done, from 0 to 1; reports may arrive out of order.
    pub fraction: f64,
}

/// Looks on while a plan is [built](crate::Builder::watch) or [applied](crate::Fmm::apply_watched), or
/// [sums are formed directly](crate::direct_watched), and can stop them.
///
/// Clones share one state. What is watched looks whether it shall stop after every few milliseconds of its work, and
/// ends with [`Error::Stopped`] then; nothing of the plan or of its later applications is changed by that. Results have
/// the same bits whether they are watched or not.
///
/// ```
/// use farfield::{Error, Fmm, Watch, formula};
///
/// let points: Vec<[f64; 3]> = (0..500).map(|i| [f64::from(i).sin(), f64::from(i).cos(), 0.0]).collect();
/// let watch = Watch::new();
/// let fmm = Fmm::builder(formula!(|d| d.length())).watch(&watch).build(&points, &points)?;
/// let potentials = fmm.apply_watched(&[1.0; 500], &watch)?;
///
/// // From another thread, or a handler of signals:
/// watch.stop();
/// assert_eq!(fmm.apply_watched(&[1.0; 500], &watch), Err(Error::Stopped));
/// assert_eq!(fmm.apply(&[1.0; 500])?, potentials);
/// # Ok::<(), Error>(())
/// ```
#[derive(Clone, Default)]
pub struct Watch(Option<Arc<State>>);

struct State {
    stopped: AtomicBool,
    phase: AtomicU8,
    /// Parts of the phase that are done, and all of them.
    done: AtomicU64,
    all: AtomicU64,
    ask: Option<Box<Ask>>,
    start: Instant,
    /// Milliseconds after the start at which it was asked last.
    asked: AtomicU64,
}

type Ask = dyn Fn(Progress) -> ControlFlow<()> + Send + Sync;

/// Parts that a fraction is counted in.
const PARTS: f64 = 1e6;
/// The time between two questions.
const INTERVAL: Duration = Duration::from_millis(20);

impl Watch {
    /// One that [`stop`](Self::stop) stops.
    pub fn new() -> Self {
        Self::of(None)
    }

    /// One that asks a closure, told how far the work has come, whether to go on: about every 20 milliseconds, from one
    /// of the threads that do the work. Once it has said [`ControlFlow::Break`], it may be asked again while the work
    /// comes to its end.
    ///
    /// ```
    /// use std::ops::ControlFlow;
    /// use farfield::{Error, Watch, direct_watched, formula};
    ///
    /// let points = vec![[0.0f64; 3]; 100_000];
    /// let watch = Watch::asking(|_progress| ControlFlow::Break(()));
    /// let stopped = direct_watched(&formula!(|d| d.length()), &points, &vec![1.0; 100_000], &points, &watch);
    /// assert_eq!(stopped, Err(Error::Stopped));
    /// ```
    pub fn asking(ask: impl Fn(Progress) -> ControlFlow<()> + Send + Sync + 'static) -> Self {
        Self::of(Some(Box::new(ask)))
    }

    /// Ends all that is watched, now and later.
    pub fn stop(&self) {
        if let Some(state) = &self.0 {
            state.stopped.store(true, Relaxed);
        }
    }

    /// How far the work has come that began last.
    pub fn progress(&self) -> Progress {
        self.0.as_deref().map_or(Progress { phase: Phase::Tree, fraction: 0.0 }, State::progress)
    }

    /// Whether the work shall end. Whoever computes something long inside an expansion looks here now and then; what
    /// it leaves behind then is not used.
    #[inline]
    pub fn is_stopped(&self) -> bool {
        self.0.as_deref().is_some_and(State::is_stopped)
    }

    /// Whether the work shall go on.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub(crate) fn check(&self) -> Result<(), Error> {
        if self.is_stopped() { Err(Error::Stopped) } else { Ok(()) }
    }

    /// Begins a phase of so many parts.
    pub(crate) fn begin(&self, phase: Phase, parts: usize) {
        if let Some(state) = &self.0 {
            let index = PHASES.iter().position(|known| *known == phase).unwrap_or(0);
            state.phase.store(index as u8, Relaxed);
            state.done.store(0, Relaxed);
            state.all.store(parts.max(1) as u64, Relaxed);
        }
    }

    /// Counts parts of the phase as done, and says whether the work shall end.
    pub(crate) fn advance(&self, parts: usize) -> bool {
        self.0.as_deref().is_some_and(|state| {
            state.done.fetch_add(parts as u64, Relaxed);
            state.is_stopped()
        })
    }

    /// A phase is so far.
    pub(crate) fn enter(&self, Progress { phase, fraction }: Progress) {
        self.begin(phase, PARTS as usize);
        self.advance((fraction * PARTS) as usize);
    }

    fn of(ask: Option<Box<Ask>>) -> Self {
        Self(Some(Arc::new(State {
            stopped: AtomicBool::new(false),
            phase: AtomicU8::new(0),
            done: AtomicU64::new(0),
            all: AtomicU64::new(1),
            ask,
            start: Instant::now(),
            asked: AtomicU64::new(0),
        })))
    }
}

impl State {
    fn progress(&self) -> Progress {
        let fraction = self.done.load(Relaxed) as f64 / self.all.load(Relaxed) as f64;
        let phase = PHASES[usize::from(self.phase.load(Relaxed)).min(PHASES.len() - 1)];
        Progress { phase, fraction: fraction.min(1.0) }
    }

    fn is_stopped(&self) -> bool {
        if self.stopped.load(Relaxed) {
            return true;
        }
        let Some(ask) = &self.ask else { return false };
        let (now, asked) = (self.start.elapsed().as_millis() as u64, self.asked.load(Relaxed));
        let is_time = now >= asked + INTERVAL.as_millis() as u64;
        // One thread asks at a time.
        if is_time
            && self.asked.compare_exchange(asked, now, Relaxed, Relaxed).is_ok()
            && ask(self.progress()).is_break()
        {
            self.stopped.store(true, Relaxed);
        }
        self.stopped.load(Relaxed)
    }
}

/// A watch is no part of what is watched: all are equal.
impl PartialEq for Watch {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl fmt::Debug for Watch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stopped = self.0.as_deref().is_some_and(|state| state.stopped.load(Relaxed));
        f.debug_struct("Watch").field("stopped", &stopped).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_is_asked_is_told_how_far_it_is() {
        let seen = Arc::new(AtomicU64::new(0));
        let told = Arc::clone(&seen);
        let watch = Watch::asking(move |progress| {
            told.store((progress.fraction * 100.0) as u64, Relaxed);
            if progress.phase == Phase::Values {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        });
        watch.begin(Phase::Lists, 4);
        assert!(!watch.advance(1));
        std::thread::sleep(2 * INTERVAL);
        assert!(!watch.is_stopped());
        assert_eq!(seen.load(Relaxed), 25);
        watch.begin(Phase::Values, 2);
        std::thread::sleep(2 * INTERVAL);
        assert!(watch.is_stopped() && watch.clone().check() == Err(Error::Stopped));
        assert_eq!(watch.progress(), Progress { phase: Phase::Values, fraction: 0.0 });
        assert!(!Watch::default().is_stopped());
    }
}
