//! Form factors between faces.

use farfield::Watch;
use farfield_radiosity::{Element, Occluders, Patch, Triangle, visible_exchange_area};
use farfield_scenes::Scene;
use rayon::prelude::*;

use super::{Failure, check, faces_of};

/// The form factors F_ij of faces that see part of each other, in the order of rows and columns; each is off by about
/// the tolerance at most.
pub(super) fn factors(
    scene: &Scene,
    faces: usize,
    tolerance: f64,
    watch: &Watch,
) -> Result<Vec<(u32, u32, f64)>, Failure> {
    let (mut elements, mut triangles) = (Vec::new(), Vec::new());
    let mut areas = vec![0.0; faces];
    for (surface, &face) in scene.surfaces.iter().zip(faces_of(scene)) {
        let corners = scene.corners(surface);
        let patch = Patch::new(&corners)?;
        areas[face as usize] += patch.area();
        elements.push((Element::patch(patch, surface.face), face));
        triangles.extend((2..corners.len()).map(|k| {
            let vertices = [corners[0], corners[k - 1], corners[k]];
            Triangle { vertices, face: surface.face }
        }));
    }
    let occluders = Occluders::new(&triangles)?;
    let row = |(i, (a, face)): (usize, &(Element, u32))| -> Vec<(u32, u32, f64)> {
        if watch.is_stopped() {
            return Vec::new();
        }
        let others = elements[i + 1..].iter().filter(|(_, other)| other != face);
        let with = |(b, other): &(Element, u32)| {
            (*face, *other, visible_exchange_area(a, b, &occluders, tolerance))
        };
        others.map(with).filter(|&(.., area)| area > 0.0).collect()
    };
    let rows: Vec<Vec<_>> = elements.par_iter().enumerate().map(row).collect();
    check(watch)?;
    let mut found: Vec<(u32, u32, f64)> = rows
        .into_iter()
        .flatten()
        .flat_map(|(i, j, area)| {
            [(i, j, area / areas[i as usize]), (j, i, area / areas[j as usize])]
        })
        .collect();
    found.sort_by_key(|&(i, j, _)| (i, j));
    // Of faces that were cut into triangles there are several.
    found.dedup_by(|next, first| {
        let same = (next.0, next.1) == (first.0, first.1);
        first.2 += if same { next.2 } else { 0.0 };
        same
    });
    Ok(found)
}
