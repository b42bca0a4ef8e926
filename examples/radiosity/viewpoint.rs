//! From where to look at a scene that says nothing about it.

use glam::DVec3;

use crate::scene::{Scene, Viewpoint};
use crate::sight::Backs;

/// The scene's own viewpoint. If it has none, one from which all of it is seen, with y upwards, and
/// then through the backs of surfaces: from outside into a room.
pub(crate) fn viewpoint(scene: &Scene) -> (Viewpoint, Backs) {
    match scene.camera {
        Some(camera) => (camera, Backs::Opaque),
        None => (from_outside(scene), Backs::Transparent),
    }
}

/// From the middle of the picture to the camera.
const AWAY: DVec3 = DVec3::new(0.4, 0.35, 1.0);
/// Edge of the film over its distance from the lens.
const FILM_OVER_FOCAL: f64 = 0.7;

/// A viewpoint from which the sphere around the scene's bounding box just fits into the picture.
fn from_outside(scene: &Scene) -> Viewpoint {
    let corners = scene.surfaces.iter().flat_map(|surface| surface.corners.iter().copied());
    let points = corners.chain(scene.points.iter().map(|point| point.position));
    let [low, high] = points
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)]);
    let centre = Some(0.5 * (low + high)).filter(|centre| centre.is_finite());
    let radius = Some(0.5 * low.distance(high)).filter(|&r| r.is_finite() && r > 0.0);
    let target = centre.unwrap_or_default();
    let half_angle = (0.5 * FILM_OVER_FOCAL).atan();
    let distance = radius.unwrap_or(1.0) / half_angle.sin();
    let eye = target + distance * AWAY.normalize();
    Viewpoint { eye, target, up: DVec3::Y, film_over_focal: FILM_OVER_FOCAL }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::scene::Surface;

    #[test]
    fn all_of_a_scene_without_a_camera_is_in_the_picture() {
        let corners = vec![DVec3::ZERO, DVec3::new(9.0, 1.0, 0.0), DVec3::new(3.0, -4.0, 7.0)];
        let surface = Surface { corners: corners.clone(), material: 0, face: 0 };
        let scene = Scene { surfaces: vec![surface], ..Scene::default() };
        let (view, backs) = viewpoint(&scene);
        assert_eq!(backs, Backs::Transparent);
        let camera = Camera::at(&view);
        let [forward, right, lower] =
            [(0.5, 0.5), (1.0, 0.5), (0.5, 1.0)].map(|(x, y)| camera.direction(x, y));
        for corner in corners {
            let ray = corner - view.eye;
            let ray = ray / ray.dot(forward) - forward;
            for axis in [right - forward, lower - forward] {
                assert!(ray.dot(axis).abs() < axis.length_squared());
            }
        }
        let own = Scene { camera: Some(view), ..scene };
        assert_eq!(viewpoint(&own), (view, Backs::Opaque));
        assert!(viewpoint(&Scene::default()).0.eye.is_finite());
    }
}
