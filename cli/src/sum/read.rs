//! Points and charges from `.npy` and `.csv` files.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

use farfield::{Point, Real, Vector};
use ndarray_npy::npy::header::{Header, Layout, ParseHeaderError, ReadHeaderError};
use ndarray_npy::{ReadDataError, ReadableElement};

/// A file that could not be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub(crate) struct ReadError {
    path: PathBuf,
    problem: Problem,
}

#[derive(Debug, thiserror::Error)]
enum Problem {
    #[error("{0}")]
    Io(#[from] io::Error),
    #[error("unknown file type: expected .npy or .csv")]
    Extension,
    #[error("the file is empty: expected {0}")]
    Empty(&'static str),
    #[error("not an npy file: {0}")]
    NotNpy(&'static str),
    #[error("elements of type {0}: expected little-endian floats, '<f4' or '<f8'")]
    Type(String),
    #[error("an array of shape {found:?}: expected {expected}")]
    Shape { found: Vec<usize>, expected: String },
    #[error("{found} bytes of data: expected {expected} for an array of shape {shape:?}")]
    Size { found: u64, expected: u128, shape: Vec<usize> },
    #[error("line {line}: {error}")]
    Line { line: usize, error: io::Error },
    #[error("line {line} has {found} columns: expected {expected}")]
    Columns { line: usize, found: usize, expected: usize },
    #[error("line {line}, column {column} is {found:?}: expected a finite {precision} number")]
    Cell { line: usize, column: usize, found: String, precision: &'static str },
    #[error("entry {index:?} is {found}: expected a finite {precision} number")]
    Entry { index: Vec<usize>, found: f64, precision: &'static str },
}

/// Reads N points: an array of shape N×3, or a CSV file of three columns.
pub(crate) fn points<T: Real>(path: &Path) -> Result<Vec<Point<T>>, ReadError> {
    let coordinates = numbers::<T>(path, 3)?;
    Ok(coordinates.chunks_exact(3).map(|p| Point::<T>::from_array([p[0], p[1], p[2]])).collect())
}

/// Reads N charges of so many numbers each, row after row: an array of shape N if they are one, of shape N×`numbers` if
/// they are more, or a CSV file of as many columns.
pub(crate) fn charges<T: Real>(path: &Path, numbers: usize) -> Result<Vec<T>, ReadError> {
    self::numbers(path, numbers)
}

/// The numbers of a table, row after row; all of them finite.
fn numbers<T: Real>(path: &Path, columns: usize) -> Result<Vec<T>, ReadError> {
    let read = || {
        let file = File::open(path)?;
        match path.extension().and_then(|e| e.to_str()) {
            Some("npy") => npy(file, columns),
            Some("csv") => csv(file, columns),
            _ => Err(Problem::Extension),
        }
    };
    read().map_err(|problem| ReadError { path: path.to_owned(), problem })
}

fn npy<T: Real>(file: File, columns: usize) -> Result<Vec<T>, Problem> {
    let bytes = file.metadata()?.len();
    let what = match columns {
        1 => "N numbers, shape [N]".to_owned(),
        3 => "N points or vectors, shape [N, 3]".to_owned(),
        _ => format!("N rows of {columns} numbers, shape [N, {columns}]"),
    };
    if bytes == 0 {
        return Err(Problem::Empty("an npy array"));
    }
    let mut reader = BufReader::new(file);
    let header = Header::from_reader(&mut reader)?;
    let shape = header.shape;
    let rows = match shape[..] {
        [rows] if columns == 1 => rows,
        [rows, width] if columns > 1 && width == columns => rows,
        _ => return Err(Problem::Shape { found: shape, expected: what }),
    };
    let descriptor = header.type_descriptor;
    let element_bytes = match descriptor.as_string().map(String::as_str) {
        Some("<f4") => 4,
        Some("<f8") => 8,
        _ => return Err(Problem::Type(descriptor.to_string())),
    };

    // The header is compared with the file before anything of the size it speaks of is allocated.
    let found = bytes - reader.stream_position()?;
    let expected = rows as u128 * columns as u128 * element_bytes;
    if u128::from(found) != expected {
        return Err(Problem::Size { found, expected, shape });
    }
    let len = rows * columns;
    let values: Vec<f64> = if element_bytes == 4 {
        let single = f32::read_to_end_exact_vec(reader, &descriptor, len)?;
        single.into_iter().map(f64::from).collect()
    } else {
        f64::read_to_end_exact_vec(reader, &descriptor, len)?
    };

    let stored = |row: usize, column: usize| match header.layout {
        Layout::Standard => values[row * columns + column],
        Layout::Fortran => values[column * rows + row],
    };
    (0..len)
        .map(|k| {
            let (row, column) = (k / columns, k % columns);
            let found = stored(row, column);
            finite(found).ok_or_else(|| Problem::Entry {
                index: if columns == 1 { vec![row] } else { vec![row, column] },
                found,
                precision: std::any::type_name::<T>(),
            })
        })
        .collect()
}

/// Plain lines split at commas: tables of numbers need no quotes, and what is wrong with one can be
/// told with its exact line.
fn csv<T: Real>(file: File, columns: usize) -> Result<Vec<T>, Problem> {
    if file.metadata()?.len() == 0 {
        return Err(Problem::Empty("a header line or rows of numbers"));
    }
    let mut values = Vec::new();
    let mut first = true;
    for (index, text) in BufReader::new(file).lines().enumerate() {
        let line = index + 1;
        let text = text.map_err(|error| Problem::Line { line, error })?;
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() {
            continue;
        }
        let cells: Vec<_> = text.split(',').map(str::trim).collect();
        if cells.len() != columns {
            return Err(Problem::Columns { line, found: cells.len(), expected: columns });
        }
        let is_header = first && cells.iter().all(|cell| is_name(cell));
        first = false;
        if is_header {
            continue;
        }
        for (column, &cell) in cells.iter().enumerate() {
            let value = cell.parse().ok().and_then(finite).ok_or_else(|| Problem::Cell {
                line,
                column: column + 1,
                found: cell.to_owned(),
                precision: std::any::type_name::<T>(),
            })?;
            values.push(value);
        }
    }
    Ok(values)
}

/// Whether a cell may name a column: it is no number, and doesn't begin as one that is mistyped.
fn is_name(cell: &str) -> bool {
    let bare = cell.trim_start_matches(['"', '\'', '+', '-', '.']);
    cell.parse::<f64>().is_err() && !bare.starts_with(|c: char| c.is_ascii_digit())
}

/// `x` in the precision asked for, unless it is NaN, infinite or too large for it.
fn finite<T: Real>(x: f64) -> Option<T> {
    let rounded = T::from_f64(x);
    num_traits::Float::is_finite(rounded).then_some(rounded)
}

impl From<ReadHeaderError> for Problem {
    fn from(error: ReadHeaderError) -> Self {
        match error {
            ReadHeaderError::Io(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
                Self::NotNpy("it ends within its header")
            }
            ReadHeaderError::Io(e) => Self::Io(e),
            ReadHeaderError::Parse(ParseHeaderError::MagicString) => {
                Self::NotNpy("expected it to start with \\x93NUMPY")
            }
            ReadHeaderError::Parse(_) => Self::NotNpy("its header is malformed"),
        }
    }
}

impl From<ReadDataError> for Problem {
    fn from(error: ReadDataError) -> Self {
        match error {
            ReadDataError::Io(e) => Self::Io(e),
            e => Self::Io(io::Error::other(e)),
        }
    }
}
