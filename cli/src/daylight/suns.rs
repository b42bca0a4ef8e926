//! Positions of the sun, from a file.

use std::fs;
use std::path::Path;

use farfield::glam::DVec3;

use super::failure::Failure;
use crate::csv;
use crate::outdoors::Compass;

/// A position of the sun.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sun {
    /// The name that the file has for it.
    pub(crate) time: String,
    /// The direction to it; none while it is below the horizon.
    pub(crate) direction: Option<DVec3>,
}

/// Reads the positions, line by line below a header `time,azimuth,elevation`. Empty lines and those that begin with `#`
/// are passed over.
///
/// # Errors
/// If the file can't be read, or with the first line that isn't right.
pub(crate) fn read(path: &Path, compass: &Compass) -> Result<Vec<Sun>, Failure> {
    let unreadable = |source| Failure::Unreadable { path: path.to_owned(), source };
    let text = fs::read_to_string(path).map_err(unreadable)?;
    let wrong = |line: usize, expected: &'static str, found: &str| Failure::Sun {
        path: path.to_owned(),
        line,
        expected,
        found: found.to_owned(),
    };
    let mut lines = csv::lines(&text);
    let (number, header) = lines.next().ok_or_else(|| wrong(1, HEADER, "nothing"))?;
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    if names != ["time", "azimuth", "elevation"] {
        return Err(wrong(number, HEADER, header));
    }
    let mut suns: Vec<Sun> = Vec::new();
    for (number, line) in lines {
        let words: Vec<&str> = line.split(',').map(str::trim).collect();
        let &[time, azimuth, elevation] = &words[..] else {
            return Err(wrong(number, "a time, an azimuth and an elevation", line));
        };
        if time.is_empty() || time.contains('"') || suns.iter().any(|sun| sun.time == time) {
            return Err(wrong(number, "a time without quotes that no other line has", time));
        }
        let angle = |word: &str, most: f64, expected: &'static str| {
            let angle = word.parse().ok().filter(|angle: &f64| angle.abs() <= most);
            angle.ok_or_else(|| wrong(number, expected, word))
        };
        let azimuth = angle(azimuth, 360.0, "an azimuth from -360 to 360 degrees")?;
        let elevation = angle(elevation, 90.0, "an elevation from -90 to 90 degrees")?;
        let direction = (elevation > 0.0).then(|| compass.direction(azimuth, elevation));
        suns.push(Sun { time: time.to_owned(), direction });
    }
    Ok(suns)
}

/// The first line of a file.
const HEADER: &str = "a header time,azimuth,elevation";
