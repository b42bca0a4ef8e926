//! What elements receive from outside of the scene.

use farfield::glam::DVec3;
use farfield_radiosity::{Daylight, Occluders, Surroundings};
use farfield_scenes::{Mesh, Optics, Scene};
use rayon::prelude::*;

use super::args::Args;
use super::failure::Failure;
use crate::outdoors::numbers;

/// Rays from each element, in units of 1/tolerance, at least and at most.
const RAYS: f64 = 4.0;
const LEAST_RAYS: f64 = 256.0;
const MOST_RAYS: f64 = 4096.0;

/// The sun, as the command line has it.
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// The irradiance of each element \[W/m²] by the sky, the ground around and the sun; none if there are neither sky nor sun.
/// A sun below the horizon gives nothing.
///
/// # Errors
/// If north is no horizontal direction, or if no light comes from anywhere.
pub(crate) fn daylight(
    args: &Args,
    scene: &Scene,
    mesh: &Mesh,
    occluders: &Occluders,
) -> Result<Option<Vec<f64>>, Failure> {
    if !args.is_outdoors() {
        return Ok(None);
    }
    let elements = &mesh.elements;
    let compass = args.outdoors.compass()?;
    let rays = (RAYS / args.sum_tolerance()).clamp(LEAST_RAYS, MOST_RAYS) as usize;
    let around = Surroundings::new(elements, occluders, 1);
    let sun = args.sun.filter(|sun| sun.elevation > 0.0);
    let (sky, beam) = (args.sky.unwrap_or(0.0), sun.map_or(0.0, |sun| sun.irradiance));
    let on_ground = sky + sun.map_or(0.0, |sun| sun.elevation.to_radians().sin() * beam);
    let ground = args.ground * on_ground;
    let model = args.outdoors.sky()?;
    let diffuse = |element: usize| {
        let found: Daylight = around.daylight(element, &model, rays);
        sky * found.sky + ground * found.ground
    };
    let mut received: Vec<f64> = if sky > 0.0 || ground > 0.0 {
        (0..elements.len()).into_par_iter().map(diffuse).collect()
    } else {
        vec![0.0; elements.len()]
    };
    if let Some(sun) = sun {
        let to_sun: DVec3 = compass.direction(sun.azimuth, sun.elevation);
        let shares = around.sunlight(to_sun, rays)?;
        received.iter_mut().zip(shares).for_each(|(received, share)| *received += beam * share);
    }
    let own = Optics::<1>::new(scene, mesh, args.quantity.into(), 1, 0);
    let is_lit = |h: f64| h > 0.0;
    if !(received.iter().copied().any(is_lit) || own.emission.iter().any(|&[e]| is_lit(e))) {
        return Err(Failure::Unlit);
    }
    Ok(Some(received))
}
