//! Positions of the sun, from a file.

use std::fs;
use std::path::Path;

use farfield::glam::DVec3;

use super::failure::Failure;

/// A position of the sun.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sun {
    /// The name that the file has for it.
    pub(crate) time: String,
    /// The direction to it; none while it is below the horizon.
    pub(crate) direction: Option<DVec3>,
}

/// Which way is up, east and north: unit vectors across each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Compass {
    pub(crate) zenith: DVec3,
    east: DVec3,
    north: DVec3,
}

impl Compass {
    /// The compass of two directions of any lengths.
    ///
    /// # Errors
    /// If north is up or down.
    pub(crate) fn new(zenith: [f64; 3], north: [f64; 3]) -> Result<Self, Failure> {
        let [up, ahead] = [zenith, north].map(|v| unit(DVec3::from_array(v)));
        let east = ahead.cross(up);
        if east.length() < LEAST_SINE {
            return Err(Failure::NorthIsUp { zenith, north });
        }
        let east = east.normalize();
        Ok(Self { zenith: up, east, north: up.cross(east) })
    }

    /// The direction of an azimuth, from north by east, and an elevation above the horizon, in degrees.
    fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        let (height, across) = elevation.to_radians().sin_cos();
        across * (cos * self.north + sin * self.east) + height * self.zenith
    }
}

/// Sines of the angle between north and the zenith below this are 0 but for rounding.
const LEAST_SINE: f64 = 1e-9;

/// The unit vector along one of any length but zero.
fn unit(v: DVec3) -> DVec3 {
    // Lengths whose squares overflow or vanish are lengths, too.
    (v / v.abs().max_element()).normalize()
}

/// Reads the positions, line by line below a header `time,azimuth,elevation`. Empty lines and those that begin with `#`
/// are passed over.
///
/// # Errors
/// If the file can't be read, or with the first line that isn't right.
pub(crate) fn read(path: &Path, compass: &Compass) -> Result<Vec<Sun>, Failure> {
    let unreadable = |source| Failure::Unreadable { path: path.to_owned(), source };
    let text = fs::read_to_string(path).map_err(unreadable)?;
    let lines = text.trim_start_matches('\u{feff}').lines().enumerate();
    let mut lines = lines.filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'));
    let wrong = |line: usize, expected: &'static str, found: &str| Failure::Sun {
        path: path.to_owned(),
        line: line + 1,
        expected,
        found: found.to_owned(),
    };
    let (number, header) = lines.next().ok_or_else(|| wrong(0, HEADER, "nothing"))?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn azimuths_go_from_north_by_east() {
        let compass = Compass::new([0.0, 0.0, 2.0], [0.0, 3.0, 1.0]).unwrap();
        let found = |azimuth, elevation| compass.direction(azimuth, elevation);
        let cases = [
            (found(0.0, 0.0), DVec3::Y),
            (found(90.0, 0.0), DVec3::X),
            (found(180.0, 0.0), -DVec3::Y),
            (found(-90.0, 0.0), -DVec3::X),
            (found(45.0, 90.0), DVec3::Z),
            (found(0.0, 45.0), (DVec3::Y + DVec3::Z) / 2f64.sqrt()),
        ];
        for (found, expected) in cases {
            assert!(found.distance(expected) < 1e-15, "{found}, {expected}");
        }
        // Where y is up, as in many meshes, and north is away from the viewer.
        let compass = Compass::new([0.0, 1e200, 0.0], [0.0, 0.0, -1e-200]).unwrap();
        assert!(compass.direction(90.0, 0.0).distance(DVec3::X) < 1e-15);
        assert!(Compass::new([0.0, 0.0, 1.0], [0.0, 0.0, -5.0]).is_err());
    }
}
