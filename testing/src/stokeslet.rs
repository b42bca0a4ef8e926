//! A kernel whose charges and values are vectors.

use farfield::{Kernel, PointKernel};
use glam::DVec3;

/// The slow flow that forces cause: K(x, y) = 1/r + d dᵀ/r³, d = x − y, a 3 × 3 matrix; 0 at r = 0.
#[derive(Clone, Copy, Debug)]
pub struct Stokeslet;

impl Kernel for Stokeslet {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = [f64; 3];
    type Value = [f64; 3];

    #[inline(always)]
    fn add(&self, x: &DVec3, y: &DVec3, q: &[f64; 3], u: &mut [f64; 3]) {
        let (d, q) = (*x - *y, DVec3::from_array(*q));
        let r2 = d.length_squared();
        let inverse = if r2 > 0.0 { 1.0 / r2.sqrt() } else { 0.0 };
        let flow = (q + d * (d.dot(q) * inverse * inverse)) * inverse;
        *u = (DVec3::from_array(*u) + flow).to_array();
    }
}

impl PointKernel for Stokeslet {
    type Entry = f64;
    type Column = f64;
    const DENSITIES: usize = 3;
    const FIELDS: usize = 3;

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        let d = x - y;
        let inverse = 1.0 / d.length();
        let along = d * inverse;
        for (i, row) in g.chunks_exact_mut(3).enumerate() {
            let unit = DVec3::AXES[i];
            row.copy_from_slice(&((unit + along * along[i]) * inverse).to_array());
        }
    }

    fn density(&self, _y: &DVec3, q: &[f64; 3], d: &mut [f64]) {
        d.copy_from_slice(q);
    }

    fn value(&self, _x: &DVec3, fields: &[f64], _gradients: &[[f64; 3]], u: &mut [f64; 3]) {
        u.iter_mut().zip(fields).for_each(|(u, field)| *u += field);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield::Interpolation;
    use farfield::conformance::{Samples, check, check_point_kernel};

    #[test]
    fn the_matrix_is_the_kernel_and_obeys_the_laws_of_expansions() {
        let samples = Samples {
            source: |p: DVec3, _| p,
            target: |p: DVec3, _| p,
            charge: |i| [1.0, -2.0, 0.5].map(|q| q + (i as f64).cos()),
        };
        check_point_kernel(&Stokeslet, &samples, 1e-14).unwrap();
        check(Interpolation::new(Stokeslet).order(7), &samples, 1e-3).unwrap();
    }
}
