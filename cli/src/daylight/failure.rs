//! Why `farfield daylight` fails.

use std::io;
use std::path::PathBuf;

use farfield_scenes::{OutputError, SceneError};

use crate::outdoors::NorthIsUp;

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    #[error("cannot start the threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Radiosity(#[from] farfield_radiosity::Error),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("cannot listen to Ctrl-C: {0}")]
    Interrupt(#[from] ctrlc::Error),
    #[error("{0}: expected surfaces, found none")]
    NoSurfaces(String),
    #[error("{}: expected a file that ends in .csv", _0.display())]
    Ending(PathBuf),
    #[error(transparent)]
    North(#[from] NorthIsUp),
    #[error("{}: {source}", path.display())]
    Unreadable { path: PathBuf, source: io::Error },
    #[error("{}, line {line}: expected {expected}, found `{found}`", path.display())]
    Sun { path: PathBuf, line: usize, expected: &'static str, found: String },
}
