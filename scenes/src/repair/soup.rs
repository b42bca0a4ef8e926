//! Polygons as files hold them, mended and made into surfaces that share their vertices.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use farfield_radiosity::Patch;
use glam::DVec3;

use crate::repair::orient::orient;
use crate::repair::triangulate::triangulate;
use crate::scene::Scene;
use crate::scene::geometry::{is_watertight, vector_area};
use crate::scene::material::Material;
use crate::scene::place::Part;
use crate::scene::surface::Surface;
use crate::scene::weld::Weld;

/// The polygons of a file, which are mended one by one.
///
/// Vertices at the same place become one. Polygons that aren't flat and convex with three or four
/// corners are cut into triangles. What has no area, or has been there before, is dropped.
#[derive(Clone, Debug, Default)]
pub(crate) struct Soup {
    weld: Weld,
    /// For each vertex of the file, which one it has become.
    welded: Vec<u32>,
    /// The corners of polygons so far, from the smallest on, and their materials.
    seen: HashMap<Vec<u32>, usize>,
    /// Flat convex pieces; those of one flat polygon have one face.
    surfaces: Vec<Surface>,
    /// For each of them the number of its polygon, from 1.
    numbers: Vec<u32>,
    /// How many polygons have been added.
    polygons: u32,
    degenerate: usize,
    duplicate: usize,
    /// How many of those are of another material than what was there before.
    other: usize,
    bent: usize,
}

impl Soup {
    /// Adds a vertex, which must be finite.
    pub(crate) fn add_vertex(&mut self, place: DVec3) {
        self.welded.push(self.weld.vertex(place));
    }

    /// How many vertices have been added.
    pub(crate) fn vertices(&self) -> u32 {
        self.welded.len() as u32
    }

    /// Adds a polygon of any number of corners, counter-clockwise around its front, given by the numbers
    /// of its vertices. Returns whether there are such vertices; otherwise nothing is added.
    pub(crate) fn add_polygon(&mut self, corners: &[u32], material: usize) -> bool {
        let corners = corners.iter().map(|&k| self.welded.get(k as usize).copied());
        let Some(mut corners) = corners.collect::<Option<Vec<_>>>() else { return false };
        self.polygons = self.polygons.saturating_add(1);
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        let before = if corners.len() > 2 {
            match self.seen.entry(cycle(&corners)) {
                Entry::Occupied(before) => Some(*before.get()),
                Entry::Vacant(place) => {
                    place.insert(material);
                    None
                }
            }
        } else {
            None
        };
        if let Some(before) = before {
            self.duplicate += 1;
            self.other += usize::from(before != material);
        } else {
            self.add_pieces(corners, material);
            self.numbers.resize(self.surfaces.len(), self.polygons);
        }
        true
    }

    /// The scene of these polygons. Neighbours that disagree about their front are turned. That and all
    /// that has been mended before is noted among the repairs.
    pub(crate) fn into_scene(mut self, materials: Vec<Material>) -> Scene {
        let vertices = self.weld.vertices;
        let oriented = orient(&vertices, &mut self.surfaces);
        let notes = [
            (self.degenerate, "faces without area, dropped"),
            (self.duplicate, "duplicate faces, dropped"),
            (self.bent, "faces that aren't flat, cut into triangles"),
            (oriented.turned, "faces turned round to agree with their neighbours"),
            (oriented.unorientable, "connected parts that can't be oriented, left as they are"),
        ];
        let mentioned = notes.iter().filter(|&&(count, _)| count > 0);
        let repairs = mentioned.map(|(count, what)| format!("{what}: {count}")).collect();
        let doubts = [
            (self.other, "duplicate faces of another material, of which the first counts"),
            (
                oriented.doubtful,
                "closed parts made to look outwards, although most of their faces looked inwards",
            ),
        ];
        let mentioned = doubts.iter().filter(|&&(count, _)| count > 0);
        let doubts = mentioned.map(|(count, what)| format!("{what}: {count}")).collect();
        let parts = vec![Part { kind: "face", numbers: self.numbers, ..Part::default() }];
        let surfaces = self.surfaces;
        let watertight = is_watertight(&surfaces);
        Scene {
            materials,
            vertices,
            surfaces,
            parts,
            watertight,
            repairs,
            doubts,
            ..Scene::default()
        }
    }

    /// Adds a polygon, in triangles if need be.
    fn add_pieces(&mut self, corners: Vec<u32>, material: usize) {
        let places: Vec<_> = corners.iter().map(|&k| self.weld.vertices[k as usize]).collect();
        let mut face = self.surfaces.last().map_or(0, |last| last.face + 1);
        if corners.len() <= 4 && Patch::new(&places).is_ok() {
            self.surfaces.push(Surface { corners, material, face });
            return;
        }
        let (triangles, flat) = (triangulate(&places), is_flat(&places));
        self.bent += usize::from(!flat);
        self.degenerate += usize::from(triangles.is_empty());
        for triangle in triangles {
            if Patch::new(&triangle.map(|k| places[k])).is_err() {
                self.degenerate += 1;
                continue;
            }
            let corners = triangle.map(|k| corners[k]).to_vec();
            self.surfaces.push(Surface { corners, material, face });
            face += u32::from(!flat);
        }
    }
}

/// How far a corner may lie off the plane of a flat polygon, relative to the polygon.
const FLATNESS: f64 = 1e-6;

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

    fn scene(vertices: &[[f64; 3]], polygons: &[&[u32]]) -> Scene {
        let mut soup = Soup::default();
        vertices.iter().for_each(|&place| soup.add_vertex(place.into()));
        assert!(polygons.iter().all(|corners| soup.add_polygon(corners, 0)));
        assert!(!soup.add_polygon(&[0, 1, vertices.len() as u32], 0));
        soup.into_scene(vec![Material::grey()])
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
        assert!((house.surfaces.iter().map(|s| house.area(s)).sum::<f64>() - 1.5).abs() < 1e-15);
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
        let polygons: [&[u32]; 7] =
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
        assert_eq!(scene.vertices.len(), 4);
        assert!(is_watertight(&scene.surfaces));
        assert!((scene.volume() - 1.0 / 6.0).abs() < 1e-15);
    }

    #[test]
    fn what_cannot_be_oriented_is_said() {
        let strip = |k: usize| {
            let angle = (k / 2) as f64 * std::f64::consts::TAU / 3.0;
            let up = if k.is_multiple_of(2) { 0.0 } else { 1.0 };
            [angle.cos() * (1.0 + 0.3 * up), angle.sin(), up]
        };
        let vertices: Vec<_> = (0..6).map(strip).collect();
        let polygons: [&[u32]; 6] =
            [&[0, 1, 2], &[2, 1, 3], &[2, 3, 4], &[4, 3, 5], &[4, 5, 1], &[1, 5, 0]];
        let scene = scene(&vertices, &polygons);
        assert_eq!(scene.surfaces.len(), 6);
        assert!(scene.repairs[0].starts_with("connected parts that can't be oriented"));
    }
}
