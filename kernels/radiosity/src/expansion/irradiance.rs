//! The radiosity kernel.

use std::fmt;
use std::marker::PhantomData;

use farfield::{DispatchLevel, Kernel, Numbers, Point, Real, Vector};

use crate::elements::{Projections, Surfel};
use crate::expansion::near_field::{Block, Pairs};

/// The irradiance that surfels of given radiosity cause on others, visibility aside:
///
/// H(x) = Σ_y K(x, y) A_y B(y),   K(x, y) = cos θ_x cos θ_y / (π r²),
///
/// with r cos θ_y = n_y·(x − y), r cos θ_x = n_x·(y − x), r = |x − y|.
///
/// The [`clamped`](Self::clamped) kernel is the physical one: zero unless each lies in front of the other,
/// however close they are. It isn't smooth where a cosine changes sign, so a fast sum needs the mask [`Facing`](crate::Facing) or [`Visibility`](crate::Visibility), which let
/// expansions act only where the two kernels agree. The [`signed`](Self::signed) kernel is smooth
/// and needs none, but in its sums the back of a surface takes away what its front gives.
///
/// The charge is the radiosity B [W/m²], the value is H in the same units; `C` is a number or, for
/// several bands, an array. Both kernels are 0 at coincident points.
///
/// As a formula: densities n_y A_y B (3), entries T_ij = d_i d_j / (π r⁴) with d = x − y, and
/// H = −n_x·Φ from the fields Φ (3), the irradiance vector. T is a degree −2 homogeneous tensor,
/// symmetric in (i, j); unlike the numerator multiplied out, it doesn't cancel at grazing angles.
pub struct Irradiance<T, C = T> {
    clamped: bool,
    types: PhantomData<fn(T) -> C>,
}

impl<T, C> Irradiance<T, C> {
    /// The kernel with cosines clamped at zero: back sides neither radiate nor receive.
    pub fn clamped() -> Self {
        Self { clamped: true, types: PhantomData }
    }

    /// The kernel with signed cosines.
    pub fn signed() -> Self {
        Self { clamped: false, types: PhantomData }
    }
}

impl<T: Real, C> Irradiance<T, C> {
    /// K(x, y), per unit area of y.
    #[inline(always)]
    pub fn factor(&self, x: &Surfel<T>, y: &Surfel<T>) -> T {
        let pair = Projections::new(x, y);
        let zero = T::from_f64(0.0);
        let counts = if self.clamped { pair.in_front() } else { pair.distance_squared > zero };
        if counts { pair.kernel() } else { zero }
    }
}

impl<T: Real, C: Numbers<Real = T>> Irradiance<T, C> {
    fn block(
        &self,
        xs: &[Surfel<T>],
        ys: &[Surfel<T>],
        qs: &[C],
        pairs: Pairs<'_>,
        tolerance: f64,
        us: &mut [C],
    ) {
        Block { clamped: self.clamped, xs, ys, qs, pairs, tolerance, us }.run();
    }
}

impl<T, C> Clone for Irradiance<T, C> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T, C> Copy for Irradiance<T, C> {}

impl<T, C> Default for Irradiance<T, C> {
    fn default() -> Self {
        Self::clamped()
    }
}

impl<T, C> fmt::Debug for Irradiance<T, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Irradiance").field("clamped", &self.clamped).finish()
    }
}

impl<T: Real, C: Numbers<Real = T>> Kernel for Irradiance<T, C> {
    type Real = T;
    type Source = Surfel<T>;
    type Target = Surfel<T>;
    type Charge = C;
    type Value = C;
    type Entry = T;

    fn add_block(
        &self,
        xs: &[Surfel<T>],
        ys: &[Surfel<T>],
        qs: &[C],
        tolerance: f64,
        us: &mut [C],
    ) {
        self.block(xs, ys, qs, Pairs::All, tolerance, us);
    }

    fn add_pairs(
        &self,
        xs: &[Surfel<T>],
        ys: &[Surfel<T>],
        qs: &[C],
        bits: &[u64],
        tolerance: f64,
        us: &mut [C],
    ) {
        self.block(xs, ys, qs, Pairs::Set(bits), tolerance, us);
    }

    /// Measured on one AVX-512 machine at every level.
    fn pair_seconds(&self, tolerance: f64) -> f64 {
        match DispatchLevel::in_force() {
            Ok(DispatchLevel::Avx512 | DispatchLevel::Avx2) if tolerance >= 1e-7 => 5e-10,
            Ok(DispatchLevel::Avx512 | DispatchLevel::Avx2) => 1e-9,
            _ => 4.5e-9,
        }
    }

    /// Clamping is not in the entries.
    fn has_parameters(&self) -> bool {
        false
    }

    #[inline(always)]
    fn fields(&self) -> usize {
        3
    }

