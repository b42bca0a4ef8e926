//! How much two elements exchange past everything that stands between them.

use glam::DVec3;

use crate::elements::{Element, Patch};
use crate::form_factors::exchange_area;
use crate::numbers::in_cube;
use crate::occlusion::{Occluders, Segment};

/// A_i F_ij of two elements past all that hides them from each other, in squared scene units, so that either
/// form factor is off by about `tolerance` at most. Elements need not be small: whole walls may be asked for.
///
/// Two pieces between which there is nothing exchange what contour integrals say, however small the tolerance. So do two
/// of which no ray is blocked, and they exchange nothing if all rays are blocked.
/// Others are cut, the larger one in four, until what their rays leave open is too little to count.
/// A disk isn't cut: it exchanges the share of [`exchange_area`] that 64 rays leave.
///
/// Some 64 rays through the hierarchy of the occluders for each piece: the fewer, the less of a shadow's edge there is.
pub fn visible_exchange_area(
    a: &Element,
    b: &Element,
    occluders: &Occluders,
    tolerance: f64,
) -> f64 {
    let whole = exchange_area(a, b);
    if occluders.are_clear([a, b]) {
        return whole;
    }
    let (Some(&p), Some(&q)) = (a.as_patch(), b.as_patch()) else {
        return whole * share([a, b], occluders, RAYS, 0);
    };
    let area = p.area().min(q.area());
    if whole <= NOTHING * tolerance * area {
        return whole * share([a, b], occluders, 1, 0);
    }
    // Each piece that is left is off at random: all together by the square root of their number.
    let mixed = (tolerance / DOUBT).powi(2) * area * area / whole;
    let limits = Limits { agreed: AGREED * tolerance * area, mixed };
    let faces = [a, b].map(|element| element.surfel().face);
    Cutting { faces, occluders, limits }.exchange([p, q], whole, [0, 1])
}

/// Rays between two pieces.
const RAYS: usize = 64;
/// By how much the share of pieces that see part of each other may be off by so many rays.
const DOUBT: f64 = 0.12;
/// What pieces may exchange of which all rays say the same, in units of the tolerance.
const AGREED: f64 = 8.0;
/// How often as many rays have to say the same before it is believed.
const CONFIRMING: usize = 16;
/// What exchanges less, in units of the tolerance, is not cut.
const NOTHING: f64 = 1e-2;
/// How often pieces are cut at most.
const MOST_CUTS: usize = 24;

/// Up to which exchange pieces are left as they are: if all their rays say the same, and if not.
#[derive(Clone, Copy)]
struct Limits {
    agreed: f64,
    mixed: f64,
}

/// Two patches that are cut where their rays leave open what they exchange.
struct Cutting<'a> {
    faces: [u32; 2],
    occluders: &'a Occluders,
    limits: Limits,
}

impl Cutting<'_> {
    /// What two pieces exchange, which is `whole` if nothing hides them.
    fn exchange(&self, pieces: [Patch; 2], whole: f64, [depth, number]: [usize; 2]) -> f64 {
        if whole <= 0.0 {
            return 0.0;
        }
        let [a, b] = [0, 1].map(|k| Element::patch(pieces[k], self.faces[k]));
        let share = share([&a, &b], self.occluders, RAYS, number);
        if whole <= self.limits.mixed || depth == MOST_CUTS {
            return share * whole;
        }
        let agree = share == 0.0 || share == 1.0;
        // What lets little pass, or hides little, is left as it is only if no other ray says so either.
        let confirmed = |k: usize| {
            let number = number.wrapping_mul(CONFIRMING).wrapping_add(k);
            self::share([&a, &b], self.occluders, RAYS, !number) == share
        };
        if agree && whole <= self.limits.agreed && (0..CONFIRMING).all(confirmed) {
            return share * whole;
        }
        if share == 1.0 && self.occluders.are_clear([&a, &b]) {
            return whole;
        }
        let larger = usize::from(pieces[1].area() > pieces[0].area());
        let quarters = quarters(&pieces[larger]).into_iter().enumerate();
        let parts = quarters.map(|(k, quarter)| {
            let mut pieces = pieces;
            pieces[larger] = quarter;
            let whole = pieces[0].exchange(&pieces[1]);
            let number = number.wrapping_mul(4).wrapping_add(k);
            self.exchange(pieces, whole, [depth + 1, number])
        });
        parts.sum()
    }
}

