//! Why `farfield radiosity` fails.

use std::io;
use std::path::PathBuf;

use farfield_radiosity::Error;
use farfield_scenes::{Mesh, OutputError, Scene, SceneError};

use super::warning::Warning;
use crate::outdoors::NorthIsUp;

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
    #[error(
        "--sky, --sun and --ambient need surfaces that cast shadows: expected --visibility exact or fractional"
    )]
    Unhidden,
    #[error(
        "--ground, --sky-model, --zenith and --north say nothing without --sky or --sun: expected one of these"
    )]
    Indoors,
    #[error("nothing from outside reaches the scene, and nothing in it emits")]
    Unlit,
    #[error("--ambient is a temperature, and says nothing about light: expected --quantity heat")]
    Warm,
    #[error(transparent)]
    North(#[from] NorthIsUp),
    #[error("{0}; form factors alone come by `--form-factors FILE`")]
    Dark(Warning),
    #[error("{flag} {}: expected a name that no other file of the run has", path.display())]
    Taken { flag: &'static str, path: PathBuf },
    #[error("{}: {source}", path.display())]
    Unreadable { path: PathBuf, source: io::Error },
    #[error("{}, line {line}: expected {expected}, found `{found}`", path.display())]
    Steps { path: PathBuf, line: usize, expected: String, found: String },
    #[error("{}; nothing was written (--strict)", sentences(warnings))]
    Strict { warnings: Vec<Warning> },
    #[error(
        "the form factors of {element} would have to change by {:+.0} % to close its row, allowed are \
         \u{b1}{:.0} %: elements are missing, turned the wrong way or too coarse",
        100.0 * change,
        100.0 * limit
    )]
    NotClosable { element: String, change: f64, limit: f64 },
    #[error("{source}; it is {element}")]
    Negative { element: String, source: farfield_radiosity::Error },
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
    BelowZero { found: f64, place: [f64; 3], rms: f64 },
}

impl Failure {
    /// The failure of an exchange or of its solution, with the place of the element that it concerns.
    pub(crate) fn placed(error: Error, scene: &Scene, mesh: &Mesh) -> Self {
        let place = |index| mesh.describe(scene, index);
        match error {
            Error::NotClosable { index, change, limit } => {
                Self::NotClosable { element: place(index), change, limit }
            }
            Error::NegativeRadiosity { index, .. } => {
                Self::Negative { element: place(index), source: error }
            }
            error => error.into(),
        }
    }

    /// Makes warnings errors, if they are to be.
    pub(crate) fn of_warnings(strict: bool, warnings: &[Warning]) -> Result<(), Self> {
        if strict && !warnings.is_empty() {
            return Err(Self::Strict { warnings: warnings.to_vec() });
        }
        Ok(())
    }
}

/// Warnings one after the other.
fn sentences(warnings: &[Warning]) -> String {
    let sentences: Vec<_> = warnings.iter().map(Warning::to_string).collect();
    sentences.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_t_be_closed_is_told_with_its_sign() {
        let element = "the element".to_owned();
        let message = Failure::NotClosable { element, change: -0.52, limit: 0.5 }.to_string();
        assert!(
            message.contains("change by -52 % to close its row, allowed are \u{b1}50 %"),
            "{message}"
        );
    }
}
