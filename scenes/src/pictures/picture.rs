//! What a solved scene looks like.

use farfield_radiosity::{Error, Occluders};

use crate::cutting::fields::Fields;
use crate::pictures::camera::Camera;
use crate::pictures::colours::{Colours, temperature};
use crate::pictures::exposure::RAYS;
use crate::pictures::film::{Film, Lit};
use crate::pictures::lamps::{ByPixel, Lamps};
use crate::pictures::palette;
use crate::pictures::sight::Sight;
use crate::pictures::smooth::Smooth;
use crate::pictures::tone::{Rgb, ToneMap, colour};
use crate::pictures::view::View;

/// A picture and the colours of elements.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Picture {
    /// Columns and rows.
    pub size: [usize; 2],
    /// sRGB codes, row by row from the upper left corner.
    pub codes: Vec<[u8; 3]>,
    /// What the codes stand for: radiances, or temperatures \[K\] in every band.
    pub values: Vec<Rgb>,
    /// Which colours radiosities have in it.
    pub colours: Colours,
    /// What was mended in the camera.
    pub repair: Option<String>,
}

impl Picture {
    /// The light that a camera sees. What `by_pixel` says is gathered pixel by pixel, with sharp shadows; all else is that
    /// of the elements, smoothed. `size` is that of the picture, columns and rows; `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless the fields match the mesh.
    pub fn of_light(
        sight: &Sight,
        fields: &Fields,
        shadows: &Occluders,
        by_pixel: Option<&ByPixel>,
        size: [usize; 2],
        progress: impl Fn(f64) + Sync,
    ) -> Result<Self, Error> {
        let irradiance = by_pixel.map_or(&fields.irradiance, |by_pixel| &by_pixel.rest);
        for (what, field) in [
            ("radiosity", &fields.radiosity[..]),
            ("emission", &fields.emission),
            ("irradiance", irradiance),
        ] {
            check(what, field, sight, fields.bands)?;
        }
        let of =
            |field: &[f64]| -> Vec<Rgb> { field.chunks(fields.bands.max(1)).map(colour).collect() };
        let Sight { scene, mesh, .. } = *sight;
        let View { place, backs, repair } = View::new(scene, sight);
        let camera = Camera::at(&place).widened(size);
        let film = Film { camera, backs, size, evenness: EVENNESS };
        let emission = of(&fields.emission);
        let irradiance = Smooth::new(&mesh.elements, sight, sight.occluders(), &of(irradiance));
        let lamps = by_pixel.map(|by_pixel| {
            let dark = vec![[0.0; 3]; emission.len()];
            let emission = if by_pixel.lamps { &emission } else { &dark };
            Lamps::new(scene, mesh, emission, RAYS).with_sun(mesh, by_pixel.sun)
        });
        let reflectance: Vec<Rgb> = mesh
            .material
            .iter()
            .map(|&material| colour(&scene.materials[material as usize].reflectance))
            .collect();
        let lit = Lit {
            elements: &mesh.elements,
            emission: &emission,
            reflectance: &reflectance,
            irradiance: &irradiance,
            direct: lamps.as_ref().map(|lamps| (lamps, shadows)),
        };
        let values = film.radiances(sight, &lit, rows_done(size, &progress));
        let tone = ToneMap::exposing(&values);
        let codes = values.iter().map(|radiance| tone.code(radiance)).collect();
        let colours = Colours::of_light(tone);
        Ok(Self { size, codes, values, colours, repair })
    }

    /// Temperatures in false colours, by the first band of the radiosity. `size` is that of the picture,
    /// columns and rows; `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless the fields match the mesh.
    pub fn of_heat(
        sight: &Sight,
        fields: &Fields,
        size: [usize; 2],
        progress: impl Fn(f64) + Sync,
    ) -> Result<Self, Error> {
        check("radiosity", &fields.radiosity, sight, fields.bands)?;
        let View { place, backs, repair } = View::new(sight.scene, sight);
        let camera = Camera::at(&place).widened(size);
        let film = Film { camera, backs, size, evenness: EVENNESS_OF_HEAT };
        let first = fields.radiosity.iter().step_by(fields.bands.max(1));
        let temperatures: Vec<Rgb> = first.map(|&b| [temperature(b); 3]).collect();
        let field = Smooth::new(&sight.mesh.elements, sight, sight.occluders(), &temperatures);
        let values = film.values(sight, &field, rows_done(size, &progress));
        let range = palette::range(values.iter().flatten().copied());
        let codes = palette::picture(&values, size, &range);
        let colours = Colours::of_heat(range);
        let values = values.iter().map(|value| [value.unwrap_or(0.0); 3]).collect();
        Ok(Self { size, codes, values, colours, repair })
    }

    /// Columns and rows where nobody says otherwise.
    pub const SIZE: [usize; 2] = [720; 2];
}

/// The [evenness](Film::evenness) of radiances: less than the eye tells apart.
const EVENNESS: f64 = 0.03;
/// That of temperatures, which differ by little, and all colours go to what they differ by.
const EVENNESS_OF_HEAT: f64 = 5e-4;

/// Checks that there is a number for every element and band of a mesh.
fn check(what: &'static str, field: &[f64], sight: &Sight, bands: usize) -> Result<(), Error> {
    let (expected, found) = (sight.mesh.elements.len() * bands.max(1), field.len());
    if found == expected { Ok(()) } else { Err(Error::LengthMismatch { what, expected, found }) }
}

/// Counts the rows of a picture.
fn rows_done([_, height]: [usize; 2], show: &(impl Fn(f64) + Sync)) -> impl Fn() + Sync {
    let rows = std::sync::atomic::AtomicUsize::new(0);
    move || {
        let done = 1 + rows.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        show(done as f64 / height as f64);
    }
}