    #[inline(always)]
    fn densities(&self) -> usize {
        3
    }

    #[inline(always)]
    fn columns(&self) -> usize {
        C::LEN
    }

    #[inline(always)]
    fn entries(&self, x: Point<T>, y: Point<T>, g: &mut [T]) {
        let d = x - y;
        let r2 = d.length_squared();
        let [a, b, c] = d.to_array().map(|component| component / r2);
        let [pa, pb, pc] = [a, b, c].map(|component| component * T::FRAC_1_PI());
        let (ab, ac, bc) = (pa * b, pa * c, pb * c);
        g.copy_from_slice(&[pa * a, ab, ac, ab, pb * b, bc, ac, bc, pc * c]);
    }

    #[inline(always)]
    fn density(&self, y: &Surfel<T>, q: &C, d: &mut [T]) {
        for (density, n) in d.chunks_exact_mut(C::LEN.max(1)).zip(y.normal.to_array()) {
            for (column, density) in density.iter_mut().enumerate() {
                *density = n * y.area * q.number(column);
            }
        }
    }

    #[inline(always)]
    fn value(&self, x: &Surfel<T>, fields: &[T], _gradients: &[[T; 3]], u: &mut C) {
        for (field, n) in fields.chunks_exact(C::LEN.max(1)).zip(x.normal.to_array()) {
            for (column, &field) in field.iter().enumerate() {
                u.set_number(column, u.number(column) - n * field);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use farfield::conformance::{Samples, check, check_kernel};
    use farfield::{Interpolation, direct};
    use glam::DVec3;

    fn surfel(position: [f64; 3], normal: [f64; 3], area: f64) -> Surfel {
        let normal = DVec3::from_array(normal).normalize();
        Surfel { position: position.into(), normal, area, face: Surfel::<f64>::NO_FACE }
    }

    #[test]
    fn two_parallel_surfels_at_unit_distance_exchange_one_over_pi() {
        let x = surfel([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], 9.0);
        let y = surfel([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.5);
        let h = direct(&Irradiance::clamped(), &[y], &[4.0], &[x]).unwrap();
        assert_relative_eq!(h[0], 4.0 * 0.5 / std::f64::consts::PI, max_relative = 1e-15);
    }

    #[test]
    fn clamping_removes_back_sides_and_the_sign_keeps_them() {
        let x = surfel([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 1.0);
        let y = surfel([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0);
        let clamped = Irradiance::<f64>::clamped();
        let signed = Irradiance::<f64>::signed();
        assert_eq!(clamped.factor(&x, &y), 0.0);
        assert_relative_eq!(signed.factor(&x, &y), -1.0 / std::f64::consts::PI);
        // Both look away: the signed product of two negative cosines is positive, the clamped is 0.
        let away = surfel([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 1.0);
        assert_eq!(clamped.factor(&x, &away), 0.0);
        assert_relative_eq!(signed.factor(&x, &away), 1.0 / std::f64::consts::PI);
    }

    #[test]
    fn coincident_points_exchange_nothing() {
        let x = surfel([1.0, 2.0, 3.0], [0.0, 0.0, 1.0], 1.0);
        assert_eq!(Irradiance::<f64>::clamped().factor(&x, &x), 0.0);
        assert_eq!(Irradiance::<f64>::signed().factor(&x, &x), 0.0);
    }

    #[test]
    fn the_tensor_form_equals_the_kernel_and_obeys_the_laws_of_expansions() {
        let normal = |i: usize| [1.0, 2.0, 3.0].map(|k| (k * (i as f64 + 0.5)).sin());
        let samples = Samples {
            source: |p: DVec3, i| surfel(p.to_array(), normal(i), 1.0 + i as f64),
            target: |p: DVec3, i| surfel(p.to_array(), normal(i + 100), 1.0),
            charge: |i| [1.0, -2.0, 0.5].map(|b| b + (i as f64).cos()),
        };
        let kernel = Irradiance::<f64, [f64; 3]>::signed();
        check_kernel(&kernel, &samples, 1e-14).unwrap();
        check(Interpolation::new(kernel).order(5), &samples, 5e-2).unwrap();
    }

    #[test]
    fn tiny_scenes_do_not_underflow() {
        let scale = 1e-12_f32;
        let at = |z: f32, n: f32| Surfel::<f32> {
            position: glam::Vec3::new(0.0, 0.0, z * scale),
            normal: glam::Vec3::new(0.0, 0.0, n),
            area: 1.0,
            face: Surfel::<f32>::NO_FACE,
        };
        let factor = Irradiance::<f32>::clamped().factor(&at(1.0, -1.0), &at(0.0, 1.0));
        assert_relative_eq!(factor, std::f32::consts::FRAC_1_PI * 1e24, max_relative = 1e-5);
    }
}
