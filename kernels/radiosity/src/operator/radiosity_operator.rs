//! From the radiosity of all elements to their irradiance: a fast sum over centroids, corrected for near
//! elements and scaled.

use std::borrow::Cow;

use crate::elements::Element;
use crate::error::{Error, check_length};
use crate::form_factors::Corrections;
use crate::numbers::{mixed, relative};
use crate::operator::rounding;

/// H = A⁻¹ (D (A K + C) D + R): the irradiance of elements by their radiosity, all bands in one pass.
///
/// K is a sum over centroids (any fast sum of [`Irradiance`](crate::Irradiance) over
/// [`Element::surfel`]s), C its [`Corrections`], A the areas, D the scaling that
/// [`close`](Self::close) finds; without it D = 1. R is diagonal and holds what the rows of closed parts
/// then lack to 1, so that these sum to 1 exactly. The mean radiosity of a closed part doesn't go through
/// the sum, as it is known what becomes of it: rounding is relative to what the radiosities differ by.
///
/// ```
/// use farfield::Fmm;
/// use farfield_radiosity::{Corrections, Irradiance, Occluders, RadiosityOperator, Visibility, furnace};
///
/// let room = furnace(6);
/// let occluders = Occluders::new(&room.triangles)?;
/// let mask = Visibility::new(&occluders);
/// let kernel = Irradiance::<f64, [f64; 3]>::clamped();
/// let fmm = Fmm::builder(kernel).mask(&mask).tolerance(1e-3).build(&room.surfels, &room.surfels)?;
/// let corrections = Corrections::new(&room.elements, &occluders, 1e-3)?;
/// let operator = RadiosityOperator::new(&room.elements, |b| fmm.apply(b), corrections)?;
/// // In a closed room, whatever radiates 1 receives 1.
/// assert!(operator.row_sums()?.iter().all(|s| (s - 1.0).abs() < 4e-3));
/// # Ok::<(), farfield_radiosity::Error>(())
/// ```
pub struct RadiosityOperator<'a, const BANDS: usize> {
    sum: Box<Sum<'a, BANDS>>,
    corrections: Corrections,
    pub(super) areas: Vec<f64>,
    /// D; empty if it is 1.
    pub(super) scaling: Vec<f64>,
    /// The closed part of each element; empty if there is none.
    pub(super) parts: Vec<Option<u32>>,
    /// A⁻¹ R; empty if there is no closed part.
    pub(super) own: Vec<f64>,
    /// Which elements take no part; empty if all do.
    left_out: Vec<bool>,
}

