//! A problem as files, so that rivals in other processes get the same numbers.

use std::path::{Path, PathBuf};
use std::{fs, io};

use glam::DVec3;

/// Sources that are targets too, their charges, and the exact sums at every `step`-th of them.
#[derive(Debug)]
pub(crate) struct Problem {
    pub(crate) points: Vec<DVec3>,
    pub(crate) charges: Vec<f64>,
    pub(crate) exact: Vec<f64>,
    pub(crate) step: usize,
}

impl Problem {
    /// Relative l2 error of sums at all points, measured at every `step`-th.
    pub(crate) fn error(&self, values: &[f64]) -> f64 {
        let sampled: Vec<f64> = values.iter().step_by(self.step).copied().collect();
        farfield::relative_l2_error(&sampled, &self.exact)
    }

    /// Writes `points.f64` (N×3), `charges.f64` (N) and `exact.f64` into a folder, in the machine's own
    /// byte order.
    ///
    /// # Errors
    /// If the folder can't be written to.
    pub(crate) fn write(&self, folder: &Path) -> io::Result<()> {
        fs::create_dir_all(folder)?;
        let [points, charges, exact] = files(folder);
        let coordinates: Vec<f64> = self.points.iter().flat_map(|p| p.to_array()).collect();
        write(&points, &coordinates)?;
        write(&charges, &self.charges)?;
        write(&exact, &self.exact)
    }

    /// Reads what [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// If the files can't be read.
    pub(crate) fn read(folder: &Path) -> io::Result<Self> {
        let [points, charges, exact] = files(folder).map(|file| read(&file));
        let points = points?.as_chunks().0.iter().map(|&p| DVec3::from_array(p)).collect();
        let (charges, exact) = (charges?, exact?);
        let step = step(charges.len());
        Ok(Self { points, charges, exact, step })
    }
}

/// The distance between targets so that about a thousand of `n` are taken.
pub(crate) fn step(n: usize) -> usize {
    n.div_ceil(1000)
}

fn files(folder: &Path) -> [PathBuf; 3] {
    ["points.f64", "charges.f64", "exact.f64"].map(|name| folder.join(name))
}

fn write(file: &Path, numbers: &[f64]) -> io::Result<()> {
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_ne_bytes()).collect();
    fs::write(file, bytes)
}

fn read(file: &Path) -> io::Result<Vec<f64>> {
    let bytes = fs::read(file)?;
    Ok(bytes.as_chunks().0.iter().map(|&bytes| f64::from_ne_bytes(bytes)).collect())
}
