//! Quadrilaterals in pieces that are flat and convex.

use farfield_radiosity::Patch;
use glam::DVec3;

use crate::repair::triangulate::triangulate;
use crate::scene::geometry::vector_area;

/// The furthest that a corner may lie off the mean plane, relative to the polygon, for what it is meant
/// to be to be clear: coordinates that were rounded.
const MOST_BENT: f64 = 0.05;

/// A polygon as it is if it is flat and convex; otherwise the triangles that cover it, if it is nearly flat
/// and doesn't cross itself; otherwise as it is, for a check to refuse.
pub(crate) fn flat_pieces(corners: &[DVec3]) -> Vec<Vec<DVec3>> {
    let whole = vec![corners.to_vec()];
    if Patch::new(corners).is_ok() || !corners.iter().all(|corner| corner.is_finite()) {
        return whole;
    }
    let area = vector_area(corners);
    let normal = area.normalize_or_zero();
    let centre = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
    let size = corners.iter().map(|p| p.distance(centre)).fold(0.0, f64::max);
    if corners.iter().any(|&p| normal.dot(p - centre).abs() > MOST_BENT * size) {
        return whole;
    }
    let triangles: Vec<_> =
        triangulate(corners).iter().map(|t| t.map(|k| corners[k]).to_vec()).collect();
    let fits = |triangle: &Vec<DVec3>| {
        Patch::new(triangle).is_ok() && vector_area(triangle).dot(normal) > 0.0
    };
    if !triangles.is_empty() && triangles.iter().all(fits) { triangles } else { whole }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pieces(fourth: [f64; 3]) -> Vec<Vec<DVec3>> {
        let corners = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 3.0, 0.0], fourth];
        flat_pieces(&corners.map(DVec3::from_array))
    }

    #[test]
    fn what_is_nearly_flat_or_not_convex_becomes_two_triangles() {
        assert_eq!(pieces([0.0, 3.0, 0.0]).len(), 1);
        for fourth in [[0.0, 3.0, 0.001], [0.0, 3.0, -0.2], [3.0, 1.0, 0.0], [3.0, 1.0, 1e-3]] {
            let pieces = pieces(fourth);
            assert_eq!(pieces.len(), 2, "{fourth:?}");
            let area: f64 = pieces.iter().map(|piece| vector_area(piece).z).sum();
            let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [fourth[0], fourth[1]]];
            let expected = vector_area(&corners.map(|[x, y]| DVec3::new(x, y, 0.0))).z;
            assert!((area - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn what_is_far_from_flat_crosses_itself_or_is_no_polygon_stays() {
        for fourth in [[0.0, 3.0, 1.5], [2.0, -1.0, 0.0], [f64::NAN, 3.0, 0.0], [4.0, 3.0, 0.0]] {
            assert_eq!(pieces(fourth).len(), 1, "{fourth:?}");
        }
        assert_eq!(flat_pieces(&[]), [Vec::<DVec3>::new()]);
    }
}
