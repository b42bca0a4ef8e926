//! What a solved scene looks like.

use std::f64::consts::FRAC_1_PI;

use farfield_radiosity::{Error, Occluders};

use crate::args::QuantityName;
use crate::camera::Camera;
use crate::fields::Fields;
use crate::lamps::{Lamps, direct_light_by_pixel};
use crate::mesh::Mesh;
use crate::palette;
use crate::progress::Progress;
use crate::scene::{STEFAN_BOLTZMANN, Scene};
use crate::sight::Sight;
use crate::smooth::Smooth;
use crate::surfaces::colour;
use crate::tone::{Rgb, ToneMap};
use crate::view::{Film, Lit, RAYS};
use crate::viewpoint::View;

/// Rows and columns.
pub(crate) const SIZE: usize = 720;

/// A picture and the colours of elements.
pub(crate) struct Picture {
    /// sRGB codes, row by row from the upper left corner.
    pub(crate) codes: Vec<[u8; 3]>,
    /// What the codes stand for: radiances, or temperatures \[K\] in every band.
    pub(crate) values: Vec<Rgb>,
    /// The sRGB code of each element.
    pub(crate) elements: Vec<[u8; 3]>,
    /// What was mended in the camera.
    pub(crate) repair: Option<String>,
}

/// The irradiance of the light that surfaces reflect, all but what comes straight from lamps.
pub(crate) type Indirect<'a> = &'a dyn Fn() -> Result<Vec<f64>, Error>;

/// Takes the picture: light as a camera sees it, heat as temperatures in false colours.
///
/// # Errors
/// If a sum fails.
pub(crate) fn take(
    scene: &Scene,
    mesh: &Mesh,
    fields: &Fields,
    shadows: &Occluders,
    quantity: QuantityName,
    indirect: Indirect<'_>,
    progress: &Progress,
) -> Result<Picture, Error> {
    let sight = Sight::new(&mesh.elements)?;
    let View { place, backs, repair } = View::new(scene, &sight);
    let film = Film { camera: Camera::at(&place), backs, size: SIZE };
    let of =
        |field: &[f64]| -> Vec<Rgb> { field.chunks(fields.bands.max(1)).map(colour).collect() };
    let walls = Occluders::new(&mesh.triangles)?;
    match quantity {
        QuantityName::Light => {
            let by_pixel = direct_light_by_pixel(scene);
            let held = if by_pixel { of(&indirect()?) } else { of(&fields.irradiance) };
            let bar = progress.bar("rendering");
            let emission = of(&fields.emission);
            let irradiance = Smooth::new(&mesh.elements, &sight, &walls, &held);
            let lamps = Lamps::new(scene, mesh, &emission, RAYS);
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
                direct: by_pixel.then_some((&lamps, shadows)),
            };
            let values = film.radiances(&sight, &lit, rows_done(&bar.shower()));
            let tone = ToneMap::exposing(&values);
            let codes = values.iter().map(|radiance| tone.code(radiance)).collect();
            let radiosity = of(&fields.radiosity);
            let elements = radiosity.iter().map(|b| tone.code(&b.map(|b| FRAC_1_PI * b))).collect();
            Ok(Picture { codes, values, elements, repair })
        }
        QuantityName::Heat => {
            let bar = progress.bar("rendering");
            let temperature = |b: &f64| (b / STEFAN_BOLTZMANN).max(0.0).powf(0.25);
            let first = fields.radiosity.iter().step_by(fields.bands.max(1));
            let temperatures: Vec<f64> = first.map(temperature).collect();
            let held: Vec<Rgb> = temperatures.iter().map(|&t| [t; 3]).collect();
            let field = Smooth::new(&mesh.elements, &sight, &walls, &held);
            let values = film.values(&sight, &field, rows_done(&bar.shower()));
            let range = palette::range(values.iter().flatten().copied());
            let codes = palette::picture(&values, SIZE, &range);
            let elements = temperatures.iter().map(|&t| palette::code(t, &range)).collect();
            let values = values.iter().map(|value| [value.unwrap_or(0.0); 3]).collect();
            Ok(Picture { codes, values, elements, repair })
        }
    }
}

/// Counts the rows of a picture.
fn rows_done(show: &(impl Fn(f64) + Sync)) -> impl Fn() + Sync {
    let rows = std::sync::atomic::AtomicUsize::new(0);
    move || {
        let done = 1 + rows.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        show(done as f64 / SIZE as f64);
    }
}
