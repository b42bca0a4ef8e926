//! From where to look at a scene: as it says, unless it says nothing or there is nothing to be seen.

use glam::DVec3;

use crate::pictures::camera::Camera;
use crate::pictures::sight::{Backs, Sight};
use crate::scene::Scene;
use crate::scene::viewpoint::Viewpoint;

/// A viewpoint, and how to look from there.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct View {
    /// The viewpoint.
    pub(crate) place: Viewpoint,
    /// What rays do at the backs of surfaces.
    pub(crate) backs: Backs,
    /// What was wrong with the scene's own viewpoint.
    pub(crate) repair: Option<String>,
}

impl View {
    /// The scene's own viewpoint. If it has none, or sees hardly more from there than backs, one from
    /// which all of it is seen, with y upwards, and then through the backs of surfaces: from outside
    /// into a room.
    pub(crate) fn new(scene: &Scene, sight: &Sight) -> Self {
        let complaint = scene.camera.and_then(|place| complaint(&place, sight));
        match scene.camera {
            Some(place) if complaint.is_none() => {
                Self { place, backs: Backs::Opaque, repair: None }
            }
            _ => {
                let repair = complaint
                    .map(|what| format!("camera that saw {what}, replaced by one outside"));
                Self { place: from_outside(scene), backs: Backs::Transparent, repair }
            }
        }
    }
}

/// What is wrong with what is seen from a place, if anything is.
fn complaint(place: &Viewpoint, sight: &Sight) -> Option<&'static str> {
    let camera = Camera::at(place);
    let (mut fronts, mut backs) = (0, 0);
    for k in 0..PROBES * PROBES {
        let [x, y] = [k % PROBES, k / PROBES].map(|at| (at as f64 + 0.5) / PROBES as f64);
        let direction = camera.direction(x, y).normalize();
        backs += usize::from(sight.meets_back(camera.eye(), direction));
        fronts += usize::from(sight.first(camera.eye(), direction, Backs::Opaque).is_some());
    }
    match (fronts, backs) {
        (0, 0) => Some("nothing"),
        _ if fronts == 0 || 2 * backs > PROBES * PROBES => Some("backs of surfaces"),
        _ => None,
    }
}

/// Rows and columns of rays to find out what is seen; odd, so that one goes to the target.
const PROBES: usize = 45;
/// From the middle of the picture to the camera.
const AWAY: DVec3 = DVec3::new(0.4, 0.35, 1.0);
/// Edge of the film over its distance from the lens.
const FILM_OVER_FOCAL: f64 = 0.7;

/// A viewpoint from which the sphere around the scene's bounding box just fits into the picture.
fn from_outside(scene: &Scene) -> Viewpoint {
    let corners = scene.surfaces.iter().flat_map(|surface| scene.corners(surface));
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
    use crate::cutting::mesh::Mesh;
    use crate::generators::{GENERATORS, generate};

    #[test]
    fn all_of_a_scene_without_a_camera_is_in_the_picture() {
        let corners = [DVec3::ZERO, DVec3::new(9.0, 1.0, 0.0), DVec3::new(3.0, -4.0, 7.0)];
        let mut scene = Scene::default();
        scene.add(&corners, 0, 0);
        let (empty, no_mesh) = (Scene::default(), Mesh::default());
        let nothing = Sight::new(&empty, &no_mesh).expect("finite");
        let view = View::new(&scene, &nothing);
        assert_eq!((view.backs, view.repair), (Backs::Transparent, None));
        let camera = Camera::at(&view.place);
        let [forward, right, lower] =
            [(0.5, 0.5), (1.0, 0.5), (0.5, 1.0)].map(|(x, y)| camera.direction(x, y));
        for corner in corners {
            let ray = corner - view.place.eye;
            let ray = ray / ray.dot(forward) - forward;
            for axis in [right - forward, lower - forward] {
                assert!(ray.dot(axis).abs() < axis.length_squared());
            }
        }
        assert!(View::new(&empty, &nothing).place.eye.is_finite());
    }

    #[test]
    fn cameras_of_generated_scenes_are_kept() {
        for name in GENERATORS {
            let scene = generate(name).expect("listed");
            let mesh = Mesh::new(&scene, 1_000).expect("valid");
            let sight = Sight::new(&scene, &mesh).expect("finite");
            let place = scene.camera.expect("generated");
            let expected = View { place, backs: Backs::Opaque, repair: None };
            assert_eq!(View::new(&scene, &sight), expected, "{name}");
        }
    }

    #[test]
    fn a_camera_in_a_wall_or_behind_it_is_replaced() {
        let generated = generate("cornell").expect("listed");
        let mesh = Mesh::new(&generated, 1_000).expect("valid");
        let sight = Sight::new(&generated, &mesh).expect("finite");
        let own = generated.camera.expect("published");
        let centre = DVec3::new(278.0, 273.0, 280.0);
        let in_block = DVec3::new(186.0, 80.0, 168.0);
        let on_back_wall = DVec3::new(278.0, 273.0, 559.2);
        let beside = DVec3::new(900.0, 273.0, -100.0);
        for (eye, target, saw) in [
            (in_block, centre, Some("backs of surfaces")),
            (centre.with_z(900.0), centre, Some("backs of surfaces")),
            (on_back_wall, 2.0 * on_back_wall - centre, Some("nothing")),
            (own.eye, 2.0 * own.eye - centre, Some("nothing")),
            // Past the edge of a wall, of which it sees the back.
            (beside, centre.with_x(552.0).with_z(120.0), Some("backs of surfaces")),
            (beside, centre.with_x(552.0).with_z(-20.0), None),
            (on_back_wall, centre, None),
            (centre, on_back_wall, None),
        ] {
            let camera = Some(Viewpoint { eye, target, ..own });
            let view = View::new(&Scene { camera, ..generated.clone() }, &sight);
            let expected = saw.map(|saw| format!("camera that saw {saw}, replaced by one outside"));
            assert_eq!(view.repair, expected, "from {eye} to {target}");
            assert_eq!(view.backs == Backs::Transparent, saw.is_some());
            assert_eq!(view.place.eye == eye, saw.is_none());
        }
    }
}
