//! A pinhole camera.

use glam::DVec3;

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
