//! From the radiosity of all elements to their irradiance: a fast sum over centroids, what near
//! elements change in it, and what closes it.

use std::borrow::Cow;

use crate::corrections::Corrections;
use crate::element::Element;
use crate::error::Error;
use crate::rounding::{relative, rounding};
use crate::solve::check_length;

/// H = A⁻¹ D (A K + C) D: the irradiance of elements by their radiosity, all bands in one pass.
///
/// K is a sum over centroids (any fast sum of [`Irradiance`](crate::Irradiance) over
/// [`Element::surfel`]s), C its [`Corrections`], A the areas, D the scaling that
/// [`close`](Self::close) finds; without it D = 1.
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
    areas: Vec<f64>,
    /// D; empty if it is 1.
    scaling: Vec<f64>,
}

type Sum<'a, const BANDS: usize> =
    dyn Fn(&[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, farfield::Error> + Sync + 'a;

/// The size of the corrections that [`RadiosityOperator::close`] made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Closure {
    /// The largest |d_i d_j − 1|, at most: the largest relative change of a form factor.
    pub largest: f64,
    /// The root mean square of d_i² − 1 over the area.
    pub rms: f64,
}

/// What is known of the surfaces as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enclosure {
    /// They close a room: all light that leaves one arrives at others, so rows sum to 1.
    Closed,
    /// Light may escape: rows sum to 1 at most.
    Open,
}

/// Iterations of the scaling; each takes one sum.
const SCALINGS: usize = 20;

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
        Ok(Self { sum: Box::new(sum), corrections, areas, scaling: Vec::new() })
    }

    /// The irradiance H of each element for radiosities B, in the same units.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`] unless there is one radiosity per element, and the sum gives one
    /// irradiance. Those of the sum.
    pub fn apply(&self, radiosity: &[[f64; BANDS]]) -> Result<Vec<[f64; BANDS]>, Error> {
        check_length("radiosity", radiosity.len(), self.areas.len())?;
        let scaled = self.scaled(radiosity);
        let mut irradiance = (self.sum)(&scaled)?;
        check_length("irradiance", irradiance.len(), self.areas.len())?;
        self.corrections.add(&scaled, &mut irradiance);
        for (h, d) in irradiance.iter_mut().zip(&self.scaling) {
            *h = h.map(|h| d * h);
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

    /// Scales the exchange K to D K D, which keeps it reciprocal, so that the rows of closed surfaces
    /// sum to 1 and those of open ones to 1 at most: without, an iteration of bounces may gain light.
    ///
    /// d_i ← √(d_i A_i / (K d)_i), of open surfaces 1 at most (Sinkhorn's scaling in its symmetric
    /// form: Knight, Ruiz and Uçar, SIAM J. Matrix Anal. Appl. 35, 2014). Some ten sums; none if no
    /// row of open surfaces sums to more than 1.
    ///
    /// # Errors
    /// [`Error::NotClosable`] if a form factor would have to change by more than `limit`: then elements
    /// are missing or far too coarse, and the operator is left as it was. Those of the sum.
    pub fn close(&mut self, enclosure: Enclosure, limit: f64) -> Result<Closure, Error> {
        let before = std::mem::take(&mut self.scaling);
        let closed = self.scaling_for(enclosure).and_then(|d| {
            let change = |d: f64| d * d - 1.0;
            let squares = d.iter().zip(&self.areas).map(|(&d, area)| area * change(d).powi(2));
            let rms = (squares.sum::<f64>()
                / self.areas.iter().sum::<f64>().max(f64::MIN_POSITIVE))
            .sqrt();
            let worst =
                (0..d.len()).max_by(|&i, &j| change(d[i]).abs().total_cmp(&change(d[j]).abs()));
            let largest = worst.map_or(0.0, |index| change(d[index]).abs());
            match worst {
                Some(index) if largest > limit || largest.is_nan() || limit.is_nan() => {
                    Err(Error::NotClosable { index, change: change(d[index]), limit })
                }
                _ => Ok((d, Closure { largest, rms })),
            }
        });
        match closed {
            Ok((d, closure)) => {
                self.scaling = if closure.largest > 0.0 { d } else { Vec::new() };
                Ok(closure)
            }
            Err(error) => {
                self.scaling = before;
                Err(error)
            }
        }
    }

    /// What it adds to the sum over centroids.
    pub fn corrections(&self) -> &Corrections {
        &self.corrections
    }

    /// The factor d_j by which an element's radiosity counts, and its irradiance.
    pub fn scaling(&self, j: usize) -> f64 {
        self.scaling.get(j).copied().unwrap_or(1.0)
    }

    fn scaling_for(&self, enclosure: Enclosure) -> Result<Vec<f64>, Error> {
        let mut d = vec![1.0; self.areas.len()];
        for _ in 0..SCALINGS {
            let columns: Vec<_> = d.iter().map(|&d| [d; BANDS]).collect();
            let received = self.apply(&columns)?;
            let mut change = 0.0f64;
            for (d, h) in d.iter_mut().zip(&received) {
                // An element that nothing sees has nothing to scale; a sum that is no number shows.
                let seen = h[0] > 0.0 || h[0].is_nan();
                let wanted = if seen { (*d / h[0]).sqrt() } else { *d };
                let most = if enclosure == Enclosure::Open { 1.0 } else { f64::INFINITY };
                let wanted = if wanted > most { most } else { wanted };
                change = change.max((wanted / *d - 1.0).abs());
                *d = wanted;
            }
            if change < CLOSED {
                break;
            }
        }
        Ok(d)
    }

    /// D B
    fn scaled<'b>(&self, radiosity: &'b [[f64; BANDS]]) -> Cow<'b, [[f64; BANDS]]> {
        if self.scaling.is_empty() {
            return Cow::Borrowed(radiosity);
        }
        radiosity.iter().zip(&self.scaling).map(|(b, d)| b.map(|b| d * b)).collect()
    }
}

