//! Ctrl-C: ends the run at once, and leaves no half file behind.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// 128 + SIGINT, as shells have it.
const EXIT_CODE: i32 = 130;

/// Knows the file that is being written under a temporary name.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interrupt(Arc<Mutex<Option<PathBuf>>>);

impl Interrupt {
    /// One that Ctrl-C asks, for the rest of the program.
    ///
    /// # Errors
    /// If the system doesn't tell of Ctrl-C.
    pub(crate) fn by_ctrl_c() -> Result<Self, ctrlc::Error> {
        let interrupt = Self::default();
        let asked = interrupt.clone();
        ctrlc::set_handler(move || {
            // Held until the end, so that nothing is begun or renamed meanwhile.
            let _held = asked.remove();
            // Below the bar, if any. Whoever reads this may have gone away.
            drop(writeln!(io::stderr(), "\nfarfield sum: interrupted: nothing more is written"));
            std::process::exit(EXIT_CODE);
        })?;
        Ok(interrupt)
    }

    /// Writes to a temporary name and then gives the file its own, each of which Ctrl-C finds done or not begun.
    pub(crate) fn whole_file(
        &self,
        temporary: &Path,
        path: &Path,
        write: impl FnOnce(File) -> io::Result<()>,
    ) -> io::Result<()> {
        let file = {
            let mut held = self.lock();
            *held = Some(temporary.to_owned());
            File::create(temporary)
        };
        let written = file.and_then(write);
        let mut held = self.lock();
        let renamed = written.and_then(|()| fs::rename(temporary, path));
        if renamed.is_err() {
            // Best effort: the error that is reported is the one that came first.
            let _ = fs::remove_file(temporary);
        }
        *held = None;
        renamed
    }

    /// Removes what has been written under a temporary name. Nothing is renamed as long as the guard lives.
    fn remove(&self) -> MutexGuard<'_, Option<PathBuf>> {
        let held = self.lock();
        if let Some(temporary) = &*held {
            let _ = fs::remove_file(temporary);
        }
        held
    }

    fn lock(&self) -> MutexGuard<'_, Option<PathBuf>> {
        self.0.lock().unwrap_or_else(|e| e.into_inner())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_half_written_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let [temporary, path] = ["half", "whole"].map(|name| folder.path().join(name));
        let interrupt = Interrupt::default();
        let found = interrupt.whole_file(&temporary, &path, |mut file| {
            file.write_all(b"half")?;
            drop(interrupt.remove());
            assert!(!temporary.exists());
            Ok(())
        });
        assert!(found.is_err() && !path.exists());
        interrupt.whole_file(&temporary, &path, |mut file| file.write_all(b"whole")).unwrap();
        drop(interrupt.remove());
        assert!(path.exists() && !temporary.exists());
    }
}
