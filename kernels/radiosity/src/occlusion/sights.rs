//! Which share of one element another sees.

use std::borrow::Cow;

use farfield::Real;
use glam::DVec3;

use crate::elements::{Element, Projections, Surfel};
use crate::numbers::mixed;
use crate::occlusion::occluders::Occluders;
use crate::occlusion::shapes::{POINTS, Shape, Shapes};

/// What hides, and the elements that are hidden. Of elements whose shapes are known, rays go from all over one
/// to all over the other; others are their centroids.
#[derive(Clone, Debug)]
pub(crate) struct Sights<'a> {
    pub(crate) occluders: &'a Occluders,
    shapes: Option<Shapes>,
}

/// A segment between two points on these faces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment {
    pub(crate) ends: [DVec3; 2],
    pub(crate) faces: [u32; 2],
}

/// Pairs of which one receives no more of its light from the other have one ray, between points at random:
/// what that is off by is lost among many such pairs. Others have [`POINTS`] rays.
const WEAK: f64 = 1.0 / 4096.0;

impl<'a> Sights<'a> {
    pub(crate) fn of_points(occluders: &'a Occluders) -> Self {
        Self { occluders, shapes: None }
    }

    pub(crate) fn of_elements(occluders: &'a Occluders, elements: &[Element]) -> Self {
        Self { occluders, shapes: Some(Shapes::new(elements)) }
    }

    /// Whether elements are their centroids.
    pub(crate) fn are_points(&self) -> bool {
        self.shapes.is_none()
    }

    /// The shapes of some surfels.
    pub(crate) fn shapes_of<T: Real>(&self, surfels: &[Surfel<T>]) -> Vec<Shape> {
        surfels.iter().map(|surfel| *self.shape_of(surfel)).collect()
    }

    /// The shape of a surfel.
    pub(crate) fn shape_of<T: Real>(&self, surfel: &Surfel<T>) -> Cow<'_, Shape> {
        let known = self.shapes.as_ref().and_then(|shapes| shapes.of(surfel));
        known.map_or_else(|| Cow::Owned(Shape::point(surfel)), Cow::Borrowed)
    }

    /// The share of two surfels that sees the other, by the rays of [`rays`](Self::rays).
    pub(crate) fn share<T: Real>(&self, x: &Surfel<T>, y: &Surfel<T>) -> (f64, usize) {
        let shapes = [self.shape_of(x), self.shape_of(y)];
        let faces = [x.face, y.face];
        let (mut passed, mut all) = (0, 0);
        for ends in rays([&shapes[0], &shapes[1]], is_weak(&Projections::new(x, y))).iter() {
            all += 1;
            passed += usize::from(!self.occluders.blocked(ends[0], ends[1], faces));
        }
        (passed as f64 / all as f64, all)
    }

    /// The share of two elements near each other that sees the other: by more rays where a few disagree.
    pub(crate) fn close_share(&self, [i, j]: [usize; 2], [x, y]: [&Surfel; 2]) -> f64 {
        let shape = |k: usize, surfel: &Surfel| {
            let known = self.shapes.as_ref().and_then(|shapes| shapes.get(k));
            known.copied().unwrap_or_else(|| Shape::point(surfel))
        };
        let [a, b] = [shape(i, x), shape(j, y)];
        let passes =
            |ends: &[DVec3; 2]| !self.occluders.blocked(ends[0], ends[1], [x.face, y.face]);
        let few = rays([&a, &b], false);
        let (all, passed) = (few.len(), few.iter().filter(|ends| passes(ends)).count());
        if passed == 0 || passed == all {
            return f64::from(u8::from(passed > 0));
        }
        let every = a.points.iter().flat_map(|&p| b.points.iter().map(move |&q| [p, q]));
        every.filter(passes).count() as f64 / (POINTS * POINTS) as f64
    }
}

/// Whether two surfels exchange so little that one ray is enough.
pub(crate) fn is_weak<T: Real>(pair: &Projections<T>) -> bool {
    pair.kernel().as_f64() * pair.area.as_f64() <= WEAK
}

