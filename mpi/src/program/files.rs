//! Arrays in files of which each rank reads and writes its own rows.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use ndarray_npy::WritableElement;
use ndarray_npy::npy::header::{Header, Layout, ReadHeaderError};

use crate::collective::agree;
use crate::error::Error;
use crate::transport::Transport;

/// A file that can't be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub(super) struct FileError {
    path: PathBuf,
    problem: Problem,
}

#[derive(Debug, thiserror::Error)]
enum Problem {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error("not an npy file: {0}")]
    NotNpy(String),
    #[error("elements of type {0}: expected little-endian floats, '<f4' or '<f8'")]
    Type(String),
    #[error("an array of shape {found:?}: expected {expected}")]
    Shape { found: Vec<usize>, expected: String },
    #[error("{found} bytes of data: expected {expected} for an array of shape {shape:?}")]
    Size { found: u64, expected: u128, shape: Vec<usize> },
    #[error("row {row}, column {column} is {found}: expected a finite number")]
    Entry { row: usize, column: usize, found: f64 },
    #[error("expected a file that ends in .npy")]
    Ending,
}

/// The rows of a table that rank `rank` of `size` reads or writes.
pub(super) fn own_rows(rows: usize, rank: usize, size: usize) -> Range<usize> {
    let start = |rank: usize| (rows as u128 * rank as u128 / size as u128) as usize;
    start(rank)..start(rank + 1)
}

/// An npy file of numbers.
pub(super) struct Table {
    path: PathBuf,
    reader: BufReader<File>,
    /// Where the numbers begin, and the bytes that each takes.
    start: u64,
    bytes: usize,
    layout: Layout,
    /// How many rows there are.
    pub(super) rows: usize,
    columns: usize,
}

impl Table {
    /// Opens a file of rows of so many numbers.
    pub(super) fn open(path: &Path, columns: usize) -> Result<Self, FileError> {
        let open = || {
            let file = File::open(path)?;
            let all = file.metadata()?.len();
            let mut reader = BufReader::new(file);
            let Header { type_descriptor, layout, shape } = Header::from_reader(&mut reader)?;
            let rows = match shape[..] {
                [rows] if columns == 1 => rows,
                [rows, width] if columns > 1 && width == columns => rows,
                _ => {
                    let of =
                        if columns == 1 { "[N]".to_owned() } else { format!("[N, {columns}]") };
                    return Err(Problem::Shape { found: shape, expected: of });
                }
            };
            let bytes = match type_descriptor.as_string().map(String::as_str) {
                Some("<f4") => 4,
                Some("<f8") => 8,
                _ => return Err(Problem::Type(type_descriptor.to_string())),
            };
            let start = reader.stream_position()?;
            let (found, expected) = (all - start, rows as u128 * columns as u128 * bytes as u128);
            if u128::from(found) != expected {
                return Err(Problem::Size { found, expected, shape });
            }
            let path = path.to_owned();
            Ok(Self { path, reader, start, bytes, layout, rows, columns })
        };
        open().map_err(|problem| FileError { path: path.to_owned(), problem })
    }

    /// Some of its rows, one after the other.
    pub(super) fn read(&mut self, rows: Range<usize>) -> Result<Vec<f64>, FileError> {
        let path = self.path.clone();
        self.numbers(rows).map_err(|problem| FileError { path, problem })
    }

    fn numbers(&mut self, rows: Range<usize>) -> Result<Vec<f64>, Problem> {
        let Self { columns, .. } = *self;
        let mut numbers = vec![0.0; rows.len() * columns];
        match self.layout {
            Layout::Standard => {
                let all = self.stretch(rows.start * columns, numbers.len())?;
                numbers.copy_from_slice(&all);
            }
            Layout::Fortran => {
                for column in 0..columns {
                    let one = self.stretch(column * self.rows + rows.start, rows.len())?;
                    let places = numbers.iter_mut().skip(column).step_by(columns);
                    places.zip(one).for_each(|(place, number)| *place = number);
                }
            }
        }
        match numbers.iter().position(|number| !number.is_finite()) {
            Some(k) => {
                let (row, column) = (rows.start + k / columns, k % columns);
                Err(Problem::Entry { row, column, found: numbers[k] })
            }
            None => Ok(numbers),
        }
    }

    /// Numbers as they follow each other in the file.
    fn stretch(&mut self, first: usize, count: usize) -> Result<Vec<f64>, Problem> {
        self.reader.seek(SeekFrom::Start(self.start + (first * self.bytes) as u64))?;
        let mut bytes = vec![0; count * self.bytes];
        self.reader.read_exact(&mut bytes)?;
        Ok(if self.bytes == 4 {
            let single = bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b));
            single.map(f64::from).collect()
        } else {
            bytes.as_chunks::<8>().0.iter().map(|&b| f64::from_le_bytes(b)).collect()
        })
    }
}

/// Refuses, before anything is computed, what could not be written after it.
pub(super) fn check_out(path: &Path) -> Result<(), FileError> {
    let error = |problem| FileError { path: path.to_owned(), problem };
    if path.extension().is_none_or(|ending| ending != "npy") {
        return Err(error(Problem::Ending));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let found = fs::metadata(folder.unwrap_or(Path::new(".")));
    found.map(drop).map_err(|source| error(Problem::Io(source)))
}

/// Writes a table of `rows` rows of `columns` numbers, of which each rank has its own, so that it appears complete or not at
/// all. All ranks call it.
pub(super) fn write(
    ranks: &dyn Transport,
    path: &Path,
    [rows, columns]: [usize; 2],
    own: &[f64],
) -> Result<(), Error> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    let error = |source| FileError { path: part.clone(), problem: Problem::Io(source) };
    let shape = if columns == 1 { vec![rows] } else { vec![rows, columns] };
    let descriptor = f64::type_descriptor();
    let header = Header { type_descriptor: descriptor, layout: Layout::Standard, shape };
    let header = header.to_bytes().map_err(|problem| error(io::Error::other(problem)));
    let header = agree(ranks, header)?;
    let begun = if ranks.rank() == 0 {
        File::create(&part).and_then(|mut file| file.write_all(&header)).map_err(error)
    } else {
        Ok(())
    };
    let rest = || {
        let mut file = OpenOptions::new().write(true).open(&part)?;
        let first = own_rows(rows, ranks.rank(), ranks.size()).start;
        file.seek(SeekFrom::Start((header.len() + 8 * first * columns) as u64))?;
        let bytes: Vec<u8> = own.iter().flat_map(|number| number.to_le_bytes()).collect();
        file.write_all(&bytes)?;
        file.sync_all()
    };
    let written = agree(ranks, begun).and_then(|()| agree(ranks, rest().map_err(error)));
    let ended = match (&written, ranks.rank()) {
        (Ok(()), 0) => fs::rename(&part, path).map_err(error),
        (Err(_), 0) => {
            // What is left of it is of no use to anybody.
            drop(fs::remove_file(&part));
            Ok(())
        }
        _ => Ok(()),
    };
    written?;
    agree(ranks, ended)
}

impl From<ReadHeaderError> for Problem {
    fn from(error: ReadHeaderError) -> Self {
        match error {
            ReadHeaderError::Io(error) if error.kind() != io::ErrorKind::UnexpectedEof => {
                Self::Io(error)
            }
            ReadHeaderError::Io(_) => Self::NotNpy("it ends within its header".to_owned()),
            ReadHeaderError::Parse(error) => Self::NotNpy(error.to_string()),
        }
    }
}
