//! What the sizes of near elements change in a sum over their centroids: a sparse matrix, built once.

use std::f64::consts::FRAC_1_PI;

use rayon::prelude::*;

use crate::bvh::Occluders;
use crate::element::Element;
use crate::error::Error;
use crate::neighbours::Neighbours;
use crate::patch::Patch;
use crate::quadrature::{Rule, exchange};
use crate::surfel::{Projections, Surfel, check_surfels};

/// The differences C_ij = V_ij (A_i F_ij − A_i K_ij A_j) for the pairs that are so close that a sum over
/// centroids would be off by more than the tolerance.
///
/// F is the form factor of the whole areas, K the kernel of [`Irradiance`](crate::Irradiance) between
/// centroids, V whether these see each other. C is symmetric, bit for bit: with it an exchange stays as
/// reciprocal as the sum that it corrects.
///
/// By distance, pairs of patches are taken exactly ([`Patch::exchange`]), by Gauss's rules of 3 × 3 or
/// 2 × 2 points on both, or left to the sum over centroids: whichever is the first to be off by less
/// than the tolerance. With disks, the kernel's πr² becomes πr² + A, A the mean of the two areas: a
/// disk then receives A/(πr² + A) of what a point before its centre sends, as it does, and not
/// arbitrarily much.
#[derive(Clone, Debug)]
pub struct Corrections {
    /// Where the entries of each row start; one more ends the last.
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f32>,
    areas: Vec<f64>,
    counts: Zones,
}

/// How many unordered pairs of elements were taken by each rule. Those that don't see each other, and
/// all others, are left to the sum over centroids.
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

impl Corrections {
    /// The corrections for a sum over the centroids of `elements`. `tolerance` is the relative error that
    /// irradiances may have, from all pairs together.
    ///
    /// O(N) for elements of similar size: O(1/tolerance) pairs each.
    ///
    /// # Errors
    /// Those of [`check_surfels`]; [`Error::InvalidTolerance`] unless the tolerance lies between 0 and 1.
    pub fn new(elements: &[Element], occluders: &Occluders, tolerance: f64) -> Result<Self, Error> {
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(Error::InvalidTolerance { found: tolerance });
        }
        let surfels: Vec<Surfel> = elements.iter().map(|element| *element.surfel()).collect();
        check_surfels(&surfels)?;
        let zones = Pair { elements, occluders, tolerance: PAIR_SHARE * tolerance };
        let neighbours = Neighbours::new(elements);
        // From both ends of a pair the same: rows are found by themselves and in parallel, each pair
        // twice, but summed with equal bits.
        let row = |i: usize| {
            let mut row = Vec::new();
            let (centre, radius) = (elements[i].surfel().position, elements[i].radius());
            neighbours.for_each(centre, radius, zones.kappa(), |j| {
                if j > i
                    && let Some((value, zone)) = zones.correction(i, j)
                {
                    row.push((j as u32, value as f32, zone));
                }
            });
            row.sort_unstable_by_key(|entry| entry.0);
            row
        };
        let upper: Vec<Vec<(u32, f32, Zone)>> =
            (0..elements.len()).into_par_iter().map(row).collect();

