//! Which share of one element another sees.

use std::borrow::Cow;

use farfield::Real;
use glam::DVec3;

use crate::elements::{Element, Projections, Surfel};
use crate::numbers::{in_cube, mixed};
use crate::occlusion::occluders::Occluders;
use crate::occlusion::shapes::{Shape, Shapes};

/// What hides, and the elements that are hidden. Of elements whose shapes are known, rays go from all over one
/// to all over the other; others are their centroids.
#[derive(Clone, Debug)]
pub(crate) struct Sights<'a> {
    pub(crate) occluders: &'a Occluders,
    shapes: Option<Shapes>,
}

/// A segment between two points.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// The points.
    pub ends: [DVec3; 2],
    /// The faces on which they lie, which hide nothing from them; [`NO_FACE`](Surfel::NO_FACE) is none.
    pub faces: [u32; 2],
}

/// Pairs of which one receives no more of its light from the other have one ray, between points at random:
/// what that is off by is lost among many such pairs. Others have [`POINTS`] rays.
const WEAK: f64 = 1.0 / 4096.0;

/// Rays between two elements, as many as quarters.
const POINTS: usize = 4;

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

    /// The share of what two elements near each other exchange that is unhidden: by many rays, each counting
    /// as much as it carries, where a few disagree; of elements that `touch`, and of others that give one of
    /// the two more than a [`STRONG`] share of its light, also where a few agree.
    pub(crate) fn close_share(
        &self,
        numbers: [usize; 2],
        elements: [&Element; 2],
        touch: bool,
    ) -> f64 {
        let [x, y] = elements.map(Element::surfel);
        let passes = |[p, q]: [DVec3; 2]| !self.occluders.blocked(p, q, [x.face, y.face]);
        let shape = |k: usize| {
            let known = self.shapes.as_ref().and_then(|shapes| shapes.get(numbers[k]));
            known.copied().unwrap_or_else(|| Shape::point(elements[k].surfel()))
        };
        let few = rays([&shape(0), &shape(1)], false);
        let (all, passed) = (few.len(), few.iter().filter(|&&ends| passes(ends)).count());
        let agree = passed == 0 || passed == all;
        let pair = Projections::new(x, y);
        let strong = touch || pair.kernel() * pair.area > STRONG;
        if self.are_points() || (agree && !strong) {
            return f64::from(u8::from(passed > 0));
        }
        // From the smaller to the larger of the two, whichever way they are given.
        let order = |k: usize| (elements[k].surfel().area, numbers[k]);
        let [a, b] = if order(0) <= order(1) { [0, 1] } else { [1, 0] };
        let turn = mixed((numbers[a] as u64) << 32 | numbers[b] as u64);
        let mut tally = Tally { agree, ..Tally::default() };
        if let Some(patch) = elements[b].as_patch().filter(|_| touch) {
            // What goes from one to the other of two that touch is mostly what is next to where they do. Rays
            // that leave by the cosine law carry the same each.
            for ray in 0..COSINE_RAYS {
                let [u, v, r, angle] = in_cube(ray, turn);
                let from = elements[a].point_at([u, v]);
                let direction = about(elements[a].surfel().normal, [r, angle]);
                if let Some(to) = patch.met_by(from, direction)
                    && tally.is_settled(1.0, passes([from, to]))
                {
                    break;
                }
            }
            if let Some(share) = tally.share() {
                return share;
            }
        }
        for ray in 0..CLOSE_RAYS {
            let [u, v, w, t] = in_cube(ray, turn);
            let ends = [elements[a].point_at([u, v]), elements[b].point_at([w, t])];
            let d = ends[1] - ends[0];
            let cosines = [a, b].map(|k| elements[k].surfel().normal.dot(d));
            let weight = cosines[0].max(0.0) * (-cosines[1]).max(0.0) / d.length_squared().powi(2);
            if weight > 0.0 && tally.is_settled(weight, passes(ends)) {
                break;
            }
        }
        tally.share().unwrap_or(1.0)
    }
}

/// What some rays between two elements have carried.
#[derive(Default)]
struct Tally {
    /// Whether all say the same that were asked before.
    agree: bool,
    carried: f64,
    sum: f64,
    count: usize,
}

impl Tally {
    /// Counts a ray that carries so much if it `passes`; whether there are enough of them.
    fn is_settled(&mut self, weight: f64, passes: bool) -> bool {
        self.sum += weight;
        self.carried += if passes { weight } else { 0.0 };
        self.count += 1;
        let same = self.agree && (self.carried == self.sum || self.carried == 0.0);
        self.count >= if same { FEW_RAYS } else { CLOSE_RAYS }
    }

