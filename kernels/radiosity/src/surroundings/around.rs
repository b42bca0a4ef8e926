//! What all elements of a scene see, and which of them close rooms.

use rayon::prelude::*;

use crate::elements::Element;
use crate::occlusion::Occluders;
use crate::surroundings::seen::{End, Seen, look};
use crate::surroundings::sides::Sides;

/// What elements see by rays: fronts of others, backs, the sky; and which of them are parts of closed rooms.
///
/// Rays need no form factors, so these can be held against them: [`row_error`](Self::row_error).
#[derive(Clone, Debug)]
pub struct Surroundings<'a> {
    pub(super) elements: &'a [Element],
    pub(super) occluders: &'a Occluders,
    pub(super) sides: Sides,
    /// By two sets of rays that know nothing of each other.
    seen: Vec<[Seen; 2]>,
    parts: Vec<Option<u32>>,
}

/// Rays that tell whether an element that has seen nothing but backs sees anything else.
const BURIED_RAYS: usize = 1 << 9;

/// Rays from all elements of a part together that find no way out of it, at least.
const CLOSED_RAYS: usize = 1 << 14;

impl<'a> Surroundings<'a> {
    /// Those of `elements` among `occluders`, by about `rays` rays from each of them.
    ///
    /// Elements that see each other, directly or by way of others, make up a part. It is closed if no ray
    /// from any of its elements ends at a back or in the sky, but for those that see backs alone: they are no
    /// part of it. O(N · rays) steps through the hierarchy of
    /// the occluders.
    pub fn new(elements: &'a [Element], occluders: &'a Occluders, rays: usize) -> Self {
        let sides = Sides::new(elements);
        let look = |i: usize, rays: usize| {
            let mut fronts = Vec::new();
            let seen = [0, 1].map(|set| {
                let half = rays.div_ceil(2).max(1);
                seen_by(&elements[i], &sides, occluders, [half, 2 * i + set], |side| {
                    if !fronts.contains(&side) {
                        fronts.push(side);
                    }
                })
            });
            Look { seen, fronts }
        };
        let mut looks: Vec<Look> =
            (0..elements.len()).into_par_iter().map(|i| look(i, rays)).collect();
        // A gap is found by the rays of all of a part: a part of few elements needs more from each.
        let parts = closed_parts(&sides, &looks);
        let mut sizes = vec![0; parts.iter().flatten().max().map_or(0, |&part| part as usize + 1)];
        parts.iter().flatten().for_each(|&part| sizes[part as usize] += 1);
        looks.par_iter_mut().enumerate().for_each(|(i, found)| {
            if let Some(part) = parts[i] {
                let needed = CLOSED_RAYS.div_ceil(sizes[part as usize]);
                if needed > rays {
                    *found = look(i, needed);
                }
            }
        });
        let parts = closed_parts(&sides, &looks);
        let seen = looks.into_iter().map(|look| look.seen).collect();
        Self { elements, occluders, sides, seen, parts }
    }

    /// The closed part that each element belongs to, numbered from 0; none for elements of parts that lose
    /// light. Fit for [`close_parts`](crate::RadiosityOperator::close_parts).
    pub fn closed_parts(&self) -> &[Option<u32>] {
        &self.parts
    }

    /// What an element sees, by the rays that there were.
    pub fn seen(&self, element: usize) -> Seen {
        let [a, b] = self.seen[element];
        Seen {
            fronts: 0.5 * (a.fronts + b.fronts),
            backs: 0.5 * (a.backs + b.backs),
            sky: 0.5 * (a.sky + b.sky),
        }
    }

    /// Which elements see backs and nothing else: they lie within bodies, or between bodies that touch. What
    /// surfaces there exchange, if form factors are all that is known of them, never gets out, nor
    /// does anything get in. O(N), and 512 rays from each of them.
    pub fn buried(&self) -> Vec<bool> {
        let of = |i: usize| self.seen(i).backs == 1.0 && self.look(i, BURIED_RAYS).backs == 1.0;
        (0..self.elements.len()).into_par_iter().map(of).collect()
    }

