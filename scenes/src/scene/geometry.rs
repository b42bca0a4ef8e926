//! Areas and centroids of surfaces, and whether surfaces enclose a volume.

use std::collections::HashMap;

use glam::DVec3;

use crate::scene::surface::Surface;

/// The area of a polygon times its unit normal, which points to where its corners run
/// counter-clockwise; for one that isn't flat, the mean over its surface.
pub(crate) fn vector_area(corners: &[DVec3]) -> DVec3 {
    let Some(&origin) = corners.first() else { return DVec3::ZERO };
    let parts = corners.windows(2).map(|edge| (edge[0] - origin).cross(edge[1] - origin));
    0.5 * parts.sum::<DVec3>()
}

/// The triangles that a convex polygon's first corner spans with the edges that it isn't on.
pub(crate) fn fan(corners: &[DVec3]) -> impl Iterator<Item = [DVec3; 3]> {
    (2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]])
}

/// The regular polygon of an area around a centre, counter-clockwise around its unit normal.
pub(crate) fn regular_polygon<const CORNERS: usize>(
    centre: DVec3,
    normal: DVec3,
    area: f64,
) -> [DVec3; CORNERS] {
    let angle = std::f64::consts::TAU / CORNERS as f64;
    let radius = (area / (0.5 * CORNERS as f64 * angle.sin())).sqrt();
    let (u, v) = normal.any_orthonormal_pair();
    std::array::from_fn(|k| {
        let (sin, cos) = (k as f64 * angle).sin_cos();
        centre + radius * (cos * u + sin * v)
    })
}

/// Whether every edge of surfaces that share their vertices is run through as often one way as the
/// other: then they enclose volumes, without gaps.
pub(crate) fn is_watertight(surfaces: &[Surface]) -> bool {
    let mut balance: HashMap<_, i32> = HashMap::new();
    for surface in surfaces {
        let ends = surface.corners.iter().cycle().skip(1);
        for (&start, &end) in surface.corners.iter().zip(ends) {
            let edge = [start.min(end), start.max(end)];
            *balance.entry(edge).or_default() += if start < end { 1 } else { -1 };
        }
    }
    !surfaces.is_empty() && balance.values().all(|&count| count == 0)
}

#[cfg(test)]
pub(crate) use for_tests::*;

#[cfg(test)]
mod for_tests {
    use super::*;

    /// The centre of area of a surface.
    pub(crate) fn centroid(corners: &[DVec3]) -> DVec3 {
        farfield_radiosity::Patch::new(corners).expect("a valid surface").centroid()
    }

    /// Whether a point of a surface's plane is inside of it.
    pub(crate) fn contains(corners: &[DVec3], point: DVec3) -> bool {
        let normal = vector_area(corners);
        (0..corners.len()).all(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            normal.dot((b - a).cross(point - a)) > 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_of_polygons() {
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        assert_eq!(vector_area(&square), DVec3::Z);
        assert_eq!(vector_area(&square[..3]), 0.5 * DVec3::Z);
    }

    #[test]
    fn polygons_have_their_area_and_are_that_of_their_triangles() {
        let normal = DVec3::new(1.0, 2.0, 2.0) / 3.0;
        let hexagon = regular_polygon::<6>(DVec3::ONE, normal, 2.0);
        let octagon = regular_polygon::<8>(DVec3::ONE, normal, 2.0);
        for (corners, triangles) in [(&hexagon[..], 4), (&octagon[..], 6)] {
            assert!(vector_area(corners).abs_diff_eq(2.0 * normal, 1e-12));
            let centre = corners.iter().sum::<DVec3>() / corners.len() as f64;
            assert!(centre.abs_diff_eq(DVec3::ONE, 1e-12));
            assert_eq!(fan(corners).count(), triangles);
            let sum: DVec3 = fan(corners).map(|triangle| vector_area(&triangle)).sum();
            assert!(sum.abs_diff_eq(2.0 * normal, 1e-12));
        }
    }

    #[test]
    fn a_tetrahedron_is_watertight_until_a_face_is_missing_or_turned() {
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let surface = |face: [u32; 3]| Surface { corners: face.to_vec(), material: 0, face: 0 };
        let mut surfaces = faces.map(surface);
        assert!(is_watertight(&surfaces));
        assert!(!is_watertight(&surfaces[1..]));
        surfaces[0].corners.reverse();
        assert!(!is_watertight(&surfaces));
        assert!(!is_watertight(&[]));
    }
}