    /// The share that has passed, if there was any ray.
    fn share(&self) -> Option<f64> {
        (self.sum > 0.0).then(|| self.carried / self.sum)
    }
}

/// A direction about a normal by the cosine law, for each point of the unit square.
pub(crate) fn about(normal: DVec3, [r, angle]: [f64; 2]) -> DVec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let (sin, cos) = (std::f64::consts::TAU * angle).sin_cos();
    (x * cos + y * sin) * r.sqrt() + normal * (1.0 - r).sqrt()
}

/// Rays between two elements near each other that see part of each other, and rays that tell whether they do
/// where the elements touch or exchange much.
const CLOSE_RAYS: usize = 64;
const FEW_RAYS: usize = 16;

/// Rays from an element at most, of which some arrive at one that touches it.
const COSINE_RAYS: usize = 1024;

/// Elements of which one gives the other a larger share of its light have more than a few rays in any case.
const STRONG: f64 = 1.0 / 32.0;

/// Whether two surfels exchange so little that one ray is enough.
pub(crate) fn is_weak<T: Real>(pair: &Projections<T>) -> bool {
    pair.kernel().as_f64() * pair.area.as_f64() <= WEAK
}

/// The ends of the rays between two shapes, the same for both orders but for theirs: from each quarter of one
/// to another quarter of the other, as far as these face each other, or one of them if the pair is `weak`. One
/// between their middles if none does, and between points.
///
/// Where in the quarters they end is up to each pair. If all rays to an element ended at the same few points
/// of it, an edge close to one of these would hide it from all others, and what that is off by would add up.
pub(crate) fn rays([a, b]: [&Shape; 2], weak: bool) -> Rays {
    let in_order = a.number <= b.number;
    let (low, high) = if in_order { (a, b) } else { (b, a) };
    // That between centroids stays, if there is no other.
    let mut rays = Rays { ends: [[a.centroid(), b.centroid()]; POINTS], count: 0 };
    if high.number == u32::MAX {
        rays.count = 1;
        return rays;
    }
    let key = mixed(u64::from(low.number) << 32 | u64::from(high.number));
    let [turn, start] = [key as usize % POINTS, key as usize / POINTS % POINTS];
    let most = if weak { 1 } else { POINTS };
    for k in 0..POINTS {
        let bits = mixed(key ^ k as u64);
        let [u, v, w, t] = [0, 16, 32, 48].map(|shift| f64::from((bits >> shift) as u16) * UNIT);
        let from = (start + k) % POINTS;
        let p = low.point_of_quarter(from, [u, v]);
        let q = high.point_of_quarter((from + turn) % POINTS, [w, t]);
        // What is below a horizon is not hidden: the kernel leaves it out.
        if low.normal().dot(q - p) > 0.0 && high.normal().dot(p - q) > 0.0 {
            rays.ends[rays.count] = if in_order { [p, q] } else { [q, p] };
            rays.count += 1;
            if rays.count == most {
                break;
            }
        }
    }
    rays.count = rays.count.max(1);
    rays
}