        let mut counts = Zones::default();
        let mut lengths: Vec<usize> = upper.iter().map(Vec::len).collect();
        for &(j, _, zone) in upper.iter().flatten() {
            lengths[j as usize] += 1;
            match zone {
                Zone::Exact => counts.exact += 1,
                Zone::Three => counts.three += 1,
                Zone::Two => counts.two += 1,
                Zone::Disk => counts.disk += 1,
            }
        }
        let mut starts = Vec::with_capacity(elements.len() + 1);
        starts.push(0);
        for length in lengths {
            starts.push(starts[starts.len() - 1] + length);
        }
        let mut next = starts.clone();
        let mut columns = vec![0; starts[elements.len()]];
        let mut values = vec![0.0; starts[elements.len()]];
        let mut put = |i: usize, j: usize, value| {
            columns[next[i]] = j as u32;
            values[next[i]] = value;
            next[i] += 1;
        };
        for (i, row) in upper.iter().enumerate() {
            for &(j, value, _) in row {
                put(i, j as usize, value);
                put(j as usize, i, value);
            }
        }
        let areas = surfels.iter().map(|surfel| surfel.area).collect();
        Ok(Self { starts, columns, values, areas, counts })
    }

    /// H_i += 1/A_i Σ_j C_ij B_j.
    ///
    /// # Panics
    /// If there isn't one entry per element.
    pub fn add<const BANDS: usize>(
        &self,
        radiosity: &[[f64; BANDS]],
        irradiance: &mut [[f64; BANDS]],
    ) {
        assert_eq!(radiosity.len(), self.areas.len(), "one radiosity per element");
        assert_eq!(irradiance.len(), self.areas.len(), "one irradiance per element");
        irradiance.par_iter_mut().with_min_len(256).enumerate().for_each(|(i, h)| {
            let entries = self.starts[i]..self.starts[i + 1];
            let mut sum = [0.0; BANDS];
            for (&j, &value) in self.columns[entries.clone()].iter().zip(&self.values[entries]) {
                for (sum, b) in sum.iter_mut().zip(radiosity[j as usize]) {
                    *sum += f64::from(value) * b;
                }
            }
            for (h, sum) in h.iter_mut().zip(sum) {
                *h += sum / self.areas[i];
            }
        });
    }

    /// The irradiance that element `j` causes per unit of its radiosity beyond what its centroid does:
    /// C_ij/A_i, as pairs of i and value.
    pub fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.starts[j]..self.starts[j + 1];
        let pairs = self.columns[entries.clone()].iter().zip(&self.values[entries]);
        pairs.map(|(&i, &value)| (i as usize, f64::from(value) / self.areas[i as usize]))
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.areas.len()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty()
    }

    /// How many pairs were taken by which rule.
    pub fn zones(&self) -> Zones {
        self.counts
    }

    /// Its size in memory.
    pub fn bytes(&self) -> usize {
        let Self { starts, columns, values, areas, .. } = self;
        size_of_val(&starts[..])
            + size_of_val(&columns[..])
            + size_of_val(&values[..])
            + size_of_val(&areas[..])
    }
}

/// A_i F_ij of two elements: the exchange of their whole areas, as if nothing were in between. A pair
/// of patches by their exact contour integral, with a disk as [`Corrections`] says.
pub fn exchange_area(a: &Element, b: &Element) -> f64 {
    match (a.as_patch(), b.as_patch()) {
        (Some(a), Some(b)) => a.exchange(b),
        _ => disk_exchange(a.surfel(), b.surfel()),
    }
}

/// What one pair is taken by.
#[derive(Clone, Copy)]
enum Zone {
    Exact,
    Three,
    Two,
    Disk,
}

/// Pairs of elements that are near each other.
struct Pair<'a> {
    elements: &'a [Element],
    occluders: &'a Occluders,
    tolerance: f64,
}

impl Pair<'_> {
    /// Pairs with x < 1/κ need no correction.
    fn kappa(&self) -> f64 {
        CENTROID_ERROR / self.tolerance
    }

    /// C_ij; none if there is nothing to correct.
    fn correction(&self, i: usize, j: usize) -> Option<(f64, Zone)> {
        let [a, b] = [i, j].map(|k| &self.elements[k]);
        let (x, y) = (a.surfel(), b.surfel());
        let (value, zone) = match (a.as_patch(), b.as_patch()) {
            (Some(a), Some(b)) => self.of_patches(a, b, x, y)?,
            _ => (disk_exchange(x, y), Zone::Disk),
        };
        let difference = value - centroid_exchange(x, y);
        let least = NEGLIGIBLE * self.tolerance.powi(2) * x.area.min(y.area);
        let counts = difference.abs() > least;
        let sees = || !self.occluders.blocked(x.position, y.position, [x.face, y.face]);
        (counts && sees()).then_some((difference, zone))
    }

    fn of_patches(&self, a: &Patch, b: &Patch, x: &Surfel, y: &Surfel) -> Option<(f64, Zone)> {
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
        if high_a <= flat || high_b <= flat {
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
        let whole = low_a >= -flat && low_b >= -flat;
        if whole && TWO_ERROR * ratio.powi(2) <= self.tolerance {
            Some((exchange(a, b, Rule::Two), Zone::Two))
        } else if whole && THREE_ERROR * ratio.powi(3) <= self.tolerance {
            Some((exchange(a, b, Rule::Three), Zone::Three))
        } else {
            Some((a.exchange(b), Zone::Exact))
        }
    }
}

