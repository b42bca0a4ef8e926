//! Scaling an exchange until no row gains light.

use crate::error::{Error, check_length};
use crate::operator::RadiosityOperator;

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

/// Iterations of the scaling, each of which takes one sum: after the first number they end once rows are
/// closed well enough, after the second there will be no end.
const SCALINGS: usize = 20;
const MOST_SCALINGS: usize = 100;

/// Rows that sum to 1 within this are closed; within the other, well enough.
const CLOSED: f64 = 1e-6;
const CLOSED_ENOUGH: f64 = 1e-3;

impl<const BANDS: usize> RadiosityOperator<'_, BANDS> {
    /// The scaling of [`close_parts`](Self::close_parts) alone where it isn't known which elements see each
    /// other: all of them belong to closed parts, or none.
    ///
    /// # Errors
    /// Those of [`close_parts`](Self::close_parts).
    pub fn close(&mut self, enclosure: Enclosure, limit: f64) -> Result<Closure, Error> {
        let part = match enclosure {
            Enclosure::Closed => Some(0),
            Enclosure::Open => None,
        };
        let closure = self.close_parts(vec![part; self.areas.len()], limit)?;
        self.parts.clear();
        self.own.clear();
        Ok(closure)
    }

    /// Scales the exchange K to D K D, which keeps it reciprocal, so that the rows of closed surfaces
    /// sum to 1 and those of open ones to 1 at most: without, an iteration of bounces may gain light.
    /// `parts` has the number of the closed part that each element belongs to, and none for those that lose
    /// light.
    ///
    /// d_i ← √(d_i A_i / (K d)_i), of open surfaces 1 at most (Sinkhorn's scaling in its symmetric
    /// form: Knight, Ruiz and Uçar, SIAM J. Matrix Anal. Appl. 35, 2014). Some ten sums; none if no
    /// row of open surfaces sums to more than 1. What the rows of closed surfaces then still lack to 1 is
    /// [given to themselves](Self::own_factor).
    ///
    /// # Errors
    /// [`Error::NotClosable`] if a form factor would have to change by more than `limit`, and
    /// [`Error::NotClosed`] if no scaling closes all rows: then elements are missing or far too coarse, and
    /// the operator is left as it was. [`Error::LengthMismatch`] unless there is an entry for each element.
    /// Those of the sum.
    pub fn close_parts(&mut self, parts: Vec<Option<u32>>, limit: f64) -> Result<Closure, Error> {
        check_length("parts", parts.len(), self.areas.len())?;
        let before = self.take_closure();
        let closed = self.closed_by(&parts, limit);
        match closed {
            Ok((scaling, own, closure)) => {
                if closure.largest > 0.0 {
                    self.scaling = scaling;
                }
                if parts.iter().any(Option::is_some) {
                    (self.parts, self.own) = (parts, own);
                }
                Ok(closure)
            }
            Err(error) => {
                (self.scaling, self.parts, self.own) = before;
                Err(error)
            }
        }
    }

    /// D, what closed rows lack to 1 after it, and how large D is.
    fn closed_by(
        &mut self,
        parts: &[Option<u32>],
        limit: f64,
    ) -> Result<(Vec<f64>, Vec<f64>, Closure), Error> {
        let (d, left) = self.scaling_for(parts)?;
        let change = |d: f64| d * d - 1.0;
        let squares = d.iter().zip(&self.areas).map(|(&d, area)| area * change(d).powi(2));
        let rms =
            (squares.sum::<f64>() / self.areas.iter().sum::<f64>().max(f64::MIN_POSITIVE)).sqrt();
        let worst = (0..d.len()).max_by(|&i, &j| change(d[i]).abs().total_cmp(&change(d[j]).abs()));
        let largest = worst.map_or(0.0, |index| change(d[index]).abs());
        if let Some(index) = worst
            && !within(largest, limit)
        {
            return Err(Error::NotClosable { index, change: change(d[index]), limit });
        }
        let lacks = |i: usize| if parts[i].is_some() { left[i] } else { 0.0 };
        let own: Vec<f64> = (0..d.len()).map(lacks).collect();
        let worst = (0..d.len()).max_by(|&i, &j| own[i].abs().total_cmp(&own[j].abs()));
        match worst {
            Some(index) if !within(own[index], CLOSED_ENOUGH) => {
                Err(Error::NotClosed { index, row_sum: 1.0 - own[index] })
            }
            _ => Ok((d, own, Closure { largest, rms })),
        }
    }

    /// D, and what the rows lack to 1 once they are scaled by it.
    fn scaling_for(&self, parts: &[Option<u32>]) -> Result<(Vec<f64>, Vec<f64>), Error> {
        let mut d = vec![1.0; self.areas.len()];
        let mut iteration = 0;
        loop {
            iteration += 1;
            let columns: Vec<_> = d.iter().map(|&d| [d; BANDS]).collect();
            let received = self.apply(&columns)?;
            let (mut next, mut change) = (d.clone(), 0.0f64);
            for ((d, h), part) in next.iter_mut().zip(&received).zip(parts) {
                // An open element that nothing sees has nothing to scale; nor has one whose row errors have
                // taken below zero.
                let received = if h[0] < 0.0 { 0.0 } else { h[0] };
                let scaled = received != 0.0 || part.is_some();
                let wanted = if scaled { (*d / received).sqrt() } else { *d };
                let most = if part.is_some() { f64::INFINITY } else { 1.0 };
                let wanted = if wanted > most { most } else { wanted };
                let step = (wanted / *d - 1.0).abs();
                // Unlike f64::max, this doesn't lose a NaN.
                change = if change.is_nan() || step <= change { change } else { step };
                *d = wanted;
            }
            let enough = if iteration < SCALINGS { CLOSED } else { 0.25 * CLOSED_ENOUGH };
            if change < enough || iteration == MOST_SCALINGS {
                let left = d.iter().zip(&received).map(|(d, h)| 1.0 - d * h[0]).collect();
                return Ok((d, left));
            }
            d = next;
            if !change.is_finite() {
                let left = vec![f64::NAN; d.len()];
                return Ok((d, left));
            }
        }
    }
}

