//! Polygons of any shape in triangles.

use earcut::Earcut;
use glam::DVec3;

use crate::scene::geometry::vector_area;

/// The triangles of a polygon, as indices of its corners, in its orientation, the smallest index first.
/// The polygon need be neither convex nor flat; it is looked at along the axis that its vector area is
/// closest to. If it crosses itself the triangles still share its edges, but may overlap.
pub(crate) fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    if corners.len() < 3 {
        return Vec::new();
    }
    let whole = vector_area(corners);
    // Coordinates stay as they are, so that corners on a line stay there.
    let axis = whole.abs().max_position();
    let place = |p: &DVec3| [p[(axis + 1) % 3], p[(axis + 2) % 3]];
    let mut indices: Vec<u32> = Vec::new();
    Earcut::new().earcut(corners.iter().map(place), &[], &mut indices);
    let (triangles, _) = indices.as_chunks::<3>();
    let mut triangles: Vec<_> = triangles.iter().map(|t| t.map(|k| k as usize)).collect();
    let area = |t: &[usize; 3]| vector_area(&t.map(|k| corners[k])).dot(whole);
    if triangles.iter().map(area).sum::<f64>() < 0.0 {
        triangles.iter_mut().for_each(|triangle| triangle.reverse());
    }
    for triangle in &mut triangles {
        let first = (0..3).min_by_key(|&k| triangle[k]).unwrap_or(0);
        triangle.rotate_left(first);
    }
    let covered: f64 = triangles.iter().map(area).map(f64::abs).sum();
    let expected = whole.length_squared();
    let is_whole = (covered - expected).abs() <= NOTHING * expected;
    if is_whole && !leaves_out(corners, &triangles, NOTHING * whole.length()) {
        triangles
    } else {
        // It crosses itself, or has no area.
        (2..corners.len()).map(|k| [0, k - 1, k]).collect()
    }
}

/// Areas below this part of a polygon's area count as none.
const NOTHING: f64 = 1e-6;

/// Whether a corner that belongs to no triangle is off the line between its neighbours.
fn leaves_out(corners: &[DVec3], triangles: &[[usize; 3]], nothing: f64) -> bool {
    let mut used = vec![false; corners.len()];
    triangles.iter().flatten().for_each(|&k| used[k] = true);
    let last = corners.len() - 1;
    let is_off = |k: usize| {
        let before = if k > 0 { k - 1 } else { last };
        let after = if k < last { k + 1 } else { 0 };
        vector_area(&[corners[before], corners[k], corners[after]]).length() > nothing
    };
    (0..corners.len()).any(|k| !used[k] && is_off(k))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn areas(corners: &[DVec3]) -> Vec<DVec3> {
        let triangles = triangulate(corners);
        triangles.iter().map(|t| vector_area(&t.map(|k| corners[k]))).collect()
    }

    #[test]
    fn a_polygon_that_is_not_convex_is_covered_once() {
        // An arrowhead, and a U.
        let arrow = [[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]];
        let cup = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.0, 2.0],
        ];
        // A square around a square hole, entered and left along one line.
        let ring = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 3.0],
            [0.0, 3.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
        ];
        for (polygon, area) in [(&arrow[..], 0.5), (&cup[..], 5.0), (&ring[..], 8.0)] {
            let corners: Vec<_> = polygon.iter().map(|&[x, y]| DVec3::new(x, y, 0.3)).collect();
            let areas = areas(&corners);
            assert_eq!(areas.len(), corners.len() - 2);
            assert!(areas.iter().all(|a| a.z > 0.0));
            assert!((areas.iter().map(|a| a.z).sum::<f64>() - area).abs() < 1e-14);
        }
    }

    #[test]
    fn spirals_and_zigzags_of_twenty_thousand_corners_are_covered_once() {
        let half = 10_000;
        let spiral = |k: usize, width: f64| {
            let turns = 20.0 * k as f64 / half as f64;
            let (sin, cos) = (std::f64::consts::TAU * turns).sin_cos();
            (1.0 + turns + width) * DVec3::new(cos, sin, 0.1 * cos)
        };
        let zigzag = |k: usize, width: f64| {
            let (x, y) = (k as f64, 100.0 * (k % 2) as f64 + width);
            DVec3::new(x, y, x - 2.0 * y)
        };
        let band = |edge: &dyn Fn(usize, f64) -> DVec3, inner: f64, outer: f64| -> Vec<DVec3> {
            let there = (0..half).map(|k| edge(k, outer));
            there.chain((0..half).rev().map(|k| edge(k, inner))).collect()
        };
        for corners in [band(&spiral, 0.0, 0.4), band(&zigzag, 0.5, 0.0)] {
            let areas = areas(&corners);
            let whole = vector_area(&corners);
            assert!(areas.len() > corners.len() - 10 && areas.len() <= corners.len() - 2);
            assert!(areas.iter().all(|area| area.dot(whole) > 0.0));
            let sum: f64 = areas.iter().map(|area| area.dot(whole) / whole.length()).sum();
            assert!((sum / whole.length() - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn what_is_no_proper_polygon_does_no_harm() {
        assert!(triangulate(&[]).is_empty());
        assert!(triangulate(&[DVec3::ZERO, DVec3::X]).is_empty());
        assert_eq!(triangulate(&[DVec3::ZERO, DVec3::X, DVec3::Y]), [[0, 1, 2]]);
        let bow = [DVec3::ZERO, DVec3::ONE, DVec3::X, DVec3::Y, DVec3::ZERO];
        assert_eq!(triangulate(&bow).len(), 3);
        assert_eq!(triangulate(&[DVec3::NAN; 5]).len(), 3);
    }

    #[test]
    fn a_comb_of_twenty_thousand_corners_is_covered_once() {
        // 9,999 teeth on a bar, turned out of the plane of z = 0: minutes for what takes n³ steps.
        let teeth = 9_999;
        let valley = |k: usize| 0.3 * (0.7 * k as f64).sin();
        let tooth = |k: usize| [[(2 * k + 1) as f64, valley(k)], [(2 * k) as f64, 1.0]];
        let bar = [[-1.0, -1.0], [2.0 * teeth as f64, -1.0]];
        let outline = bar.into_iter().chain((0..teeth).rev().flat_map(tooth));
        let corners: Vec<_> = outline.map(|[x, y]| DVec3::new(x, y, y - x)).collect();
        assert_eq!(corners.len(), 20_000);
        let areas = areas(&corners);
        assert_eq!(areas.len(), corners.len() - 2);
        let whole = vector_area(&corners);
        assert!(areas.iter().all(|area| area.dot(whole) > 0.0));
        let sum: f64 = areas.iter().map(|area| area.length()).sum();
        assert!((sum / whole.length() - 1.0).abs() < 1e-9);
    }
}
