//! Polygons as files hold them, mended and made into surfaces.

use std::collections::{HashMap, HashSet};

use farfield_radiosity::Patch;
use glam::DVec3;

use crate::repair::orient::orient;
use crate::repair::triangulate::triangulate;
use crate::scene::Scene;
use crate::scene::geometry::vector_area;
use crate::scene::material::Material;
use crate::scene::surface::Surface;

/// Polygons that share vertices, or ought to.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Soup {
    /// The vertices, all finite.
    pub(crate) vertices: Vec<DVec3>,
    /// The polygons.
    pub(crate) polygons: Vec<Polygon>,
}

/// A polygon of any number of corners.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Polygon {
    /// Indices of its vertices, counter-clockwise around its front.
    pub(crate) corners: Vec<usize>,
    /// Index of its material.
    pub(crate) material: usize,
}

impl Soup {
    /// The scene of these polygons.
    ///
    /// Vertices at the same place become one. Polygons that aren't flat and convex with three or four
    /// corners are cut into triangles. What has no area, or has been there before, is dropped;
    /// neighbours that disagree about their front are turned. All that is noted among the repairs.
    pub(crate) fn into_scene(self, materials: Vec<Material>) -> Scene {
        let (vertices, polygons) = self.weld();
        let mut pieces = Pieces::default();
        let mut seen = HashSet::new();
        let (mut duplicate, mut bent) = (0, 0);
        for (index, (corners, material)) in polygons.into_iter().enumerate() {
            if corners.len() > 2 && !seen.insert(cycle(&corners)) {
                duplicate += 1;
                continue;
            }
            bent += usize::from(!pieces.add(&vertices, corners, material, index));
        }
        let oriented = orient(&vertices, &mut pieces.corners);
        let notes = [
            (pieces.degenerate, "faces without area, dropped"),
            (duplicate, "duplicate faces, dropped"),
            (bent, "faces that aren't flat, cut into triangles"),
            (oriented.turned, "faces turned round to agree with their neighbours"),
            (oriented.unorientable, "connected parts that can't be oriented, left as they are"),
        ];
        let mentioned = notes.iter().filter(|&&(count, _)| count > 0);
        let repairs = mentioned.map(|(count, what)| format!("{what}: {count}")).collect();
        let surfaces = pieces.into_surfaces(&vertices);
        Scene { materials, surfaces, repairs, ..Scene::default() }
    }

    /// One vertex for each place, and the corners of polygons without immediate repetitions.
    fn weld(self) -> (Vec<DVec3>, Vec<(Vec<u32>, usize)>) {
        let mut places = HashMap::new();
        let mut vertices = Vec::new();
        let welded: Vec<u32> = self
            .vertices
            .iter()
            .map(|&p| {
                // Adding zero turns −0 into 0.
                let bits = (p + DVec3::ZERO).to_array().map(f64::to_bits);
                *places.entry(bits).or_insert_with(|| {
                    vertices.push(p);
                    (vertices.len() - 1) as u32
                })
            })
            .collect();
        let polygons = self.polygons.into_iter().map(|polygon| {
            let mut corners: Vec<u32> = polygon.corners.iter().map(|&k| welded[k]).collect();
            corners.dedup();
            while corners.len() > 1 && corners.first() == corners.last() {
                corners.pop();
            }
            (corners, polygon.material)
        });
        let polygons = polygons.collect();
        (vertices, polygons)
    }
}

/// How far a corner may lie off the plane of a flat polygon, relative to the polygon.
const FLATNESS: f64 = 1e-6;

/// Flat convex pieces of polygons.
#[derive(Default)]
struct Pieces {
    /// Three or four vertices each.
    corners: Vec<Vec<u32>>,
    material: Vec<usize>,
    /// Index of the polygon; none for a piece of one that isn't flat.
    polygon: Vec<Option<usize>>,
    /// How many had no area.
    degenerate: usize,
}

impl Pieces {
    /// Adds a polygon, in triangles if need be. Returns whether it was flat.
    fn add(&mut self, all: &[DVec3], corners: Vec<u32>, material: usize, index: usize) -> bool {
        let places: Vec<_> = corners.iter().map(|&k| all[k as usize]).collect();
        if corners.len() <= 4 && Patch::new(&places).is_ok() {
            self.push(corners, material, Some(index));
            return true;
        }
        let triangles = triangulate(&places);
        if triangles.is_empty() {
            self.degenerate += 1;
        }
        let flat = is_flat(&places);
        for triangle in triangles {
            match Patch::new(&triangle.map(|k| places[k])) {
                Ok(_) => {
                    let corners = triangle.map(|k| corners[k]).to_vec();
                    self.push(corners, material, flat.then_some(index));
                }
                Err(_) => self.degenerate += 1,
            }
        }
        flat
    }

    fn push(&mut self, corners: Vec<u32>, material: usize, polygon: Option<usize>) {
        self.corners.push(corners);
        self.material.push(material);
        self.polygon.push(polygon);
    }

    /// The pieces as surfaces: those of one flat polygon have one face.
    fn into_surfaces(self, all: &[DVec3]) -> Vec<Surface> {
        let mut faces = 0;
        let mut last = None;
        let mut surfaces = Vec::with_capacity(self.corners.len());
        for ((corners, material), polygon) in
            self.corners.into_iter().zip(self.material).zip(self.polygon)
        {
            if polygon.is_none() || polygon != last {
                faces += 1;
            }
            last = polygon;
            let corners = corners.into_iter().map(|k| all[k as usize]).collect();
            surfaces.push(Surface { corners, material, face: faces - 1 });
        }
        surfaces
    }
}

