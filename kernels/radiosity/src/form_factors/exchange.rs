//! The exchange of two elements without occlusion, and the cheapest rule that is good enough for it.

use std::f64::consts::FRAC_1_PI;

use crate::elements::{Element, Patch, Projections, Surfel};
use crate::form_factors::contour::Care;
use crate::form_factors::quadrature::{Rule, exchange};
use crate::occlusion::Sights;

/// With x = (r_1² + r_2²)/d², r the radii and d the distance, the relative errors of a pair are at most
/// about x/2 by centroids, x²/2 with two points per edge and x³ with three; with disks A/(πr²).
const CENTROID_ERROR: f64 = 0.5;
const TWO_ERROR: f64 = 0.5;
const THREE_ERROR: f64 = 1.0;

/// The share of the tolerance that one pair may be off by relative to itself, since errors of either
/// sign add up in a sum: over a flat surface, that of the centroids is the midpoint rule's.
const PAIR_SHARE: f64 = 4.0;

/// The share of the tolerance that all that is left out of a row may add up to: a row has some
/// 1/tolerance entries.
const NEGLIGIBLE: f64 = 0.02;

/// Patches that rise above each other's planes by no more of their size, and sink below them too, are of
/// one plane: as flat as a [`Patch`] has to be.
const COPLANAR: f64 = 1e-6;

/// Of the squared tolerance, what contour integrals may be off by, in units of the squared distance or
/// edge: less than the least form factor that counts.
const CONTOUR_ERROR: f64 = 1e-3;

/// A_i F_ij of two elements in squared scene units: the exchange of their whole areas without occlusion.
/// It is exact for two patches ([`Patch::exchange`]). With a disk it is the approximation that
/// [`Corrections`](crate::Corrections) describe.
pub fn exchange_area(a: &Element, b: &Element) -> f64 {
    match (a.as_patch(), b.as_patch()) {
        (Some(a), Some(b)) => a.exchange(b),
        _ => disk_exchange(a.surfel(), b.surfel()),
    }
}

/// How many unordered pairs of elements were corrected by each rule. Pairs that don't see each other
/// need no correction, and all others are left to the sum over centroids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Zones {
    /// By contour integrals.
    pub exact: u64,
    /// By 3 × 3 points on both patches, or six on triangles.
    pub three: u64,
    /// By 2 × 2 points on both patches, or three on triangles.
    pub two: u64,
    /// With a disk.
    pub disk: u64,
}

/// What one pair is taken by.
#[derive(Clone, Copy)]
pub(crate) enum Zone {
    Exact,
    Three,
    Two,
    Disk,
}

/// Pairs with x < 1/κ need no correction for this tolerance.
pub(crate) fn kappa(tolerance: f64) -> f64 {
    CENTROID_ERROR / (PAIR_SHARE * tolerance)
}

/// Pairs of elements that are near each other.
pub(crate) struct Pair<'a> {
    elements: &'a [Element],
    sights: &'a Sights<'a>,
    tolerance: f64,
    care: Care,
}

impl<'a> Pair<'a> {
    /// Those of which the sum may be off by `tolerance`.
    pub(crate) fn new(elements: &'a [Element], sights: &'a Sights<'a>, tolerance: f64) -> Self {
        let care = Care::within(CONTOUR_ERROR * tolerance.powi(2));
        Self { elements, sights, tolerance: PAIR_SHARE * tolerance, care }
    }

    /// C_ij; none if there is nothing to correct.
    pub(crate) fn correction(&self, i: usize, j: usize) -> Option<(f64, Zone)> {
        let [a, b] = [i, j].map(|k| &self.elements[k]);
        let (x, y) = (a.surfel(), b.surfel());
        let least = NEGLIGIBLE * self.tolerance.powi(2) * x.area.min(y.area);
        let zone = match (a.as_patch(), b.as_patch()) {
            (Some(a), Some(b)) => self.zone(a, b, x, y)?,
            _ => Zone::Disk,
        };
        let taken = centroid_exchange(x, y);
        let value = || match (a.as_patch(), b.as_patch(), zone) {
            (Some(a), Some(b), Zone::Two) => exchange(a, b, Rule::Two),
            (Some(a), Some(b), Zone::Three) => exchange(a, b, Rule::Three),
            (Some(a), Some(b), _) => a.exchange_with(b, self.care),
            _ => disk_exchange(x, y),
        };
        // What the sum takes of them, and what it should: where they see all of each other, the same.
        let shares = || {
            let touch = matches!(zone, Zone::Exact);
            let share = self.sights.close_share([i, j], [a, b], touch);
            (share, if taken > 0.0 { self.sights.share(x, y).0 } else { 0.0 })
        };
        // A contour integral takes much longer than rays.
        let (value, (share, sum)) = if matches!(zone, Zone::Exact) {
            let shares = shares();
            (if shares.0 > 0.0 { value() } else { 0.0 }, shares)
        } else {
            let value = value();
            if (value - taken).abs() <= least && self.sights.are_points() {
                return None;
            }
            (value, shares())
        };
        let difference = share * value - sum * taken;
        (difference.abs() > least).then_some((difference, zone))
    }