/// Whether a number, of either sign, is no larger than a limit: neither is if it is none.
fn within(number: f64, limit: f64) -> bool {
    number.abs() <= limit
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::radiosity_operator::tests::{extremes, plain, sums};
    use crate::{Corrections, Element, Scene, Stop, Surfel, furnace, jacobi};
    use glam::DVec3;

    /// The four walls and the floor of a cube.
    fn open_room(n: usize) -> Scene {
        let mut scene = furnace(n);
        scene.elements.retain(|e| e.surfel().face != 5);
        scene.surfels.retain(|s| s.face != 5);
        scene
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
    fn parts_are_closed_each_by_itself_and_rows_of_closed_ones_are_exact() {
        let (room, mut scene) = (furnace(4), furnace(4));
        let mut second = open_room(4);
        for element in &mut second.elements {
            let surfel = *element.surfel();
            *element = Element::disk(Surfel { position: surfel.position + 9.0, ..surfel });
        }
        scene.surfels.extend(second.elements.iter().map(|e| *e.surfel()));
        scene.elements.extend(second.elements);
        // No wall keeps them apart: only the first sees itself.
        let alone = sums(&room);
        let mut part = Scene::new();
        part.surfels = scene.surfels[96..].to_vec();
        let beside = sums(&part);
        let both = move |b: &[[f64; 1]]| {
            let mut h = alone(&b[..96])?;
            h.extend(beside(&b[96..])?);
            Ok(h)
        };
        let none = Corrections::none(&scene.elements);
        let mut operator = RadiosityOperator::new(&scene.elements, both, none).unwrap();
        let before = operator.row_sums().unwrap();
        let parts = (0..scene.elements.len()).map(|i| (i < 96).then_some(0)).collect();
        operator.close_parts(parts, 0.5).unwrap();
        let after = operator.row_sums().unwrap();
        assert!(after[..96].iter().all(|&sum| sum == 1.0));
        let (before, after) = (&before[96..], &after[96..]);
        assert!(before.iter().zip(after).all(|(b, a)| a <= b) && extremes(after).0 < 0.9);
        assert!(operator.own_factor(3).abs() < 1e-5 && operator.own_factor(99) == 0.0);
        assert!(operator.reciprocity_error().unwrap() < 1e-12);
        // The same by the matrix, which has no exact rows but for what is given to each element.
        let mut unit = vec![[0.0]; scene.elements.len()];
        unit[3] = [1.0];
        let h = operator.apply(&unit).unwrap();
        assert!((h[3][0] - operator.own_factor(3)).abs() < 1e-12);
        let length = Error::LengthMismatch { what: "parts", expected: 176, found: 1 };
        assert_eq!(operator.close_parts(vec![None], 0.5), Err(length));
    }

    #[test]
    fn rows_that_no_scaling_closes_are_refused() {
        // Two elements that see nothing but each other, of different areas.
        let disk = |area: f64| {
            Element::disk(Surfel { position: DVec3::ZERO, normal: DVec3::Z, area, face: 0 })
        };
        let elements = [disk(1.0), disk(1.0)];
        for second in [1.004, 1.01] {
            let elements = [disk(1.0), disk(second)];
            let swapped = move |b: &[[f64; 1]]| Ok(vec![[b[1][0]], [b[0][0] / second]]);
            let none = Corrections::none(&elements);
            let mut operator = RadiosityOperator::new(&elements, swapped, none).unwrap();
            let error = operator.close(Enclosure::Closed, 0.5).unwrap_err();
            let not_closed =
                matches!(error, Error::NotClosed { row_sum, .. } if (row_sum - 1.0).abs() > 1e-3);
            // The larger the difference, the further the scaling goes in vain.
            let too_far = matches!(error, Error::NotClosable { .. });
            assert!(if second < 1.01 { not_closed } else { not_closed || too_far }, "{error}");
            assert_eq!(operator.row_sums().unwrap(), [1.0, 1.0 / second]);
        }
        // What should be closed and sees nothing can't be.
        let dark = |b: &[[f64; 1]]| Ok(vec![[0.0]; b.len()]);
        let none = Corrections::none(&elements);
        let mut operator = RadiosityOperator::new(&elements, dark, none).unwrap();
        let error = operator.close(Enclosure::Closed, 0.5).unwrap_err();
        assert!(matches!(error, Error::NotClosable { change: f64::INFINITY, .. }), "{error}");
        assert_eq!(operator.close(Enclosure::Open, 0.5), Ok(Closure::default()));
        // Nor can what errors have taken below zero, wherever in the list it is.
        for index in [0, 1] {
            let below = move |b: &[[f64; 1]]| {
                let mut h = vec![[b[1][0]], [b[0][0]]];
                h[index] = [-0.3];
                Ok(h)
            };
            let none = Corrections::none(&elements);
            let mut operator = RadiosityOperator::new(&elements, below, none).unwrap();
            let error = operator.close(Enclosure::Closed, 0.5).unwrap_err();
            assert!(
                matches!(error, Error::NotClosable { change: f64::INFINITY, index: i, .. } if i == index),
                "{error}"
            );
            assert_eq!(operator.close(Enclosure::Open, 0.5), Ok(Closure::default()));
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
}