    /// What all elements see together, by their areas.
    pub fn mean(&self) -> Seen {
        let (mut mean, mut area) = (Seen::default(), 0.0);
        for (i, element) in self.elements.iter().enumerate() {
            let (own, seen) = (element.surfel().area, self.seen(i));
            mean.fronts += own * seen.fronts;
            mean.backs += own * seen.backs;
            mean.sky += own * seen.sky;
            area += own;
        }
        let share = |sum: f64| if area > 0.0 { sum / area } else { 0.0 };
        Seen { fronts: share(mean.fronts), backs: share(mean.backs), sky: share(mean.sky) }
    }

    /// What an element sees, by so many rays of its own.
    pub fn look(&self, element: usize, rays: usize) -> Seen {
        let Self { elements, occluders, sides, .. } = self;
        let turn = 2 * elements.len() + element;
        seen_by(&elements[element], sides, occluders, [rays.max(1), turn], |_| ())
    }

    /// How far rows of form factors are off, in the root mean square over the area, whatever the cause: the sums of
    /// some of them held against the shares of many rays that end at fronts. 0 if that is less than rays can
    /// tell, which is some 3e-4. About a million rays.
    ///
    /// Two sets of rays from each element err independently, so their errors cancel in the product of both
    /// differences.
    pub fn row_error(&self, row_sums: &[f64]) -> f64 {
        let count = self.elements.len();
        let sampled = count.min(SAMPLED_ROWS);
        let half = SAMPLED_RAYS / (2 * sampled.max(1));
        let square = |k: usize| {
            // Spread evenly, and in step with no grid: multiples of the golden section.
            let i = if sampled == count {
                k
            } else {
                (k as f64 * GOLDEN % 1.0 * count as f64) as usize
            };
            let element = &self.elements[i];
            let [a, b] = [0, 1].map(|set| {
                let turn = 3 * count + 2 * i + set;
                let seen = seen_by(element, &self.sides, self.occluders, [half, turn], |_| ());
                row_sums[i] - seen.fronts
            });
            let own = element.surfel().area;
            (own * a * b, own)
        };
        let squares: Vec<(f64, f64)> = (0..sampled).into_par_iter().map(square).collect();
        let (sum, area) =
            squares.iter().fold((0.0, 0.0), |(sum, area), (s, a)| (sum + s, area + a));
        if area > 0.0 { (sum / area).max(0.0).sqrt() } else { 0.0 }
    }
}

/// Rows that are held against rays, the rays in all, and how far apart the rows are.
const SAMPLED_ROWS: usize = 32;
const SAMPLED_RAYS: usize = 1 << 20;
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// What an element sees by two sets of rays, and which fronts.
struct Look {
    seen: [Seen; 2],
    fronts: Vec<u32>,
}

impl Look {
    fn is_buried(&self) -> bool {
        self.seen.iter().all(|seen| seen.backs == 1.0)
    }
}

/// The closed part of each element, numbered one after the other.
fn closed_parts(sides: &Sides, looks: &[Look]) -> Vec<Option<u32>> {
    let mut groups = Union::new(sides.count());
    for (i, look) in looks.iter().enumerate() {
        look.fronts.iter().for_each(|&front| groups.join(sides.of_element(i), front));
    }
    let mut closed = vec![true; sides.count()];
    for (i, look) in looks.iter().enumerate() {
        let group = groups.root(sides.of_element(i)) as usize;
        let sees_fronts = look.seen.iter().all(|seen| seen.backs == 0.0 && seen.sky == 0.0);
        closed[group] &= sees_fronts || look.is_buried();
    }
    let mut numbers: Vec<Option<u32>> = vec![None; sides.count()];
    let mut count = 0;
    let number = |i: usize| {
        let group = groups.root(sides.of_element(i)) as usize;
        if looks[i].is_buried() {
            return None;
        }
        if closed[group] && numbers[group].is_none() {
            numbers[group] = Some(count);
            count += 1;
        }
        numbers[group]
    };
    (0..looks.len()).map(number).collect()
}

