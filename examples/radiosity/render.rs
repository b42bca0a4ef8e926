//! A noise-free picture: direct light by shadow rays per pixel, everything else from the surfels.

use std::f64::consts::FRAC_1_PI;

use farfield_radiosity::{Hit, Irradiance, Occluders, Surfel, Triangle, quad_surfels};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::cornell::Scene;
use crate::shading::{Rgb, Shading};
use crate::surfels::triangles;

/// Rays per pixel and axis.
const RAYS: usize = 3;
/// Points on the light per ray and axis. The rays of a pixel take turns on a grid `RAYS` times finer.
const LIGHT_POINTS: usize = 4;

/// A scene with its light, ready to be looked at.
#[derive(Debug)]
pub(crate) struct View<'a> {
    scene: &'a Scene,
    triangles: Vec<Triangle>,
    /// What the camera sees: all triangles.
    visible: &'a Occluders,
    /// What casts shadows.
    shadowing: &'a Occluders,
    /// The light's surface by turns: each of the RAYS² lists covers it evenly with 1/RAYS² of its area.
    light: Vec<Vec<Surfel>>,
    indirect: &'a Shading,
}

impl<'a> View<'a> {
    /// A view of `scene`, whose [`triangles`] are in `visible`, with shadows cast by `shadowing`.
    /// `indirect` is the irradiance by all light but that which comes straight from the light's surface.
    pub(crate) fn new(
        scene: &'a Scene,
        visible: &'a Occluders,
        shadowing: &'a Occluders,
        indirect: &'a Shading,
    ) -> Self {
        let n = RAYS * LIGHT_POINTS;
        let face = scene.light();
        let mut light = vec![Vec::new(); RAYS * RAYS];
        for (k, surfel) in
            quad_surfels(scene.walls[face].corners, n, n, face as u32).into_iter().enumerate()
        {
            light[(k / n % RAYS) * RAYS + k % n % RAYS].push(surfel);
        }
        Self { scene, triangles: triangles(scene), visible, shadowing, light, indirect }
    }

    /// The picture of size × size radiances that `camera` takes, row by row from the upper left
    /// corner; calls `row_done` after every row, from any thread.
    pub(crate) fn render(
        &self,
        camera: &Camera,
        size: usize,
        row_done: impl Fn() + Sync,
    ) -> Vec<Rgb> {
        let mut pixels = vec![[0.0; 3]; size * size];
        pixels.par_chunks_mut(size).enumerate().for_each(|(row, pixels)| {
            for (column, pixel) in pixels.iter_mut().enumerate() {
                *pixel = self.pixel(camera, size, column, row);
            }
            row_done();
        });
        pixels
    }

    /// The mean radiance over a pixel, by a ray through the middle of each of RAYS × RAYS squares.
    fn pixel(&self, camera: &Camera, size: usize, column: usize, row: usize) -> Rgb {
        let mut sum = [0.0; 3];
        for turn in 0..RAYS * RAYS {
            let at = |pixel: usize, ray: usize| {
                (pixel as f64 + (ray as f64 + 0.5) / RAYS as f64) / size as f64
            };
            let direction = camera.direction(at(column, turn % RAYS), at(row, turn / RAYS));
            let radiance = self.radiance(camera.eye(), direction, turn);
            for (sum, band) in sum.iter_mut().zip(radiance) {
                *sum += band / (RAYS * RAYS) as f64;
            }
        }
        sum
    }

    /// The radiance L = B/π that arrives at `origin` from `direction`; B = E + ρH.
    fn radiance(&self, origin: DVec3, direction: DVec3, turn: usize) -> Rgb {
        let Some(hit) = self.visible.first_hit(origin, direction) else { return [0.0; 3] };
        let [a, b, c] = self.triangles[hit.triangle].vertices;
        let normal = (b - a).cross(c - a).normalize();
        if normal.dot(direction) >= 0.0 {
            return [0.0; 3];
        }
        let position = origin + hit.distance * direction.normalize();
        let direct = self.direct(&Surfel { position, normal, area: 0.0, face: hit.face }, turn);
        let wall = hit.face as usize;
        let indirect = self.indirect.at(wall, parameters(&hit));
        let material = &self.scene.walls[wall].material;
        [0, 1, 2].map(|band| {
            let irradiance = direct[band] + indirect[band];
            FRAC_1_PI * (material.emission[band] + material.reflectance[band] * irradiance)
        })
    }

