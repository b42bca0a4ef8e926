//! Flat patches.

use glam::DVec3;

use crate::error::Error;

/// A flat convex piece of surface with three or four corners.
///
/// Form factors between patches are those of their whole areas, not of their centroids: touching
/// patches, where the centroid rule never converges, are as exact as distant ones. Visibility is not
/// looked at.
///
/// ```
/// use farfield_radiosity::Patch;
/// use glam::DVec3;
///
/// let [x, y, z] = DVec3::AXES;
/// let floor = Patch::new(&[DVec3::ZERO, x, x + y, y])?;
/// let wall = Patch::new(&[DVec3::ZERO, y, y + z, z])?;
/// // Two walls of a cube (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", C-14).
/// assert!((floor.form_factor(&wall) - 0.200_043_776_075_403).abs() < 1e-12);
/// # Ok::<(), farfield_radiosity::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    corners: [DVec3; 4],
    count: usize,
    normal: DVec3,
    area: f64,
}

/// How far a corner may lie off the plane of the others, relative to the patch.
const FLATNESS: f64 = 1e-6;

impl Patch {
    /// The patch with these corners, counter-clockwise around its front.
    ///
    /// # Errors
    /// [`Error::InvalidPatch`] unless there are three or four of them, all finite, of a convex polygon
    /// that has an area and is flat to a millionth of its size. A quadrilateral that isn't flat is two
    /// triangles.
    pub fn new(corners: &[DVec3]) -> Result<Self, Error> {
        let invalid = |expected| {
            let corners = corners.iter().map(DVec3::to_array).collect();
            Err(Error::InvalidPatch { corners, expected })
        };
        let &[a, b, c, ..] = corners else { return invalid("three or four corners") };
        if corners.len() > 4 {
            return invalid("three or four corners");
        }
        if !corners.iter().all(|corner| corner.is_finite()) {
            return invalid("finite coordinates");
        }
        let d = corners.get(3).copied().unwrap_or(c);
        // The vector area of a quadrilateral is half the product of its diagonals.
        let vector_area = 0.5 * (c - a).cross(if corners.len() == 3 { c - b } else { d - b });
        let size = corners.iter().map(|&corner| corner.distance(a)).fold(0.0, f64::max);
        let Some(normal) = vector_area.try_normalize() else { return invalid("an area") };
        let area = vector_area.length();
        if area <= f64::EPSILON * size * size {
            return invalid("an area");
        }
        if corners.iter().any(|&corner| normal.dot(corner - a).abs() > FLATNESS * size) {
            return invalid("corners in one plane");
        }
        let count = corners.len();
        let turn = |k: usize| {
            let [p, q, r] = [0, 1, 2].map(|next| corners[(k + next) % count]);
            normal.dot((q - p).cross(r - q))
        };
        if (0..count).any(|k| turn(k) < -FLATNESS * size * size) {
            return invalid("corners of a convex polygon, one after the other");
        }
        Ok(Self { corners: [a, b, c, d], count, normal, area })
    }

    /// Its corners, counter-clockwise around its front.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Unit normal on the side that radiates and receives.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }

    /// Its area.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// A point of it for each point of the unit square, such that equal areas of the square go to equal areas
    /// of the patch.
    pub(crate) fn point_at(&self, [u, v]: [f64; 2]) -> DVec3 {
        let [a, b, c, d] = self.corners;
        if self.count == 4 && (a - b + c - d).length_squared() <= FLATNESS * self.area {
            return a + (b - a) * u + (d - a) * v;
        }
        // Its triangles side by side, each of which has one corner as an edge of the square.
        let share = 0.5 * self.normal.dot((b - a).cross(c - a)) / self.area;
        let (u, [b, c]) = if u < share || self.count == 3 {
            (u / share, [b, c])
        } else {
            ((u - share) / (1.0 - share), [c, d])
        };
        let along = u.clamp(0.0, 1.0).sqrt();
        a + (b - a).lerp(c - a, v) * along
    }

    /// Where a ray from `origin` along `direction` meets its front.
    pub(crate) fn met_by(&self, origin: DVec3, direction: DVec3) -> Option<DVec3> {
        let towards = -self.normal.dot(direction);
        let height = self.normal.dot(origin - self.corners[0]);
        if !(towards > 0.0 && height > 0.0) {
            return None;
        }
        let point = origin + direction * (height / towards);
        let corners = self.corners();
        let within = |k: usize| {
            let (a, b) = (corners[k], corners[(k + 1) % self.count]);
            self.normal.dot((b - a).cross(point - a)) >= 0.0
        };
        (0..self.count).all(within).then_some(point)
    }

