//! The gathered light held against direct summation, at some of the surfels.

use std::time::Instant;

use farfield::{Kernel, Mask, relative_l2_error};
use farfield_radiosity::{Irradiance, Surfel, Visibility};
use rayon::prelude::*;

use crate::shading::Rgb;

/// How well, and at which cost, direct summation does the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Check {
    /// Number of surfels at which light was summed directly.
    pub(crate) sampled: usize,
    /// Relative l2 error of the gathered light there.
    pub(crate) relative_l2_error: f64,
    /// Seconds to find out for all pairs of surfels which see each other, extrapolated.
    pub(crate) visibility_s: f64,
    /// Seconds to sum once over all pairs that do, extrapolated.
    pub(crate) sum_s: f64,
}

impl Check {
    /// Compares `gathered`, the irradiance caused by `radiosity`, with direct sums at `samples` surfels
    /// or, if there are fewer, at all.
    pub(crate) fn new(
        surfels: &[Surfel],
        visibility: &Visibility<'_>,
        radiosity: &[Rgb],
        gathered: &[Rgb],
        samples: usize,
    ) -> Self {
        let kernel = Irradiance::<f64, Rgb>::clamped();
        let sample = spread(surfels.len(), samples);
        let extrapolated = |start: Instant| {
            start.elapsed().as_secs_f64() * surfels.len() as f64 / sample.len() as f64
        };

        let start = Instant::now();
        let sees = |i: usize, j: usize| {
            Mask::<Irradiance<f64, Rgb>>::pair(visibility, &surfels[i], &surfels[j])
        };
        let seen: Vec<Vec<usize>> = sample
            .par_iter()
            .map(|&i| (0..surfels.len()).filter(|&j| sees(i, j)).collect())
            .collect();
        let visibility_s = extrapolated(start);

        let start = Instant::now();
        let sum = |(&i, seen): (&usize, &Vec<usize>)| {
            let mut sum = [0.0; 3];
            for &j in seen {
                kernel.add(&surfels[i], &surfels[j], &radiosity[j], &mut sum);
            }
            sum
        };
        let exact: Vec<Rgb> = sample.par_iter().zip(&seen).map(sum).collect();
        let sum_s = extrapolated(start);

        let found: Vec<Rgb> = sample.iter().map(|&i| gathered[i]).collect();
        let relative_l2_error = relative_l2_error(&found, &exact);
        Self { sampled: sample.len(), relative_l2_error, visibility_s, sum_s }
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
    use crate::cornell::Scene;
    use crate::surfels::{Surfels, triangles};
    use farfield::direct_masked;
    use farfield_radiosity::Occluders;

    #[test]
    fn direct_sums_pass_and_wrong_ones_show_their_error() {
        let scene = Scene::cornell_box();
        let occluders = Occluders::new(&triangles(&scene)).expect("finite");
        let visibility = Visibility::new(&occluders);
        let Surfels { surfels, emission, .. } = Surfels::new(&scene, 400);
        let kernel = Irradiance::<f64, Rgb>::clamped();
        let exact = direct_masked(&kernel, &visibility, &surfels, &emission, &surfels);
        let check = |gathered: &[Rgb]| Check::new(&surfels, &visibility, &emission, gathered, 100);
        assert_eq!(check(&exact).sampled, 100);
        assert!(check(&exact).relative_l2_error < 1e-15);
        let brighter: Vec<Rgb> = exact.iter().map(|h| h.map(|band| 1.01 * band)).collect();
        assert!((check(&brighter).relative_l2_error - 0.01).abs() < 1e-6);
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
