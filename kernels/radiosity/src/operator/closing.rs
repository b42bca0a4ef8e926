//! Scaling an exchange until no row gains light.

use crate::error::Error;
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

/// Iterations of the scaling; each takes one sum.
const SCALINGS: usize = 20;

/// Rows that sum to 1 within this are closed.
const CLOSED: f64 = 1e-6;

impl<const BANDS: usize> RadiosityOperator<'_, BANDS> {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator::radiosity_operator::tests::{extremes, plain};
    use crate::{Corrections, Scene, Stop, furnace, jacobi};
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
