//! Why `farfield factors` fails.

use std::path::PathBuf;

use farfield_scenes::{OutputError, SceneError};

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
    #[error("--between: expected names of {kind}, of which there are {known}; found `{name}`")]
    Unnamed { name: String, kind: &'static str, known: String },
    #[error("the scene has {0} points: expected none, as only surfaces have form factors")]
    Points(usize),
    #[error("{}: expected a file that ends in .csv, .npy or .txt", _0.display())]
    Ending(PathBuf),
    #[error("{}: expected a file that ends in .csv for --sparse", _0.display())]
    Sparse(PathBuf),
    #[error("{found} groups: expected {limit} at most; --by material or --by file makes fewer")]
    TooMany { found: usize, limit: usize },
    #[error(
        "factors that include reflection (emit = 1) do not converge: expected surfaces that absorb"
    )]
    White,
}
