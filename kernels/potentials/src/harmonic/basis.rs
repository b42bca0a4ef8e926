//! The regular and the singular functions and their gradients.

use farfield::{Point, Real, Vector};

use super::{Harmonic, MAX_ORDER};

impl<T: Real> Harmonic<T> {
    /// Writes R_k(y) = |y|^n Y_lm(ŷ) into `out`.
    ///
    /// # Panics
    /// If `out` isn't [`len`](Self::len) long, as in all functions of this kind.
    pub fn regular(&self, y: Point<T>, out: &mut [T]) {
        self.check(out.len());
        self.solid.evaluate(y.to_array(), &self.heads, out);
        let r2 = y.length_squared();
        for shell in self.shells.iter().filter(|shell| shell.n > shell.l) {
            for k in 0..2 * shell.l + 1 {
                out[shell.start + k] = r2 * out[shell.below + k];
            }
        }
    }

    /// Writes R_k(y) into `out` and ∇R_k(y) into `gradients`.
    ///
    /// # Panics
    /// If a length isn't [`len`](Self::len).
    pub fn regular_gradient(&self, y: Point<T>, out: &mut [T], gradients: &mut [[T; 3]]) {
        self.check(gradients.len());
        self.regular(y, out);
        self.solid.gradients(out, &self.heads, gradients);
        let r2 = y.length_squared();
        let twice = y.to_array().map(|component| component + component);
        for shell in self.shells.iter().filter(|shell| shell.n > shell.l) {
            // ∇(|y|² R) = 2y R + |y|² ∇R
            for k in 0..2 * shell.l + 1 {
                let (value, gradient) = (out[shell.below + k], gradients[shell.below + k]);
                gradients[shell.start + k] =
                    std::array::from_fn(|c| twice[c] * value + r2 * gradient[c]);
            }
        }
    }

    /// Writes S_k(x) = e_n^j |x|^(−n−2λ) Y_lm(x̂) into `out`; they aren't finite at x = 0.
    ///
    /// # Panics
    /// If `out` isn't [`len`](Self::len) long.
    pub fn singular(&self, x: Point<T>, out: &mut [T]) {
        self.check(out.len());
        let (direction, powers) = self.polar(x);
        self.solid.evaluate(direction.to_array(), &self.heads, out);
        for shell in self.shells.iter().rev() {
            let scale = shell.weight * powers[shell.n];
            let head = self.heads[shell.l];
            for k in 0..2 * shell.l + 1 {
                out[shell.start + k] = scale * out[head + k];
            }
        }
    }

    /// Writes S_k(x) into `out` and ∇S_k(x) into `gradients`; they aren't finite at x = 0.
    ///
    /// # Panics
    /// If a length isn't [`len`](Self::len).
    pub fn singular_gradient(&self, x: Point<T>, out: &mut [T], gradients: &mut [[T; 3]]) {
        self.check(out.len());
        self.check(gradients.len());
        let (direction, powers) = self.polar(x);
        let unit = direction.to_array();
        let per_length = x.length_squared().sqrt().recip();
        self.solid.evaluate(unit, &self.heads, out);
        self.solid.gradients(out, &self.heads, gradients);
        for shell in self.shells.iter().rev() {
            let scale = shell.weight * powers[shell.n];
            // S = e |x|^(−n−2λ−l) H_l(x), H_l homogeneous of degree l
            let radial = T::from_f64(-((shell.n + shell.l) as f64) - 2.0 * self.lambda);
            let head = self.heads[shell.l];
            for k in 0..2 * shell.l + 1 {
                let (value, gradient) = (out[head + k], gradients[head + k]);
                out[shell.start + k] = scale * value;
                gradients[shell.start + k] = std::array::from_fn(|c| {
                    scale * per_length * (radial * unit[c] * value + gradient[c])
                });
            }
        }
    }

    /// x̂ and |x|^(−n−2λ) for all n.
    fn polar(&self, x: Point<T>) -> (Point<T>, [T; MAX_ORDER + 1]) {
        let inverse = x.length_squared().sqrt().recip();
        (x * inverse, powers(inverse.powf(T::from_f64(2.0 * self.lambda)), inverse))
    }

