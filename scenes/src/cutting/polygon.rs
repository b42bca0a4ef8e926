//! Flat convex polygons, and which of them come close to each other.

use glam::DVec3;

use crate::scene::geometry::vector_area;

/// Lengths that count as nothing, relative to a surface: as flat as surfaces have to be.
const SLACK: f64 = 1e-6;

/// A surface that others would cut into more pieces is left whole: what meets it is a mesh, whose facets
/// are smaller than elements are.
const MOST_PIECES: usize = 32;

/// A flat convex polygon.
#[derive(Clone, Debug)]
pub(crate) struct Polygon {
    /// Counter-clockwise around its front.
    pub(crate) corners: Vec<DVec3>,
    /// Of unit length, or zero if it has no area.
    pub(crate) normal: DVec3,
    /// What counts as nothing.
    slack: f64,
    low: DVec3,
    high: DVec3,
}

impl Polygon {
    /// The polygon of these corners.
    pub(crate) fn new(corners: Vec<DVec3>) -> Self {
        let normal = vector_area(&corners).normalize_or_zero();
        let low = corners.iter().fold(DVec3::INFINITY, |low, &c| low.min(c));
        let high = corners.iter().fold(DVec3::NEG_INFINITY, |high, &c| high.max(c));
        let slack = SLACK * (high - low).length();
        Self { corners, normal, slack, low, high }
    }

    /// Where the plane of this polygon meets another, if that is a line that divides this one.
    pub(crate) fn met_by(&self, other: &Self) -> Option<[DVec3; 2]> {
        let height = |p: DVec3| {
            let height = self.normal.dot(p - self.corners[0]);
            if height.abs() <= self.slack { 0.0 } else { height }
        };
        let mut ends: Vec<DVec3> = Vec::new();
        for (a, b) in other.edges() {
            let (from, to) = (height(a), height(b));
            if from == 0.0 {
                ends.push(a);
            } else if from * to < 0.0 {
                ends.push(a.lerp(b, from / (from - to)));
            }
        }
        // A polygon of the same plane meets it everywhere, one that stands on a corner nowhere.
        let [a, b] = ends[..] else { return None };
        self.divided_by([a, b]).then_some([a, b])
    }

    /// Its pieces when it is cut along segments, each on from end to end of the pieces that it divides;
    /// none if there would be too many.
    pub(crate) fn cut_along(&self, segments: &[[DVec3; 2]]) -> Option<Vec<Self>> {
        let mut pieces = vec![self.clone()];
        for &[a, b] in segments {
            let across = self.normal.cross(b - a).normalize_or_zero();
            let halves = |piece: Self| {
                if !piece.divided_by([a, b]) {
                    return vec![piece];
                }
                [across, -across].map(|side| piece.part(a, side)).to_vec()
            };
            pieces = pieces.into_iter().flat_map(halves).collect();
            if pieces.len() > MOST_PIECES {
                return None;
            }
        }
        Some(pieces)
    }

    /// It in pieces of three or four corners.
    pub(crate) fn quadrilaterals(&self) -> Vec<Vec<DVec3>> {
        let (mut rest, mut pieces) = (self.corners.clone(), Vec::new());
        while rest.len() > 4 {
            pieces.push(rest[..4].to_vec());
            rest.drain(1..3);
        }
        pieces.push(rest);
        pieces
    }

    /// What of it and of another polygon of its plane lies upon each other: an area.
    pub(crate) fn common_area(&self, other: &Self) -> f64 {
        // Without slack, which may be wider than what is thin.
        let mut rest = Self { slack: 0.0, ..other.clone() };
        for (a, b) in self.edges() {
            rest = rest.part(a, self.normal.cross(b - a).normalize_or_zero());
            if rest.corners.len() < 3 {
                return 0.0;
            }
        }
        rest.area()
    }

    /// Its area.
    pub(crate) fn area(&self) -> f64 {
        vector_area(&self.corners).length()
    }

    /// How far its corners are off the plane of another polygon, at most.
    pub(crate) fn farthest_from(&self, other: &Self) -> f64 {
        let height = |&p: &DVec3| other.normal.dot(p - other.corners[0]).abs();
        self.corners.iter().map(height).fold(0.0, f64::max)
    }

    /// Whether a segment of its plane has a part inside that doesn't run along the border.
    fn divided_by(&self, [a, b]: [DVec3; 2]) -> bool {
        let (mut start, mut end) = (0.0f64, 1.0f64);
        let inwards = |(c, d): (DVec3, DVec3)| (c, self.normal.cross(d - c).normalize_or_zero());
        for (corner, inwards) in self.edges().map(inwards) {
            let [from, to] = [a, b].map(|p| inwards.dot(p - corner));
            match (from >= 0.0, to >= 0.0) {
                (true, true) => (),
                (false, false) => return false,
                (false, true) => start = start.max(from / (from - to)),
                (true, false) => end = end.min(from / (from - to)),
            }
        }
        let middle = a.lerp(b, 0.5 * (start + end));
        (end - start) * a.distance(b) > self.slack
            && self
                .edges()
                .map(inwards)
                .all(|(corner, inwards)| inwards.dot(middle - corner) > self.slack)
    }

    /// What of it lies on the side of a line through `origin` to which `side` points (Sutherland and
    /// Hodgman, "Reentrant polygon clipping", CACM 17, 1974).
    fn part(&self, origin: DVec3, side: DVec3) -> Self {
        let height = |p: DVec3| {
            let height = side.dot(p - origin);
            if height.abs() <= self.slack { 0.0 } else { height }
        };
        let mut corners = Vec::with_capacity(self.corners.len() + 1);
        for (a, b) in self.edges() {
            let (from, to) = (height(a), height(b));
            if from >= 0.0 {
                corners.push(a);
            }
            if from * to < 0.0 {
                // The same point from both sides.
                let (a, b, from, to) = if from < 0.0 { (a, b, from, to) } else { (b, a, to, from) };
                corners.push(a.lerp(b, from / (from - to)));
            }
        }
        Self { slack: self.slack, ..Self::new(corners) }
    }

    fn edges(&self) -> impl Iterator<Item = (DVec3, DVec3)> {
        self.corners.iter().copied().zip(self.corners.iter().copied().cycle().skip(1))
    }
}

/// Calls `visit` for every two polygons whose boxes touch.
pub(crate) fn for_each_close_pair(polygons: &[Polygon], mut visit: impl FnMut(usize, usize)) {
    let mut order: Vec<usize> = (0..polygons.len()).collect();
    order.sort_by(|&i, &j| polygons[i].low.x.total_cmp(&polygons[j].low.x));
    // Those that the sweep has not passed yet.
    let mut open: Vec<usize> = Vec::new();
    for i in order {
        let here = &polygons[i];
        open.retain(|&j| polygons[j].high.x + polygons[j].slack >= here.low.x - here.slack);
        for &j in &open {
            let (other, slack) = (&polygons[j], here.slack.max(polygons[j].slack));
            let touch = here.low.cmple(other.high + slack) & other.low.cmple(here.high + slack);
            if touch.all() {
                visit(i, j);
            }
        }
        open.push(i);
    }
}
