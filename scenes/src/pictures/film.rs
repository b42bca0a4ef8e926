//! Noise-free pictures of a mesh.

use std::f64::consts::FRAC_1_PI;

use farfield_radiosity::{Element, Occluders};

use crate::pictures::camera::Camera;
use crate::pictures::exposure::{Ray, expose};
use crate::pictures::lamps::{Lamps, Receiver};
use crate::pictures::sight::{Backs, Seen, Sight};
use crate::pictures::smooth::Smooth;
use crate::pictures::tone::Rgb;

/// A picture's camera, and how it takes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Film {
    /// The camera.
    pub(crate) camera: Camera,
    /// What rays do at the backs of elements.
    pub(crate) backs: Backs,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// How far from a linear function what is seen around a pixel may be for few rays to be enough; see
    /// [`expose`].
    pub(crate) evenness: f64,
}

/// A lit mesh, ready to be looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lit<'a> {
    /// The elements.
    pub(crate) elements: &'a [Element],
    /// Their emitted exitance \[W/m²\], in the colours of the picture.
    pub(crate) emission: &'a [Rgb],
    /// Their reflectance.
    pub(crate) reflectance: &'a [Rgb],
    /// The irradiance \[W/m²\]; without what comes straight from lamps and the sun if these are given.
    pub(crate) irradiance: &'a Smooth,
    /// Lamps of which light is gathered per pixel, for as many turns as a pixel has rays, and what casts shadows.
    pub(crate) direct: Option<(&'a Lamps, &'a Occluders)>,
}

impl Film {
    /// The radiances L = B/π, B = E + ρH, row by row from the upper left corner; black where there is
    /// nothing. Calls `row_done` after every row, from any thread.
    pub(crate) fn radiances(
        &self,
        sight: &Sight,
        lit: &Lit,
        row_done: impl Fn() + Sync,
    ) -> Vec<Rgb> {
        let see = |ray: Ray| Some(lit.radiance(&self.meet(sight, ray)?, ray.turn));
        let pixels = expose(self.size, self.evenness, see, row_done).into_iter();
        pixels.map(|pixel| pixel.mean.map(|band| pixel.share * band)).collect()
    }

    /// The first band of a field as seen from the camera, row by row from the upper left corner; none
    /// where less than half of a pixel shows any surface. Calls `row_done` after every row, from any
    /// thread.
    pub(crate) fn values(
        &self,
        sight: &Sight,
        field: &Smooth,
        row_done: impl Fn() + Sync,
    ) -> Vec<Option<f64>> {
        let see = |ray: Ray| {
            let seen = self.meet(sight, ray)?;
            Some(field.at(seen.element, seen.parameters))
        };
        let pixels = expose(self.size, self.evenness, see, row_done).into_iter();
        pixels.map(|pixel| (pixel.share > 0.5).then_some(pixel.mean[0])).collect()
    }

    /// What a ray sees.
    fn meet(&self, sight: &Sight, ray: Ray) -> Option<Seen> {
        let direction = self.camera.direction(ray.place.x, ray.place.y);
        sight.first(self.camera.eye(), direction, self.backs)
    }
}

