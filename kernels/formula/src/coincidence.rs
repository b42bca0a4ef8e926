//! Derivatives where a target and a source are at one place.

use std::collections::HashMap;

use farfield::{Error, Point, Vector};

use crate::formula::{Coincident, TextFormula};
use crate::plan::Derivatives;
use crate::precision::Precision;

/// Refuses derivatives where points coincide, such pairs count, and the kernel has a value there but no derivatives.
/// O(1) unless it has none; O(N) otherwise.
pub(crate) fn check_derivatives<T: Precision>(
    kernel: &TextFormula,
    sources: &[Point<T>],
    targets: &[Point<T>],
    derivatives: Derivatives,
) -> Result<(), Error> {
    let counts = kernel.at_coincident_points() == Coincident::Formula;
    if derivatives == Derivatives::None || !counts || targets.is_empty() {
        return Ok(());
    }
    let place = &targets[..1];
    let charge = vec![T::from_f64(1.0); kernel.columns()];
    let sums = T::direct_sums(kernel, place, &charge, place, derivatives)?;
    let (values, slopes) = sums.split_at(kernel.rows());
    let are_finite = |numbers: &[T]| numbers.iter().all(|x| x.as_f64().is_finite());
    if !are_finite(values) || are_finite(slopes) {
        return Ok(());
    }
    // Zeros of either sign are one place.
    let key = |p: &Point<T>| p.to_array().map(|c| (c.as_f64() + 0.0).to_bits());
    let known: HashMap<_, _> =
        sources.iter().enumerate().rev().map(|(from, y)| (key(y), from)).collect();
    let pair =
        targets.iter().enumerate().find_map(|(target, x)| Some((target, *known.get(&key(x))?)));
    match pair {
        Some((target, from)) => Err(Error::NotDifferentiable { target, from }),
        None => Ok(()),
    }
}
