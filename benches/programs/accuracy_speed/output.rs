//! Files of measurements.

use std::fs;
use std::path::{Path, PathBuf};

/// The folder that files are written to.
#[derive(Debug)]
pub(crate) struct Output {
    folder: PathBuf,
}

impl Output {
    /// Makes the folder.
    ///
    /// # Errors
    /// If that can't be done.
    pub(crate) fn new(folder: &Path) -> Result<Self, String> {
        fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        Ok(Self { folder: folder.into() })
    }

    /// Writes a file.
    ///
    /// # Errors
    /// If it can't be written.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<(), String> {
        let path = self.folder.join(name);
        fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))
    }
}
