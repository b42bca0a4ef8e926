//! Corrections of a sum over centroids, for pairs of elements that are too close to be taken for points.

use rayon::prelude::*;

use crate::elements::{Element, Surfel, check_surfels};
use crate::error::Error;
use crate::form_factors::exchange::{Pair, Zone, Zones, kappa};
use crate::form_factors::neighbours::Neighbours;
use crate::occlusion::{Occluders, Sights};

/// The differences C_ij = S_ij A_i F_ij − V_ij A_i K_ij A_j for the pairs that are so close that a sum over
/// centroids would be off by more than the tolerance.
///
/// F is the form factor of the whole areas, S the share of it that is unhidden, K the kernel of
/// [`Irradiance`](crate::Irradiance) between centroids, and V what the mask of the sum says: for points,
/// V = S is 1 if the centroids see each other, else 0. What sum and correction come to is S F, which is
/// neither negative nor more than 1. C is symmetric, bit for bit, so an exchange stays as reciprocal as the
/// sum that C corrects.
///
/// The distance of two patches decides how their form factor is computed. From far to near it is left to
/// the sum over centroids, computed by Gauss's rules with 2 × 2 or with 3 × 3 points on both, or computed
/// exactly ([`Patch::exchange`](crate::Patch::exchange)). The first of these that meets the tolerance is
/// taken. In pairs with a disk, πr² in the kernel is replaced by πr² + A, where A is the larger of the two
/// areas. This is exact for a disk and a point in front of its centre, and no disk then receives more than
/// was sent.
#[derive(Clone, Debug)]
pub struct Corrections {
    /// Where the entries of each row start; one more ends the last.
    starts: Vec<usize>,
    columns: Vec<u32>,
    /// In units of the largest area: single precision then holds them at any scale.
    values: Vec<f32>,
    areas: Vec<f64>,
    largest: f64,
    counts: Zones,
}

impl Corrections {
    /// The corrections for a sum over the centroids of `elements` that is masked by
    /// [`Visibility::new`](crate::Visibility::new); [`Visibility::corrections`](crate::Visibility::corrections)
    /// are those for others. `tolerance` is the relative error that irradiances may have,
    /// from all pairs together.
    ///
    /// For elements of similar size this takes O(N / tolerance) time and memory: each has O(1 / tolerance)
    /// elements near it.
    ///
    /// # Errors
    /// Those of [`check_surfels`]; [`Error::InvalidTolerance`] unless the tolerance lies between 0 and 1.
    pub fn new(elements: &[Element], occluders: &Occluders, tolerance: f64) -> Result<Self, Error> {
        Self::with(elements, &Sights::of_points(occluders), tolerance)
    }

    /// The same where the sum goes by these sights.
    pub(crate) fn with(
        elements: &[Element],
        sights: &Sights<'_>,
        tolerance: f64,
    ) -> Result<Self, Error> {
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(Error::InvalidTolerance { found: tolerance });
        }
        let surfels: Vec<Surfel> = elements.iter().map(|element| *element.surfel()).collect();
        check_surfels(&surfels)?;
        let zones = Pair::new(elements, sights, tolerance);
        let largest = surfels.iter().map(|surfel| surfel.area).fold(0.0, f64::max);
        let neighbours = Neighbours::new(elements);
        // From both ends of a pair the same: rows are found by themselves and in parallel, each pair
        // twice, but summed with equal bits.
        let row = |i: usize| {
            let mut row = Vec::new();
            let (centre, radius) = (elements[i].surfel().position, elements[i].radius());
            neighbours.for_each(centre, radius, kappa(tolerance), |j| {
                if j > i
                    && let Some((value, zone)) = zones.correction(i, j)
                {
                    row.push((j as u32, (value / largest) as f32, zone));
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
        Ok(Self { starts, columns, values, areas, largest, counts })
    }

    /// No corrections: the sum over the centroids of `elements` as it is.
    pub fn none(elements: &[Element]) -> Self {
        let areas: Vec<f64> = elements.iter().map(|element| element.surfel().area).collect();
        let (columns, values, counts) = (Vec::new(), Vec::new(), Zones::default());
        Self { starts: vec![0; areas.len() + 1], columns, values, areas, largest: 0.0, counts }
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
                *h += sum * (self.largest / self.areas[i]);
            }
        });
    }

    /// The irradiance that element `j` causes per unit of its radiosity beyond what its centroid does:
    /// C_ij/A_i, as pairs of i and value.
    pub fn column(&self, j: usize) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.starts[j]..self.starts[j + 1];
        let pairs = self.columns[entries.clone()].iter().zip(&self.values[entries]);
        let per_area = |i: usize| self.largest / self.areas[i];
        pairs.map(move |(&i, &value)| (i as usize, f64::from(value) * per_area(i as usize)))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::form_factors::exchange::{centroid_exchange, exchange_area};
    use crate::numbers::mixed;
    use crate::{Patch, Scene, furnace, two_rooms};
    use farfield::relative_l2_error;
    use glam::DVec3;
    use std::collections::HashMap;

