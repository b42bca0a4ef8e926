//! What elements receive from outside of the scene: light of sky, ground and sun, heat of the surroundings.

use farfield::glam::DVec3;
use farfield_radiosity::{Daylight, Occluders, Surroundings};
use farfield_scenes::{Mesh, Optics, STEFAN_BOLTZMANN, Scene};
use rayon::prelude::*;
use serde::Serialize;

use super::args::{Args, QuantityName};
use super::failure::Failure;
use crate::outdoors::{SkyModel, numbers};
use crate::progress::Progress;

/// Rays from each element, in units of 1/tolerance, at least and at most.
const RAYS: f64 = 4.0;
const LEAST_RAYS: f64 = 256.0;
const MOST_RAYS: f64 = 4096.0;

/// The sun, as the command line has it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Sun {
    /// Degrees from north by east.
    azimuth: f64,
    /// Degrees above the horizon.
    elevation: f64,
    /// Irradiance of a plane across the beam [W/m²].
    irradiance: f64,
}

impl Sun {
    /// An azimuth, an elevation and an irradiance.
    ///
    /// # Errors
    /// What was expected instead.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let sun = numbers(text).map(|[azimuth, elevation, irradiance]| Self {
            azimuth,
            elevation,
            irradiance,
        });
        let is_right = |sun: &Self| {
            sun.azimuth.abs() <= 360.0 && sun.elevation.abs() <= 90.0 && sun.irradiance >= 0.0
        };
        sun.filter(is_right).ok_or_else(|| {
            "expected an azimuth from -360 to 360 degrees, an elevation from -90 to 90 degrees and an irradiance of 0 or \
             more, such as 180,45,800"
                .to_owned()
        })
    }
}

/// The irradiance of each element \[W/m²] from outside of the scene.
pub(crate) struct Received {
    /// By the sky, the ground around, and the heat of the surroundings.
    pub(crate) diffuse: Vec<f64>,
    /// By the sun, if it is up.
    pub(crate) beam: Option<Beam>,
    /// What it is of.
    pub(crate) origin: Origin,
}

/// Where light from outside comes from, as a report says it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Origin {
    /// What an open horizontal plane receives of the sky [W/m²].
    pub(crate) sky: f64,
    /// How bright the sky is, direction by direction.
    pub(crate) sky_model: SkyModel,
    /// The sun.
    pub(crate) sun: Option<Sun>,
    /// The albedo of the ground around.
    pub(crate) ground: f64,
    /// The temperature of the surroundings [K].
    pub(crate) ambient: Option<f64>,
    /// Which way is up, a unit vector.
    pub(crate) zenith: [f64; 3],
    /// Which way is north, a unit vector.
    pub(crate) north: [f64; 3],
}

/// The sun's.
pub(crate) struct Beam {
    /// The direction to the sun, a unit vector, and what a plane across the beam receives.
    pub(crate) sun: (DVec3, f64),
    /// What each element receives.
    pub(crate) irradiance: Vec<f64>,
}

impl Received {
    /// All of it.
    pub(crate) fn total(&self) -> Vec<f64> {
        let mut total = self.diffuse.clone();
        if let Some(beam) = &self.beam {
            total.iter_mut().zip(&beam.irradiance).for_each(|(total, beam)| *total += beam);
        }
        total
    }

    /// Whether nothing reaches any element.
    pub(crate) fn is_dark(&self) -> bool {
        let beam = self.beam.iter().flat_map(|beam| &beam.irradiance);
        self.diffuse.iter().chain(beam).all(|&h| h == 0.0)
    }
}

/// What elements receive from the sky, the ground around, the sun and warm surroundings; none if there is nothing of these. A
/// sun below the horizon gives nothing.
///
/// # Errors
/// If flags say how the scene stands below sky and sun, and there are neither; if surroundings are warm and heat is not asked
/// for; if north is no horizontal direction, or if nothing comes from anywhere.
pub(crate) fn daylight(
    args: &Args,
    scene: &Scene,
    mesh: &Mesh,
    occluders: &Occluders,
    progress: &Progress,
) -> Result<Option<Received>, Failure> {
    let is_said = args.ground.is_some() || args.outdoors.is_given();
    if is_said && !args.is_below_the_sky() {
        return Err(Failure::Indoors);
    }
    if args.ambient.is_some() && args.quantity == QuantityName::Light {
        return Err(Failure::Warm);
    }
    if !args.is_outdoors() {
        return Ok(None);
    }
    let _bar = progress.spinner("daylight");
    let elements = &mesh.elements;
    let compass = args.outdoors.compass(scene)?;
    let rays = (RAYS / args.sum_tolerance()).clamp(LEAST_RAYS, MOST_RAYS) as usize;
    let around = Surroundings::new(elements, occluders, 1);
    let sun = args.sun.filter(|sun| sun.elevation > 0.0);
    let on_ground = |sun: Sun| sun.elevation.to_radians().sin() * sun.irradiance;
    let sky = args.sky.unwrap_or(0.0);
    let albedo = args.ground.unwrap_or(0.0);
    let ground = albedo * (sky + sun.map_or(0.0, on_ground));
    let model = args.outdoors.sky(scene)?;
    let black = STEFAN_BOLTZMANN * args.ambient.unwrap_or(0.0).powi(4);
    let diffuse_of = |element: usize| {
        let light = if sky > 0.0 || ground > 0.0 {
            let found: Daylight = around.daylight(element, &model, rays);
            sky * found.sky + ground * found.ground
        } else {
            0.0
        };
        let heat = if black > 0.0 { black * around.look(element, rays).sky } else { 0.0 };
        light + heat
    };
    let diffuse = if sky > 0.0 || ground > 0.0 || black > 0.0 {
        (0..elements.len()).into_par_iter().map(diffuse_of).collect()
    } else {
        vec![0.0; elements.len()]
    };
    let beam_of = |sun: Sun| {
        let to_sun = compass.direction(sun.azimuth, sun.elevation);
        let mut irradiance = around.sunlight(to_sun, rays)?;
        irradiance.iter_mut().for_each(|share| *share *= sun.irradiance);
        Ok::<_, Failure>(Beam { sun: (to_sun, sun.irradiance), irradiance })
    };
    let origin = Origin {
        sky,
        sky_model: args.outdoors.sky_model(),
        sun: args.sun,
        ground: albedo,
        ambient: args.ambient,
        zenith: compass.zenith.to_array(),
        north: compass.north.to_array(),
    };
    let received = Received { diffuse, beam: sun.map(beam_of).transpose()?, origin };
    let own = Optics::<1>::new(scene, mesh, args.quantity.into(), 1, 0);
    let emits = own.emission.iter().any(|&[e]| e > 0.0);
    if !emits && received.is_dark() {
        return Err(Failure::Unlit);
    }
    Ok(Some(received))
}
