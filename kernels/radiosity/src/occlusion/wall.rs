//! Occluders that hide a whole cell from another: convex polygons.

use std::collections::HashMap;

use glam::DVec3;

use crate::elements::Surfel;
use crate::occlusion::bounds::Bounds;
use crate::occlusion::facet::Facet;

/// A face of the occluders that is a convex polygon.
#[derive(Clone, Debug)]
pub(crate) struct Wall {
    /// Its corners, counter-clockwise around the normal.
    corners: Vec<DVec3>,
    normal: DVec3,
}

/// Faces of more triangles are not looked at.
const MOST_TRIANGLES: usize = 64;

/// Cosines and shares of an area that count as nothing.
const SLACK: f64 = 1e-9;

/// The faces that are convex polygons, by their numbers.
pub(crate) fn walls(facets: &[Facet]) -> HashMap<u32, Wall> {
    let mut faces: HashMap<u32, Vec<&Facet>> = HashMap::new();
    for facet in facets.iter().filter(|facet| facet.face != Surfel::<f64>::NO_FACE) {
        faces.entry(facet.face).or_default().push(facet);
    }
    let walls = faces.into_iter().filter(|(_, facets)| facets.len() <= MOST_TRIANGLES);
    walls.filter_map(|(face, facets)| Some((face, wall(&facets)?))).collect()
}

/// The polygon that some facets make up together, if they are of one plane and it is convex.
fn wall(facets: &[&Facet]) -> Option<Wall> {
    let (normal, origin) = (facets[0].normal, facets[0].vertices[0]);
    if normal == DVec3::ZERO {
        return None;
    }
    let vertices: Vec<DVec3> = facets.iter().flat_map(|facet| facet.vertices).collect();
    let size = vertices.iter().map(|v| v.distance(origin)).fold(0.0, f64::max);
    if vertices.iter().any(|v| normal.dot(*v - origin).abs() > SLACK * size) {
        return None;
    }
    let corners = hull(vertices, normal);
    let area = |corners: &[DVec3]| {
        let fan = corners.windows(2).map(|w| (w[0] - corners[0]).cross(w[1] - corners[0]));
        0.5 * fan.map(|cross| cross.dot(normal)).sum::<f64>().abs()
    };
    let covered: f64 = facets.iter().map(|facet| area(&facet.vertices)).sum();
    // Facets that overlap are no closed polygon for sure.
    ((covered / area(&corners) - 1.0).abs() <= SLACK).then_some(Wall { corners, normal })
}

/// The convex hull of points of one plane, counter-clockwise around its normal (Andrew, "Another
/// efficient algorithm for convex hulls in two dimensions", 1979).
fn hull(mut points: Vec<DVec3>, normal: DVec3) -> Vec<DVec3> {
    let (u, v) = normal.any_orthonormal_pair();
    points
        .sort_unstable_by(|a, b| a.dot(u).total_cmp(&b.dot(u)).then(a.dot(v).total_cmp(&b.dot(v))));
    let half = |points: &mut dyn Iterator<Item = DVec3>| {
        let mut chain: Vec<DVec3> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..] {
                if (b - a).cross(p - b).dot(normal) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut corners = half(&mut points.iter().copied());
    corners.extend(half(&mut points.iter().rev().copied()));
    corners
}

impl Wall {
    /// Whether it certainly hides all points of one box from all points of the other: every line from
    /// corner to corner passes it, further than `margin` from its border, and so do those in between.
    pub(crate) fn hides(&self, [a, b]: [&Bounds<f64>; 2], margin: f64) -> bool {
        let anchor = self.corners[0].to_array();
        let [from, to] = [a, b].map(|bounds| bounds.extent_along(self.normal.to_array(), anchor));
        let apart = (from.0 > margin && to.1 < -margin) || (from.1 < -margin && to.0 > margin);
        apart
            && a.corners().into_iter().all(|p| {
                b.corners().into_iter().all(|q| {
                    let [start, end] = [p, q].map(|p| self.normal.dot(p - self.corners[0]));
                    self.holds(p + (q - p) * (start / (start - end)), margin)
                })
            })
    }

    /// Whether a point of its plane lies inside, further than `margin` from the border.
    fn holds(&self, p: DVec3, margin: f64) -> bool {
        let count = self.corners.len();
        (0..count).all(|k| {
            let (a, b) = (self.corners[k], self.corners[(k + 1) % count]);
            let inwards = self.normal.cross(b - a);
            inwards.dot(p - a) > margin * inwards.length()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::{Triangle, quad_triangles};

    fn facets(triangles: &[Triangle]) -> Vec<Facet> {
        triangles.iter().enumerate().map(|(i, t)| Facet::new(i, t)).collect()
    }

    fn square(face: u32, at: DVec3) -> [Triangle; 2] {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y].map(|c| c + at);
        quad_triangles(corners, face)
    }

    fn cube(centre: DVec3, half: f64) -> Bounds<f64> {
        Bounds::of([centre.to_array()]).grown(half)
    }

    #[test]
    fn only_convex_plane_faces_are_walls() {
        let far = square(1, DVec3::X * 2.0);
        let next = square(2, DVec3::X);
        let mut all = square(0, DVec3::ZERO).to_vec();
        all.extend(far.map(|t| Triangle { face: 0, ..t }));
        all.extend(square(1, DVec3::ZERO));
        all.extend(next.map(|t| Triangle { face: 1, ..t }));
        all.extend(square(2, DVec3::ZERO));
        all.extend(square(2, DVec3::Z));
        all.extend(square(Surfel::<f64>::NO_FACE, DVec3::ZERO));
        let walls = walls(&facets(&all));
        assert_eq!(walls.keys().copied().collect::<Vec<_>>(), [1]);
        assert_eq!(walls[&1].corners.len(), 4);
    }

    #[test]
    fn a_wall_hides_what_lies_wholly_behind_it() {
        let walls = walls(&facets(&square(7, DVec3::ZERO)));
        let wall = &walls[&7];
        let above = cube(DVec3::new(0.5, 0.5, 1.0), 0.2);
        let hidden = |at: DVec3, half: f64| {
            let below = cube(at, half);
            let both = [wall.hides([&above, &below], 1e-9), wall.hides([&below, &above], 1e-9)];
            assert_eq!(both[0], both[1]);
            both[0]
        };
        assert!(hidden(DVec3::new(0.5, 0.5, -1.0), 0.2));
        assert!(!hidden(DVec3::new(0.5, 0.5, -1.0), 0.9));
        assert!(!hidden(DVec3::new(1.5, 0.5, -1.0), 0.2));
        assert!(!hidden(DVec3::new(0.5, 0.5, 2.0), 0.2));
        assert!(!hidden(DVec3::new(0.5, 0.5, -0.1), 0.2));
    }
}