impl Lit<'_> {
    /// The radiance that leaves a point.
    fn radiance(&self, seen: &Seen, turn: usize) -> Rgb {
        let Seen { element, position, parameters } = *seen;
        let mut irradiance = self.irradiance.at(element, parameters);
        let reflectance = self.reflectance[element];
        if let Some((lamps, shadows)) = self.direct
            && reflectance != [0.0; 3]
        {
            let (position, normal) = self.irradiance.surface(element, parameters, position);
            let face = self.elements[element].surfel().face;
            let receiver = Receiver { position, normal, face };
            let direct = lamps.irradiance(&receiver, turn, shadows);
            irradiance = [0, 1, 2].map(|band| irradiance[band] + direct[band]);
        }
        [0, 1, 2].map(|band| {
            FRAC_1_PI * (self.emission[element][band] + reflectance[band] * irradiance[band])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::exposure::RAYS;
    use crate::pictures::samples::{grid, scene_of, sheet};
    use crate::pictures::smooth::tests::smoothed;
    use crate::scene::viewpoint::Viewpoint;
    use glam::DVec3;
    use std::f64::consts::PI;

    const SIZE: usize = 16;

    /// A camera that sees 2 × 2 of the plane z = 0, around the origin, from above, x to the right.
    fn film() -> Film {
        let [eye, target, up] = [3.0 * DVec3::Z, DVec3::ZERO, DVec3::Y];
        let camera = Camera::at(&Viewpoint { eye, target, up, film_over_focal: 2.0 / 3.0 });
        Film { camera, backs: Backs::Opaque, size: [SIZE; 2], evenness: 0.0 }
    }

    fn open() -> Occluders {
        Occluders::new(&[]).expect("empty")
    }

    #[test]
    fn a_pixel_is_what_its_place_emits_and_reflects() {
        // The right half of the picture; the left is empty.
        let elements = grid(DVec3::NEG_Y, DVec3::X, 2.0 * DVec3::Y, [4, 4], 0);
        let values: Vec<Rgb> = elements
            .iter()
            .map(|e| e.surfel().position)
            .map(|p| [2.0 + p.x, 2.0 + p.y, 1.0])
            .collect();
        let irradiance = smoothed(&elements, &open(), &values);
        let lit = Lit {
            elements: &elements,
            emission: &[[0.0, 0.0, PI]; 16],
            reflectance: &[[0.5, 0.25, 0.0]; 16],
            irradiance: &irradiance,
            direct: None,
        };
        let (scene, mesh) = scene_of(&elements);
        let sight = Sight::new(&scene, &mesh).expect("finite");
        let rows = std::sync::atomic::AtomicUsize::new(0);
        let row_done = || {
            rows.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        };
        let pixels = film().radiances(&sight, &lit, row_done);
        assert_eq!((pixels.len(), rows.into_inner()), (SIZE * SIZE, SIZE));
        let values = film().values(&sight, &irradiance, || ());
        for (k, (pixel, value)) in pixels.iter().zip(values).enumerate() {
            let place = |index: usize| (index as f64 + 0.5) / SIZE as f64 * 2.0 - 1.0;
            let (x, y) = (place(k % SIZE), -place(k / SIZE));
            if x < 0.0 {
                assert_eq!((*pixel, value), ([0.0; 3], None));
                continue;
            }
            let expected = [0.5 * (2.0 + x) / PI, 0.25 * (2.0 + y) / PI, 1.0];
            assert!((0..3).all(|band| (pixel[band] - expected[band]).abs() < 1e-9), "{pixel:?}");
            assert!((value.expect("seen") - 2.0 - x).abs() < 1e-9);
        }
    }

    #[test]
    fn a_wide_or_tall_picture_has_the_square_one_in_its_middle() {
        let elements = grid(DVec3::new(-3.0, -3.0, 0.0), 6.0 * DVec3::X, 6.0 * DVec3::Y, [8, 8], 0);
        let values: Vec<Rgb> = elements.iter().map(|e| [e.surfel().position.x; 3]).collect();
        let field = smoothed(&elements, &open(), &values);
        let (scene, mesh) = scene_of(&elements);
        let sight = Sight::new(&scene, &mesh).expect("finite");
        let square = film().values(&sight, &field, || ());
        for size in [[2 * SIZE, SIZE], [SIZE, 2 * SIZE]] {
            let film = Film { camera: film().camera.widened(size), size, ..film() };
            let wide = film.values(&sight, &field, || ());
            assert_eq!(wide.len(), 2 * SIZE * SIZE);
            let [left, top] = size.map(|edge| (edge - SIZE) / 2);
            for (k, value) in square.iter().enumerate() {
                let other = wide[(top + k / SIZE) * size[0] + left + k % SIZE];
                let change = value.expect("seen") - other.expect("seen");
                assert!(change.abs() < 1e-9, "{size:?} {k} {change}");
            }
        }
    }

    #[test]
    fn linear_fields_are_linear_on_triangles_and_skew_quadrangles() {
        let [a, b, c, d] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| DVec3::new(x, y, 0.0));
        let middle = DVec3::new(0.1, -0.2, 0.0);
        let [left, low] = [a.lerp(d, 0.3), a.lerp(b, 0.6)];
        let cells = [
            &[a, low, middle, left][..],
            &[low, b, middle],
            &[b, c, middle],
            &[c, d, middle],
            &[d, left, middle],
        ];
        let elements: Vec<_> = cells
            .map(|corners| {
                Element::patch(farfield_radiosity::Patch::new(corners).expect("flat"), 0)
            })
            .to_vec();
        let field = |p: DVec3| 4.0 + p.x - 2.0 * p.y;
        let values: Vec<Rgb> =
            elements.iter().map(|e| [field(e.surfel().position), 0.0, 0.0]).collect();
        let smooth = smoothed(&elements, &open(), &values);
        let (scene, mesh) = scene_of(&elements);
        let sight = Sight::new(&scene, &mesh).expect("finite");
        for (k, value) in film().values(&sight, &smooth, || ()).into_iter().enumerate() {
            let place = |index: usize| (index as f64 + 0.5) / SIZE as f64 * 2.0 - 1.0;
            let point = DVec3::new(place(k % SIZE), -place(k / SIZE), 0.0);
            let value = value.expect("seen");
            assert!((value - field(point)).abs() < 1e-9, "{value} at {point}");
        }
    }

    #[test]
    fn lamps_light_pixels_unless_something_hides_them() {
        let mut elements =
            grid(DVec3::new(-1.0, -1.0, 0.0), 2.0 * DVec3::X, 2.0 * DVec3::Y, [1, 1], 0);
        elements.extend(grid(
            DVec3::new(-0.2, -0.2, 4.0),
            0.4 * DVec3::Y,
            0.4 * DVec3::X,
            [1, 1],
            1,
        ));
        let emission = [[0.0; 3], [8.0; 3]];
        let (scene, mesh) = scene_of(&elements);
        let lamps = Lamps::new(&scene, &mesh, &emission, RAYS);
        let irradiance = smoothed(&mesh.elements, &open(), &[[0.0; 3]; 2]);
        let sight = Sight::new(&scene, &mesh).expect("finite");
        // Over the left half of the floor.
        let cover = sheet(DVec3::new(-2.0, -2.0, 0.01), 2.0 * DVec3::X, 4.0 * DVec3::Y, 9);
        let cover = Occluders::new(&cover).expect("finite");
        let shoot = |shadows: &Occluders| {
            let lit = Lit {
                elements: &mesh.elements,
                emission: &emission,
                reflectance: &[[0.5; 3]; 2],
                irradiance: &irradiance,
                direct: Some((&lamps, shadows)),
            };
            film().radiances(&sight, &lit, || ())
        };
        let (free, covered) = (shoot(&open()), shoot(&cover));
        for (k, (free, covered)) in free.iter().zip(&covered).enumerate() {
            // About the exitance times the solid angle from below.
            assert!(
                (free[0] / (0.5 / PI * 8.0 * 0.16 / (16.0 * PI)) - 0.8).abs() < 0.21,
                "{free:?}"
            );
            match k % SIZE {
                column if column < SIZE / 2 => assert_eq!(*covered, [0.0; 3]),
                _ => assert_eq!(covered, free),
            }
        }
    }
}
