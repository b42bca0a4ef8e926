//! Turning surfaces of a closed room that look out of it.

use farfield_radiosity::{Occluders, Triangle};
use glam::DVec3;
use rayon::prelude::*;

use crate::scene::Scene;
use crate::scene::geometry::{fan, vector_area};

/// Turns the surfaces of a closed room that look out of it, and says so: those of one side whose fronts see
/// nothing, or backs only, while from their backs they see the fronts of others.
///
/// In a closed room each surface sees others. So its front sees the front of something, unless it is
/// within a solid; then its back doesn't either. The scene must have passed its check.
pub(crate) fn face_room(scene: &mut Scene) -> Option<String> {
    let mut turned: Vec<usize> = Vec::new();
    // What is turned may be what others see.
    for _ in 0..MOST_TURNS {
        let found = looking_out(scene);
        if found.is_empty() {
            break;
        }
        for &index in &found {
            scene.surfaces[index].corners.reverse();
        }
        turned.extend(found);
    }
    turned.sort_unstable();
    turned.dedup();
    let first = scene.describe(*turned.first()?);
    let count = turned.len();
    Some(format!(
        "surfaces of a closed room that looked out of it, turned round: {count} ({first})"
    ))
}

/// How often what has been turned is looked at again.
const MOST_TURNS: usize = 3;

/// The surfaces that look out of the room.
fn looking_out(scene: &Scene) -> Vec<usize> {
    let corners: Vec<Vec<DVec3>> = scene.surfaces.iter().map(|s| scene.corners(s)).collect();
    let normals: Vec<DVec3> = corners.iter().map(|c| vector_area(c).normalize_or_zero()).collect();
    let [low, high] = scene
        .vertices
        .iter()
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], &p| [low.min(p), high.max(p)]);
    let shift = SHIFT * low.distance(high);
    // Where two surfaces lie upon each other, either may be seen first: only what is seen first with all
    // surfaces a little in front of their places, and with all of them a little behind, is seen for sure.
    let shifted = [shift, -shift].map(|shift| {
        let (mut owners, mut triangles) = (Vec::new(), Vec::new());
        for (index, (corners, normal)) in corners.iter().zip(&normals).enumerate() {
            let moved = fan(corners).map(|triangle| triangle.map(|p| p + shift * normal));
            triangles.extend(moved.map(|vertices| Triangle { vertices, face: 0 }));
            owners.resize(triangles.len(), index);
        }
        // What can't be looked at is refused elsewhere.
        Occluders::new(&triangles).ok().map(|occluders| (owners, occluders))
    });
    let [Some(before), Some(behind)] = shifted else { return Vec::new() };
    let two_sided = |index: usize| scene.materials[scene.surfaces[index].material].two_sided;
    let sees_front = |from: DVec3, direction: DVec3| {
        [&before, &behind].into_iter().all(|(owners, occluders)| {
            occluders.first_hit(from, direction).is_some_and(|hit| {
                let owner = owners[hit.triangle];
                two_sided(owner) || normals[owner].dot(direction) < 0.0
            })
        })
    };
    let looks_out = |&index: &usize| {
        let centre = corners[index].iter().sum::<DVec3>() / corners[index].len().max(1) as f64;
        let fronts = |normal: DVec3| {
            let from = centre + 3.0 * shift * normal;
            directions(normal).filter(|&direction| sees_front(from, direction)).count()
        };
        let normal = normals[index];
        !two_sided(index)
            && !sees_front(centre + 3.0 * shift * normal, normal)
            && fronts(normal) == 0
            && 2 * fronts(-normal) > DIRECTIONS
    };
    (0..corners.len()).into_par_iter().filter(looks_out).collect()
}

/// How far surfaces are moved, relative to the scene.
const SHIFT: f64 = 1e-7;

/// Rays to find out what a side sees.
const DIRECTIONS: usize = 17;

/// Directions all over the side of a surface to which its normal points: on a spiral, even in the cosine.
fn directions(normal: DVec3) -> impl Iterator<Item = DVec3> {
    let (u, v) = normal.any_orthonormal_pair();
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..DIRECTIONS).map(move |k| {
        let cosine = (k as f64 + 0.5) / DIRECTIONS as f64;
        let (sin, cos) = (k as f64 * golden).sin_cos();
        let sine = (1.0 - cosine * cosine).sqrt();
        cosine * normal + sine * (cos * u + sin * v)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::material::Material;

    /// A cube with its faces inwards, the upper one in four, and a block on its floor.
    fn room() -> Scene {
        let mut scene = Scene { materials: vec![Material::grey()], ..Scene::default() };
        let at =
            |corner: &[f64; 3], size: f64, base: DVec3| base + size * DVec3::from_array(*corner);
        let faces = [
            [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]],
            [[0., 0., 0.], [0., 0., 1.], [1., 0., 1.], [1., 0., 0.]],
            [[1., 1., 0.], [1., 1., 1.], [0., 1., 1.], [0., 1., 0.]],
            [[0., 1., 0.], [0., 1., 1.], [0., 0., 1.], [0., 0., 0.]],
            [[1., 0., 0.], [1., 0., 1.], [1., 1., 1.], [1., 1., 0.]],
        ];
        for face in &faces {
            scene.add(&face.each_ref().map(|corner| at(corner, 3.0, DVec3::ZERO)), 0, 0);
        }
        let quarter = [[0., 0., 0.], [0., 1., 0.], [1., 1., 0.], [1., 0., 0.]];
        for (x, y) in [(0.0, 0.0), (1.5, 0.0), (0.0, 1.5), (1.5, 1.5)] {
            let base = DVec3::new(x, y, 3.0);
            scene.add(&quarter.each_ref().map(|corner| at(corner, 1.5, base)), 0, 0);
        }
        let base = DVec3::new(1.6, 1.3, 0.0);
        for face in &faces {
            let mut corners = face.each_ref().map(|corner| at(corner, 0.5, base));
            corners.reverse();
            scene.add(&corners, 0, 0);
        }
        let top = [[0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]];
        scene.add(&top.each_ref().map(|corner| at(corner, 0.5, base)), 0, 0);
        scene
    }

    #[test]
    fn what_looks_out_of_a_room_is_turned_and_said() {
        let right = room();
        assert!(right.surfaces.len() == 15 && face_room(&mut right.clone()).is_none());
        for wrong in [vec![0], vec![6], vec![4, 7], vec![14], vec![5, 6, 11]] {
            let mut scene = right.clone();
            for &index in &wrong {
                scene.surfaces[index].corners.reverse();
            }
            let said = face_room(&mut scene).expect("turned");
            let first = scene.describe(wrong[0]);
            let expected = format!("turned round: {} ({first})", wrong.len());
            assert!(said.ends_with(&expected), "{said}");
            for (found, expected) in scene.surfaces.iter().zip(&right.surfaces) {
                let area = |s| vector_area(&right.corners(s));
                assert!(area(found).dot(area(expected)) > 0.0, "{wrong:?}");
            }
        }
    }

    #[test]
    fn two_sides_and_nothing_are_left_alone() {
        let mut scene = room();
        scene.surfaces[6].corners.reverse();
        scene.surfaces[6].material = scene.materials.len();
        scene.materials.push(Material { two_sided: true, ..Material::grey() });
        assert_eq!(face_room(&mut scene), None);
        assert_eq!(face_room(&mut Scene::default()), None);
    }
}
