//! What lies around a scene: which way is up and north, and how bright the sky is.

use clap::{Args, ValueEnum};
use farfield::glam::DVec3;
use farfield_radiosity::{Error, Sky};
use farfield_scenes::Scene;
use serde::Serialize;

/// The flags that say how a scene stands below the sky.
#[derive(Clone, Debug, PartialEq, Args)]
pub(crate) struct Outdoors {
    /// How bright the sky is, direction by direction [default: uniform]
    #[arg(long, value_enum)]
    pub(crate) sky_model: Option<SkyModel>,

    /// Which way is up [default: what is up for the scene's camera, or 0,1,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    zenith: Option<[f64; 3]>,

    /// Which way is north; what of it is not horizontal doesn't count [default: 0,0,-1, or 0,1,0 where z is up or down]
    #[arg(long, value_name = "X,Y,Z", value_parser = vector, allow_hyphen_values = true)]
    north: Option<[f64; 3]>,
}

/// How bright the sky is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SkyModel {
    /// As bright everywhere
    Uniform,
    /// The overcast sky of the CIE, three times as bright in the zenith as at the horizon
    Overcast,
}

impl Outdoors {
    /// The directions of angles around a scene.
    ///
    /// # Errors
    /// If north is up or down.
    pub(crate) fn compass(&self, scene: &Scene) -> Result<Compass, NorthIsUp> {
        let zenith = self.zenith(scene);
        let up = unit(DVec3::from_array(zenith));
        let usual = if up.z.abs() > 0.9 { DVec3::Y } else { -DVec3::Z };
        Compass::new(zenith, self.north.unwrap_or(usual.to_array()))
    }

    /// Which way is up, a vector of any length but zero.
    fn zenith(&self, scene: &Scene) -> [f64; 3] {
        let up = || scene.camera.map_or(DVec3::Y, |camera| camera.up).to_array();
        self.zenith.unwrap_or_else(up)
    }

    /// The sky above a scene, in units of what an open horizontal plane receives of it.
    ///
    /// # Errors
    /// None that the flags let through.
    pub(crate) fn sky(&self, scene: &Scene) -> Result<Sky, Error> {
        let zenith = DVec3::from_array(self.zenith(scene));
        match self.sky_model() {
            SkyModel::Uniform => Sky::uniform(zenith),
            SkyModel::Overcast => Sky::overcast(zenith),
        }
    }

    /// How bright the sky is.
    pub(crate) fn sky_model(&self) -> SkyModel {
        self.sky_model.unwrap_or(SkyModel::Uniform)
    }

    /// Whether any of the flags is given.
    pub(crate) fn is_given(&self) -> bool {
        self.sky_model.is_some() || self.zenith.is_some() || self.north.is_some()
    }
}

/// North is no horizontal direction.
#[derive(Debug, thiserror::Error)]
#[error(
    "--north {north:?}: expected a direction other than up and down, which --zenith {zenith:?} says"
)]
pub(crate) struct NorthIsUp {
    zenith: [f64; 3],
    north: [f64; 3],
}

/// Which way is up, east and north: unit vectors across each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Compass {
    pub(crate) zenith: DVec3,
    east: DVec3,
    pub(crate) north: DVec3,
}

impl Compass {
    /// The compass of two directions of any lengths.
    ///
    /// # Errors
    /// If north is up or down.
    fn new(zenith: [f64; 3], north: [f64; 3]) -> Result<Self, NorthIsUp> {
        let [up, ahead] = [zenith, north].map(|v| unit(DVec3::from_array(v)));
        let east = ahead.cross(up);
        if east.length() < LEAST_SINE {
            return Err(NorthIsUp { zenith, north });
        }
        let east = east.normalize();
        Ok(Self { zenith: up, east, north: up.cross(east) })
    }

    /// The direction of an azimuth, from north by east, and an elevation above the horizon, in degrees.
    pub(crate) fn direction(&self, azimuth: f64, elevation: f64) -> DVec3 {
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

/// A direction on the command line.
fn vector(text: &str) -> Result<[f64; 3], String> {
    let vector = numbers(text).filter(|vector| *vector != [0.0; 3]);
    vector.ok_or_else(|| {
        "expected three finite numbers, not all of them zero, such as 0,0,1".to_owned()
    })
}

/// Three finite numbers between commas.
pub(crate) fn numbers(text: &str) -> Option<[f64; 3]> {
    let numbers =
        text.split(',').map(|word| word.trim().parse().ok().filter(|x: &f64| x.is_finite()));
    numbers.collect::<Option<Vec<f64>>>()?.try_into().ok()
}

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

    #[test]
    fn up_is_what_it_is_for_the_camera() {
        let outdoors = Outdoors { sky_model: None, zenith: None, north: None };
        let compass = |scene: &Scene| outdoors.compass(scene).expect("no north that is up");
        let y = Compass::new([0.0, 1.0, 0.0], [0.0, 0.0, -1.0]).expect("across");
        assert_eq!(compass(&Scene::default()), y);
        let mut scene = farfield_scenes::generate("canyon").expect("a scene");
        assert_eq!(compass(&scene), y);
        scene.camera.as_mut().expect("there is one").up = DVec3::Z * 2.0;
        let z = Compass::new([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]).expect("across");
        assert_eq!(compass(&scene), z);
        let said = Outdoors { zenith: Some([1.0, 0.0, 0.0]), ..outdoors };
        assert_eq!(said.compass(&scene).expect("across").direction(0.0, 90.0).x, 1.0);
    }
}