type Sum<'a, const BANDS: usize> =
    dyn Fn(&[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, farfield::Error> + Sync + 'a;

impl<'a, const BANDS: usize> RadiosityOperator<'a, BANDS> {
    /// The operator of `elements` by `sum`, from radiosities to irradiances by centroids, such as
    /// `|b| fmm.apply(b)`.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] if `corrections` are those of another number of elements.
    pub fn new(
        elements: &[Element],
        sum: impl Fn(&[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, farfield::Error> + Sync + 'a,
        corrections: Corrections,
    ) -> Result<Self, Error> {
        check_length("corrections", corrections.len(), elements.len())?;
        let areas = elements.iter().map(|element| element.surfel().area).collect();
        let (scaling, parts, own, left_out) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Ok(Self { sum: Box::new(sum), corrections, areas, scaling, parts, own, left_out })
    }

    /// Leaves some elements out: they give nothing to others and receive nothing, as what lies
    /// [buried](crate::Surroundings::buried) in a body. To be said before rows are closed.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless there is an entry for each element.
    pub fn leave_out(&mut self, left_out: Vec<bool>) -> Result<(), Error> {
        check_length("elements left out", left_out.len(), self.areas.len())?;
        self.left_out = if left_out.contains(&true) { left_out } else { Vec::new() };
        Ok(())
    }

    /// The irradiance H of each element for radiosities B, in the same units.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless there is one radiosity per element, and the sum gives one
    /// irradiance. Those of the sum.
    pub fn apply(&self, radiosity: &[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, Error> {
        check_length("radiosity", radiosity.len(), self.areas.len())?;
        let means = self.means(radiosity);
        if means.is_empty() {
            return self.exchanged(radiosity);
        }
        let mean = |i: usize| self.parts[i].map_or([0.0; BANDS], |part| means[part as usize]);
        let uneven: Vec<[f64; BANDS]> = (0..radiosity.len())
            .map(|i| {
                let mean = mean(i);
                std::array::from_fn(|k| radiosity[i][k] - mean[k])
            })
            .collect();
        let mut irradiance = self.exchanged(&uneven)?;
        for (i, h) in irradiance.iter_mut().enumerate() {
            let mean = mean(i);
            *h = std::array::from_fn(|k| mean[k] + (h[k] + self.own[i] * uneven[i][k]));
        }
        Ok(irradiance)
    }

    /// The share of each element's light that arrives at others, Σ_j F_ij: its irradiance when all
    /// radiate 1. One sum.
    ///
    /// # Errors
    /// Those of the sum.
    pub fn row_sums(&self) -> Result<Vec<f64>, Error> {
        Ok(self.apply(&vec![[1.0; BANDS]; self.areas.len()])?.iter().map(|h| h[0]).collect())
    }

    /// The relative error of irradiances by rounding, ‖H(B) − H(B′) − H(B − B′)‖ / ‖H(B)‖ for radiosities
    /// B = 1 and random parts B′ of them. Three sums.
    ///
    /// It is some 10⁻¹⁶ for sums in double precision and 10⁻⁸ for those that form near pairs in single
    /// precision, as [`Irradiance`](crate::Irradiance) does from a tolerance of 10⁻⁶ on. No solver can
    /// be relied on to reach a residual of less than a few times ρ ‖H(B)‖ / ‖E‖ of that. One that is asked
    /// for less ends with [`Error::Stagnated`], which tells how much rounding may leave in its equation.
    ///
    /// # Errors
    /// Those of the sum.
    pub fn rounding(&self) -> Result<f64, Error> {
        let ones = vec![[1.0; BANDS]; self.areas.len()];
        let irradiance = self.apply(&ones)?;
        let errors = rounding(&ones, &irradiance, |b| self.apply(b))?;
        Ok(relative(&errors, &irradiance))
    }

    /// |⟨w, A H v⟩ − ⟨A H w, v⟩| / (‖w‖ ‖A H v‖) for two vectors of random signs: how far the exchange is
    /// from reciprocal, A_i F_ij = A_j F_ji. Two sums.
    ///
    /// # Errors
    /// Those of the sum.
    pub fn reciprocity_error(&self) -> Result<f64, Error> {
        let signs = |start: u64| {
            let sign = |i: usize| if mixed(start + i as u64) & 1 == 0 { 1.0 } else { -1.0 };
            (0..self.areas.len()).map(sign).collect::<Vec<f64>>()
        };
        let (v, w) = (signs(0), signs(1 << 40));
        let received = |b: &[f64]| -> Result<Vec<f64>, Error> {
            let columns: Vec<_> = b.iter().map(|&b| [b; BANDS]).collect();
            let h = self.apply(&columns)?;
            Ok(h.iter().zip(&self.areas).map(|(h, area)| area * h[0]).collect())
        };
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (hv, hw) = (received(&v)?, received(&w)?);
        let size = dot(&w, &w).sqrt() * dot(&hv, &hv).sqrt();
        let difference = (dot(&w, &hv) - dot(&hw, &v)).abs();
        Ok(if size > 0.0 { difference / size } else { 0.0 })
    }

    /// What it adds to the sum over centroids.
    pub fn corrections(&self) -> &Corrections {
        &self.corrections
    }

    /// The factor d_j by which an element's radiosity counts, and its irradiance: 0 if it is
    /// [left out](Self::leave_out).
    pub fn scaling(&self, j: usize) -> f64 {
        let left_out = self.left_out.get(j).is_some_and(|&left_out| left_out);
        if left_out { 0.0 } else { self.scaling.get(j).copied().unwrap_or(1.0) }
    }

    /// What an element of a closed part gives to itself, as a form factor: what its row lacks to 1 after the
    /// scaling. 0 for others.
    pub fn own_factor(&self, j: usize) -> f64 {
        self.own.get(j).copied().unwrap_or(0.0)
    }

    /// The mean radiosity of each closed part over its area.
    pub(super) fn means(&self, radiosity: &[[f64; BANDS]]) -> Vec<[f64; BANDS]> {
        let mut sums = vec![([0.0; BANDS], 0.0); self.part_count()];
        for ((b, area), part) in radiosity.iter().zip(&self.areas).zip(&self.parts) {
            if let Some(part) = part {
                let (sum, total) = &mut sums[*part as usize];
                *total += area;
                sum.iter_mut().zip(b).for_each(|(sum, b)| *sum += area * b);
            }
        }
        let mean = |(sum, area): ([f64; BANDS], f64)| sum.map(|sum| sum / area);
        sums.into_iter().map(mean).collect()
    }

    /// How many closed parts there are.
    pub(super) fn part_count(&self) -> usize {
        self.parts.iter().flatten().max().map_or(0, |&part| part as usize + 1)
    }

    /// Leaves D = 1 and no closed part; returns what there was of them.
    pub(super) fn take_closure(&mut self) -> (Vec<f64>, Vec<Option<u32>>, Vec<f64>) {
        let Self { scaling, parts, own, .. } = self;
        (std::mem::take(scaling), std::mem::take(parts), std::mem::take(own))
    }

    /// A⁻¹ D (A K + C) D B.
    fn exchanged(&self, radiosity: &[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, Error> {
        let scaled = self.scaled(radiosity);
        let mut irradiance = (self.sum)(&scaled)?;
        check_length("irradiance", irradiance.len(), self.areas.len())?;
        self.corrections.add(&scaled, &mut irradiance);
        if self.is_scaled() {
            let rows = irradiance.iter_mut().enumerate();
            rows.for_each(|(i, h)| *h = h.map(|h| self.scaling(i) * h));
        }
        Ok(irradiance)
    }

    /// D B
    fn scaled<'b>(&self, radiosity: &'b [[f64; BANDS]]) -> Cow<'b, [[f64; BANDS]]> {
        if !self.is_scaled() {
            return Cow::Borrowed(radiosity);
        }
        let rows = radiosity.iter().enumerate();
        rows.map(|(j, b)| b.map(|b| self.scaling(j) * b)).collect()
    }

    /// Whether D isn't 1.
    fn is_scaled(&self) -> bool {
        !(self.scaling.is_empty() && self.left_out.is_empty())
    }
}

impl<const BANDS: usize> std::fmt::Debug for RadiosityOperator<'_, BANDS> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RadiosityOperator")
            .field("elements", &self.areas.len())
            .field("zones", &self.corrections.zones())
            .field("scaled", &self.is_scaled())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::{Closure, Enclosure, Irradiance, Occluders, Scene, Surfel, furnace};
    use farfield::direct;

    pub(in crate::operator) fn sums(
        scene: &Scene,
    ) -> impl Fn(&[[f64; 1]]) -> Result<Vec<[f64; 1]>, farfield::Error> {
        let surfels: Vec<Surfel> = scene.surfels.clone();
        move |b| Ok(direct(&Irradiance::clamped(), &surfels, b, &surfels).unwrap())
    }

    /// The operator of centroids alone.
    pub(in crate::operator) fn plain(scene: &Scene) -> RadiosityOperator<'_, 1> {
        let none = Corrections::none(&scene.elements);
        RadiosityOperator::new(&scene.elements, sums(scene), none).unwrap()
    }

    pub(in crate::operator) fn extremes(values: &[f64]) -> (f64, f64) {
        values.iter().fold((f64::INFINITY, 0.0), |(low, high), &v| (low.min(v), high.max(v)))
    }

    #[test]
    fn what_is_left_out_gives_nothing_and_receives_nothing() {
        let scene = furnace(4);
        let count = scene.elements.len();
        let left_out: Vec<bool> = (0..count).map(|i| i % 5 == 0).collect();
        let nothing = Occluders::new(&[]).unwrap();
        let corrections = Corrections::new(&scene.elements, &nothing, 1e-2).unwrap();
        let mut operator =
            RadiosityOperator::new(&scene.elements, sums(&scene), corrections).unwrap();
        let b: Vec<[f64; 1]> = (0..count).map(|i| [1.0 + (i % 7) as f64]).collect();
        let zeroed = |i: usize| if left_out[i] { [0.0] } else { b[i] };
        let mut expected = operator.apply(&(0..count).map(zeroed).collect::<Vec<_>>()).unwrap();
        (0..count).filter(|&i| left_out[i]).for_each(|i| expected[i] = [0.0]);
        operator.leave_out(left_out.clone()).unwrap();
        assert_eq!(operator.apply(&b).unwrap(), expected);
        assert!(operator.reciprocity_error().unwrap() < 1e-12);
        operator.close(Enclosure::Open, 0.5).unwrap();
        let sums = operator.row_sums().unwrap();
        assert!((0..count).all(|i| (sums[i] == 0.0) == left_out[i]));
        assert!((0..count).all(|i| (operator.scaling(i) == 0.0) == left_out[i]));
        assert!(operator.leave_out(vec![true]).is_err());
    }

    #[test]
    fn with_corrections_the_rows_of_a_closed_room_sum_to_one() {
        let scene = furnace(6);
        for tolerance in [1e-1, 1e-2, 1e-3] {
            let nothing = Occluders::new(&[]).unwrap();
            let corrections = Corrections::new(&scene.elements, &nothing, tolerance).unwrap();
            let operator =
                RadiosityOperator::new(&scene.elements, sums(&scene), corrections).unwrap();
            let (low, high) = extremes(&operator.row_sums().unwrap());
            assert!(low > 1.0 - 4.0 * tolerance && high < 1.0 + 4.0 * tolerance);
            assert!(operator.reciprocity_error().unwrap() < 1e-12);
        }
        let (_, high) = extremes(&plain(&scene).row_sums().unwrap());
        assert!(high > 1.2, "without, they don't");
    }

    #[test]
    fn rounding_is_told_from_what_is_wrong_alike_for_all_radiosities() {
        let scene = furnace(4);
        let rounding = |change: &(dyn Fn(f64) -> f64 + Sync)| {
            let sum = sums(&scene);
            let changed = move |b: &[[f64; 1]]| Ok(sum(b)?.iter().map(|h| h.map(change)).collect());
            let none = Corrections::none(&scene.elements);
            RadiosityOperator::new(&scene.elements, changed, none).unwrap().rounding().unwrap()
        };
        for error in [0.0, 0.1] {
            let double = rounding(&|h| h * (1.0 + error));
            assert!((1e-18..1e-14).contains(&double), "{double:e}");
            let single = rounding(&|h| f64::from((h * (1.0 + error)) as f32));
            assert!((1e-8..1e-6).contains(&single), "{single:e}");
        }
        assert_eq!(rounding(&|_| 0.0), 0.0);
    }

    #[test]
    fn an_exchange_that_is_not_reciprocal_is_seen() {
        let scene = furnace(3);
        let none = || Corrections::none(&scene.elements);
        let sum = sums(&scene);
        let uneven = |b: &[[f64; 1]]| {
            let mut h = sum(b)?;
            h.iter_mut().take(9).for_each(|h| h[0] *= 1.1);
            Ok(h)
        };
        let operator = RadiosityOperator::new(&scene.elements, uneven, none()).unwrap();
        assert!(operator.reciprocity_error().unwrap() > 1e-4);
        let dark = |b: &[[f64; 1]]| Ok(vec![[0.0]; b.len()]);
        let operator = RadiosityOperator::new(&scene.elements, dark, none()).unwrap();
        assert_eq!(operator.reciprocity_error(), Ok(0.0));
    }

    #[test]
    fn lengths_that_do_not_match_and_failing_sums_are_reported() {
        let (scene, other) = (furnace(2), furnace(1));
        let found = RadiosityOperator::new(
            &scene.elements,
            sums(&scene),
            Corrections::none(&other.elements),
        );
        let error = Error::LengthMismatch { what: "corrections", expected: 24, found: 6 };
        assert_eq!(found.unwrap_err(), error);
        let error = Error::LengthMismatch { what: "radiosity", expected: 24, found: 23 };
        assert_eq!(plain(&scene).apply(&[[1.0]; 23]), Err(error));
        let short = |_: &[[f64; 1]]| Ok(vec![[1.0]; 5]);
        let none = Corrections::none(&scene.elements);
        let mut operator = RadiosityOperator::new(&scene.elements, short, none.clone()).unwrap();
        let error = || Error::LengthMismatch { what: "irradiance", expected: 24, found: 5 };
        assert_eq!(operator.row_sums(), Err(error()));
        assert_eq!(operator.close(Enclosure::Open, 0.5), Err(error()));
        let failing = |_: &[[f64; 1]]| Err(farfield::Error::InvalidLeafSize);
        let operator = RadiosityOperator::new(&scene.elements, failing, none).unwrap();
        assert_eq!(operator.row_sums(), Err(Error::Sum(farfield::Error::InvalidLeafSize)));
        let empty = Corrections::none(&[]);
        let mut operator = RadiosityOperator::<1>::new(&[], |_| Ok(vec![]), empty).unwrap();
        assert_eq!(operator.close(Enclosure::Closed, 0.1), Ok(Closure::default()));
        assert_eq!(operator.row_sums(), Ok(vec![]));
    }
}