    /// Its centre of area.
    pub fn centroid(&self) -> DVec3 {
        let [a, b, c, d] = self.corners;
        let part = |b: DVec3, c: DVec3| {
            let twice = self.normal.dot((b - a).cross(c - a));
            (twice * (b - a + c - a) / 3.0, twice)
        };
        // The second triangle of a triangular patch has no area.
        let [(first, first_area), (second, second_area)] = [part(b, c), part(c, d)];
        a + (first + second) / (first_area + second_area)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: DVec3 = DVec3::X;
    const Y: DVec3 = DVec3::Y;
    const Z: DVec3 = DVec3::Z;

    #[test]
    fn points_of_the_square_fill_a_patch_evenly() {
        let shapes: [&[DVec3]; 3] = [
            &[DVec3::ZERO, X, 0.2 * X + Y],
            &[DVec3::ZERO, X, 1.4 * X + Y, 0.4 * X + Y],
            &[DVec3::ZERO, 1.5 * X, X + 0.8 * Y, Y],
        ];
        for corners in shapes {
            let patch = Patch::new(corners).unwrap();
            // So that no strip is part of two triangles.
            let n = 220;
            let at = |k: usize| [k % n, k / n].map(|k| (k as f64 + 0.5) / n as f64);
            let points: Vec<DVec3> = (0..n * n).map(|k| patch.point_at(at(k))).collect();
            let mean = points.iter().sum::<DVec3>() / (n * n) as f64;
            assert!(mean.distance(patch.centroid()) < 1e-4, "{mean}");
            let squares = points.iter().map(|p| p.length_squared()).sum::<f64>() / (n * n) as f64;
            // The second moment of a triangle is that of the middles of its edges.
            let [a, b, c, d] = patch.corners;
            let moment = |[p, q, r]: [DVec3; 3]| {
                let middles = [p + q, q + r, r + p].map(|sum| 0.25 * sum.length_squared());
                let area = 0.5 * (q - p).cross(r - p).length();
                (middles.iter().sum::<f64>() / 3.0 * area, area)
            };
            let parts = [moment([a, b, c]), moment([a, c, d])];
            let exact = (parts[0].0 + parts[1].0) / (parts[0].1 + parts[1].1);
            assert!((squares / exact - 1.0).abs() < 1e-3, "{squares} {exact}");
        }
    }

    #[test]
    fn rays_meet_the_front_of_a_patch_and_nothing_else() {
        for corners in [&[DVec3::ZERO, X, X + Y, Y][..], &[DVec3::ZERO, X, Y]] {
            let patch = Patch::new(corners).unwrap();
            let (above, inside) = (DVec3::new(0.3, 0.9, 2.0), DVec3::new(0.25, 0.5, 0.0));
            assert!(patch.met_by(above, inside - above).unwrap().distance(inside) < 1e-15);
            assert_eq!(patch.met_by(above, above - inside), None, "the other way");
            assert_eq!(patch.met_by(-above, inside + above), None, "from behind");
            assert_eq!(patch.met_by(above, X), None, "along it");
            for outside in [-0.1 * X, -0.1 * Y, X + Y + 0.1 * X] {
                assert_eq!(patch.met_by(above, outside - above), None, "{outside}");
            }
        }
    }

    #[test]
    fn corners_that_are_no_patch_are_refused() {
        let expected = |corners: &[DVec3]| match Patch::new(corners) {
            Err(Error::InvalidPatch { expected, .. }) => expected,
            other => panic!("{other:?}"),
        };
        assert_eq!(expected(&[X, Y]), "three or four corners");
        assert_eq!(expected(&[X, Y, Z, DVec3::ONE, DVec3::ZERO]), "three or four corners");
        assert_eq!(expected(&[X, Y, DVec3::NAN]), "finite coordinates");
        assert_eq!(expected(&[X, 2.0 * X, 3.0 * X]), "an area");
        assert_eq!(expected(&[X, X, X]), "an area");
        assert_eq!(expected(&[DVec3::ZERO, X, X + Y + 0.1 * Z, Y]), "corners in one plane");
        let dart = [DVec3::ZERO, X, 0.2 * (X + Y), Y];
        assert_eq!(expected(&dart), "corners of a convex polygon, one after the other");
        let bow = [DVec3::ZERO, X, 0.5 * X + Y, 0.6 * X - 0.1 * Y];
        assert_eq!(expected(&bow), "corners of a convex polygon, one after the other");
    }
}
