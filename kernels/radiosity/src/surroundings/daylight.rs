//! What the sky, the ground around and the sun give elements, past all that hides them.

use rayon::prelude::*;

use glam::DVec3;

use crate::elements::Surfel;
use crate::error::Error;
use crate::numbers::in_cube;
use crate::surroundings::around::Surroundings;
use crate::surroundings::seen::{End, look};

/// How bright the sky is, direction by direction, in units of what an open horizontal plane receives of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    zenith: DVec3,
    is_overcast: bool,
}

impl Sky {
    /// As bright everywhere: L = 1/π. `zenith` points upwards and may have any length.
    ///
    /// # Errors
    /// [`Error::InvalidDirection`] if the zenith isn't finite or is zero.
    pub fn uniform(zenith: DVec3) -> Result<Self, Error> {
        Ok(Self { zenith: direction("zenith", zenith)?, is_overcast: false })
    }

    /// The overcast sky of the CIE, three times as bright in the zenith as at the horizon:
    /// L(γ) = 3/(7π) (1 + 2 sin γ) at the elevation γ (Moon and Spencer, "Illumination from a non-uniform sky",
    /// Illum. Eng. 37, 1942).
    ///
    /// # Errors
    /// Those of [`uniform`](Self::uniform).
    pub fn overcast(zenith: DVec3) -> Result<Self, Error> {
        Ok(Self { zenith: direction("zenith", zenith)?, is_overcast: true })
    }

    /// π L in a direction, a unit vector; none below the horizon.
    fn brightness(&self, direction: DVec3) -> Option<f64> {
        let sine = self.zenith.dot(direction);
        let overcast = || 3.0 / 7.0 * (1.0 + 2.0 * sine);
        (sine >= 0.0).then(|| if self.is_overcast { overcast() } else { 1.0 })
    }
}

/// What an element receives from outside of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Daylight {
    /// Irradiance by the sky, in units of what an open horizontal plane receives: of a uniform sky the form factor
    /// from the element to the sky above the horizon, which is its sky view factor.
    pub sky: f64,
    /// The form factor to what is below the horizon and not hidden by the scene. Ground of an even radiosity, or
    /// of an albedo and an irradiance of its own, gives the element this share of it.
    pub ground: f64,
}

impl Surroundings<'_> {
    /// What an element receives from the sky and the ground around the scene, by so many rays that leave it by
    /// the cosine law. The error falls nearly as 1/rays for smooth surroundings and is about
    /// 0.5/√rays at most. O(rays) steps through the hierarchy of the occluders.
    pub fn daylight(&self, element: usize, sky: &Sky, rays: usize) -> Daylight {
        let mut found = Daylight::default();
        let rays = rays.max(1);
        let turn = [rays, 2 * self.elements.len() + element];
        look(&self.elements[element], &self.sides, self.occluders, turn, |end| {
            if let End::Sky(direction) = end {
                match sky.brightness(direction) {
                    Some(brightness) => found.sky += brightness,
                    None => found.ground += 1.0,
                }
            }
        });
        found.sky /= rays as f64;
        found.ground /= rays as f64;
        found
    }

    /// The direct beam on each element from the sun in direction `to_sun`, which may have any length, in units
    /// of what a plane across the beam receives: cos θ times the share of the area that sees the sun, by `rays` from
    /// all over the element. For several times, once for each. O(N · rays) steps through the hierarchy of
    /// the occluders.
    ///
    /// # Errors
    /// [`Error::InvalidDirection`] if the direction isn't finite or is zero.
    pub fn sunlight(&self, to_sun: DVec3, rays: usize) -> Result<Vec<f64>, Error> {
        let to_sun = direction("direction to the sun", to_sun)?;
        let rays = rays.max(1);
        let margin = self.occluders.margin();
        let beam = |element: usize| {
            let &Surfel { normal, face, .. } = self.elements[element].surfel();
            let cosine = normal.dot(to_sun);
            if cosine <= 0.0 {
                return 0.0;
            }
            let passes = |&ray: &usize| {
                let [u, v, ..] = in_cube(ray, element as u64);
                let from = self.elements[element].point_at([u, v]);
                self.occluders.nearest(from, to_sun, [face; 2], margin).is_none()
            };
            cosine * (0..rays).filter(passes).count() as f64 / rays as f64
        };
        Ok((0..self.elements.len()).into_par_iter().map(beam).collect())
    }
}

/// A unit vector along one of any length.
fn direction(what: &'static str, found: DVec3) -> Result<DVec3, Error> {
    // Lengths whose squares overflow or vanish are lengths, too.
    let scaled = found / found.abs().max_element();
    scaled.try_normalize().ok_or(Error::InvalidDirection { what, found: found.to_array() })
}
