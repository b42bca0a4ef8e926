//! A kernel that separates: no tree, no far field, just a few moments.

use farfield::{Error, Located, Numbers, Point, Real, Vector};

use crate::output::PotentialGradient;

/// u_i = Σ_j |x_i − y_j|² q_j in O(N + M), exact.
///
/// |x − y|² = |x|² − 2 x·y + |y|² is a sum of products, so five moments of the sources serve every
/// target:
///
/// u(x) = |x|² Σ q_j − 2 x·Σ y_j q_j + Σ |y_j|² q_j.
///
/// Lengths are measured from the sources' mean position: about a far-away origin the three terms
/// would cancel.
///
/// # Errors
/// [`Error::LengthMismatch`] if there isn't one charge per source.
pub fn squared_distance_sum<P: Located, C: Numbers<Real = P::Real>>(
    sources: &[P],
    charges: &[C],
    targets: &[P],
) -> Result<Vec<C>, Error> {
    let moments = Moments::new(sources, charges)?;
    Ok(targets.iter().map(|x| moments.potential(x.position())).collect())
}

/// [`squared_distance_sum`] with its gradient, ∇u = 2 Σ_j (x − y_j) q_j.
///
/// # Errors
/// [`Error::LengthMismatch`] if there isn't one charge per source.
pub fn squared_distance_sum_with_gradient<P: Located, C: Numbers<Real = P::Real>>(
    sources: &[P],
    charges: &[C],
    targets: &[P],
) -> Result<Vec<PotentialGradient<C>>, Error> {
    let moments = Moments::new(sources, charges)?;
    Ok(targets
        .iter()
        .map(|x| PotentialGradient {
            potential: moments.potential(x.position()),
            gradient: moments.gradient(x.position()),
        })
        .collect())
}

/// Moments of the charges about a centre.
struct Moments<T: Real, C> {
    centre: Point<T>,
    /// Σ q
    total: C,
    /// Σ y q
    first: [C; 3],
    /// Σ |y|² q
    second: C,
}

impl<T: Real, C: Numbers<Real = T>> Moments<T, C> {
    fn new<P: Located<Real = T>>(sources: &[P], charges: &[C]) -> Result<Self, Error> {
        if sources.len() != charges.len() {
            return Err(Error::LengthMismatch {
                what: "charges",
                expected: sources.len(),
                found: charges.len(),
            });
        }
        let mut centre = Point::<T>::default();
        for (i, y) in sources.iter().enumerate() {
            // A running mean: the sum of all positions could overflow.
            centre = centre + (y.position() - centre) * T::from_f64(1.0 / (i + 1) as f64);
        }
        let mut moments =
            Self { centre, total: C::zero(), first: Numbers::zero(), second: C::zero() };
        for (y, q) in sources.iter().zip(charges) {
            let y = y.position() - centre;
            moments.total.accumulate(q);
            for (first, component) in moments.first.iter_mut().zip(y.to_array()) {
                first.add_scaled(component, q);
            }
            moments.second.add_scaled(y.length_squared(), q);
        }
        Ok(moments)
    }

    fn potential(&self, x: Point<T>) -> C {
        let x = x - self.centre;
        let mut u = self.second.clone();
        for (first, component) in self.first.iter().zip(x.to_array()) {
            u.add_scaled(T::from_f64(-2.0) * component, first);
        }
        u.add_scaled(x.length_squared(), &self.total);
        u
    }

    fn gradient(&self, x: Point<T>) -> [C; 3] {
        let x = (x - self.centre).to_array();
        let two = T::from_f64(2.0);
        std::array::from_fn(|c| {
            let mut g = C::zero();
            g.add_scaled(two * x[c], &self.total);
            g.add_scaled(-two, &self.first[c]);
            g
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::power_law::SquaredDistance;
    use farfield::{direct, relative_l2_error};
    use glam::DVec3;

    fn line(n: usize, origin: DVec3) -> Vec<DVec3> {
        (0..n).map(|i| i as f64).map(|i| origin + DVec3::new(i.sin(), i.cos(), i / 7.0)).collect()
    }

    #[test]
    fn equals_the_direct_sum_also_far_from_the_origin() {
        for origin in [DVec3::ZERO, DVec3::splat(1e8)] {
            let (sources, targets) = (line(40, origin), line(30, origin + DVec3::X));
            let charges: Vec<_> = (0..40).map(|i| [1.0 + f64::from(i), f64::from(i % 3)]).collect();
            let kernel = SquaredDistance::<f64>::new().columns::<[f64; 2]>();
            let exact = direct(&kernel, &sources, &charges, &targets).unwrap();
            let found = squared_distance_sum(&sources, &charges, &targets).unwrap();
            // The mean of far-away sources is itself rounded; differences from it are not.
            assert!(relative_l2_error(&found, &exact) < 1e-14);
            let exact = direct(&kernel.with_gradient(), &sources, &charges, &targets).unwrap();
            let found = squared_distance_sum_with_gradient(&sources, &charges, &targets).unwrap();
            assert!(relative_l2_error(&found, &exact) < 1e-14);
        }
    }

    #[test]
    fn no_sources_and_mismatched_charges() {
        let x = [DVec3::ONE];
        assert_eq!(squared_distance_sum::<_, f64>(&[], &[], &x), Ok(vec![0.0]));
        let error = Error::LengthMismatch { what: "charges", expected: 1, found: 2 };
        assert_eq!(squared_distance_sum(&x, &[1.0, 2.0], &x), Err(error));
    }
}
