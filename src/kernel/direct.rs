//! Direct sums, the reference that every fast path is held against.

use crate::dispatch_level::DispatchLevel;
use crate::error::Error;
use crate::kernel::ordinary::check_range;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Numbers, l2_norm};
use crate::parallel;
use crate::parallel::watch::{Phase, Watch};

/// Direct summation u_i = Σ_j K(x_i, y_j) q_j over all pairs, in parallel over targets, each sum in
/// the order of the sources. O(N·M).
///
/// # Errors
/// [`Error::LengthMismatch`] if there is not one charge per source; those of
/// [`Kernel::check_sizes`]; [`Error::ChargeTooLong`] if a charge
/// is a list of more numbers than the kernel takes; [`Error::KernelOutOfRange`] if points extend so far, or so little,
/// that what the kernel gives between most of them is too small for its precision.
pub fn direct<K: Kernel>(
    kernel: &K,
    sources: &[K::Source],
    charges: &[K::Charge],
    targets: &[K::Target],
) -> Result<Vec<K::Value>, Error> {
    direct_watched(kernel, sources, charges, targets, &Watch::default())
}

/// The same sums as [`direct`], to the bit, while a watch looks on that can stop them.
///
/// # Errors
/// As [`direct`], or [`Error::Stopped`].
pub fn direct_watched<K: Kernel>(
    kernel: &K,
    sources: &[K::Source],
    charges: &[K::Charge],
    targets: &[K::Target],
    watch: &Watch,
) -> Result<Vec<K::Value>, Error> {
    check_charges(kernel, sources.len(), charges)?;
    check_range(kernel, sources, targets)?;
    let mut values = vec![K::Value::zero(); targets.len()];
    add_all(kernel, (sources, charges), targets, 0.0, &mut values, watch);
    watch.check()?;
    Ok(values)
}

/// Adds the fields of all sources to the values at all targets, in blocks that fill registers and stay in caches. Each
/// pair may be off by a relative error of `tolerance`. Once `watch` is stopped, the values are not to be used.
pub(crate) fn add_all<K: Kernel>(
    kernel: &K,
    (sources, charges): (&[K::Source], &[K::Charge]),
    targets: &[K::Target],
    tolerance: f64,
    values: &mut [K::Value],
    watch: &Watch,
) {
    watch.begin(Phase::Values, targets.len());
    parallel::for_each_piece(values, DIRECT_BLOCK, &|block, us| {
        let xs = &targets[DIRECT_BLOCK * block..][..us.len()];
        for (ys, qs) in sources.chunks(DIRECT_RUN).zip(charges.chunks(DIRECT_RUN)) {
            if watch.is_stopped() {
                return;
            }
            kernel.add_block(xs, ys, qs, tolerance, us);
        }
        watch.advance(us.len());
    });
}

/// Refuses any other number of charges than one per source, and lists of numbers that would be left over.
pub(crate) fn check_charges<K: Kernel>(
    kernel: &K,
    sources: usize,
    charges: &[K::Charge],
) -> Result<(), Error> {
    kernel.check_sizes()?;
    DispatchLevel::in_force()?;
    let (expected, found) = (sources, charges.len());
    if expected != found {
        return Err(Error::LengthMismatch { what: "charges", expected, found });
    }
    // Other charges have the length of their type.
    if K::Charge::LEN == 0 {
        let expected = kernel.charge_len();
        let too_long = |q: &K::Charge| q.count() > expected;
        if let Some(index) = charges.iter().position(too_long) {
            return Err(Error::ChargeTooLong { index, expected, found: charges[index].count() });
        }
    }
    Ok(())
}

/// Targets per parallel task of a direct sum.
const DIRECT_BLOCK: usize = 64;
/// Sources per block of a direct sum: they stay in the first-level cache while the targets pass.
const DIRECT_RUN: usize = 1024;

/// Relative l2 error ‖a − b‖ / ‖b‖ of `values` against `reference`; the absolute one where the
/// reference vanishes, and infinity where there is not one value for each of the reference.
pub fn relative_l2_error<V: Numbers>(values: &[V], reference: &[V]) -> f64 {
    if values.len() != reference.len() {
        return f64::INFINITY;
    }
    let differences = values.iter().zip(reference).map(|(value, exact)| {
        let mut difference = value.clone();
        difference.subtract(exact);
        difference
    });
    let (error, norm) = (l2_norm(differences), l2_norm(reference.iter().cloned()));
    if norm > 0.0 { error / norm } else { error }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::closure::from_fn;
    use glam::DVec3;

    #[test]
    fn the_error_of_a_vanishing_reference_is_absolute() {
        assert_eq!(relative_l2_error::<f64>(&[3.0, 4.0], &[0.0, 0.0]), 5.0);
        assert_eq!(relative_l2_error::<f64>(&[1.0, 3.0], &[1.0, 2.0]), 1.0 / 5f64.sqrt());
    }

    #[test]
    fn errors_of_any_size_of_values_are_seen() {
        for unit in [1e-300, 1e-160, 1e160, 1e300] {
            let error = relative_l2_error::<f64>(&[unit, 3.0 * unit], &[unit, 2.0 * unit]);
            assert!((error - 1.0 / 5f64.sqrt()).abs() < 1e-12, "{unit:e}: {error:e}");
        }
        assert!(relative_l2_error(&[f64::NAN, 1.0], &[1.0, 1.0]).is_nan());
    }

    #[test]
    fn lengths_that_differ_are_refused() {
        let kernel = from_fn(|x: DVec3, y: DVec3| x.distance(y));
        let refused = direct(&kernel, &[DVec3::X], &[1.0, 2.0], &[DVec3::Y]);
        assert!(matches!(refused, Err(Error::LengthMismatch { expected: 1, found: 2, .. })));
        assert_eq!(relative_l2_error(&[1.0], &[1.0, 1.0]), f64::INFINITY);
    }
}
