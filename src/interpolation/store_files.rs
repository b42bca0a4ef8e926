//! Files of operators: a header that says who wrote them, what they are found by, the operators, and a hash of all that.

use std::fs::{self, File};
use std::hash::Hasher;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use num_complex::Complex;

use crate::dispatch_level::DispatchLevel;
use crate::interpolation::accuracy::Accuracy;
use crate::interpolation::hashing::StableHasher;
use crate::interpolation::known::{AnyOperators, Identity, Key, Known, scalar_name};
use crate::interpolation::operators::Operators;
use crate::interpolation::store_error::StoreError;
use crate::interpolation::stored::{Sink, Stored};
use crate::numbers::traits::Scalar;

/// How the names of files of operators end.
const EXTENSION: &str = "operators";

/// Writes the sets that the folder doesn't have, each to a file.
pub(super) fn write(folder: &Path, sets: &[Known]) -> Result<(), StoreError> {
    let writer = writer()?;
    fs::create_dir_all(folder).map_err(|source| at(folder, source))?;
    for set in sets {
        let mut found_by = StableHasher::default();
        set.key.store(&mut |bytes| found_by.write(bytes));
        set.digest.unwrap_or_default().store(&mut |bytes| found_by.write(bytes));
        found_by.write(set.operators.scalar().as_bytes());
        let name = format!("{}-{:016x}.{EXTENSION}", prefix(&writer), found_by.value());
        let path = folder.join(&name);
        if path.exists() {
            continue;
        }
        let mut bytes = Vec::with_capacity(set.bytes + 1000);
        let mut to = |piece: &[u8]| bytes.extend_from_slice(piece);
        writer.store(&mut to);
        set.operators.scalar().to_owned().store(&mut to);
        set.key.store(&mut to);
        set.digest.is_some().store(&mut to);
        set.digest.unwrap_or_default().store(&mut to);
        set.operators.store(&mut to);
        let hash = hash(&bytes);
        bytes.extend(hash.to_le_bytes());
        // Two processes may save the same at once.
        let partial = folder.join(format!(".{name}.{}", std::process::id()));
        let written = File::create(&partial).and_then(|mut file| {
            file.write_all(&bytes)?;
            file.sync_all()?;
            fs::rename(&partial, &path)
        });
        written.map_err(|source| {
            drop(fs::remove_file(&partial));
            at(&path, source)
        })?;
    }
    Ok(())
}

/// Reads all files of a folder that this version wrote at this dispatch level.
pub(super) fn read(folder: &Path) -> Result<Vec<Known>, StoreError> {
    let writer = writer()?;
    let prefix = prefix(&writer);
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(|source| at(folder, source))? {
        let path = entry.map_err(|source| at(folder, source))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.starts_with(&prefix) && name.ends_with(EXTENSION) {
            paths.push(path);
        }
    }
    // The same order, whatever the file system's.
    paths.sort();
    paths.into_iter().map(|path| read_one(path, &writer)).collect()
}

fn read_one(path: PathBuf, writer: &str) -> Result<Known, StoreError> {
    let bytes = fs::read(&path).map_err(|source| at(&path, source))?;
    let Some((content, known)) = bytes.split_last_chunk() else {
        return Err(StoreError::Damaged { path });
    };
    if hash(content).to_le_bytes() != *known {
        return Err(StoreError::Damaged { path });
    }
    let mut from = content;
    match String::restore(&mut from) {
        Some(found) if found == writer => {
            set(&mut from, bytes.len()).ok_or(StoreError::Damaged { path })
        }
        Some(found) => Err(StoreError::Foreign { path, found, expected: writer.to_owned() }),
        None => Err(StoreError::Damaged { path }),
    }
}

fn set(from: &mut &[u8], bytes: usize) -> Option<Known> {
    let scalar = String::restore(from)?;
    let key = Key::restore(from)?;
    let (has_digest, digest) = (bool::restore(from)?, u64::restore(from)?);
    let digest = has_digest.then_some(digest);
    let operators = operators::<f64>(&scalar, from)
        .or_else(|| operators::<f32>(&scalar, from))
        .or_else(|| operators::<Complex<f64>>(&scalar, from))
        .or_else(|| operators::<Complex<f32>>(&scalar, from))?;
    from.is_empty().then_some(Known { key, operators, digest, bytes })
}

/// The operators, if that is what their scalars are called.
fn operators<S: Scalar>(scalar: &str, from: &mut &[u8]) -> Option<Arc<dyn AnyOperators>> {
    if scalar != scalar_name::<S>() {
        return None;
    }
    Some(Arc::new(Operators::<S>::restore(from)?))
}

/// Who writes: operators differ in their bits from version to version and from level to level.
fn writer() -> Result<String, StoreError> {
    let level = DispatchLevel::in_force()?;
    Ok(format!("farfield {}, {}, {level}", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH))
}

/// How the names of a writer's files begin.
fn prefix(writer: &str) -> String {
    format!("{:08x}", hash(writer.as_bytes()) as u32)
}

fn hash(bytes: &[u8]) -> u64 {
    let mut hasher = StableHasher::default();
    hasher.write(bytes);
    hasher.write_usize(bytes.len());
    hasher.value()
}

fn at(path: &Path, source: io::Error) -> StoreError {
    StoreError::Io { path: path.to_owned(), source }
}

impl Stored for String {
    fn store(&self, to: &mut Sink<'_>) {
        self.as_bytes().to_vec().store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        String::from_utf8(Vec::restore(from)?).ok()
    }
}

impl Stored for Key {
    fn store(&self, to: &mut Sink<'_>) {
        match &self.identity {
            Identity::Stated(name) => name.store(to),
            // No kernel calls itself nothing.
            Identity::Code(_) | Identity::Values => String::new().store(to),
        }
        self.with_slopes.store(to);
        match self.accuracy {
            Accuracy::Tolerance(tolerance) => (0, tolerance).store(to),
            Accuracy::Order(order) => (order, 0.0).store(to),
        }
        self.half_widths.store(to);
        self.fingerprint.store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        let name = String::restore(from)?;
        let identity = if name.is_empty() { Identity::Values } else { Identity::Stated(name) };
        let with_slopes = bool::restore(from)?;
        let accuracy = match <(usize, f64)>::restore(from)? {
            (0, tolerance) => Accuracy::Tolerance(tolerance),
            (order, _) => Accuracy::Order(order),
        };
        let (half_widths, fingerprint) = (Stored::restore(from)?, Stored::restore(from)?);
        Some(Self { identity, with_slopes, accuracy, half_widths, fingerprint })
    }
}

impl<A: Stored, B: Stored> Stored for (A, B) {
    fn store(&self, to: &mut Sink<'_>) {
        self.0.store(to);
        self.1.store(to);
    }

    fn restore(from: &mut &[u8]) -> Option<Self> {
        Some((A::restore(from)?, B::restore(from)?))
    }
}
