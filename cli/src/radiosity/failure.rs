//! Why `farfield radiosity` fails.

use farfield_scenes::{OutputError, SceneError};

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    #[error("cannot start the threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error("cannot listen to Ctrl-C: {0}")]
    Interrupt(#[from] ctrlc::Error),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{found} bands were asked for: expected 1, or the {} of the scene", expected)]
    Bands { found: usize, expected: usize },
    #[error("fractional visibility needs `--scheme fmm` and `--expansion interpolation`")]
    Unweighed,
    #[error("nothing in the scene {0}: expected a lamp, a sky or a surface with a temperature")]
    Dark(&'static str),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Radiosity(#[from] farfield_radiosity::Error),
    #[error(transparent)]
    Sum(#[from] farfield::Error),
    #[error(
        "the irradiance is off by {error:.1e} (relative l2, at {sampled} elements): expected at most \
         {tolerance:e}; nothing was written"
    )]
    Inaccurate { error: f64, sampled: usize, tolerance: f64 },
    #[error(
        "the irradiance at {place:?} comes out as {found:.1e}, of a root mean square of {rms:.1e}: \
         expected no more below zero than the tolerance; nothing was written"
    )]
    Negative { found: f64, place: [f64; 3], rms: f64 },
}