/// The ends of the rays between two shapes, the same for both orders but for theirs: from each point of one
/// to another point of the other, or one of those if the pair is `weak`. One between centroids.
pub(crate) fn rays([a, b]: [&Shape; 2], weak: bool) -> Rays {
    if a.number == u32::MAX || b.number == u32::MAX {
        return Rays { ends: [[a.points[0], b.points[0]]; POINTS], count: 1 };
    }
    let in_order = a.number <= b.number;
    let (low, high) = if in_order { (a, b) } else { (b, a) };
    let key = mixed(u64::from(low.number) << 32 | u64::from(high.number)) as usize;
    let [turn, start] = [key % POINTS, key / POINTS % POINTS];
    let ends = std::array::from_fn(|k| {
        let from = (start + k) % POINTS;
        let (p, q) = (low.points[from], high.points[(from + turn) % POINTS]);
        if in_order { [p, q] } else { [q, p] }
    });
    Rays { ends, count: if weak { 1 } else { POINTS } }
}

/// The ends of some rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rays {
    ends: [[DVec3; 2]; POINTS],
    count: usize,
}

impl std::ops::Deref for Rays {
    type Target = [[DVec3; 2]];

    fn deref(&self) -> &Self::Target {
        &self.ends[..self.count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::{Patch, Scene};

    /// Two unit squares at a distance, and a screen half-way that reaches over part of it.
    fn scene(screen: f64) -> Scene {
        let [x, y, z] = DVec3::AXES;
        let mut scene = Scene::new();
        scene.add_quad([DVec3::ZERO, x, x + y, y], 1, 1);
        scene.add_quad([z, z + y, z + x + y, z + x], 1, 1);
        let [middle, far] = [0.5 * z - y * 9.0, 0.5 * z + y * 9.0];
        let [low, high] = [-9.0 * x, x * screen];
        scene.add_quad([middle + low, middle + high, far + high, far + low], 0, 0);
        scene
    }

    #[test]
    fn shares_are_those_of_areas_and_the_same_from_both_ends() {
        let mut error = 0.0;
        for k in 0..=20 {
            let edge = -0.5 + 0.1 * f64::from(k);
            let scene = scene(edge);
            let occluders = Occluders::new(&scene.triangles).unwrap();
            let sights = Sights::of_elements(&occluders, &scene.elements);
            let [x, y] = [&scene.surfels[0], &scene.surfels[1]];
            let share = sights.share(x, y);
            assert_eq!(share, sights.share(y, x));
            assert_eq!(share.1, POINTS);
            let close = sights.close_share([0, 1], [x, y]);
            assert_eq!(close, sights.close_share([1, 0], [y, x]));
            // The middle of a segment between random points of both is below the edge.
            let exact = match edge {
                ..0.0 => 1.0,
                ..0.5 => 1.0 - 2.0 * edge * edge,
                ..1.0 => 2.0 * (1.0 - edge).powi(2),
                _ => 0.0,
            };
            error += (close - exact) / 21.0;
            assert!((close - exact).abs() < 0.4 && (share.0 - exact).abs() < 0.6, "{edge}");
            // Between centroids all is seen or nothing.
            let centroids = Sights::of_points(&occluders);
            let (all, rays) = centroids.share(x, y);
            assert!((all == 0.0 || all == 1.0) && rays == 1);
            assert_eq!(centroids.close_share([0, 1], [x, y]), all);
        }
        assert!(error.abs() < 0.03, "{error}");
    }

    #[test]
    fn elements_are_found_by_their_surfels_and_weak_pairs_have_one_ray() {
        let [x, y, z] = DVec3::AXES;
        let patch = |at: DVec3| Patch::new(&[at, at + x, at + x + y, at + y]).unwrap();
        let elements = [0.0, 1e3].map(|h| Element::patch(patch(z * h), 0));
        let occluders = Occluders::new(&[]).unwrap();
        let sights = Sights::of_elements(&occluders, &elements);
        for (i, element) in elements.iter().enumerate() {
            assert_eq!(sights.shape_of(element.surfel()).number as usize, i);
        }
        let [a, b] = [0, 1].map(|k| *elements[k].surfel());
        let turned = Surfel { normal: -b.normal, ..b };
        assert_eq!(sights.shape_of(&turned).number, u32::MAX);
        assert_eq!(sights.share(&a, &b), (1.0, 1));
    }
}
