//! Areas and centroids of surfaces, and whether surfaces enclose a volume.

use std::collections::HashMap;

use glam::DVec3;

use crate::scene::Surface;

/// The area of a polygon times its unit normal, which points to where its corners run
/// counter-clockwise; for one that isn't flat, the mean over its surface.
pub(crate) fn vector_area(corners: &[DVec3]) -> DVec3 {
    let Some(&origin) = corners.first() else { return DVec3::ZERO };
    let parts = corners.windows(2).map(|edge| (edge[0] - origin).cross(edge[1] - origin));
    0.5 * parts.sum::<DVec3>()
}

/// The area of a surface.
pub(crate) fn area(surface: &Surface) -> f64 {
    vector_area(&surface.corners).length()
}

/// Whether every edge of the surfaces is run through as often one way as the other: then they enclose
/// volumes, without gaps.
pub(crate) fn is_watertight(surfaces: &[Surface]) -> bool {
    // Adding zero turns −0 into 0.
    let key = |p: DVec3| (p + DVec3::ZERO).to_array().map(f64::to_bits);
    let mut balance: HashMap<_, i32> = HashMap::new();
    for surface in surfaces {
        let ends = surface.corners.iter().cycle().skip(1);
        for (&start, &end) in surface.corners.iter().zip(ends) {
            let (a, b) = (key(start), key(end));
            let edge = if a < b { (a, b) } else { (b, a) };
            *balance.entry(edge).or_default() += if a < b { 1 } else { -1 };
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
    pub(crate) fn centroid(surface: &Surface) -> DVec3 {
        let patch = farfield_radiosity::Patch::new(&surface.corners);
        patch.expect("a valid surface").centroid()
    }

    /// Whether a point of a surface's plane is inside of it.
    pub(crate) fn contains(surface: &Surface, point: DVec3) -> bool {
        let corners = &surface.corners;
        let normal = vector_area(corners);
        (0..corners.len()).all(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            normal.dot((b - a).cross(point - a)) > 0.0
        })
    }

    /// The volume that closed surfaces enclose, negative if they look inwards.
    pub(crate) fn volume(surfaces: &[Surface]) -> f64 {
        surfaces.iter().map(|s| vector_area(&s.corners).dot(s.corners[0]) / 3.0).sum()
    }

    /// The sum of all vector areas: zero for closed surfaces.
    pub(crate) fn open_area(surfaces: &[Surface]) -> DVec3 {
        surfaces.iter().map(|s| vector_area(&s.corners)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(corners: &[DVec3]) -> Surface {
        Surface { corners: corners.to_vec(), material: 0, face: 0 }
    }

    #[test]
    fn areas_of_polygons() {
        let square = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        assert_eq!(vector_area(&square), DVec3::Z);
        assert_eq!(vector_area(&square[..3]), 0.5 * DVec3::Z);
        assert_eq!(area(&surface(&square)), 1.0);
    }

    #[test]
    fn a_tetrahedron_is_watertight_until_a_face_is_missing_or_turned() {
        let p = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let mut surfaces: Vec<_> =
            faces.iter().map(|face| surface(&face.map(|k: usize| p[k]))).collect();
        assert!(is_watertight(&surfaces));
        assert!((volume(&surfaces) - 1.0 / 6.0).abs() < 1e-15);
        assert!(open_area(&surfaces).length() < 1e-15);
        assert!(!is_watertight(&surfaces[1..]));
        surfaces[0].corners.reverse();
        assert!(!is_watertight(&surfaces));
        assert!(!is_watertight(&[]));
    }
}
