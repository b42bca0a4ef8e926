//! The facing mask: which cells lie wholly in front of each other.

use farfield::{CellView, Coverage, Mask, Numbers, Real, Vector};

use crate::elements::{Projections, Surfel, closest};
use crate::expansion::Irradiance;
use crate::occlusion::Bounds;

/// The mask without occlusion: a pair counts if the two surfels [face each
/// other](Projections::facing). It gives the clamped [`Irradiance`] a fast sum.
///
/// Cells are first judged by the extents of their bounding boxes along the normals, then, where
/// that leaves doubt and the cells are small, pair by pair: exactly.
#[derive(Clone, Copy, Debug, Default)]
pub struct Facing;

impl<T: Real, C: Numbers<Real = T>> Mask<Irradiance<T, C>> for Facing {
    fn cells(
        &self,
        targets: CellView<'_, Surfel<T>>,
        sources: CellView<'_, Surfel<T>>,
    ) -> Coverage {
        facing(targets.points, sources.points)
    }

    fn pair(&self, x: &Surfel<T>, y: &Surfel<T>) -> f64 {
        f64::from(Projections::new(x, y).facing())
    }
}

/// Cell pairs with at most so many pairs of points are judged exactly where their boxes leave doubt.
const EXACT_PAIRS: usize = 4096;

/// Whether all, none or some of the pairs between two groups face each other.
pub(crate) fn facing<T: Real>(targets: &[Surfel<T>], sources: &[Surfel<T>]) -> Coverage {
    by_bounds(targets, sources).unwrap_or_else(|| {
        if targets.len() * sources.len() <= EXACT_PAIRS {
            by_pairs(targets, sources)
        } else {
            Coverage::Partial
        }
    })
}

/// [`facing`] by the extents of the two bounding boxes; nothing where they leave doubt.
fn by_bounds<T: Real>(targets: &[Surfel<T>], sources: &[Surfel<T>]) -> Option<Coverage> {
    let target_bounds = Bounds::of(targets.iter().map(|x| x.position.to_array()));
    let source_bounds = Bounds::of(sources.iter().map(|y| y.position.to_array()));
    // No pair is further apart than the diagonal: a projection beyond √ε of it has a cosine beyond
    // √ε. The factor 2 covers the rounding of the diagonal itself.
    let diagonal = target_bounds.union(&source_bounds).diagonal();
    let grazing = T::from_f64(2.0) * T::epsilon().sqrt() * diagonal;
    // What is further from a plane than this is no closer to the surfels on it.
    let margin = grazing.max(closest(targets)).max(closest(sources));
    let targets_are = Side::of(&target_bounds, sources, margin);
    let sources_are = Side::of(&source_bounds, targets, margin);
    match (targets_are, sources_are) {
        (Side::Behind, _) | (_, Side::Behind) => Some(Coverage::Empty),
        (Side::InFront, Side::InFront) => Some(Coverage::Full),
        _ => None,
    }
}

/// [`facing`] by asking every pair, up to the first two that disagree.
fn by_pairs<T: Real>(targets: &[Surfel<T>], sources: &[Surfel<T>]) -> Coverage {
    let mut verdicts =
        targets.iter().flat_map(|x| sources.iter().map(move |y| Projections::new(x, y).facing()));
    let Some(first) = verdicts.next() else { return Coverage::Empty };
    match (first, verdicts.all(|verdict| verdict == first)) {
        (true, true) => Coverage::Full,
        (false, true) => Coverage::Empty,
        (_, false) => Coverage::Partial,
    }
}

/// On which side of the planes of some surfels a box lies.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    /// In front of every plane, by more than the margin.
    InFront,
    /// Behind or on every plane.
    Behind,
    /// Neither is certain.
    Both,
}

impl Side {
    /// The side of `region` with respect to the planes of `surfels`, by the region's support along
    /// their normals.
    fn of<T: Real>(region: &Bounds<T>, surfels: &[Surfel<T>], margin: T) -> Self {
        let zero = T::from_f64(0.0);
        let (mut in_front, mut behind) = (true, true);
        for surfel in surfels {
            let (low, high) =
                region.extent_along(surfel.normal.to_array(), surfel.position.to_array());
            in_front &= low > margin;
            behind &= high <= zero;
            if !in_front && !behind {
                return Self::Both;
            }
        }
        if in_front { Self::InFront } else { Self::Behind }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_testing::clouds::Random;
    use glam::DVec3;

    fn grid(origin: DVec3, u: DVec3, v: DVec3, n: usize) -> Vec<Surfel> {
        let normal = u.cross(v).normalize();
        let at = |i: usize, j: usize| {
            origin + u * ((i as f64 + 0.5) / n as f64) + v * ((j as f64 + 0.5) / n as f64)
        };
        (0..n * n)
            .map(|k| Surfel { position: at(k / n, k % n), normal, area: 1.0, face: 0 })
            .collect()
    }

    #[test]
    fn parallel_squares_face_perpendicular_ones_too_and_backs_never() {
        let floor = grid(DVec3::ZERO, DVec3::X, DVec3::Y, 4);
        let ceiling = grid(DVec3::Z, DVec3::Y, DVec3::X, 4);
        let wall = grid(DVec3::ZERO, DVec3::Y, DVec3::Z, 4);
        let roof = grid(DVec3::Z, DVec3::X, DVec3::Y, 4);
        assert_eq!(facing(&floor, &ceiling), Coverage::Full);
        assert_eq!(facing(&floor, &wall), Coverage::Full);
        assert_eq!(facing(&floor, &roof), Coverage::Empty);
        assert_eq!(facing(&floor, &floor), Coverage::Empty);
        let both = [floor.clone(), ceiling.clone()].concat();
        assert_eq!(facing(&both, &ceiling), Coverage::Partial);
    }

    #[test]
    fn oblique_planes_are_decided_although_their_boxes_overlap() {
        let tilt = |p: DVec3| {
            glam::DQuat::from_rotation_z(0.5).mul_quat(glam::DQuat::from_rotation_x(0.7)) * p
        };
        let floor = grid(DVec3::ZERO, tilt(DVec3::X), tilt(DVec3::Y), 5);
        let wall = grid(DVec3::ZERO, tilt(DVec3::Y), tilt(DVec3::Z), 5);
        assert_eq!(facing(&floor, &wall), Coverage::Full);
        assert_eq!(facing(&floor, &floor), Coverage::Empty);
    }

    /// Surfels of a small cluster whose normals scatter around one direction.
    fn cluster(random: &mut Random) -> Vec<Surfel<f32>> {
        let offset = |random: &mut Random| (2.0 * random.in_cube() - 1.0).as_vec3();
        let (centre, axis) = (2.0 * offset(random), offset(random));
        let spread = random.between(0.0, 1.5) as f32;
        let surfel = |random: &mut Random| {
            let position = centre + 0.5 * offset(random);
            let normal = axis + spread * offset(random);
            let normal = normal.try_normalize().unwrap_or(glam::Vec3::Z);
            Surfel { position, normal, area: 1.0, face: 0 }
        };
        (0..1 + random.below(7)).map(|_| surfel(random)).collect()
    }

    #[test]
    fn verdicts_on_cells_agree_with_the_pairs() {
        for seed in 0..256 {
            let random = &mut Random::new(seed);
            let (t, s) = (cluster(random), cluster(random));
            let exact = by_pairs(&t, &s);
            assert_eq!(facing(&t, &s), exact, "{seed}");
            // The bounds alone must never contradict the pairs, only know less.
            let bounds = by_bounds(&t, &s);
            assert!(bounds.is_none() || bounds == Some(exact), "{seed}");
        }
    }
}