/// The share of what two elements exchange that is not blocked, by some rays, each counting as much as it carries;
/// 1 if they don't see each other's fronts. Pieces of different numbers have different rays.
fn share(elements: [&Element; 2], occluders: &Occluders, rays: usize, number: usize) -> f64 {
    let surfels = elements.map(|element| element.surfel());
    let faces = surfels.map(|surfel| surfel.face);
    let mut weights = [0.0; RAYS];
    let mut segments = [Segment { ends: [DVec3::ZERO; 2], faces }; RAYS];
    let mut count = 0;
    for k in 0..rays.min(RAYS) {
        let [u, v, w, t] = in_cube(k, number as u64);
        let ends = [elements[0].point_at([u, v]), elements[1].point_at([w, t])];
        let line = ends[1] - ends[0];
        let cosines = [surfels[0].normal.dot(line), -surfels[1].normal.dot(line)];
        if cosines.iter().all(|&cosine| cosine > 0.0) {
            weights[count] = cosines[0] * cosines[1] / line.length_squared().powi(2);
            segments[count].ends = ends;
            count += 1;
        }
    }
    let (mut passed, mut all) = (0.0, 0.0);
    occluders.blocked_each(&segments[..count], |k, blocked| {
        all += weights[k];
        passed += if blocked { 0.0 } else { weights[k] };
    });
    if all > 0.0 { passed / all } else { 1.0 }
}