/// Whether all corners lie in one plane, up to the tolerance of patches.
fn is_flat(corners: &[DVec3]) -> bool {
    // Three corners always do, but rounding hides it where there is no area.
    let [origin, _, _, _, ..] = *corners else { return true };
    let normal = vector_area(corners).normalize_or_zero();
    let size = corners.iter().map(|p| p.distance(origin)).fold(0.0, f64::max);
    corners.iter().all(|&p| normal.dot(p - origin).abs() <= FLATNESS * size)
}

/// The same corners in the same order, from the smallest on.
fn cycle(corners: &[u32]) -> Vec<u32> {
    let mut corners = corners.to_vec();
    let smallest = (0..corners.len()).min_by_key(|&k| corners[k]).unwrap_or(0);
    corners.rotate_left(smallest);
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::geometry::{area, is_watertight, volume};

    fn soup(vertices: &[[f64; 3]], polygons: &[&[usize]]) -> Soup {
        let polygon = |corners: &&[usize]| Polygon { corners: corners.to_vec(), material: 0 };
        Soup {
            vertices: vertices.iter().map(|&p| p.into()).collect(),
            polygons: polygons.iter().map(polygon).collect(),
        }
    }

    fn scene(vertices: &[[f64; 3]], polygons: &[&[usize]]) -> Scene {
        soup(vertices, polygons).into_scene(vec![Material::grey()])
    }

    const SQUARE: [[f64; 3]; 4] =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

    #[test]
    fn quadrilaterals_stay_whole_and_larger_polygons_are_cut() {
        let quad = scene(&SQUARE, &[&[0, 1, 2, 3]]);
        assert_eq!((quad.surfaces.len(), quad.surfaces[0].corners.len()), (1, 4));
        let house = [&SQUARE[..], &[[0.5, 2.0, 0.0]]].concat();
        let house = scene(&house, &[&[0, 1, 2, 4, 3]]);
        assert_eq!(house.surfaces.len(), 3);
        assert!((house.surfaces.iter().map(area).sum::<f64>() - 1.5).abs() < 1e-15);
        assert!(house.surfaces.iter().all(|s| s.face == 0));
        assert!(house.repairs.is_empty());
    }

    #[test]
    fn bent_quadrilaterals_become_two_faces() {
        let mut bent = SQUARE;
        bent[2][2] = 0.1;
        let scene = scene(&bent, &[&[0, 1, 2, 3]]);
        let faces: Vec<_> = scene.surfaces.iter().map(|s| s.face).collect();
        assert_eq!(faces, [0, 1]);
        assert_eq!(scene.repairs, ["faces that aren't flat, cut into triangles: 1"]);
    }

    #[test]
    fn faces_without_area_and_duplicates_are_dropped_and_counted() {
        let polygons: [&[usize]; 7] =
            [&[0, 1, 2], &[1, 2, 0], &[0, 1, 1], &[0, 1], &[2, 1, 0], &[0, 1, 4], &[0, 2, 3]];
        let vertices = [&SQUARE[..], &[[2.0, 0.0, 0.0]]].concat();
        let scene = scene(&vertices, &polygons);
        // The third time, the first triangle is seen from behind: a sheet of its own.
        assert_eq!(scene.surfaces.len(), 3);
        assert_eq!(
            scene.repairs,
            ["faces without area, dropped: 3", "duplicate faces, dropped: 1"]
        );
        assert!(scene.check().is_ok());
    }

    #[test]
    fn triangles_without_area_count_as_flat() {
        let sliver = [[0.0, 0.0, -1.0], [2.1e-16, 7e-19, -1.0], [1.9e-16, 8e-17, -1.0 + 1e-16]];
        let needle = [[0.1, 0.2, 0.3], [0.2, 0.4, 0.6], [0.3, 0.6, 0.9]];
        for vertices in [sliver, needle] {
            let scene = scene(&vertices, &[&[0, 1, 2]]);
            let dropped = ["faces without area, dropped: 1"];
            assert!(scene.surfaces.len() == 1 || scene.repairs == dropped, "{:?}", scene.repairs);
        }
    }

    #[test]
    fn vertices_at_one_place_are_one_and_neighbours_agree() {
        let p = [[0.0, 0.0, -0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let mut vertices: Vec<_> = faces.iter().flatten().map(|&k: &usize| p[k]).collect();
        vertices[0][2] = 0.0;
        let polygons = [[0, 1, 2], [3, 4, 5], [7, 6, 8], [9, 10, 11]];
        let scene = scene(&vertices, &polygons.each_ref().map(|polygon| &polygon[..]));
        assert_eq!(scene.repairs, ["faces turned round to agree with their neighbours: 1"]);
        assert!(is_watertight(&scene.surfaces));
        assert!((volume(&scene.surfaces) - 1.0 / 6.0).abs() < 1e-15);
    }

    #[test]
    fn what_cannot_be_oriented_is_said() {
        let strip = |k: usize| {
            let angle = (k / 2) as f64 * std::f64::consts::TAU / 3.0;
            let up = if k.is_multiple_of(2) { 0.0 } else { 1.0 };
            [angle.cos() * (1.0 + 0.3 * up), angle.sin(), up]
        };
        let vertices: Vec<_> = (0..6).map(strip).collect();
        let polygons: [&[usize]; 6] =
            [&[0, 1, 2], &[2, 1, 3], &[2, 3, 4], &[4, 3, 5], &[4, 5, 1], &[1, 5, 0]];
        let scene = scene(&vertices, &polygons);
        assert_eq!(scene.surfaces.len(), 6);
        assert!(scene.repairs[0].starts_with("connected parts that can't be oriented"));
    }
}