/// A_x K A_y between centroids, 0 unless they face each other.
fn centroid_exchange(x: &Surfel, y: &Surfel) -> f64 {
    let pair = Projections::new(x, y);
    if pair.facing() { pair.kernel() * x.area * y.area } else { 0.0 }
}

/// A_x cos θ_x cos θ_y A_y / (πr² + (A_x + A_y)/2).
fn disk_exchange(x: &Surfel, y: &Surfel) -> f64 {
    let pair = Projections::new(x, y);
    if !pair.facing() {
        return 0.0;
    }
    let r2 = pair.distance_squared;
    let grown = r2 + 0.5 * (x.area + y.area) * FRAC_1_PI;
    pair.kernel() * (r2 / grown) * x.area * y.area
}

#[cfg(test)]
mod calibrate {
    use super::*;
    use crate::furnace;
    #[test]
    #[ignore]
    fn calibrate() {
        for n in [8, 14] {
            for (name, scene) in [
                ("furnace", furnace(n)),
                ("flat", {
                    let mut s = crate::Scene::new();
                    s.add_room(glam::DVec3::ZERO, glam::DVec3::new(1.0, 1.0, 0.25), n);
                    s
                }),
            ] {
                let e = &scene.elements;
                let occluders = Occluders::new(&scene.triangles).unwrap();
                let smooth: Vec<[f64; 1]> =
                    e.iter().map(|e| [1.0 + e.surfel().position.x]).collect();
                let rough: Vec<[f64; 1]> = (0..e.len())
                    .map(|i| [(crate::operator::mixed(i as u64) % 1000) as f64])
                    .collect();
                let t = std::time::Instant::now();
                let exact: Vec<Vec<f64>> = (0..e.len())
                    .into_par_iter()
                    .map(|i| {
                        (0..e.len())
                            .map(|j| {
                                if i == j {
                                    0.0
                                } else {
                                    exchange_area(&e[i], &e[j]) / e[i].surfel().area
                                }
                            })
                            .collect()
                    })
                    .collect();
                println!(
                    "{name} {n}: exact pairs {:.2} us each",
                    2e6 * t.elapsed().as_secs_f64() / (e.len() as f64).powi(2)
                );
                for tol in [1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4] {
                    let t = std::time::Instant::now();
                    let c = Corrections::new(e, &occluders, tol).unwrap();
                    let time = t.elapsed().as_secs_f64();
                    print!(
                        "tol {tol:e} {:?} {:.2}s per element {}:",
                        c.zones(),
                        time,
                        c.values.len() / e.len()
                    );
                    for b in [&smooth, &rough] {
                        let mut h: Vec<[f64; 1]> = (0..e.len())
                            .into_par_iter()
                            .map(|i| {
                                [(0..e.len())
                                    .map(|j| {
                                        centroid_exchange(e[i].surfel(), e[j].surfel()) * b[j][0]
                                    })
                                    .sum::<f64>()
                                    / e[i].surfel().area]
                            })
                            .collect();
                        c.add(b, &mut h);
                        let want: Vec<[f64; 1]> = exact
                            .iter()
                            .map(|row| {
                                [row.iter().zip(b.iter()).map(|(f, b)| f * b[0]).sum::<f64>()]
                            })
                            .collect();
                        let worst = h
                            .iter()
                            .zip(&want)
                            .map(|(h, w)| (h[0] / w[0] - 1.0).abs())
                            .fold(0.0, f64::max);
                        print!(
                            " l2 {:.1e} max {:.1e}",
                            farfield::relative_l2_error(&h, &want),
                            worst
                        );
                    }
                    println!();
                }
            }
        }
    }
}