/// The four pieces of a patch between its corners, the middles of its edges, and its own middle.
fn quarters(patch: &Patch) -> [Patch; 4] {
    let middle = |a: DVec3, b: DVec3| a.midpoint(b);
    let pieces: [Vec<DVec3>; 4] = match *patch.corners() {
        [a, b, c, d] => {
            let [ab, bc, cd, da] = [middle(a, b), middle(b, c), middle(c, d), middle(d, a)];
            let m = middle(ab, cd);
            [vec![a, ab, m, da], vec![ab, b, bc, m], vec![m, bc, c, cd], vec![da, m, cd, d]]
        }
        [a, b, c] => {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [vec![a, ab, ca], vec![ab, b, bc], vec![ca, bc, c], vec![ab, bc, ca]]
        }
        _ => return [*patch; 4],
    };
    // A piece of a flat convex patch is one.
    pieces.map(|corners| Patch::new(&corners).unwrap_or(*patch))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::{Surfel, Triangle};

    const TOLERANCE: f64 = 1e-4;

    fn side(corners: [[f64; 3]; 4], face: u32) -> Element {
        let patch = Patch::new(&corners.map(DVec3::from_array)).expect("flat");
        Element::patch(patch, face)
    }

    /// Two unit squares that face each other, and what hides a square of this edge half-way in a corner.
    fn pair(edge: f64) -> ([Element; 2], Occluders) {
        let low = side([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]], 0);
        let high = side([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 0.0, 1.0]], 1);
        let corner = |x: f64, y: f64| DVec3::new(edge * x, edge * y, 0.5);
        let [a, b, c, d] = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        let blocker = [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face: 2 });
        ([low, high], Occluders::new(&blocker).expect("finite"))
    }

    #[test]
    fn a_blocker_in_a_corner_hides_a_quarter_of_what_squares_exchange() {
        let open = 0.199_824_895_698_387;
        for (edge, expected) in [(1e-9, open), (0.5, 0.75 * open), (1.0, 0.0)] {
            let ([low, high], occluders) = pair(edge);
            for sides in [[&low, &high], [&high, &low]] {
                let found = visible_exchange_area(sides[0], sides[1], &occluders, TOLERANCE);
                assert!((found - expected).abs() < TOLERANCE, "{edge}: {found} {expected}");
            }
        }
    }

    #[test]
    fn what_nothing_hides_is_exact_whatever_the_tolerance() {
        let open = 0.199_824_895_698_387_38;
        let ([low, high], _) = pair(0.5);
        // Out of the way.
        let beside = [[1.2, 0.0, 0.5], [1.3, 0.0, 0.5], [1.2, 1.0, 0.5]].map(DVec3::from_array);
        let beside = [Triangle { vertices: beside, face: 2 }];
        for triangles in [&beside[..0], &beside] {
            let occluders = Occluders::new(triangles).expect("finite");
            let found = visible_exchange_area(&low, &high, &occluders, 1e-14);
            assert!((found - open).abs() < 1e-14, "{found}");
        }
    }

    #[test]
    fn sides_that_look_away_exchange_nothing() {
        let ([low, high], occluders) = pair(0.5);
        let mut corners = high.as_patch().expect("a patch").corners().to_vec();
        corners.reverse();
        let away = Element::patch(Patch::new(&corners).expect("flat"), 1);
        assert_eq!(visible_exchange_area(&low, &away, &occluders, TOLERANCE), 0.0);
    }

    #[test]
    fn quarters_cover_their_patch() {
        let ([low, _], _) = pair(0.5);
        let square = *low.as_patch().expect("a patch");
        let triangle = Patch::new(&square.corners()[..3]).expect("flat");
        for patch in [square, triangle] {
            let parts = quarters(&patch);
            let area: f64 = parts.iter().map(Patch::area).sum();
            assert!((area - patch.area()).abs() < 1e-12);
            assert!(parts.iter().all(|part| part.normal().dot(patch.normal()) > 0.999));
        }
    }

    #[test]
    fn what_hides_a_disk_hides_its_share() {
        let ([low, high], occluders) = pair(1.0);
        let disk = |element: &Element| Element::disk(Surfel { area: 0.01, ..*element.surfel() });
        let (clear, high) = (Occluders::new(&[]).expect("none"), disk(&high));
        let open = visible_exchange_area(&low, &high, &clear, TOLERANCE);
        assert_eq!(open, exchange_area(&low, &high));
        assert!(open > 0.0);
        assert_eq!(visible_exchange_area(&low, &high, &occluders, TOLERANCE), 0.0);
        let (_, corner) = pair(0.5);
        let part = visible_exchange_area(&low, &high, &corner, TOLERANCE) / open;
        assert!((part - 0.75).abs() < 0.15, "{part}");
    }

    #[test]
    fn narrow_slits_let_pass_what_they_do_and_narrow_bars_hide_it() {
        // Ten slits of 2 mm, of which a million random pairs of points see 4.01e-3, and what they leave.
        let ([low, high], _) = pair(1.0);
        let strip = |from: f64, to: f64| {
            let corner = |x: f64, y: f64| DVec3::new(x, y, 0.5);
            let [a, b, c, d] =
                [corner(from, 0.0), corner(to, 0.0), corner(to, 1.0), corner(from, 1.0)];
            [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face: 2 })
        };
        let slit = |k: usize| (0.049 + 0.1 * k as f64, 0.051 + 0.1 * k as f64);
        let bars: Vec<Triangle> = (0..10).flat_map(|k| strip(slit(k).0, slit(k).1)).collect();
        let edges = (0..10).flat_map(|k| [slit(k).0, slit(k).1]);
        let edges: Vec<f64> = std::iter::once(0.0).chain(edges).chain([1.0]).collect();
        let plate: Vec<Triangle> =
            edges.chunks(2).flat_map(|edges| strip(edges[0], edges[1])).collect();
        for (triangles, expected) in [(plate, 4.010e-3), (bars, 0.195_826)] {
            let occluders = Occluders::new(&triangles).expect("finite");
            let found = visible_exchange_area(&low, &high, &occluders, 1e-3);
            assert!((found - expected).abs() < 3e-4, "{found} {expected}");
        }
    }
}