/// Rows that sum to 1 within this are closed.
const CLOSED: f64 = 1e-6;

impl<const BANDS: usize> std::fmt::Debug for RadiosityOperator<'_, BANDS> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RadiosityOperator")
            .field("elements", &self.areas.len())
            .field("zones", &self.corrections.zones())
            .field("scaled", &!self.scaling.is_empty())
            .finish_non_exhaustive()
    }
}

/// Well-mixed bits of a number (Steele, Lea and Flood, "Fast splittable pseudorandom number
/// generators", OOPSLA 2014).
pub(crate) fn mixed(n: u64) -> u64 {
    let z = n.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Irradiance, Occluders, Scene, Stop, Surfel, furnace, jacobi};
    use farfield::direct;
    use glam::DVec3;

    fn sums(scene: &Scene) -> impl Fn(&[[f64; 1]]) -> Result<Vec<[f64; 1]>, farfield::Error> {
        let surfels: Vec<Surfel> = scene.surfels.clone();
        move |b| Ok(direct(&Irradiance::clamped(), &surfels, b, &surfels))
    }

    /// The operator of centroids alone.
    fn plain(scene: &Scene) -> RadiosityOperator<'_, 1> {
        let none = Corrections::none(&scene.elements);
        RadiosityOperator::new(&scene.elements, sums(scene), none).unwrap()
    }

    /// The four walls and the floor of a cube.
    fn open_room(n: usize) -> Scene {
        let mut scene = furnace(n);
        scene.elements.retain(|e| e.surfel().face != 5);
        scene.surfels.retain(|s| s.face != 5);
        scene
    }

    fn extremes(values: &[f64]) -> (f64, f64) {
        values.iter().fold((f64::INFINITY, 0.0), |(low, high), &v| (low.min(v), high.max(v)))
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
    fn a_room_of_centroids_gains_light_until_it_is_closed() {
        let scene = furnace(8);
        let mut operator = plain(&scene);
        let (low, high) = extremes(&operator.row_sums().unwrap());
        assert!((low - 1.007).abs() < 1e-3 && (high - 1.239).abs() < 1e-3, "{low} {high}");
        let mut emission = vec![[0.0]; scene.surfels.len()];
        emission[7] = [1.0];
        let reflectance = vec![[0.95]; scene.surfels.len()];
        let solve = |operator: &RadiosityOperator<'_, 1>| {
            jacobi(&emission, &reflectance, Stop::default(), |b| operator.apply(b), |_, _| ())
        };
        assert!(matches!(solve(&operator), Err(Error::Diverged { .. })));

        let closure = operator.close(Enclosure::Closed, 0.5).unwrap();
        assert!(closure.largest > 0.1 && closure.largest < 0.3, "{closure:?}");
        assert!(closure.rms > 0.01 && closure.rms < closure.largest);
        let (low, high) = extremes(&operator.row_sums().unwrap());
        assert!(low > 1.0 - 1e-5 && high < 1.0 + 1e-5, "{low} {high}");
        assert!(operator.reciprocity_error().unwrap() < 1e-12);
        let solution = solve(&operator).unwrap();
        // All that is emitted is absorbed.
        let absorbed: f64 = solution.irradiance.iter().map(|h| 0.05 * h[0]).sum();
        assert!((absorbed - 1.0).abs() < 1e-3, "{absorbed}");

        // Closing once more changes nothing but the last digits.
        let scalings: Vec<f64> = (0..384).map(|j| operator.scaling(j)).collect();
        operator.close(Enclosure::Closed, 0.5).unwrap();
        for (j, before) in scalings.iter().enumerate() {
            assert!((operator.scaling(j) - before).abs() < 1e-5);
        }
    }

    #[test]
    fn open_surfaces_are_only_scaled_down() {
        let scene = open_room(8);
        let mut operator = plain(&scene);
        let before = operator.row_sums().unwrap();
        assert!(extremes(&before).1 > 1.05 && extremes(&before).0 < 0.9);
        let closure = operator.close(Enclosure::Open, 0.5).unwrap();
        assert!(closure.largest > 0.0 && closure.rms > 0.0);
        let after = operator.row_sums().unwrap();
        assert!(extremes(&after).1 < 1.0 + 1e-5, "{}", extremes(&after).1);
        assert!(before.iter().zip(&after).all(|(b, a)| a <= b));
        let scalings: Vec<f64> = (0..before.len()).map(|j| operator.scaling(j)).collect();
        assert!(scalings.iter().all(|&d| d > 0.5 && d <= 1.0) && extremes(&scalings).0 < 1.0);
        assert!(scalings.contains(&1.0), "what had no part in it is left alone");
        assert!(operator.reciprocity_error().unwrap() < 1e-12);
    }

    #[test]
    fn open_surfaces_that_gain_nothing_are_left_alone() {
        let mut scene = Scene::new();
        let [x, y, z] = DVec3::AXES;
        scene.add_quad([DVec3::ZERO, x, x + y, y], 3, 3);
        scene.add_quad([z, z + y, z + x + y, z + x], 3, 3);
        let mut operator = plain(&scene);
        let before = operator.row_sums().unwrap();
        let closure = operator.close(Enclosure::Open, 1e-9).unwrap();
        assert_eq!(closure, Closure::default());
        assert_eq!(operator.row_sums().unwrap(), before);
        assert!((0..18).all(|j| operator.scaling(j) == 1.0));
    }

    #[test]
    fn what_cannot_be_closed_is_named_and_left_as_it_was() {
        let scene = open_room(4);
        let mut operator = plain(&scene);
        operator.close(Enclosure::Open, 0.5).unwrap();
        let before = operator.row_sums().unwrap();
        let error = operator.close(Enclosure::Closed, 0.1).unwrap_err();
        let Error::NotClosable { index, change, limit } = error else { panic!("{error}") };
        assert!(limit == 0.1 && change > 0.1, "{change}");
        // Next to the missing ceiling.
        assert!(scene.surfels[index].position.z > 0.8, "{index}");
        assert_eq!(operator.row_sums().unwrap(), before);
        assert!(operator.close(Enclosure::Closed, f64::NAN).is_err());

        let nan = |b: &[[f64; 1]]| Ok(vec![[f64::NAN]; b.len()]);
        let none = Corrections::none(&scene.elements);
        let mut operator = RadiosityOperator::new(&scene.elements, nan, none).unwrap();
        for enclosure in [Enclosure::Closed, Enclosure::Open] {
            let error = operator.close(enclosure, 0.5).unwrap_err();
            assert!(matches!(error, Error::NotClosable { change, .. } if change.is_nan()));
        }
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
        let error = Error::LengthMismatch { what: "irradiance", expected: 24, found: 5 };
        assert_eq!(operator.row_sums(), Err(error.clone()));
        assert_eq!(operator.close(Enclosure::Open, 0.5), Err(error));
        let failing = |_: &[[f64; 1]]| Err(farfield::Error::InvalidLeafSize);
        let operator = RadiosityOperator::new(&scene.elements, failing, none).unwrap();
        assert_eq!(operator.row_sums(), Err(Error::Sum(farfield::Error::InvalidLeafSize)));
        let empty = Corrections::none(&[]);
        let mut operator = RadiosityOperator::<1>::new(&[], |_| Ok(vec![]), empty).unwrap();
        assert_eq!(operator.close(Enclosure::Closed, 0.1), Ok(Closure::default()));
        assert_eq!(operator.row_sums(), Ok(vec![]));
    }
}
