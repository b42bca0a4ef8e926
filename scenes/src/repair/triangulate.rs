//! Polygons of any shape in triangles.

use glam::DVec3;

use crate::scene::geometry::vector_area;

/// The triangles of a polygon, as indices of its corners, in its orientation: ears are cut off until
/// three corners are left. The polygon need be neither convex nor flat; it is looked at along its
/// vector area. If it crosses itself the triangles still share its edges, but may overlap.
pub(crate) fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    let normal = vector_area(corners);
    let mut rest: Vec<usize> = (0..corners.len()).collect();
    let mut triangles = Vec::with_capacity(corners.len().saturating_sub(2));
    while rest.len() > 3 {
        let at = |k: usize| {
            let count = rest.len();
            [rest[(k + count - 1) % count], rest[k], rest[(k + 1) % count]]
        };
        // Without an ear, the polygon crosses itself: any corner will do.
        let ear = (0..rest.len()).find(|&k| is_ear(corners, &rest, at(k), normal)).unwrap_or(0);
        triangles.push(at(ear));
        rest.remove(ear);
    }
    triangles.extend(<[usize; 3]>::try_from(rest).ok());
    triangles
}

/// Whether a triangle of neighbouring corners turns the polygon's way and holds no other corner.
fn is_ear(corners: &[DVec3], rest: &[usize], triangle: [usize; 3], normal: DVec3) -> bool {
    let [a, b, c] = triangle.map(|k| corners[k]);
    let turn = |a: DVec3, b: DVec3, c: DVec3| normal.dot((b - a).cross(c - a));
    // A polygon around a hole passes some places twice.
    let mut others = rest.iter().map(|&k| corners[k]).filter(|&p| p != a && p != b && p != c);
    turn(a, b, c) > 0.0
        && !others.any(|p| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0)
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
    fn what_is_no_proper_polygon_does_no_harm() {
        assert!(triangulate(&[]).is_empty());
        assert!(triangulate(&[DVec3::ZERO, DVec3::X]).is_empty());
        assert_eq!(triangulate(&[DVec3::ZERO, DVec3::X, DVec3::Y]), [[0, 1, 2]]);
        let bow = [DVec3::ZERO, DVec3::ONE, DVec3::X, DVec3::Y, DVec3::ZERO];
        assert_eq!(triangulate(&bow).len(), 3);
        assert_eq!(triangulate(&[DVec3::NAN; 5]).len(), 3);
    }
}
