//! Surfaces that lie upon each other and look the same way.
//!
//! Neither hides the other: whatever sees one of them sees both, and their light counts twice.

use glam::DVec3;

use crate::cutting::polygon::{Polygon, for_each_close_pair};
use crate::scene::Scene;

impl Scene {
    /// What is doubled, in a sentence, if anything is: surfaces in one plane that look the same way and have more in
    /// common than their edges.
    ///
    /// Takes time in proportion to the pairs of surfaces whose extents along x overlap.
    pub fn overlaps(&self) -> Option<String> {
        let polygons: Vec<Polygon> =
            self.surfaces.iter().map(|surface| Polygon::new(self.corners(surface))).collect();
        let corners = || self.vertices.iter().copied();
        let low = corners().fold(DVec3::INFINITY, DVec3::min);
        let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
        let farthest = low.abs().max(high.abs()).max_element();
        let margin = (MARGIN * low.distance(high)).max(16.0 * f64::EPSILON * farthest);
        let two_sided = |k: usize| self.materials[self.surfaces[k].material].two_sided;
        let (mut count, mut first) = (0, None::<[usize; 2]>);
        for_each_close_pair(&polygons, |i, j| {
            let [a, b] = [i, j].map(|k| &polygons[k]);
            let cosine = a.normal.dot(b.normal);
            let alike = cosine > 0.5 || (cosine < -0.5 && (two_sided(i) || two_sided(j)));
            let in_plane = || a.farthest_from(b).min(b.farthest_from(a)) <= margin;
            if alike && in_plane() && a.common_area(b) > LEAST * a.area().min(b.area()) {
                count += 1;
                let pair = [i.min(j), i.max(j)];
                first = Some(first.map_or(pair, |first| first.min(pair)));
            }
        });
        let [a, b] = first?.map(|surface| self.describe(surface));
        let pairs = match count {
            1 => "one pair,".to_owned(),
            _ => format!("{count} pairs, first of them"),
        };
        Some(format!(
            "surfaces lie upon each other and look the same way, so that their light counts twice: {pairs} {a}, \
             and {b}"
        ))
    }
}

/// How far from each other planes are that nothing comes between, relative to the scene.
const MARGIN: f64 = 1e-9;

/// The share of the smaller surface that two have in common at least: rounded corners let neighbours overlap by less.
const LEAST: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generators::{GENERATORS, generate};
    use crate::scene::material::Material;

    /// A square of this edge, at a place in the plane of height z, that looks up or down.
    fn square(edge: f64, at: [f64; 3], is_up: bool) -> Vec<DVec3> {
        let at = DVec3::from_array(at);
        let [x, y] = [DVec3::X * edge, DVec3::Y * edge];
        let mut corners = vec![at, at + x, at + x + y, at + y];
        if !is_up {
            corners.reverse();
        }
        corners
    }

    fn overlaps(squares: &[Vec<DVec3>], two_sided: bool) -> Option<String> {
        let material = Material { two_sided, ..Material::grey() };
        let mut scene = Scene { materials: vec![material], ..Scene::default() };
        for (face, corners) in squares.iter().enumerate() {
            scene.add(corners, 0, face as u32);
        }
        scene.overlaps()
    }

    #[test]
    fn what_lies_upon_each_other_and_looks_the_same_way_is_named() {
        let floor = square(1.0, [0.0; 3], true);
        for other in [
            floor.clone(),
            square(1.0, [0.3, 0.0, 0.0], true),
            square(0.1, [0.5, 0.5, 0.0], true),
            square(9.0, [-4.0, -4.0, 1e-12], true),
        ] {
            let said = overlaps(&[floor.clone(), other], false).expect("doubled");
            assert!(
                said.contains("one pair, surface 0, ") && said.contains(", and surface 1, "),
                "{said}"
            );
        }
        let said =
            overlaps(&[floor.clone(), floor.clone(), floor.clone()], false).expect("doubled");
        assert!(said.contains("3 pairs, first of them surface 0, "), "{said}");
        let back = square(1.0, [0.0; 3], false);
        assert!(overlaps(&[floor.clone(), back.clone()], true).is_some());
        for other in [
            back,
            square(1.0, [1.0, 0.0, 0.0], true),
            square(1.0, [1.0 - 1e-4, 0.0, 0.0], true),
            square(1.0, [0.0, 0.0, 1e-6], true),
            square(1.0, [2.0, 0.0, 0.0], true),
        ] {
            assert_eq!(overlaps(&[floor.clone(), other], false), None);
        }
    }

    #[test]
    fn nothing_is_doubled_in_generated_scenes() {
        for name in GENERATORS {
            let scene = generate(name).expect("listed");
            assert_eq!(scene.overlaps(), None, "{name}");
            assert_eq!(scene.cut_where_surfaces_meet().overlaps(), None, "{name}, cut");
        }
    }
}
