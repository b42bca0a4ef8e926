//! Surfaces cut where others meet them.
//!
//! An element has one radiosity. One that reaches under a partition has the light of both sides, and gives
//! it to both: a leak that no number of elements mends.

use farfield_radiosity::Surfel;
use glam::DVec3;

use crate::cutting::polygon::{Polygon, for_each_close_pair};
use crate::scene::Scene;
use crate::scene::surface::Surface;
use crate::scene::weld::Weld;

const NO_FACE: u32 = Surfel::<f64>::NO_FACE;

impl Scene {
    /// The same scene, its surfaces cut along the lines where others stand on them or pass through them:
    /// a floor at the foot of a partition, a wall where a shelf begins. Pieces keep their surface's
    /// material, take its place in the list, and are faces of their own: they may be parts of different rooms.
    /// What was cut is noted among the repairs.
    ///
    /// Takes time in proportion to the pairs of surfaces whose extents along x overlap.
    pub fn cut_where_surfaces_meet(mut self) -> Self {
        let polygons: Vec<Polygon> =
            self.surfaces.iter().map(|surface| Polygon::new(self.corners(surface))).collect();
        let mut segments: Vec<Vec<[DVec3; 2]>> = vec![Vec::new(); polygons.len()];
        for_each_close_pair(&polygons, |i, j| {
            for (cut, by) in [(i, j), (j, i)] {
                segments[cut].extend(polygons[cut].met_by(&polygons[by]));
            }
        });
        let first = self.vertices.len() as u32;
        let (mut weld, mut surfaces) = (Weld::default(), Vec::new());
        // For each surface the one that it is a piece of.
        let mut origins: Vec<usize> = Vec::new();
        let faces = self.surfaces.iter().map(|surface| surface.face);
        let mut face = faces.filter(|&face| face != NO_FACE).max().map_or(0, |face| face + 1);
        let (mut cut, mut left) = (0, 0);
        let all = self.surfaces.drain(..).zip(polygons).zip(segments);
        for (origin, ((surface, polygon), segments)) in all.enumerate() {
            let pieces = polygon.cut_along(&segments);
            if let None | Some([_]) = pieces.as_deref() {
                left += usize::from(pieces.is_none());
                surfaces.push(surface);
                origins.push(origin);
                continue;
            }
            cut += 1;
            for piece in pieces.iter().flatten().flat_map(|piece| piece.quadrilaterals()) {
                let number = |corner: &DVec3| {
                    let own = polygon.corners.iter().position(|c| c == corner);
                    own.map_or_else(|| first + weld.vertex(*corner), |k| surface.corners[k])
                };
                let corners = piece.iter().map(number).collect();
                surfaces.push(Surface { corners, material: surface.material, face });
                face += 1;
            }
            origins.resize(surfaces.len(), origin);
        }
        self.surfaces = surfaces;
        self.parts.iter_mut().for_each(|part| part.follow(&origins));
        self.vertices.append(&mut weld.vertices);
        let notes = [
            (cut, "surfaces cut where others meet them"),
            (left, "surfaces that too many others meet, left whole"),
        ];
        let mentioned = notes.iter().filter(|(count, _)| *count > 0);
        self.repairs.extend(mentioned.map(|(count, what)| format!("{what}: {count}")));
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::{GENERATORS, generate};
    use crate::scene::material::Material;
    use crate::scene::place::Part;

    /// A floor of 2 × 1 and what stands on it.
    fn floor(others: &[&[DVec3]]) -> Scene {
        let mut scene = Scene { materials: vec![Material::grey()], ..Scene::default() };
        let [x, y] = [DVec3::X * 2.0, DVec3::Y];
        scene.add(&[DVec3::ZERO, x, x + y, y], 0, 7);
        for (k, corners) in others.iter().enumerate() {
            scene.add(corners, 0, k as u32);
        }
        scene
    }

    /// The quadrilateral that stands upright on the line from a to b, its foot at height z.
    fn upright(a: [f64; 2], b: [f64; 2], z: f64) -> [DVec3; 4] {
        let [a, b] = [a, b].map(|[x, y]| DVec3::new(x, y, z));
        [a, b, b + DVec3::Z, a + DVec3::Z]
    }

    /// The areas of the pieces of the floor.
    fn areas(scene: Scene) -> Vec<f64> {
        let scene = scene.cut_where_surfaces_meet();
        scene.check().expect("valid");
        let flat = |surface: &&Surface| scene.corners(surface).iter().all(|corner| corner.z == 0.0);
        let floor = scene.surfaces.iter().filter(flat);
        let mut areas: Vec<f64> = floor.map(|surface| scene.area(surface)).collect();
        areas.sort_unstable_by(f64::total_cmp);
        areas
    }

    #[test]
    fn floors_are_cut_at_the_feet_of_partitions() {
        let across = upright([0.5, 0.0], [0.5, 1.0], 0.0);
        assert_eq!(areas(floor(&[&across])), [0.5, 1.5]);
        // One that passes through, one that ends in the middle.
        assert_eq!(areas(floor(&[&upright([0.5, 0.0], [0.5, 1.0], -0.5)])), [0.5, 1.5]);
        assert_eq!(areas(floor(&[&upright([0.5, 0.2], [0.5, 0.4], 0.0)])), [0.5, 1.5]);
        let cross = areas(floor(&[&across, &upright([0.0, 0.5], [2.0, 0.5], 0.0)]));
        assert_eq!(cross, [0.25, 0.25, 0.75, 0.75]);
        // A corner cut off leaves five corners, which become two pieces.
        let corner = areas(floor(&[&upright([0.0, 0.5], [0.5, 0.0], 0.0)]));
        assert!(corner.len() == 3 && (corner.iter().sum::<f64>() - 2.0).abs() < 1e-12);
        assert!(corner.iter().any(|area| (area - 0.125).abs() < 1e-12), "{corner:?}");
    }

    #[test]
    fn what_only_touches_cuts_nothing() {
        let along = upright([0.0, 0.0], [2.0, 0.0], 0.0);
        let above = upright([0.5, 0.1], [0.5, 0.9], 1e-3);
        let beside = upright([3.0, 0.0], [3.0, 1.0], 0.0);
        let flat = [DVec3::X, DVec3::X * 2.0, DVec3::X + DVec3::Y].map(|p| p * 0.5);
        let tip = [[1.5, 0.5, 0.0], [1.5, 0.6, 1.0], [1.6, 0.6, 1.0]].map(DVec3::from_array);
        let scene = floor(&[&along, &above, &beside, &flat, &tip]);
        let before = scene.surfaces.clone();
        let scene = scene.cut_where_surfaces_meet();
        assert_eq!((scene.surfaces, scene.repairs.len()), (before, 0));
    }

    #[test]
    fn neighbours_share_new_vertices_and_cuts_are_noted() {
        let scene = floor(&[&upright([0.5, 0.0], [0.5, 1.0], 0.0)]);
        let before = scene.vertices.len();
        let scene = scene.cut_where_surfaces_meet();
        assert_eq!(scene.vertices.len(), before + 2);
        assert_eq!(scene.repairs, ["surfaces cut where others meet them: 1"]);
        let faces: Vec<u32> = scene.surfaces.iter().map(|surface| surface.face).collect();
        assert_eq!(faces, [8, 9, 0]);
    }

    #[test]
    fn surfaces_keep_their_names_behind_one_that_is_cut() {
        let mut scene = floor(&[&upright([0.5, 0.0], [0.5, 1.0], 0.0)]);
        scene.parts = vec![
            Part { file: "a.obj".to_owned(), kind: "face", first: 0, numbers: vec![4] },
            Part { file: "b.obj".to_owned(), kind: "face", first: 1, numbers: vec![9] },
        ];
        let scene = scene.cut_where_surfaces_meet();
        let names: Vec<_> =
            (0..3).map(|k| scene.describe(k).split(',').next().unwrap_or("").to_owned()).collect();
        assert_eq!(names, ["face 4 of a.obj", "face 4 of a.obj", "face 9 of b.obj"]);
    }

    #[test]
    fn a_floor_that_a_mesh_stands_on_is_left_whole() {
        let at = |k: usize| {
            let (sin, cos) = (k as f64 * std::f64::consts::TAU / 40.0).sin_cos();
            [1.0 + 0.3 * cos, 0.5 + 0.3 * sin]
        };
        let mantle: Vec<_> = (0..40).map(|k| upright(at(k), at(k + 1), 0.0)).collect();
        let mantle: Vec<&[DVec3]> = mantle.iter().map(|corners| &corners[..]).collect();
        let scene = floor(&mantle).cut_where_surfaces_meet();
        assert_eq!(scene.surfaces.len(), 41);
        assert_eq!(scene.repairs, ["surfaces that too many others meet, left whole: 1"]);
    }

    #[test]
    fn generated_scenes_stay_valid_and_keep_their_area() {
        for name in GENERATORS {
            let scene = generate(name).expect("listed");
            let area = |scene: &Scene| scene.surfaces.iter().map(|s| scene.area(s)).sum::<f64>();
            let before = area(&scene);
            let cut = scene.cut_where_surfaces_meet();
            assert!(cut.check().is_ok(), "{name}");
            assert!((area(&cut) / before - 1.0).abs() < 1e-9, "{name}");
        }
    }
}
