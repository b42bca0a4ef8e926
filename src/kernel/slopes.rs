//! The derivatives of a kernel's entries, where they are asked for or not.

use num_traits::Float;

use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::{Numbers, Point, Real, Scalar, Vector};

/// Writes ∂G/∂x for all pairs of a block: as the entries, with three rows for each field. What a kernel
/// declines to say is taken from differences.
pub(crate) fn write_slopes<K: Kernel>(
    kernel: &K,
    xs: &[Point<K::Real>],
    ys: &[Point<K::Real>],
    g: &mut [K::Entry],
) {
    let (fields, densities) = (kernel.fields(), kernel.densities());
    let mut slopes = vec![[<K::Entry as Numbers>::zero(); 3]; fields * densities];
    let pairs = xs.iter().flat_map(|x| ys.iter().map(move |y| (*x, *y)));
    for ((x, y), g) in pairs.zip(g.chunks_exact_mut(3 * fields * densities)) {
        if kernel.entry_gradients(x, y, &mut slopes) == Outcome::Declined {
            differences(kernel, x, y, &mut slopes);
        }
        for (k, slope) in slopes.iter().enumerate() {
            let (field, density) = (k / densities, k % densities);
            for (axis, &part) in slope.iter().enumerate() {
                g[(3 * field + axis) * densities + density] = part;
            }
        }
    }
}

/// Derivatives to about ε^⅔, by central differences.
fn differences<K: Kernel>(
    kernel: &K,
    x: Point<K::Real>,
    y: Point<K::Real>,
    slopes: &mut [[K::Entry; 3]],
) {
    let d = (x - y).to_array();
    let step = d.into_iter().fold(K::Real::from_f64(0.0), Float::hypot) * K::Real::epsilon().cbrt();
    let mut sides = vec![<K::Entry as Numbers>::zero(); 2 * slopes.len()];
    for axis in 0..3 {
        let mut along = [K::Real::from_f64(0.0); 3];
        along[axis] = step;
        let along = Point::<K::Real>::from_array(along);
        let (before, after) = sides.split_at_mut(slopes.len());
        kernel.entries(x - along, y, before);
        kernel.entries(x + along, y, after);
        let per_length = K::Entry::from_real((step + step).recip());
        for (slope, (&a, &b)) in slopes.iter_mut().zip(before.iter().zip(&*after)) {
            slope[axis] = (b - a) * per_length;
        }
    }
}
