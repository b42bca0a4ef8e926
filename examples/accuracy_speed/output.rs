//! Files, and pictures of the charts among them.

use std::cell::Cell;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Where files go.
#[derive(Debug)]
pub(crate) struct Output {
    folder: PathBuf,
    /// Charts of which no picture could be made.
    without_picture: Cell<usize>,
}

/// Width of a picture, in pixels.
const WIDTH: &str = "1600";

impl Output {
    /// Makes the folder.
    ///
    /// # Errors
    /// If that can't be done.
    pub(crate) fn new(folder: &Path) -> Result<Self, String> {
        fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        Ok(Self { folder: folder.into(), without_picture: Cell::new(0) })
    }

    /// Writes a file. A chart, `.svg`, is written as `.png` too if `rsvg-convert` is installed.
    ///
    /// # Errors
    /// If it can't be written.
    pub(crate) fn write(&self, name: &str, text: &str) -> Result<(), String> {
        let path = self.folder.join(name);
        fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
        if path.extension().is_some_and(|e| e == "svg") && picture(&path).is_err() {
            self.without_picture.set(self.without_picture.get() + 1);
        }
        Ok(())
    }

    /// Says where the files are, and whether pictures were left out.
    pub(crate) fn close(&self) {
        println!("\nfiles in {}", self.folder.display());
        let left_out = self.without_picture.get();
        if left_out > 0 {
            println!(
                "{left_out} PNG files left out: they need rsvg-convert, which can't be run here"
            );
        }
    }
}

fn picture(svg: &Path) -> io::Result<()> {
    let mut command = Command::new("rsvg-convert");
    command.args(["-w", WIDTH, "-o"]).arg(svg.with_extension("png")).arg(svg);
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status()?;
    if status.success() { Ok(()) } else { Err(io::Error::other("no picture")) }
}
