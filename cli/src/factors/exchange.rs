//! How much two surfaces exchange past everything that stands between them.

use farfield::glam::DVec3;
use farfield_radiosity::{Element, Occluders, Patch, Segment};

/// One side of a surface.
#[derive(Clone, Debug)]
pub(crate) struct Side {
    /// Its shape, with its front where it looks.
    pub(crate) patch: Patch,
    /// The face that it lies on.
    pub(crate) face: u32,
}

/// A_1 F_12 = A_2 F_21 of two sides as they see each other, so that either form factor is off by about
/// `tolerance` at most.
///
/// Two pieces between which there is nothing exchange what contour integrals say, however small the tolerance. So do two
/// of which no ray is blocked, and they exchange nothing if all rays are blocked.
/// Others are cut, the larger one in four, until what their rays leave open is too little to count.
pub(crate) fn exchange(sides: [&Side; 2], occluders: &Occluders, tolerance: f64) -> f64 {
    let [a, b] = sides.map(|side| side.patch);
    let whole = a.exchange(&b);
    if is_clear([a, b], sides, occluders) {
        return whole;
    }
    let area = a.area().min(b.area());
    if whole <= NOTHING * tolerance * area {
        return whole * share([&a, &b], sides, occluders, 1, 0);
    }
    // Each piece that is left is off at random: all together by the square root of their number.
    let enough = (tolerance / DOUBT).powi(2) * area * area / whole;
    let limits = Limits { agreed: AGREED * tolerance * area, mixed: enough };
    refine([a, b], whole, sides, occluders, limits, [0, 1])
}

/// Rays between two pieces.
const RAYS: usize = 64;
/// By how much the share of pieces that see part of each other may be off by so many rays.
const DOUBT: f64 = 0.12;
/// What pieces may exchange of which all rays say the same, in units of the tolerance.
const AGREED: f64 = 8.0;
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

fn refine(
    pieces: [Patch; 2],
    whole: f64,
    sides: [&Side; 2],
    occluders: &Occluders,
    limits: Limits,
    [depth, number]: [usize; 2],
) -> f64 {
    if whole <= 0.0 {
        return 0.0;
    }
    let [a, b] = &pieces;
    let share = share([a, b], sides, occluders, RAYS, number);
    let limit = if share == 0.0 || share == 1.0 { limits.agreed } else { limits.mixed };
    if whole <= limit || depth == MOST_CUTS {
        return share * whole;
    }
    if share == 1.0 && is_clear(pieces, sides, occluders) {
        return whole;
    }
    let larger = usize::from(b.area() > a.area());
    let quarters = quarters(&pieces[larger]).into_iter().enumerate();
    let parts = quarters.map(|(k, quarter)| {
        let mut pieces = pieces;
        pieces[larger] = quarter;
        let whole = pieces[0].exchange(&pieces[1]);
        let number = number.wrapping_mul(4).wrapping_add(k);
        refine(pieces, whole, sides, occluders, limits, [depth + 1, number])
    });
    parts.sum()
}

/// Whether certainly nothing stands between two pieces.
fn is_clear(pieces: [Patch; 2], sides: [&Side; 2], occluders: &Occluders) -> bool {
    let element = |k: usize| Element::patch(pieces[k], sides[k].face);
    occluders.are_clear([&element(0), &element(1)])
}

/// The share of what two pieces exchange that is not blocked, by some rays, each counting as much as it carries;
/// 1 if they don't see each other's fronts. Pieces of different numbers have different rays.
fn share(
    pieces: [&Patch; 2],
    sides: [&Side; 2],
    occluders: &Occluders,
    rays: usize,
    number: usize,
) -> f64 {
    let faces = sides.map(|side| side.face);
    let mut weights = [0.0; RAYS];
    let mut segments = [Segment { ends: [DVec3::ZERO; 2], faces }; RAYS];
    let mut count = 0;
    for k in 0..rays.min(RAYS) {
        let [u, v, w, t] = point(k + RAYS * (number % PIECES));
        let ends = [at(pieces[0], u, v), at(pieces[1], w, t)];
        let line = ends[1] - ends[0];
        let cosines = [pieces[0].normal().dot(line), -pieces[1].normal().dot(line)];
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

/// The k-th of a sequence that fills the unit cube of four dimensions evenly (Roberts, "The unreasonable
/// effectiveness of quasirandom sequences", 2018): powers of the root of x⁵ = x + 1.
fn point(k: usize) -> [f64; 4] {
    const STEPS: [f64; 4] = [
        0.856_674_883_854_502_8,
        0.733_891_856_627_125_9,
        0.628_706_721_046_345_8,
        0.538_597_257_223_012_4,
    ];
    STEPS.map(|step| (0.5 + step * (k + 1) as f64).fract())
}

/// Pieces whose rays differ: beyond it numbers of the sequence lose their digits.
const PIECES: usize = 1_000_003;

/// A point of a patch for one of the unit square: evenly on triangles and parallelograms.
fn at(patch: &Patch, u: f64, v: f64) -> DVec3 {
    match *patch.corners() {
        [a, b, c, d] => a.lerp(b, u).lerp(d.lerp(c, u), v),
        [a, b, c] => {
            let along = u.sqrt();
            a + along * (1.0 - v) * (b - a) + along * v * (c - a)
        }
        _ => patch.centroid(),
    }
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
    use farfield_radiosity::Triangle;

    const TOLERANCE: f64 = 1e-4;

    fn side(corners: [[f64; 3]; 4], face: u32) -> Side {
        let patch = Patch::new(&corners.map(DVec3::from_array)).expect("flat");
        Side { patch, face }
    }

    /// Two unit squares that face each other, and what hides a square of this edge half-way in a corner.
    fn pair(edge: f64) -> ([Side; 2], Occluders) {
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
                let found = exchange(sides, &occluders, TOLERANCE);
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
            let found = exchange([&low, &high], &occluders, 1e-14);
            assert!((found - open).abs() < 1e-14, "{found}");
        }
    }

    #[test]
    fn sides_that_look_away_exchange_nothing() {
        let ([low, high], occluders) = pair(0.5);
        let corners: Vec<DVec3> = high.patch.corners().iter().rev().copied().collect();
        let away = Side { patch: Patch::new(&corners).expect("flat"), face: 1 };
        assert_eq!(exchange([&low, &away], &occluders, TOLERANCE), 0.0);
    }

    #[test]
    fn quarters_cover_their_patch() {
        let ([low, _], _) = pair(0.5);
        let triangle = Patch::new(&low.patch.corners()[..3]).expect("flat");
        for patch in [low.patch, triangle] {
            let parts = quarters(&patch);
            let area: f64 = parts.iter().map(Patch::area).sum();
            assert!((area - patch.area()).abs() < 1e-12);
            assert!(parts.iter().all(|part| part.normal().dot(patch.normal()) > 0.999));
        }
    }
}
