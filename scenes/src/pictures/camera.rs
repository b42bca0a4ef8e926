//! A pinhole camera.

use glam::DVec3;

use crate::scene::viewpoint::Viewpoint;

/// A pinhole camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Camera {
    eye: DVec3,
    /// From the eye to the middle of the picture, at unit distance.
    forward: DVec3,
    /// From the middle of the picture to the middle of its right edge.
    right: DVec3,
    /// From the middle of the picture to the middle of its lower edge.
    down: DVec3,
}

impl Camera {
    /// The camera of a viewpoint, with a square film. Where it looks nowhere, or along what is up, any direction
    /// will do.
    pub(crate) fn at(view: &Viewpoint) -> Self {
        let forward = (view.target - view.eye).try_normalize().unwrap_or(DVec3::NEG_Z);
        let up = view.up.reject_from_normalized(forward).try_normalize();
        let up = up.unwrap_or_else(|| forward.any_orthonormal_vector());
        let half = 0.5 * view.film_over_focal;
        Self { eye: view.eye, forward, right: half * forward.cross(up), down: -half * up }
    }

    /// The same camera with more film at both ends of its longer edges: for pictures of so many columns and
    /// rows, in the middle of which is the square that it saw before.
    pub(crate) fn widened(self, [width, height]: [usize; 2]) -> Self {
        let short = width.min(height).max(1) as f64;
        let right = self.right * (width as f64 / short);
        Self { right, down: self.down * (height as f64 / short), ..self }
    }

    /// Where the rays start.
    pub(crate) fn eye(&self) -> DVec3 {
        self.eye
    }

    /// The direction, of any length, in which the camera sees the point (x, y) of the picture: (0, 0)
    /// is the upper left corner, (1, 1) the lower right one.
    pub(crate) fn direction(&self, x: f64, y: f64) -> DVec3 {
        self.forward + (2.0 * x - 1.0) * self.right + (2.0 * y - 1.0) * self.down
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::generate;

    #[test]
    fn a_viewpoint_has_its_target_in_the_middle_and_up_upwards() {
        let up = DVec3::new(0.3, 5.0, 1.0);
        let [eye, target] = [DVec3::new(4.0, 1.0, 2.0), DVec3::new(-1.0, 0.5, 3.0)];
        let camera = Camera::at(&Viewpoint { eye, target, up, film_over_focal: 0.8 });
        assert!(camera.direction(0.5, 0.5).abs_diff_eq((target - eye).normalize(), 1e-12));
        assert!(camera.down.dot(up) < 0.0 && camera.right.dot(up).abs() < 1e-12);
        assert!((camera.right.length() - 0.4).abs() < 1e-12);
        for (target, up) in [(eye, up), (eye + up, up), (DVec3::NAN, DVec3::ZERO)] {
            let camera = Camera::at(&Viewpoint { eye, target, up, film_over_focal: 0.8 });
            assert!(camera.direction(0.2, 0.9).is_finite());
        }
    }

    #[test]
    fn light_above_red_left_green_right() {
        let scene = generate("cornell").expect("a scene");
        let camera = Camera::at(&scene.camera.expect("published"));
        let seen = |name: &str| {
            let of = |k: &usize| scene.materials[*k].name == name;
            let material = (0..scene.materials.len()).find(of).expect("a material");
            let surface =
                scene.surfaces.iter().find(|s| s.material == material).expect("a surface");
            let corners = scene.corners(surface);
            let to = corners.iter().sum::<DVec3>() / corners.len() as f64 - camera.eye;
            let ray = to / camera.forward.dot(to) - camera.forward;
            let from_centre = |axis: DVec3| 0.5 + 0.5 * ray.dot(axis) / axis.length_squared();
            (from_centre(camera.right), from_centre(camera.down))
        };
        let (x, y) = seen("lamp");
        assert!((x - 0.5).abs() < 1e-9 && (0.1..0.2).contains(&y), "light at ({x}, {y})");
        assert!(seen("red").0 < 0.2 && seen("green").0 > 0.8);
    }
}
