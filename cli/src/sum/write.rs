//! Results to files that appear complete or not at all.

use std::ffi::OsStr;
use std::fmt::LowerExp;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use farfield_formula::{Derivatives, Precision};
use farfield_scenes::{OutputError, write_file};
use ndarray::{ArrayView1, ArrayView2};
use ndarray_npy::{WritableElement, WriteNpyExt};

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WriteError {
    #[error("{}: unknown file type: expected .npy or .csv", .0.display())]
    Extension(PathBuf),
    #[error("{}: no such folder: expected one that exists", .0.display())]
    Folder(PathBuf),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// A number that can be written in every format.
pub(crate) trait Number: Precision + WritableElement + LowerExp {}

impl Number for f32 {}
impl Number for f64 {}

/// Refuses, before anything is computed, a file of values that could not be written after it.
pub(crate) fn check_values_path(path: &Path) -> Result<(), WriteError> {
    match format(path) {
        Some(_) => check_folder(path),
        None => Err(WriteError::Extension(path.to_owned())),
    }
}

/// Refuses, before anything is computed, a file in a folder that does not exist.
pub(crate) fn check_folder(path: &Path) -> Result<(), WriteError> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            Err(WriteError::Folder(path.to_owned()))
        }
        _ => Ok(()),
    }
}

/// Writes rows of values, with a number for each of the columns.
pub(crate) fn values<T: Number>(
    path: &Path,
    values: &[T],
    columns: &[String],
) -> Result<(), WriteError> {
    match format(path) {
        Some(Format::Npy) => Ok(write_file(path, |file| npy(file, values, columns.len()))?),
        Some(Format::Csv) => Ok(write_file(path, |file| csv(file, values, columns))?),
        None => Err(WriteError::Extension(path.to_owned())),
    }
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