/// What an element sees by so many rays of some turn; `front` is told of every side that it sees.
fn seen_by(
    element: &Element,
    sides: &Sides,
    occluders: &Occluders,
    [rays, turn]: [usize; 2],
    mut front: impl FnMut(u32),
) -> Seen {
    let (mut fronts, mut backs, mut sky) = (0u32, 0u32, 0u32);
    look(element, sides, occluders, [rays, turn], |end| match end {
        End::Front(side) => {
            fronts += 1;
            front(side);
        }
        End::Back => backs += 1,
        End::Sky(_) => sky += 1,
    });
    let [fronts, backs, sky] = [fronts, backs, sky].map(|count| f64::from(count) / rays as f64);
    Seen { fronts, backs, sky }
}

/// Numbers that are joined to groups (Tarjan, "Efficiency of a good but not linear set union algorithm",
/// J. ACM 22, 1975).
struct Union {
    parents: Vec<u32>,
}

impl Union {
    fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect() }
    }

    /// What stands for the group of a number.
    fn root(&mut self, number: u32) -> u32 {
        let mut at = number;
        while self.parents[at as usize] != at {
            let next = self.parents[at as usize];
            self.parents[at as usize] = self.parents[next as usize];
            at = next;
        }
        at
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        // The same whatever the order in which groups are joined.
        self.parents[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::{Scene, furnace, two_rooms};
    use glam::DVec3;

    const RAYS: usize = 2000;

    /// A quadrilateral, its front towards u × v.
    fn quad(origin: DVec3, u: DVec3, v: DVec3) -> [DVec3; 4] {
        [origin, origin + u, origin + u + v, origin + v]
    }

    /// A box seen from outside.
    fn add_body(scene: &mut Scene, low: DVec3, size: DVec3) {
        let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
        for (u, v, w) in [(x, y, z), (y, z, x), (z, x, y)] {
            scene.add_quad(quad(low, v, u), 1, 1);
            scene.add_quad(quad(low + w, u, v), 1, 1);
        }
    }

    fn around<T>(scene: &Scene, test: impl FnOnce(Surroundings<'_>) -> T) -> T {
        let occluders = Occluders::new(&scene.triangles).unwrap();
        test(Surroundings::new(&scene.elements, &occluders, RAYS))
    }

    #[test]
    fn a_floor_sees_past_the_back_of_its_roof() {
        let [x, y, z] = DVec3::AXES;
        for (roof, exact) in [
            (quad(z, x, y), Seen { fronts: 0.0, backs: 0.19982, sky: 0.80018 }),
            (quad(z, y, x), Seen { fronts: 0.19982, backs: 0.0, sky: 0.80018 }),
        ] {
            let mut scene = Scene::new();
            scene.add_quad(quad(DVec3::ZERO, x, y), 1, 1);
            scene.add_quad(roof, 1, 1);
            let seen = around(&scene, |around| [around.seen(0), around.look(0, 4000)]);
            for seen in seen {
                assert!((seen.fronts - exact.fronts).abs() < 5e-3, "{seen:?}");
                assert!((seen.backs - exact.backs).abs() < 5e-3, "{seen:?}");
                assert!((seen.sky - exact.sky).abs() < 5e-3, "{seen:?}");
            }
        }
    }

    #[test]
    fn faces_that_abut_or_rest_on_each_other_see_no_sky_and_sheets_do() {
        // Two bodies that share a face, on a ground.
        let mut scene = Scene::new();
        add_body(&mut scene, DVec3::ZERO, DVec3::ONE);
        add_body(&mut scene, DVec3::X, DVec3::ONE);
        scene.add_quad(quad(DVec3::new(-2.0, -2.0, 0.0), DVec3::X * 6.0, DVec3::Y * 5.0), 1, 1);
        around(&scene, |around| {
            for (i, element) in scene.elements.iter().enumerate().take(12) {
                let surfel = element.surfel();
                let shared = surfel.position.x == 1.0 && surfel.normal.x != 0.0;
                let below = surfel.position.z == 0.0;
                let seen = around.seen(i);
                let buried = Seen { backs: 1.0, ..Seen::default() };
                assert_eq!(seen == buried, shared || below, "{surfel:?} {seen:?}");
                assert!((shared || below) || seen.sky > 0.4);
                assert_eq!(around.buried()[i], shared || below);
            }
        });
        // The two sides of one sheet, turned; the same as two faces back to back, and as one over another.
        let tilt = DVec3::new(0.8, 0.6, 0.0);
        let (front, back) = (quad(DVec3::ZERO, tilt, DVec3::Z), quad(DVec3::ZERO, DVec3::Z, tilt));
        let mut sheet = Scene::new();
        sheet.add_quad(front, 2, 2);
        sheet.add_quad(back, 2, 2);
        let all_sky = Seen { sky: 1.0, ..Seen::default() };
        around(&sheet, |around| assert!((0..8).all(|i| around.seen(i) == all_sky)));
    }

    #[test]
    fn rooms_are_closed_each_by_itself() {
        let rooms = two_rooms(2);
        let parts = around(&rooms, |around| around.closed_parts().to_vec());
        assert_eq!(parts, [vec![Some(0); 24], vec![Some(1); 24]].concat());
        // A body beside a furnace is none, one inside belongs to it.
        let mut scene = furnace(2);
        add_body(&mut scene, DVec3::splat(3.0), DVec3::ONE);
        add_body(&mut scene, DVec3::splat(0.4), DVec3::splat(0.2));
        let parts = around(&scene, |around| around.closed_parts().to_vec());
        assert_eq!(parts, [vec![Some(0); 24], vec![None; 6], vec![Some(0); 6]].concat());
        // A room of which one panel is turned, and one that lacks one.
        let mut turned = furnace(2);
        let open = |scene: &Scene| {
            around(scene, |around| around.closed_parts().iter().all(Option::is_none))
        };
        assert!(!open(&furnace(2)));
        turned.elements.retain(|element| element.surfel().face != 2);
        assert!(open(&turned));
        turned.triangles.retain(|triangle| triangle.face != 2);
        assert!(open(&turned));
    }

    #[test]
    fn walls_of_two_faces_close_to_each_other_are_no_body() {
        // Each with a face for either side: what is between them looks like what is within a thin box.
        let mut scene = furnace(2);
        for at in [0.5, 0.48] {
            let corners = quad(DVec3::X * at, DVec3::Y, DVec3::Z * 0.7);
            let [a, b, c, d] = corners;
            scene.add_quad(corners, 2, 2);
            scene.add_quad([b, a, d, c], 2, 2);
        }
        around(&scene, |around| {
            assert!(around.buried().iter().all(|&buried| !buried));
            assert!(around.closed_parts().iter().all(|&part| part == Some(0)));
        });
    }

    #[test]
    fn a_small_gap_is_found_by_many_rays_from_few_elements() {
        // A lid of the room's size less a hundredth, in six elements that have few rays each.
        let mut scene = furnace(1);
        scene.elements.pop();
        scene.triangles.retain(|triangle| triangle.face != 5);
        let [x, y] = [DVec3::X, DVec3::Y];
        scene.add_quad(quad(DVec3::Z, 0.99 * y, x), 1, 1);
        let occluders = Occluders::new(&scene.triangles).unwrap();
        let around = Surroundings::new(&scene.elements, &occluders, 4);
        assert_eq!(around.closed_parts(), [None; 6]);
        let mean = around.mean();
        assert!((0.0..0.01).contains(&mean.sky) && mean.backs == 0.0, "{mean:?}");
        assert!((mean.fronts + mean.sky - 1.0).abs() < 1e-12);
    }

    #[test]
    fn errors_of_rows_are_told_from_the_noise_of_rays() {
        let [x, y, z] = DVec3::AXES;
        let mut scene = Scene::new();
        scene.add_quad(quad(DVec3::ZERO, x, y), 8, 8);
        scene.add_quad(quad(z, y, x), 8, 8);
        let occluders = Occluders::new(&scene.triangles).unwrap();
        let around = Surroundings::new(&scene.elements, &occluders, 64);
        let exact = |i: usize| -> f64 {
            let patch = scene.elements[i].as_patch().unwrap();
            let others = scene.elements.iter().filter_map(|e| e.as_patch());
            others.map(|other| patch.form_factor(other)).sum()
        };
        let rows: Vec<f64> = (0..128).map(exact).collect();
        assert!(around.row_error(&rows) < 6e-3, "{}", around.row_error(&rows));
        for error in [0.02, -0.1] {
            let off: Vec<f64> = rows.iter().map(|row| row + error).collect();
            let found = around.row_error(&off);
            assert!((0.7..1.4).contains(&(found / error.abs())), "{found}");
        }
    }
}
