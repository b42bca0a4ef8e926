//! A pinhole camera.

use glam::DVec3;

use crate::scene::Viewpoint;

/// A pinhole camera with a square film.
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
    /// The camera at `eye` that looks along the unit vector `forward`, with the unit vector `up`,
    /// perpendicular to it, upwards in the picture; its film is `film_over_focal` focal lengths wide.
    pub(crate) fn new(eye: DVec3, forward: DVec3, up: DVec3, film_over_focal: f64) -> Self {
        let half = 0.5 * film_over_focal;
        Self { eye, forward, right: half * forward.cross(up), down: -half * up }
    }

    /// The camera of a viewpoint. Where it looks nowhere, or along what is up, any direction will do.
    pub(crate) fn at(view: &Viewpoint) -> Self {
        let forward = (view.target - view.eye).try_normalize().unwrap_or(DVec3::NEG_Z);
        let up = view.up.reject_from_normalized(forward).try_normalize();
        let up = up.unwrap_or_else(|| forward.any_orthonormal_vector());
        Self::new(view.eye, forward, up, view.film_over_focal)
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
    use crate::cornell::{EYE, FILM_OVER_FOCAL, FORWARD, Scene, UP};

    /// Where the published camera sees a point.
    fn seen(point: DVec3) -> (f64, f64) {
        let camera = Camera::new(EYE, FORWARD, UP, FILM_OVER_FOCAL);
        let ray = (point - EYE) / FORWARD.dot(point - EYE);
        let from_centre =
            |axis: DVec3| 0.5 + 0.5 * (ray - FORWARD).dot(axis) / axis.length_squared();
        let (x, y) = (from_centre(camera.right), from_centre(camera.down));
        assert!(camera.direction(x, y).abs_diff_eq(ray, 1e-12));
        (x, y)
    }

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
        let scene = Scene::cornell_box();
        let centre = |wall: usize| scene.walls[wall].corners.iter().sum::<DVec3>() / 4.0;
        let (x, y) = seen(centre(scene.light()));
        assert!((x - 0.5).abs() < 1e-9 && (0.1..0.2).contains(&y), "light at ({x}, {y})");
        let redness = |wall: usize| {
            let [red, green, _] = scene.walls[wall].material.reflectance;
            red - green
        };
        let side = |wall: usize| seen(centre(wall)).0;
        let red = (0..19).max_by(|&a, &b| redness(a).total_cmp(&redness(b))).expect("19 walls");
        let green = (0..19).min_by(|&a, &b| redness(a).total_cmp(&redness(b))).expect("19 walls");
        assert!(side(red) < 0.2 && side(green) > 0.8);
    }
}
