//! The root cube of clouds of which a few points are far from all others.

use crate::error::Error;
use crate::numbers::traits::{Located, Point, Real, Vector};
use crate::octree::bounds::Bounds;
use crate::octree::geometry::Cube;

/// The root cube of sources and targets within `bounds`. Where most of them lie together and the others make
/// the bounds much larger, the root cube of those that lie together is a cell: whatever is far away, they are
/// divided as they are alone. O(N), and O(1) for all other clouds. With a `unit`, cells have that half-width times
/// powers of two.
pub(crate) fn root_cube<S: Located, X: Located<Real = S::Real>>(
    bounds: &Bounds<S::Real>,
    sources: &[S],
    targets: &[X],
    unit: Option<S::Real>,
) -> Result<Cube<S::Real>, Error> {
    let root = bounds.root_cube(unit)?;
    let Some(most) = Most::new(sources, targets) else { return Ok(root) };
    let reach = REACH * most.distance;
    if reach == 0.0 || root.half_width().as_f64() <= ALONE * reach {
        return Ok(root);
    }
    let near = |p: Point<S::Real>| most.distance_to(p.to_array().map(Real::as_f64)) <= reach;
    let together = Bounds::of(sources, &near).join(Bounds::of(targets, &near)).root_cube(unit)?;
    Ok(bounds.root_cube_around(&together).unwrap_or(root))
}

/// Points that are looked at to find where most are.
const SAMPLE: usize = 512;

/// Which share of the points is most of them.
const MOST: f64 = 7.0 / 8.0;

/// Up to how many times their distance from the middle other points lie together with most.
const REACH: f64 = 4.0;

/// How many times as large the root has to be.
const ALONE: f64 = (1u64 << 12) as f64;

/// Where most of the points are.
struct Most {
    middle: [f64; 3],
    /// How far from the middle they are along an axis.
    distance: f64,
}

impl Most {
    /// Of a sample of both sets; none if they are empty.
    fn new<S: Located, X: Located<Real = S::Real>>(sources: &[S], targets: &[X]) -> Option<Self> {
        let mut sample = some(sources);
        sample.extend(some(targets));
        let last = sample.len().checked_sub(1)?;
        let middle = [0, 1, 2].map(|axis| {
            let ascending = |a: &[f64; 3], b: &[f64; 3]| a[axis].total_cmp(&b[axis]);
            sample.select_nth_unstable_by(last / 2, ascending).1[axis]
        });
        let mut most = Self { middle, distance: 0.0 };
        let mut distances: Vec<f64> = sample.into_iter().map(|p| most.distance_to(p)).collect();
        let place = (MOST * last as f64) as usize;
        most.distance = *distances.select_nth_unstable_by(place, f64::total_cmp).1;
        Some(most)
    }

    /// How far a point is from the middle along an axis.
    fn distance_to(&self, p: [f64; 3]) -> f64 {
        (0..3).map(|axis| (p[axis] - self.middle[axis]).abs()).fold(0.0, f64::max)
    }
}

/// The places of some points, spread over all of them.
fn some<P: Located>(points: &[P]) -> Vec<[f64; 3]> {
    let step = points.len().div_ceil(SAMPLE).max(1);
    points.iter().step_by(step).map(|p| p.position().to_array().map(Real::as_f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::PointSet;
    use crate::octree::geometry::Cell;
    use crate::octree::tree::Tree;
    use crate::parallel::watch::Watch;
    use glam::DVec3;

    fn bounds(points: &[DVec3]) -> Bounds<f64> {
        Bounds::new(PointSet::Sources, points).unwrap()
    }

    fn cloud(n: u32) -> Vec<DVec3> {
        let steps = DVec3::new(0.754_877, 0.569_840, 0.362_719);
        (1..=n).map(|i| (steps * f64::from(i)).fract() + DVec3::new(3.0, -7.0, 0.1)).collect()
    }

    #[test]
    fn clouds_without_escapers_keep_their_root() {
        let mut halo = cloud(1000);
        halo.extend(cloud(300).iter().map(|p| *p * 1e9));
        let mut near = cloud(1000);
        near.push(DVec3::splat(1e3));
        for points in [cloud(1000), halo, near, vec![DVec3::ONE; 9], vec![], cloud(2)] {
            let bounds = bounds(&points);
            let root = root_cube(&bounds, &points, &points, None).unwrap();
            assert_eq!(root, bounds.root_cube(None).unwrap());
        }
    }

    #[test]
    fn a_cloud_is_divided_as_if_nothing_were_far_away() {
        let points = cloud(3000);
        let alone = bounds(&points).root_cube(None).unwrap();
        let cells = Tree::new(&alone, &points, 10, &Watch::default()).unwrap().cells.len();
        for extents in [1e5, 1e9, 1e13] {
            for away in [DVec3::new(0.7, 0.9, 0.3), DVec3::new(-0.7, 0.1, -1.0), -DVec3::Y] {
                let mut all = points.clone();
                all.extend([away * extents, -0.3 * away * extents]);
                let bounds = bounds(&all);
                let root = root_cube(&bounds, &all, &[] as &[DVec3], None).unwrap();
                // The same, whichever set has the escapers.
                assert_eq!(root, root_cube(&bounds, &points, &all, None).unwrap());
                let levels = (root.half_width() / alone.half_width()).log2();
                assert!(levels.fract() == 0.0 && levels <= extents.log2().ceil() + 2.0);
                let inside =
                    |p: &DVec3| (*p - root.centre()).abs().max_element() <= root.half_width();
                assert!(all.iter().all(inside));
                let last = (1u64 << (levels as u64 - 1)) - 1;
                let cell = Cell::new(&root, levels as usize, [last; 3]);
                assert_eq!(cell.half_width(), alone.half_width());
                assert!((cell.centre() - alone.centre()).abs().max_element() < 1e-14);
                let tree = Tree::new(&root, &all, 10, &Watch::default()).unwrap();
                assert!(tree.cells.len() < cells + 4 * levels as usize, "{}", tree.cells.len());
            }
        }
    }
}
