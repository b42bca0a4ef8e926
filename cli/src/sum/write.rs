//! Results to files that appear complete or not at all.

use std::ffi::OsStr;
use std::fmt::LowerExp;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use farfield_formula::{Derivatives, Precision};
use ndarray::{ArrayView1, ArrayView2};
use ndarray_npy::{WritableElement, WriteNpyExt};

use super::interrupt::Interrupt;

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub(crate) struct WriteError {
    path: PathBuf,
    problem: Problem,
}

#[derive(Debug, thiserror::Error)]
enum Problem {
    #[error("unknown file type: expected .npy or .csv")]
    Extension,
    #[error("no such folder: expected one that exists")]
    Folder,
    #[error("{0}")]
    Io(#[from] io::Error),
}

impl Problem {
    fn at(self, path: &Path) -> WriteError {
        WriteError { path: path.to_owned(), problem: self }
    }
}

/// A number that can be written in every format.
pub(crate) trait Number: Precision + WritableElement + LowerExp {}

impl Number for f32 {}
impl Number for f64 {}

/// Refuses, before anything is computed, a file of values that could not be written after it.
pub(crate) fn check_values_path(path: &Path) -> Result<(), WriteError> {
    match format(path) {
        Some(_) => check_folder(path),
        None => Err(Problem::Extension.at(path)),
    }
}

/// Refuses, before anything is computed, a file in a folder that does not exist.
pub(crate) fn check_folder(path: &Path) -> Result<(), WriteError> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            Err(Problem::Folder.at(path))
        }
        _ => Ok(()),
    }
}

/// Writes rows of values, with a number for each of the columns.
pub(crate) fn values<T: Number>(
    interrupt: &Interrupt,
    path: &Path,
    values: &[T],
    columns: &[String],
) -> Result<(), WriteError> {
    match format(path) {
        Some(Format::Npy) => whole_file(interrupt, path, |file| npy(file, values, columns.len())),
        Some(Format::Csv) => whole_file(interrupt, path, |file| csv(file, values, columns)),
        None => Err(Problem::Extension.at(path)),
    }
}

/// Writes to a temporary name in the same folder and renames it once everything is on disk.
pub(crate) fn whole_file(
    interrupt: &Interrupt,
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), WriteError> {
    let mut name = OsStr::new(".").to_owned();
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}", std::process::id()));
    let temporary = path.with_file_name(name);
    let finish = |file: File| {
        let mut file = BufWriter::new(file);
        write(&mut file)?;
        file.into_inner()?.sync_all()
    };
    interrupt.whole_file(&temporary, path, finish).map_err(|error| Problem::Io(error).at(path))
}

enum Format {
    Npy,
    Csv,
}

fn format(path: &Path) -> Option<Format> {
    match path.extension().and_then(OsStr::to_str) {
        Some("npy") => Some(Format::Npy),
        Some("csv") => Some(Format::Csv),
        _ => None,
    }
}

fn npy<T: Number>(file: &mut BufWriter<File>, values: &[T], columns: usize) -> io::Result<()> {
    if columns == 1 {
        ArrayView1::from(values).write_npy(file).map_err(io::Error::other)
    } else {
        ArrayView2::from_shape((values.len() / columns.max(1), columns), values)
            .map_err(io::Error::other)?
            .write_npy(file)
            .map_err(io::Error::other)
    }
}

/// The columns of values with so many fields: potentials, or components u1, u2 …; then, with gradients, their
/// derivatives along the first axis, the second and the third; then, with Hessians, their second derivatives.
pub(crate) fn columns(fields: usize, derivatives: Derivatives) -> Vec<String> {
    let value = |k: usize| if fields == 1 { "potential".into() } else { format!("u{}", k + 1) };
    let values = (0..fields).map(value);
    let axes = ["x", "y", "z", "xx", "xy", "xz", "yy", "yz", "zz"];
    let axes = axes.into_iter().take(derivatives.parts() - 1);
    let slopes = axes.flat_map(|axis| {
        (0..fields).map(move |k| match fields {
            1 if axis.len() == 2 => format!("hessian_{axis}"),
            1 => format!("gradient_{axis}"),
            _ => format!("u{}_{axis}", k + 1),
        })
    });
    values.chain(slopes).collect()
}

fn csv<T: Number>(file: &mut BufWriter<File>, values: &[T], columns: &[String]) -> io::Result<()> {
    writeln!(file, "{}", columns.join(","))?;
    for row in values.chunks(columns.len().max(1)) {
        // The shortest decimals that give the same bits when read back.
        let cells: Vec<_> = row.iter().map(|value| format!("{value:e}")).collect();
        writeln!(file, "{}", cells.join(","))?;
    }
    Ok(())
}
