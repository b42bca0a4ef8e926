//! How a file takes its name: beside it until it is whole, then in place of an earlier one, which can be put back.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// Whether two paths are those of one file, which need not be there yet.
pub fn is_same_file(one: &Path, other: &Path) -> bool {
    let place = |path: &Path| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = fs::canonicalize(folder.unwrap_or(Path::new("."))).ok()?;
        Some(folder.join(path.file_name()?))
    };
    place(one).is_some_and(|place_of_one| place(other) == Some(place_of_one))
}

/// How files are called that are not whole yet, and those that are about to be replaced.
pub(super) const PARTIAL: &str = "partial";
pub(super) const EARLIER: &str = "earlier";

/// A temporary name beside a file. What is for a device or a pipe is kept among temporary files.
pub(super) fn beside(path: &Path, what: &str) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = format!(".{name}.{}.{what}", std::process::id());
    if is_stream(path) { std::env::temp_dir().join(name) } else { path.with_file_name(name) }
}

/// Whether something other than a file or a folder has this name: it can be written to, but must not be replaced.
fn is_stream(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|what| !what.is_file() && !what.is_dir())
}

/// The file that a symbolic link leads to; any other path as it is.
pub(super) fn followed(path: &Path) -> io::Result<PathBuf> {
    let is_link = fs::symlink_metadata(path).is_ok_and(|what| what.is_symlink());
    if is_link && !is_stream(path) { fs::canonicalize(path) } else { Ok(path.to_owned()) }
}

/// Fails if there is a folder where a file is to be.
pub(super) fn refuse_folder(path: &Path) -> io::Result<()> {
    if path.is_dir() { Err(io::ErrorKind::IsADirectory.into()) } else { Ok(()) }
}

/// Gives a file its name and puts an earlier one of that name aside.
pub(super) fn replace(path: &Path) -> io::Result<()> {
    refuse_folder(path)?;
    if is_stream(path) {
        let mut stream = fs::OpenOptions::new().write(true).open(path)?;
        io::copy(&mut File::open(beside(path, PARTIAL))?, &mut stream)?;
        return fs::remove_file(beside(path, PARTIAL));
    }
    match fs::rename(path, beside(path, EARLIER)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => (),
    }
    let renamed = fs::rename(beside(path, PARTIAL), path);
    if renamed.is_err() {
        drop(fs::rename(beside(path, EARLIER), path));
    }
    renamed
}

/// Takes a file away that has its name, and puts the earlier one back.
pub(super) fn put_back(path: &Path) {
    if is_stream(path) {
        return;
    }
    drop(fs::remove_file(path));
    drop(fs::rename(beside(path, EARLIER), path));
}