    /// The irradiance straight from the light, H = Σ V K A E over one turn of its points.
    fn direct(&self, receiver: &Surfel, turn: usize) -> Rgb {
        let kernel = Irradiance::<f64>::clamped();
        let mut factor = 0.0;
        for source in &self.light[turn] {
            let pair = kernel.factor(receiver, source);
            let faces = [receiver.face, source.face];
            if pair > 0.0 && !self.shadowing.blocked(receiver.position, source.position, faces) {
                factor += pair * source.area * (RAYS * RAYS) as f64;
            }
        }
        self.scene.walls[self.scene.light()].material.emission.map(|band| factor * band)
    }
}

/// Where a wall's triangle 0 1 2 or 0 2 3 was hit, in the (u, v) of the wall: corners 0, 1, 2, 3 are at
/// (0, 0), (1, 0), (1, 1), (0, 1).
fn parameters(hit: &Hit) -> DVec2 {
    let [_, second, third] = hit.weights;
    match hit.triangle % 2 {
        0 => DVec2::new(second + third, third),
        _ => DVec2::new(second, second + third),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cornell::{EYE, FILM_OVER_FOCAL, FORWARD, UP};
    use crate::surfels::Surfels;

    #[test]
    fn parameters_agree_with_the_cells_of_the_surfels() {
        let scene = Scene::cornell_box();
        let occluders = Occluders::new(&triangles(&scene)).expect("finite");
        for (wall, shape) in scene.walls.iter().enumerate() {
            let (nu, nv) = (5, 4);
            for (cell, surfel) in quad_surfels(shape.corners, nu, nv, 0).iter().enumerate() {
                let from = surfel.position + 10.0 * surfel.normal;
                let hit = occluders.first_hit(from, -surfel.normal).expect("the wall");
                if hit.face as usize != wall {
                    continue; // under a block
                }
                let centre = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
                let expected = DVec2::new(centre(cell / nv, nu), centre(cell % nv, nv));
                // Walls with unequal opposite edges have slightly different (u, v) on their triangles.
                assert!(parameters(&hit).abs_diff_eq(expected, 5e-3), "wall {wall}, cell {cell}");
            }
        }
    }

    #[test]
    fn an_even_indirect_light_is_seen_through_the_reflectances() {
        let scene = Scene::cornell_box();
        let occluders = Occluders::new(&triangles(&scene)).expect("finite");
        let surfels = Surfels::new(&scene, 200);
        let even = Shading::new(&surfels, &vec![[std::f64::consts::PI; 3]; surfels.surfels.len()]);
        let view = View::new(&scene, &occluders, &occluders, &even);
        // Up to the ceiling beside the light, which gets none of it directly.
        let ceiling = view.radiance(DVec3::new(100.0, 100.0, 100.0), DVec3::Y, 0);
        assert!((ceiling[0] - 0.725).abs() < 1e-12 && (ceiling[2] - 0.68).abs() < 1e-12);
        let lamp = view.radiance(DVec3::new(278.0, 100.0, 280.0), DVec3::Y, 0);
        assert!((lamp[0] - 17.0).abs() < 1e-12 && (lamp[2] - 4.0).abs() < 1e-12);

        let camera = Camera::new(EYE, FORWARD, UP, FILM_OVER_FOCAL);
        let pixels = view.render(&camera, 16, || ());
        let past_the_box = camera.direction(0.01, 0.01);
        assert_eq!(view.radiance(EYE, past_the_box, 0), [0.0; 3]);
        let (left, right) = (pixels[8 * 16 + 1], pixels[8 * 16 + 14]);
        assert!(left[0] > 5.0 * left[1] && right[1] > 2.0 * right[0]);
    }

    #[test]
    fn shadows_fall_where_a_block_stands_before_the_light() {
        let scene = Scene::cornell_box();
        let occluders = Occluders::new(&triangles(&scene)).expect("finite");
        let open = Occluders::new(&[]).expect("empty");
        let surfels = Surfels::new(&scene, 200);
        let dark = Shading::new(&surfels, &vec![[0.0; 3]; surfels.surfels.len()]);
        let floor = |shadowing, x, z| {
            let view = View::new(&scene, &occluders, shadowing, &dark);
            view.radiance(DVec3::new(x, 1.0, z), DVec3::NEG_Y, 0)[0]
        };
        // Left of the tall block, then between the two.
        assert_eq!(floor(&occluders, 500.0, 380.0), 0.0);
        assert!(floor(&open, 500.0, 380.0) > 0.05);
        assert_eq!(floor(&occluders, 300.0, 200.0), floor(&open, 300.0, 200.0));
    }
}
