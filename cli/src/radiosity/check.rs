//! The gathered light held against direct summation, at some of the elements.

use std::time::Instant;

use farfield::{Mask, relative_l2_error};
use farfield_radiosity::{Irradiance, Visibility};
use rayon::prelude::*;

use super::solve::Exchange;

/// How well, and at which cost, direct summation does the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Check {
    /// Number of elements at which light was summed directly.
    pub(crate) sampled: usize,
    /// Relative l2 error of the gathered light there, all bands together; 0 where there is none.
    pub(crate) relative_l2_error: f64,
    /// Whether no light arrives there, by either sum: then a relative error says nothing.
    pub(crate) is_dark: bool,
    /// Seconds to find out for all pairs of elements which see each other, extrapolated.
    pub(crate) visibility_s: f64,
    /// Seconds to sum once over all pairs that do, extrapolated.
    pub(crate) sum_s: f64,
}

impl Check {
    /// Compares `gathered`, the irradiance caused by `radiosity`, with direct sums at `samples` elements
    /// or, if there are fewer, at all: every pair by itself, its visibility by a ray of `visibility`,
    /// near pairs corrected alike.
    pub(crate) fn new<const BANDS: usize>(
        exchange: &Exchange<'_, BANDS>,
        visibility: &Visibility<'_>,
        radiosity: &[[f64; BANDS]],
        gathered: &[[f64; BANDS]],
        samples: usize,
    ) -> Self {
        let Exchange { surfels, operator, .. } = exchange;
        let kernel = Irradiance::<f64, [f64; BANDS]>::clamped();
        let sample = spread(surfels.len(), samples);
        let extrapolated = |start: Instant| {
            start.elapsed().as_secs_f64() * surfels.len() as f64 / sample.len().max(1) as f64
        };

        let start = Instant::now();
        let sees = |i: usize, j: usize| {
            Mask::<Irradiance<f64, [f64; BANDS]>>::pair(visibility, &surfels[i], &surfels[j])
        };
        let seen_from = |&i: &usize| -> Vec<(usize, f64)> {
            let shares = (0..surfels.len()).map(|j| (j, sees(i, j)));
            shares.filter(|&(_, share)| share > 0.0).collect()
        };
        let seen: Vec<Vec<(usize, f64)>> = sample.par_iter().map(seen_from).collect();
        let visibility_s = extrapolated(start);

        let start = Instant::now();
        let scaled: Vec<[f64; BANDS]> =
            radiosity.iter().enumerate().map(|(j, b)| b.map(|b| operator.scaling(j) * b)).collect();
        let mut near = vec![[0.0; BANDS]; surfels.len()];
        operator.corrections().add(&scaled, &mut near);
        let sum = |(&i, seen): (&usize, &Vec<(usize, f64)>)| {
            let mut sum = near[i];
            for &(j, share) in seen {
                let factor = share * kernel.factor(&surfels[i], &surfels[j]) * surfels[j].area;
                for (sum, band) in sum.iter_mut().zip(scaled[j]) {
                    *sum += factor * band;
                }
            }
            let own = operator.own_factor(i);
            std::array::from_fn(|k| operator.scaling(i) * sum[k] + own * radiosity[i][k])
        };
        let exact: Vec<[f64; BANDS]> = sample.par_iter().zip(&seen).map(sum).collect();
        let sum_s = extrapolated(start);

        let found: Vec<[f64; BANDS]> = sample.iter().map(|&i| gathered[i]).collect();
        let relative_l2_error = relative_l2_error(&found, &exact);
        let is_dark = found.iter().chain(&exact).flatten().all(|&h| h == 0.0);
        Self { sampled: sample.len(), relative_l2_error, is_dark, visibility_s, sum_s }
    }
}

/// `count` indices below `n`, or all if there are no more, spread evenly and in step with no grid:
/// the multiples of the golden section, modulo 1.
fn spread(n: usize, count: usize) -> Vec<usize> {
    if count >= n {
        return (0..n).collect();
    }
    let golden = (5f64.sqrt() - 1.0) / 2.0;
    let mut taken = vec![false; n];
    for k in 0..count {
        let start = ((k as f64 * golden).fract() * n as f64) as usize;
        // The next free one: close to n, two multiples may fall on the same index.
        let free = (start..n).chain(0..start).find(|&i| !taken[i]).expect("count < n");
        taken[free] = true;
    }
    (0..n).filter(|&i| taken[i]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiosity::fixture::exchanging;

    #[test]
    fn direct_sums_pass_and_wrong_ones_show_their_error() {
        exchanging("cornell", 400, None, |_, mesh, exchange| {
            let radiosity: Vec<_> = (0..mesh.elements.len()).map(|i| [(i % 5) as f64]).collect();
            let exact = exchange.operator.apply(&radiosity).expect("applied");
            let check = |gathered: &[[f64; 1]]| {
                Check::new(exchange, exchange.visibility, &radiosity, gathered, 100)
            };
            assert_eq!(check(&exact).sampled, 100);
            assert!(check(&exact).relative_l2_error < 1e-14);
            let brighter: Vec<_> = exact.iter().map(|h| h.map(|band| 1.01 * band)).collect();
            assert!((check(&brighter).relative_l2_error - 0.01).abs() < 1e-6);
            let nothing = vec![[0.0]; exact.len()];
            assert!(!check(&brighter).is_dark && !check(&nothing).is_dark);
            let dark = Check::new(exchange, exchange.visibility, &nothing, &nothing, 100);
            assert!(dark.is_dark);
        });
    }

    #[test]
    fn samples_are_distinct_and_spread() {
        for (n, count) in [(10_000, 500), (501, 500), (7, 500), (0, 500)] {
            let sample = spread(n, count);
            assert_eq!(sample.len(), count.min(n));
            assert!(sample.is_sorted_by(|a, b| a < b) && sample.iter().all(|&i| i < n));
        }
        let sample = spread(10_000, 500);
        assert!(sample.windows(2).all(|w| w[1] - w[0] < 60));
    }
}
