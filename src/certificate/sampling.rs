//! Drawing targets at random, and what a sum over all of them may be.

use crate::error::Error;
use crate::numbers::random::Random;

/// How many targets a [`Certificate`](crate::Certificate) is drawn from.
///
/// Samples are doubled until the bound is tight enough. A confidence bound on a sum of squares needs to
/// know how large a square that was not drawn may be: it is taken to be at most twice the largest that
/// was, relative to the probability of drawing it. That probability is a mean of three: the same for all
/// targets, by the square of what the near field brings, and by that of what expansions bring. The
/// draws are spread evenly over space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// The probability that the bound has to hold with, between 0 and 1; default 0.99.
    pub confidence: f64,
    /// The bound is tight enough when it is this many times the estimate; default 1.5.
    pub tightness: f64,
    /// The most targets to draw, 2 or more; default 4096. Each costs a pass over all sources. If all
    /// targets are hardly more than what would be drawn, and no more than this, all are taken.
    pub max_samples: usize,
    /// Where the random numbers start; default 0.
    pub seed: u64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { confidence: 0.99, tightness: 1.5, max_samples: 4096, seed: 0 }
    }
}

impl Sampling {
    pub(crate) fn check(&self) -> Result<(), Error> {
        let Self { confidence, tightness, max_samples, .. } = *self;
        let refuse = |what, found, expected| Err(Error::InvalidSampling { what, found, expected });
        if !(confidence > 0.0 && confidence < 1.0) {
            return refuse("confidence", confidence, "a number between 0 and 1, both excluded");
        }
        if tightness.is_nan() || tightness < 1.0 {
            return refuse("tightness", tightness, "a number from 1 on");
        }
        if max_samples < 2 {
            return refuse("max_samples", max_samples as f64, "2 or more");
        }
        Ok(())
    }
}

/// Targets with the probabilities that they are drawn with.
#[derive(Clone, Debug)]
pub(crate) struct WeightedTargets {
    /// The probability of drawing each target or one before it.
    cumulative: Vec<f64>,
}

impl WeightedTargets {
    /// Targets that are drawn by a mean of equal shares and of shares of each of two weights.
    pub(crate) fn new(weights: &[[f64; 2]]) -> Self {
        let totals: [f64; 2] = std::array::from_fn(|k| weights.iter().map(|w| w[k]).sum());
        let usable = |k: &usize| totals[*k].is_normal();
        let parts = 1.0 + (0..2).filter(usable).count() as f64;
        let equal = 1.0 / weights.len() as f64;
        let mut sum = 0.0;
        let cumulative = weights.iter().map(|w| {
            let shares = (0..2).filter(usable).map(|k| w[k] / totals[k]);
            sum += (equal + shares.sum::<f64>()) / parts;
            sum
        });
        Self { cumulative: cumulative.collect() }
    }

    /// So many targets, one from each of as many stretches of the same probability.
    pub(crate) fn draw(&self, count: usize, random: &mut Random) -> Vec<usize> {
        let last = self.cumulative.len() - 1;
        let target = |k: usize| {
            let point = (k as f64 + random.unit()) / count as f64;
            self.cumulative.partition_point(|&sum| sum <= point).min(last)
        };
        (0..count).map(target).collect()
    }

    /// The probability with which a draw gives this target.
    pub(crate) fn probability(&self, target: usize) -> f64 {
        let before = if target > 0 { self.cumulative[target - 1] } else { 0.0 };
        self.cumulative[target] - before
    }
}

/// What the mean of a population is no more than, but for a probability of `risk`: the empirical
/// Bernstein bound (Maurer and Pontil, "Empirical Bernstein bounds and sample variance penalization",
/// COLT 2009, theorem 4) for independent draws, with [`RANGE`] times the largest of them in place of the
/// range, which nobody knows. At least two draws.
///
/// Where sums of squares are light-tailed its root is some 40 % above that of the mean; a t-interval
/// would be tighter, and wrong where they are not.
pub(crate) fn upper_mean(draws: &[f64], risk: f64) -> f64 {
    let n = draws.len() as f64;
    let mean = draws.iter().sum::<f64>() / n;
    let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let largest = draws.iter().copied().fold(0.0, f64::max);
    let log = (2.0 / risk).ln();
    mean + (2.0 * variance * log / n).sqrt() + 7.0 * RANGE * largest * log / (3.0 * (n - 1.0))
}

/// How many times the largest number drawn the largest of a population is taken to be.
const RANGE: f64 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// How often of 1,000 times the bound at 99 % is below the mean of a population, and the median
    /// of the ratio of their roots.
    fn missed(population: impl Fn(&mut Random) -> f64) -> (usize, f64) {
        let mut random = Random::new(7);
        let mut ratios: Vec<f64> = (0..1000)
            .map(|_| {
                let all: Vec<f64> = (0..3000).map(|_| population(&mut random)).collect();
                let weighted = WeightedTargets::new(&vec![[0.0; 2]; all.len()]);
                let draws: Vec<f64> =
                    weighted.draw(512, &mut random).into_iter().map(|i| all[i]).collect();
                let mean = all.iter().sum::<f64>() / all.len() as f64;
                (upper_mean(&draws, 0.01) / mean).sqrt()
            })
            .collect();
        ratios.sort_by(f64::total_cmp);
        (ratios.partition_point(|&ratio| ratio < 1.0), ratios[500])
    }

    #[test]
    fn the_bound_holds_for_light_and_heavy_tails() {
        let normal = |random: &mut Random| {
            let radius = (-2.0 * (1.0 - random.unit()).ln()).sqrt();
            radius * (std::f64::consts::TAU * random.unit()).cos()
        };
        let pareto = |random: &mut Random| (1.0 - random.unit()).powf(-1.0 / 1.5);
        let few_large = |random: &mut Random| if random.unit() < 0.01 { 100.0 } else { 1.0 };
        let (light, ratio) = missed(|random| normal(random).powi(2));
        assert!(light == 0 && (1.1..1.4).contains(&ratio), "{light} {ratio}");
        let (lognormal, ratio) = missed(|random| (2.0 * normal(random)).exp());
        assert!(lognormal <= 5 && ratio < 3.0, "{lognormal} {ratio}");
        let (heavy, ratio) = missed(pareto);
        assert!(heavy <= 5 && ratio < 3.0, "{heavy} {ratio}");
        let (rare, ratio) = missed(few_large);
        assert!(rare <= 10 && ratio < 3.0, "{rare} {ratio}");
    }

    #[test]
    fn draws_follow_their_probabilities() {
        let weights: Vec<[f64; 2]> = (0..100).map(|i| [f64::from(i), 0.0]).collect();
        let weighted = WeightedTargets::new(&weights);
        let total: f64 = (0..100).map(|i| weighted.probability(i)).sum();
        assert!((total - 1.0).abs() < 1e-12);
        let mut counts = [0.0; 100];
        let draws = 100_000;
        weighted.draw(draws, &mut Random::new(1)).into_iter().for_each(|i| counts[i] += 1.0);
        for (i, count) in counts.into_iter().enumerate() {
            let expected = draws as f64 * (0.005 + 0.5 * i as f64 / 4950.0);
            assert!((count - expected).abs() <= 2.0, "{i}: {count} of {expected}");
        }
        let vast = WeightedTargets::new(&[[f64::INFINITY, 1.0], [1.0, 1.0]]);
        assert_eq!(vast.probability(0), 0.5);
    }
}