/// Sixteen bits after the point.
const UNIT: f64 = 1.0 / 65536.0;

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
    use crate::exchange_area;

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
            let [a, b] = [&scene.elements[0], &scene.elements[1]];
            let [x, y] = [a.surfel(), b.surfel()];
            let share = sights.share(x, y);
            assert_eq!(share, sights.share(y, x));
            assert_eq!(share.1, POINTS);
            let close = sights.close_share([0, 1], [a, b], true);
            assert_eq!(close, sights.close_share([1, 0], [b, a], true));
            // The middle of a segment between random points of both is below the edge.
            let exact = match edge {
                ..0.0 => 1.0,
                ..0.5 => 1.0 - 2.0 * edge * edge,
                ..1.0 => 2.0 * (1.0 - edge).powi(2),
                _ => 0.0,
            };
            error += (close - exact) / 21.0;
            assert!((close - exact).abs() < 0.2, "{edge}: {close} {exact}");
            // Between centroids all is seen or nothing.
            let centroids = Sights::of_points(&occluders);
            let (all, rays) = centroids.share(x, y);
            assert!((all == 0.0 || all == 1.0) && rays == 1);
            assert_eq!(centroids.close_share([0, 1], [a, b], true), all);
        }
        assert!(error.abs() < 0.03, "{error}");
    }

    #[test]
    fn what_hides_a_part_of_an_element_hides_no_more_of_it_from_all_others_together() {
        // A shelf over an eighth of a floor, close to it, and a ceiling far above in many pieces.
        let [x, y, z] = DVec3::AXES;
        let mut scene = Scene::new();
        scene.add_quad([DVec3::ZERO, x, x + y, y], 1, 1);
        scene.add_quad([z, z + y, z + x + y, z + x].map(|c| c + 9.0 * z), 20, 20);
        let [low, high] = [-x - y, 0.125 * x - y].map(|c| c + 1e-3 * z);
        scene.add_quad([low, high, high + 3.0 * y, low + 3.0 * y], 0, 0);
        let occluders = Occluders::new(&scene.triangles).unwrap();
        let sights = Sights::of_elements(&occluders, &scene.elements);
        let [floor, ceiling @ ..] = &scene.elements[..] else { panic!() };
        let share = |piece: &Element| sights.share(floor.surfel(), piece.surfel()).0;
        let mean = ceiling.iter().map(share).sum::<f64>() / ceiling.len() as f64;
        assert!((mean - 0.875).abs() < 0.02, "{mean}");
    }

    #[test]
    fn what_elements_that_cross_exchange_next_to_each_other_is_not_lost() {
        // A floor and a wall through each other, and a screen across the corner between them; with another one
        // along its bisector nothing is seen but what is within the first.
        let [x, y, z] = DVec3::AXES;
        let strip = |along: DVec3, [low, high]: [f64; 2], turn: bool| {
            let corners = [along * low, along * high, along * high + y, along * low + y];
            let [a, b, c, d] = corners;
            Element::patch(Patch::new(&if turn { [d, c, b, a] } else { corners }).unwrap(), 9)
        };
        let exchange =
            |parts: [f64; 2]| exchange_area(&strip(x, parts, false), &strip(z, parts, true));
        let mut errors = [0.0; 2];
        for k in 1..=10 {
            let at = 0.06 * f64::from(k);
            for (both, error) in errors.iter_mut().enumerate() {
                let mut scene = Scene::new();
                scene.add_quad([-0.5 * x, x, x + y, y - 0.5 * x], 1, 1);
                scene.add_quad([y - 0.5 * z, y + z, z, -0.5 * z], 1, 1);
                let across = [at * x - y, at * z - y];
                scene.add_quad(
                    [across[0], across[1], across[1] + 3.0 * y, across[0] + 3.0 * y],
                    0,
                    0,
                );
                if both > 0 {
                    let from = 0.5 * at * (x + z) - y;
                    let to = 2.0 * (x + z) - y;
                    scene.add_quad([from, to, to + 3.0 * y, from + 3.0 * y], 0, 0);
                }
                let occluders = Occluders::new(&scene.triangles).unwrap();
                let sights = Sights::of_elements(&occluders, &scene.elements);
                let [a, b] = [&scene.elements[0], &scene.elements[1]];
                let found = sights.close_share([0, 1], [a, b], true);
                assert_eq!(found, sights.close_share([1, 0], [b, a], true));
                let within = exchange([0.0, at]);
                let beyond = if both > 0 { 0.0 } else { exchange([at, 1.0]) };
                let exact = (within + beyond) / exchange([0.0, 1.0]);
                assert!((found - exact).abs() < 0.15, "{at} {both}: {found} {exact}");
                *error += 0.1 * (found - exact);
            }
        }
        assert!(errors.iter().all(|error| error.abs() < 0.03), "{errors:?}");
    }

    #[test]
    fn what_is_below_a_horizon_is_not_hidden() {
        // A floor that reaches under the wall that stands on it, and a block behind that.
        let [x, y, z] = DVec3::AXES;
        let mut scene = Scene::new();
        scene.add_quad([-x, x, x + y, y - x], 1, 1);
        scene.add_quad([DVec3::ZERO, y, y + z, z], 1, 1);
        scene.add_quad([-0.1 * x, y - 0.1 * x, y + z - 0.1 * x, z - 0.1 * x], 0, 0);
        let occluders = Occluders::new(&scene.triangles).unwrap();
        let sights = Sights::of_elements(&occluders, &scene.elements);
        let [a, b] = [&scene.elements[0], &scene.elements[1]];
        assert_eq!(sights.share(a.surfel(), b.surfel()).0, 1.0);
        assert_eq!(sights.close_share([0, 1], [a, b], true), 1.0);
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