    fn flat_room(n: usize) -> Vec<Element> {
        let mut scene = Scene::new();
        scene.add_room(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.25), n);
        scene.elements
    }

    /// The patches cut in two along a diagonal.
    fn triangles(elements: &[Element]) -> Vec<Element> {
        let halves = |element: &Element| {
            let &[a, b, c, d] = element.as_patch().unwrap().corners() else { panic!() };
            let face = element.surfel().face;
            [[a, b, c], [a, c, d]].map(|half| Element::patch(Patch::new(&half).unwrap(), face))
        };
        elements.iter().flat_map(halves).collect()
    }

    /// A smooth and a rough radiosity.
    fn radiosities(elements: &[Element]) -> Vec<[f64; 2]> {
        let both = |(i, element): (usize, &Element)| {
            [1.0 + element.surfel().position.x, (mixed(i as u64) % 1000) as f64 * 1e-3]
        };
        elements.iter().enumerate().map(both).collect()
    }

    /// The irradiances by any rule for A_i F_ij.
    fn received(
        elements: &[Element],
        b: &[[f64; 2]],
        exchange: impl Fn(usize, usize) -> f64 + Sync,
    ) -> Vec<[f64; 2]> {
        let n = elements.len();
        let upper = |i: usize| (i + 1..n).map(|j| exchange(i, j)).collect::<Vec<f64>>();
        let upper: Vec<Vec<f64>> = (0..n).into_par_iter().map(upper).collect();
        let mut h = vec![[0.0; 2]; n];
        for i in 0..n {
            for (j, exchange) in (i + 1..n).zip(&upper[i]) {
                for k in 0..2 {
                    h[i][k] += exchange * b[j][k] / elements[i].surfel().area;
                    h[j][k] += exchange * b[i][k] / elements[j].surfel().area;
                }
            }
        }
        h
    }

    fn by_centroids(elements: &[Element], b: &[[f64; 2]]) -> Vec<[f64; 2]> {
        received(elements, b, |i, j| centroid_exchange(elements[i].surfel(), elements[j].surfel()))
    }

    /// The relative l2 errors of both columns.
    fn errors(found: &[[f64; 2]], exact: &[[f64; 2]]) -> [f64; 2] {
        [0, 1].map(|k| {
            let column = |rows: &[[f64; 2]]| rows.iter().map(|row| row[k]).collect::<Vec<f64>>();
            relative_l2_error(&column(found), &column(exact))
        })
    }

    fn nothing() -> Occluders {
        Occluders::new(&[]).unwrap()
    }

    #[test]
    fn corrected_sums_are_as_exact_as_the_tolerance_says() {
        let rooms = [
            ("cube", furnace(7).elements),
            ("flat room", flat_room(7)),
            ("triangles", triangles(&furnace(4).elements)),
        ];
        for (name, elements) in rooms {
            let b = radiosities(&elements);
            let exact = received(&elements, &b, |i, j| exchange_area(&elements[i], &elements[j]));
            let plain = by_centroids(&elements, &b);
            let before = errors(&plain, &exact);
            assert!(before.iter().all(|&error| error > 0.05), "{name}: {before:?}");
            for tolerance in [1e-1, 3e-2, 1e-2, 1e-3] {
                let corrections = Corrections::new(&elements, &nothing(), tolerance).unwrap();
                let mut h = plain.clone();
                corrections.add(&b, &mut h);
                let after = errors(&h, &exact);
                let most = tolerance.min(0.5 * before[0]);
                assert!(after.iter().all(|&error| error <= most), "{name} {tolerance}: {after:?}");
            }
        }
    }

    #[test]
    fn corrections_are_symmetric_to_the_bit_and_columns_are_columns() {
        // Areas and shapes of all kinds.
        let mut elements = flat_room(4);
        elements.extend(triangles(&furnace(2).elements));
        elements.push(Element::disk(Surfel {
            position: DVec3::splat(0.12),
            normal: DVec3::X,
            area: 1e-3,
            face: Surfel::<f64>::NO_FACE,
        }));
        let n = elements.len();
        let corrections = Corrections::new(&elements, &nothing(), 1e-2).unwrap();
        assert_eq!((corrections.len(), corrections.is_empty()), (n, false));
        let entries: HashMap<(usize, usize), f32> = (0..n)
            .flat_map(|i| {
                let row = corrections.starts[i]..corrections.starts[i + 1];
                row.map(move |k| (i, k))
            })
            .map(|(i, k)| ((i, corrections.columns[k] as usize), corrections.values[k]))
            .collect();
        assert_eq!(entries.len(), corrections.values.len(), "no pair stands there twice");
        for (&(i, j), value) in &entries {
            assert_ne!(i, j);
            assert_eq!(entries[&(j, i)].to_bits(), value.to_bits());
        }
        let Zones { exact, three, two, disk } = corrections.zones();
        assert_eq!(2 * (exact + three + two + disk), entries.len() as u64);
        assert!(corrections.bytes() >= 8 * entries.len());

        for j in 0..n {
            let mut unit = vec![[0.0]; n];
            unit[j] = [1.0];
            let mut expected = vec![[0.0]; n];
            corrections.add(&unit, &mut expected);
            let mut found = vec![[0.0]; n];
            for (i, value) in corrections.column(j) {
                found[i][0] += value;
            }
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn tighter_tolerances_take_more_pairs_by_better_rules() {
        let elements = furnace(8).elements;
        let zones = |tolerance| Corrections::new(&elements, &nothing(), tolerance).unwrap().zones();
        let all = [1e-1, 1e-2, 1e-3].map(zones);
        let sum = |z: &Zones| z.exact + z.three + z.two;
        assert!(all.windows(2).all(|w| sum(&w[1]) > sum(&w[0]) && w[1].exact >= w[0].exact));
        assert!(all[0].exact > 0 && all[1].two > 0 && all[2].three > 0, "{all:?}");
        assert!(all.iter().all(|zones| zones.disk == 0));
        // No more than all pairs that aren't of one wall.
        assert!(sum(&all[2]) <= 15 * 64 * 64);

        let disks: Vec<Element> = elements.iter().map(|e| Element::disk(*e.surfel())).collect();
        let Zones { exact, three, two, disk } =
            Corrections::new(&disks, &nothing(), 1e-2).unwrap().zones();
        assert!(disk > 0 && exact + three + two == 0);
    }

    #[test]
    fn what_is_hidden_is_not_corrected() {
        let rooms = two_rooms(4);
        let half = rooms.elements.len() / 2;
        let across = |occluders: &Occluders| {
            let corrections = Corrections::new(&rooms.elements, occluders, 1e-3).unwrap();
            let across = |j: usize| corrections.column(j).filter(|(i, _)| *i >= half).count();
            ((0..half).map(across).sum::<usize>(), corrections.zones())
        };
        let (seen, _) = across(&nothing());
        assert!(seen > 0, "without the wall there is something to correct");
        let (hidden, zones) = across(&Occluders::new(&rooms.triangles).unwrap());
        assert!(hidden == 0 && zones.exact > 0);
    }

    #[test]
    fn corrections_scale_with_the_scene() {
        let scaled = |scale: f64| {
            let grow = |e: &Element| {
                let corners = e.as_patch().unwrap().corners().iter().map(|&c| c * scale);
                let corners: Vec<DVec3> = corners.collect();
                Element::patch(Patch::new(&corners).unwrap(), e.surfel().face)
            };
            let elements: Vec<Element> = furnace(3).elements.iter().map(grow).collect();
            let mut h = vec![[0.0; 2]; elements.len()];
            let b = vec![[1.0, 2.0]; elements.len()];
            Corrections::new(&elements, &nothing(), 1e-2).unwrap().add(&b, &mut h);
            h
        };
        let unit = scaled(1.0);
        assert!(unit.iter().all(|h| h[0].abs() > 1e-3));
        for scale in [1e-20, 1e20] {
            assert!(relative_l2_error(&scaled(scale), &unit) < 1e-5, "{scale}");
        }
    }

    #[test]
    fn bad_input_is_refused_and_nothing_is_nothing() {
        let elements = furnace(1).elements;
        for found in [0.0, 1.0, -1e-3, f64::INFINITY] {
            let error = Error::InvalidTolerance { found };
            assert_eq!(Corrections::new(&elements, &nothing(), found).unwrap_err(), error);
        }
        assert!(Corrections::new(&elements, &nothing(), f64::NAN).is_err());
        let bad = Element::disk(Surfel { area: -1.0, ..*elements[0].surfel() });
        let error = Corrections::new(&[elements[0], bad], &nothing(), 1e-2).unwrap_err();
        assert_eq!(error, Error::InvalidArea { index: 1, area: -1.0 });

        let empty = Corrections::new(&[], &nothing(), 1e-2).unwrap();
        empty.add::<1>(&[], &mut []);
        assert!(empty.is_empty() && empty.zones() == Zones::default());
        let none = Corrections::none(&elements);
        let mut h = vec![[1.0]; 6];
        none.add(&[[5.0]; 6], &mut h);
        assert_eq!((h, none.len(), none.column(3).count()), (vec![[1.0]; 6], 6, 0));
    }
}
