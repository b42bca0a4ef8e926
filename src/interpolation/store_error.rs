//! Why operators can't be saved or loaded.

use std::io;
use std::path::PathBuf;

/// Why an [`OperatorStore`](crate::OperatorStore) can't be saved or loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The system refuses.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or the folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file has been changed since it was written, or was cut off.
    #[error("{} is damaged: expected a file as `OperatorStore::save` wrote it", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
    },
    /// A file holds operators of another version, another machine, or something else.
    #[error("{} holds operators of {found}: expected {expected}", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What wrote it.
        found: String,
        /// What would have to.
        expected: String,
    },
    /// `FARFIELD_DISPATCH` names no level.
    #[error(transparent)]
    Dispatch(#[from] crate::UnknownDispatchLevel),
}