    /// How to take two patches; none if centroids do, or they exchange too little to matter.
    fn zone(&self, a: &Patch, b: &Patch, x: &Surfel, y: &Surfel) -> Option<Zone> {
        let height = |patch: &Patch, plane: &Patch| {
            let above = |corner: &glam::DVec3| plane.normal().dot(*corner - plane.corners()[0]);
            let heights = patch.corners().iter().map(above);
            heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| {
                (low.min(h), high.max(h))
            })
        };
        let ((low_a, high_a), (low_b, high_b)) = (height(a, b), height(b, a));
        let size2 = x.area.max(y.area);
        let flat = f64::EPSILON.sqrt() * size2.sqrt();
        let whole = low_a >= -flat && low_b >= -flat;
        // Patches of one plane that rounding of their corners has turned into each other see nothing.
        let least = if whole { flat } else { COPLANAR * size2.sqrt() };
        if high_a <= least || high_b <= least {
            return None;
        }
        let radius2 = |patch: &Patch, centre: glam::DVec3| {
            let reach = |corner: &glam::DVec3| corner.distance_squared(centre);
            patch.corners().iter().map(reach).fold(0.0, f64::max)
        };
        let d2 = x.position.distance_squared(y.position);
        let ratio = (radius2(a, x.position) + radius2(b, y.position)) / d2;
        // Two strips that meet at an angle π − θ exchange 1 − cos(θ/2) ≈ θ²/8 of their light; what faces
        // each other at that angle without touching exchanges less.
        let bend = 0.25 * (1.0 + x.normal.dot(-y.normal)).max(0.0);
        if bend < NEGLIGIBLE * self.tolerance {
            return None;
        }
        if whole && TWO_ERROR * ratio.powi(2) <= self.tolerance {
            Some(Zone::Two)
        } else if whole && THREE_ERROR * ratio.powi(3) <= self.tolerance {
            Some(Zone::Three)
        } else {
            Some(Zone::Exact)
        }
    }
}

/// A_x K A_y between centroids, 0 unless they face each other.
pub(crate) fn centroid_exchange(x: &Surfel, y: &Surfel) -> f64 {
    let pair = Projections::new(x, y);
    if pair.facing() { pair.kernel() * x.area * y.area } else { 0.0 }
}

/// A_x cos θ_x cos θ_y A_y / (πr² + max(A_x, A_y)).
fn disk_exchange(x: &Surfel, y: &Surfel) -> f64 {
    let pair = Projections::new(x, y);
    if !pair.in_front() {
        return 0.0;
    }
    let r2 = pair.distance_squared;
    let grown = r2 + x.area.max(y.area) * FRAC_1_PI;
    pair.kernel() * (r2 / grown) * x.area * y.area
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::DVec3;

    #[test]
    fn a_disk_receives_what_it_does_and_never_more_than_is_sent() {
        let disk = |z: f64, normal: DVec3, area: f64| {
            let face = Surfel::<f64>::NO_FACE;
            Element::disk(Surfel { position: DVec3::Z * z, normal, area, face })
        };
        for (radius, height) in [(1.0f64, 1.0f64), (2.0, 0.1), (0.3, 5.0)] {
            let large = disk(height, -DVec3::Z, std::f64::consts::PI * radius.powi(2));
            let point = disk(0.0, DVec3::Z, 1e-12);
            let factor = exchange_area(&point, &large) / 1e-12;
            let exact = radius.powi(2) / (radius.powi(2) + height.powi(2));
            assert_relative_eq!(factor, exact, max_relative = 1e-12);
            let back = exchange_area(&large, &point) / 1e-12;
            assert_relative_eq!(back, factor, max_relative = 1e-14);
            for area in [0.1, 1.0, 10.0] {
                let other = disk(0.0, DVec3::Z, area);
                let most = area.min(large.surfel().area);
                assert!(exchange_area(&other, &large) < most, "{radius} {height} {area}");
            }
            assert_eq!(exchange_area(&disk(0.0, -DVec3::Z, 1.0), &large), 0.0, "from behind");
        }
    }
}
