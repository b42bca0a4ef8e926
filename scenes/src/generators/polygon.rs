//! Convex polygons in a plane: what is left of one where others stand on it.

use glam::DVec2;

/// Distances below this part of a polygon's size count as none, so that no slivers of rounding arise.
const TOLERANCE: f64 = 1e-9;

/// The rectangle between two corners, counter-clockwise.
pub(crate) fn rectangle(low: DVec2, high: DVec2) -> Vec<DVec2> {
    vec![low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)]
}

/// The regular polygon with `sides` sides around `centre`, counter-clockwise; its corners are `radius`
/// away, and the middle of its last side lies on the x axis.
pub(crate) fn regular(centre: DVec2, radius: f64, sides: usize) -> Vec<DVec2> {
    let step = std::f64::consts::TAU / sides as f64;
    let corner = |k: usize| centre + radius * DVec2::from_angle((k as f64 + 0.5) * step);
    (0..sides).map(corner).collect()
}

/// The parts of convex, counter-clockwise `pieces` outside of the convex polygon `hole`, which may run
/// either way round: convex, counter-clockwise and without overlap.
pub(crate) fn subtract(pieces: Vec<Vec<DVec2>>, hole: &[DVec2]) -> Vec<Vec<DVec2>> {
    let mut hole = hole.to_vec();
    if area(&hole) < 0.0 {
        hole.reverse();
    }
    pieces.into_iter().flat_map(|piece| outside(piece, &hole)).collect()
}

/// A convex polygon in quadrilaterals, and a triangle if need be.
pub(crate) fn quads(polygon: &[DVec2]) -> Vec<Vec<DVec2>> {
    let Some((&first, rest)) = polygon.split_first() else { return Vec::new() };
    // Neighbouring parts share a corner.
    let starts = (0..rest.len().saturating_sub(1)).step_by(2);
    let part = |k: usize| [&[first], &rest[k..rest.len().min(k + 3)]].concat();
    starts.map(part).collect()
}

/// The area of a polygon, negative if it runs clockwise.
pub(crate) fn area(polygon: &[DVec2]) -> f64 {
    let Some(&origin) = polygon.first() else { return 0.0 };
    let doubled: f64 = edges(polygon).map(|(a, b)| (a - origin).perp_dot(b - origin)).sum();
    0.5 * doubled
}

/// The edges of a polygon.
fn edges(polygon: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> {
    polygon.iter().copied().zip(polygon.iter().copied().cycle().skip(1))
}

/// The parts of a piece outside of a hole, both convex and counter-clockwise.
fn outside(piece: Vec<DVec2>, hole: &[DVec2]) -> Vec<Vec<DVec2>> {
    let mut parts = Vec::new();
    let mut rest = piece.clone();
    for (start, end) in edges(hole) {
        let [inner, outer] = split(&rest, start, end);
        parts.extend(outer);
        match inner {
            Some(inner) => rest = inner,
            // The hole doesn't touch the piece, which need not be cut then.
            None => return vec![piece],
        }
    }
    parts
}

/// What of a convex polygon is left of the line through two points, and what is right of it.
fn split(polygon: &[DVec2], start: DVec2, end: DVec2) -> [Option<Vec<DVec2>>; 2] {
    let along = (end - start).normalize_or_zero();
    let size = polygon.iter().map(|p| p.distance(polygon[0])).fold(0.0, f64::max);
    let height = |p: DVec2| {
        let height = along.perp_dot(p - start);
        if height.abs() > TOLERANCE * size { height } else { 0.0 }
    };
    let [mut left, mut right] = [Vec::new(), Vec::new()];
    for (p, q) in edges(polygon) {
        let (from, to) = (height(p), height(q));
        if from >= 0.0 {
            left.push(p);
        }
        if from <= 0.0 {
            right.push(p);
        }
        if from * to < 0.0 {
            let crossing = p.lerp(q, from / (from - to));
            left.push(crossing);
            right.push(crossing);
        }
    }
    let whole = |part: Vec<DVec2>| (area(&part) > TOLERANCE * size * size).then_some(part);
    [whole(left), whole(right)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_testing::clouds::Random;

    fn unit() -> Vec<DVec2> {
        rectangle(DVec2::ZERO, DVec2::ONE)
    }

    fn total(pieces: &[Vec<DVec2>]) -> f64 {
        pieces.iter().map(|piece| area(piece)).sum()
    }

    /// Whether a point is inside of a convex counter-clockwise polygon, and not on its border.
    fn contains(polygon: &[DVec2], point: DVec2) -> bool {
        edges(polygon).all(|(a, b)| (b - a).perp_dot(point - a) > 1e-9)
    }

    #[test]
    fn a_hole_leaves_the_rest() {
        let mut hole = rectangle(DVec2::splat(0.25), DVec2::splat(0.5));
        for _ in 0..2 {
            let pieces = subtract(vec![unit()], &hole);
            assert_eq!(pieces.len(), 4);
            assert!((total(&pieces) - 15.0 / 16.0).abs() < 1e-14);
            hole.reverse();
        }
    }

    #[test]
    fn what_the_hole_only_touches_stays_whole() {
        for offset in [DVec2::X, DVec2::ONE, DVec2::new(-1.0, 0.5), DVec2::splat(3.0)] {
            let hole: Vec<_> = unit().iter().map(|&p| p + offset).collect();
            assert_eq!(subtract(vec![unit()], &hole), [unit()]);
        }
        assert!(subtract(vec![unit()], &unit()).is_empty());
        let larger = rectangle(DVec2::NEG_ONE, DVec2::splat(2.0));
        assert!(subtract(vec![unit()], &larger).is_empty());
    }

    #[test]
    fn convex_polygons_in_quadrilaterals() {
        for (sides, parts) in [(3, 1), (4, 1), (5, 2), (6, 2), (7, 3), (12, 5)] {
            let polygon = regular(DVec2::new(3.0, -1.0), 2.0, sides);
            let pieces = quads(&polygon);
            assert_eq!(pieces.len(), parts);
            assert!(pieces.iter().all(|piece| [3, 4].contains(&piece.len())));
            assert!((total(&pieces) - area(&polygon)).abs() < 1e-13);
        }
        assert!(quads(&[DVec2::ZERO, DVec2::X]).iter().all(|piece| piece.len() < 3));
    }

    #[test]
    fn pieces_and_hole_fill_the_polygon_without_overlap() {
        for seed in 0..200 {
            let random = &mut Random::new(seed);
            let centre = DVec2::new(random.between(-0.2, 1.2), random.between(-0.2, 1.2));
            let hole = regular(centre, random.between(0.05, 0.6), 3 + random.below(6));
            let pieces = subtract(vec![unit()], &hole);
            let point = DVec2::new(random.unit(), random.unit());
            let near_border = pieces.iter().chain([&hole]).any(|polygon| {
                edges(polygon).any(|(a, b)| (b - a).perp_dot(point - a).abs() < 1e-6)
            });
            let times = pieces.iter().filter(|piece| contains(piece, point)).count();
            assert!(near_border || times == usize::from(!contains(&hole, point)), "{seed}");
        }
    }
}