    /// Panics unless `len` is the number of terms.
    pub(super) fn check(&self, len: usize) {
        assert_eq!(len, self.len, "one entry per term");
    }
}

/// first · x^n for n = 0, …, [`MAX_ORDER`].
pub(super) fn powers<T: Real>(first: T, x: T) -> [T; MAX_ORDER + 1] {
    let mut power = first;
    std::array::from_fn(|_| {
        let now = power;
        power *= x;
        now
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    const LAMBDAS: [f64; 6] = [0.5, 1.0, 2.0, -1.0, -0.5, 0.8];

    #[test]
    fn the_expansion_converges_to_the_kernel() {
        // |y|/|x| = 0.1: each order gains a digit.
        let (x, y) = (DVec3::new(1.0, -2.0, 0.5), DVec3::new(0.02, 0.1, 0.2050609665440988));
        assert!((y.length() / x.length() - 0.1).abs() < 1e-3);
        for lambda in LAMBDAS {
            let exact = x.distance_squared(y).powf(-lambda);
            for order in [0, 3, 8, 16] {
                let harmonic = Harmonic::<f64>::new(lambda, order).unwrap();
                let (mut r, mut s) = (vec![0.0; harmonic.len()], vec![0.0; harmonic.len()]);
                harmonic.regular(y, &mut r);
                harmonic.singular(x, &mut s);
                let sum: f64 = r.iter().zip(&s).map(|(r, s)| r * s).sum();
                let bound = 40.0 * 0.1f64.powi(order as i32 + 1) * (order as f64 + 1.0).powi(3);
                let error = (sum / exact - 1.0).abs();
                assert!(error < bound.max(1e-13), "λ = {lambda}, p = {order}: {error:e}");
            }
        }
    }

    #[test]
    fn gradients_agree_with_differences() {
        let x = DVec3::new(0.7, -0.4, 1.1);
        let h = 1e-5;
        for lambda in LAMBDAS {
            let harmonic = Harmonic::<f64>::new(lambda, 7).unwrap();
            let len = harmonic.len();
            let (mut values, mut up, mut down) = (vec![0.0; len], vec![0.0; len], vec![0.0; len]);
            let mut gradients = vec![[0.0; 3]; len];
            for singular in [false, true] {
                let evaluate = |x, out: &mut [f64]| {
                    if singular { harmonic.singular(x, out) } else { harmonic.regular(x, out) }
                };
                if singular {
                    harmonic.singular_gradient(x, &mut values, &mut gradients);
                } else {
                    harmonic.regular_gradient(x, &mut values, &mut gradients);
                }
                evaluate(x, &mut up);
                assert_eq!(values, up);
                for (c, axis) in DVec3::AXES.into_iter().enumerate() {
                    evaluate(x + axis * h, &mut up);
                    evaluate(x - axis * h, &mut down);
                    for (gradient, (up, down)) in gradients.iter().zip(up.iter().zip(&down)) {
                        let error = (gradient[c] - (up - down) / (2.0 * h)).abs();
                        assert!(error < 1e-6 * (1.0 + gradient[c].abs()));
                    }
                }
            }
        }
    }

    #[test]
    fn the_centre_and_the_poles_are_no_trouble() {
        let harmonic = Harmonic::<f64>::new(2.0, 20).unwrap();
        let mut values = vec![f64::NAN; harmonic.len()];
        let mut gradients = vec![[f64::NAN; 3]; harmonic.len()];
        for y in [DVec3::ZERO, DVec3::Z, -DVec3::Z] {
            harmonic.regular_gradient(y, &mut values, &mut gradients);
            assert!(values.iter().chain(gradients.as_flattened()).all(|v| v.is_finite()));
        }
        for x in [DVec3::Z, -DVec3::Z] {
            harmonic.singular_gradient(x, &mut values, &mut gradients);
            assert!(values.iter().chain(gradients.as_flattened()).all(|v| v.is_finite()));
        }
    }

    #[test]
    fn far_points_do_not_overflow_in_single_precision() {
        let harmonic = Harmonic::<f32>::new(0.5, 40).unwrap();
        let mut values = vec![f32::NAN; harmonic.len()];
        harmonic.singular(glam::Vec3::new(1e6, -2e6, 3e5), &mut values);
        assert!(values.iter().all(|v| v.is_finite()));
    }
}
