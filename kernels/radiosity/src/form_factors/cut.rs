//! Convex polygons that a plane has cut.

use glam::DVec3;

/// What is closer to a plane than this counts as in it, relative to the distance between the two.
const ON_PLANE: f64 = 1e-12;

/// The most corners that a patch has once a plane has cut it.
const MOST: usize = 5;

/// A convex polygon that a plane may have cut.
pub(crate) struct Cut {
    corners: [DVec3; MOST],
    count: usize,
}

impl Cut {
    /// What of a polygon lies on the side of a plane to which `normal` points (Sutherland and Hodgman,
    /// "Reentrant polygon clipping", CACM 17, 1974).
    pub(crate) fn new(polygon: &[DVec3], origin: DVec3, normal: DVec3) -> Self {
        let far = polygon.iter().map(|corner| corner.distance(origin)).fold(0.0, f64::max);
        let height = |corner: DVec3| {
            let height = normal.dot(corner - origin);
            if height.abs() <= ON_PLANE * far { 0.0 } else { height }
        };
        let mut cut = Self { corners: [DVec3::ZERO; MOST], count: 0 };
        if polygon.iter().all(|&corner| height(corner) <= 0.0) {
            return cut;
        }
        for (a, b) in edges(polygon) {
            let (above, below) = (height(a), height(b));
            if above >= 0.0 {
                cut.push(a);
            }
            if above * below < 0.0 {
                cut.push(a.lerp(b, above / (above - below)));
            }
        }
        cut
    }

    fn push(&mut self, corner: DVec3) {
        if self.count < MOST {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    pub(crate) fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }
}

/// The edges of a polygon.
pub(crate) fn edges(corners: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + Clone {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// The mean of its corners.
pub(crate) fn mean(corners: &[DVec3]) -> DVec3 {
    corners.iter().sum::<DVec3>() / corners.len() as f64
}
