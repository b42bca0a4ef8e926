//! Weights under which the entries of a kernel are of one size.

use crate::expansion::weights::Weights;
use crate::interpolation::entries::{Entries, PointOf};
use crate::interpolation::probe::sample;
use crate::interpolation::tuning::{BALANCE_STEPS, BALANCED_PAIRS, BALANCED_RANGE};
use crate::numbers::traits::{Numbers, Scalar};
use crate::octree::geometry::Cube;

/// The weights of a kernel for pairs within a root: a_i b_j |G_ij| is about the same for all entries, on geometric
/// average. They are even where entries differ by less than units make them differ.
pub(crate) fn weights<S: Scalar>(kernel: &Entries<'_, S>, root: &Cube<S::Real>) -> Weights {
    let (rows, columns) = (kernel.fields, kernel.densities);
    if rows * columns < 2 {
        return Weights::default();
    }
    let sizes = log_sizes(kernel, root);
    // log |G_ij| + α_i + β_j is nearest to 0 in the sense of least squares, one side after the other.
    let (mut alpha, mut beta) = (vec![0.0; rows], vec![0.0; columns]);
    for _ in 0..BALANCE_STEPS {
        let row = |i: usize| {
            (0..columns).filter_map(|j| Some(sizes[i * columns + j]? + beta[j])).collect()
        };
        alpha = (0..rows).map(row).map(|row: Vec<f64>| -mean(&row)).collect();
        let column =
            |j: usize| (0..rows).filter_map(|i| Some(sizes[i * columns + j]? + alpha[i])).collect();
        beta = (0..columns).map(column).map(|column: Vec<f64>| -mean(&column)).collect();
    }
    let (alpha, beta) = (centred(alpha), centred(beta));
    let largest = alpha.iter().chain(&beta).fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if 2.0 * largest < BALANCED_RANGE {
        return Weights::default();
    }
    let weights = |logs: Vec<f64>| logs.into_iter().map(|log| log.round().exp2()).collect();
    let mut found = Weights::default();
    (found.fields, found.densities) = (weights(alpha), weights(beta));
    found
}

/// The means of log₂ |G_ij| over sample pairs; none of an entry that is zero, or not finite, at all of them.
fn log_sizes<S: Scalar>(kernel: &Entries<'_, S>, root: &Cube<S::Real>) -> Vec<Option<f64>> {
    let mut logs = vec![Vec::new(); kernel.fields * kernel.densities];
    let at = |k: usize| root.centre() + sample::<S::Real>(k) * root.half_width();
    for i in 0..BALANCED_PAIRS {
        let (x, y): (PointOf<S>, PointOf<S>) = (at(2 * i), at(2 * i + 1));
        for (logs, entry) in logs.iter_mut().zip(kernel.at(x, y)) {
            logs.push(0.5 * entry.norm_squared().log2());
        }
    }
    let finite = |logs: Vec<f64>| logs.into_iter().filter(|log| log.is_finite()).collect();
    let known = |logs: Vec<f64>| (!logs.is_empty()).then(|| mean(&logs));
    logs.into_iter().map(finite).map(known).collect()
}

/// The mean; 0 of nothing.
fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len().max(1) as f64
}

/// Numbers less the middle of their range.
fn centred(numbers: Vec<f64>) -> Vec<f64> {
    let least = numbers.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    numbers.into_iter().map(|number| number - 0.5 * (least + largest)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::entries::pairwise;
    use glam::DVec3;

    /// Values and derivatives of charges and dipoles, in cubes of that size.
    fn of_units(size: f64) -> Weights {
        let block = pairwise(4, |x, y, g| {
            let (d, r) = (x - y, x.distance(y));
            g.copy_from_slice(&[1.0 / r, d.x / r.powi(3), d.x / r.powi(3), 1.0 / r.powi(3)]);
        });
        weights(&Entries::new(2, 2, &block), &Cube::new(DVec3::ONE, size))
    }

    #[test]
    fn entries_in_any_units_are_brought_to_one_size() {
        assert!(of_units(1.0).are_even());
        for size in [1e-9, 1e-3, 1e6] {
            let Weights { fields: a, densities: b } = of_units(size);
            assert_eq!(a, b, "a symmetric kernel stays symmetric");
            let ratio = a[1] / a[0] / size;
            assert!((0.1..10.0).contains(&ratio), "{size}: {ratio}");
        }
    }

    #[test]
    fn what_is_zero_has_no_size() {
        let block = pairwise(2, |x, y, g| g.copy_from_slice(&[1e9 / x.distance(y), 0.0]));
        let root = Cube::new(DVec3::ONE, 1.0);
        assert!(
            weights(&Entries::new(1, 2, &block), &root).densities.iter().all(|b| b.is_finite())
        );
    }
}
