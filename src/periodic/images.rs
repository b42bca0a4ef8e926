//! The sum of a kernel over all images that are not near, as a smooth function of the difference of two points.
//!
//! F(d) = Σ_n K(d − n L) over all images n beyond the near ones, summed by blocks that grow threefold. If K behaves like a
//! power r^α far away, then the part of degree j in d of what is missing after a block of edge ρ is a sum of ρ^(α + D − j),
//! ρ^(α + D − j − 2), … for D periodic axes: by Euler and Maclaurin, since the images are centred in the block. So what is
//! missing shrinks, or grows, by known powers of 3 from block to block, and is taken out by Richardson's extrapolation. A
//! part of degree 0 that does not shrink is the same for all differences. It is left out, and charges must add up to zero.
//! A part of degree 1 or 2 that does not shrink depends on the shape of the block; there, F is made such that the sum over
//! all images is periodic, as it is for every finite sum of this kind but for that part.

use crate::error::Error;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::l2_norm;
use crate::periodic::blocks::{next, shell};
use crate::periodic::extrapolation::{Decay, extrapolated};
use crate::periodic::periodicity::{deviation, made_periodic};
use crate::periodic::polynomials::Polynomials;
use crate::periodic::summed::Summed;

/// The sum over all images that are not near.
#[derive(Debug)]
pub(super) struct Images {
    /// For each entry of the kernel, its real and its imaginary part.
    pub(super) sum: Polynomials,
    /// Whether a constant is missing, so that charges have to add up to zero.
    pub(super) needs_neutral: bool,
    /// The absolute error that was allowed.
    pub(super) error: f64,
}

/// The share of the tolerance that what is far away may use, of values and where derivatives count.
const FAR_SHARE: f64 = 0.1;
const SLOPE_SHARE: f64 = 0.02;

/// Polynomials along an axis, at most.
const MOST_POLYNOMIALS: usize = 44;

/// How often more digits are tried, and by how much smaller errors they have.
const ATTEMPTS: usize = 4;
const MORE_DIGITS: f64 = 0.03;

/// Shells of images, at most.
const MOST_SHELLS: usize = 9;

/// Sums that are known better than this converge.
const CONVERGENT: f64 = 0.01;

/// Places at which the sum's period is measured, for each axis.
const SAMPLES: usize = 32;

impl<K: Kernel> Summed<'_, K> {
    /// The sum, such that sums of charges keep a relative tolerance.
    ///
    /// # Errors
    /// [`Error::NonFiniteKernel`], [`Error::DivergentImages`] or [`Error::UnreachableTolerance`].
    pub(super) fn images(&self, tolerance: f64) -> Result<Images, Error> {
        let share = if self.kernel.needs_gradients() { SLOPE_SHARE } else { FAR_SHARE };
        let error = share * tolerance * self.size();
        let (decay, signs) = (Decay::of(self), self.signs());
        let mut digits = share * tolerance;
        let mut attempts = 0;
        loop {
            // A difference is nearest to an image at the end of the box, across from which the gap is no wider than that.
            let order = ((1.0 / digits).ln() / 2.3f64.ln()).ceil() as usize + 2;
            let order = order.min(MOST_POLYNOMIALS);
            let (mut sum, constant) =
                self.sum([tolerance, digits, error], order, &decay, signs.as_deref())?;
            let needs_neutral = constant.is_none();
            if let Some(constant) = constant {
                for (f, c) in constant.into_iter().enumerate() {
                    sum.coefficients[f * order.pow(3)] += c;
                }
            }
            if decay.depends_on_shape() {
                made_periodic(self, &mut sum);
            }
            let found = deviation(self, &sum, SAMPLES);
            if found <= error + self.rounding() {
                return Ok(Images { sum, needs_neutral, error });
            }
            attempts += 1;
            if attempts >= ATTEMPTS {
                return Err(refusal(tolerance, found / error));
            }
            digits *= MORE_DIGITS;
        }
    }

    /// The sum but for a constant, and the constant if it is finite.
    fn sum(
        &self,
        [tolerance, digits, error]: [f64; 3],
        order: usize,
        decay: &Decay,
        signs: Option<&[[f64; 3]]>,
    ) -> Result<(Polynomials, Option<Vec<f64>>), Error> {
        let functions = self.functions();
        let half_widths = self.lattice.half_widths.map(|h| 2.0 * h);
        let is_periodic = self.lattice.is_periodic();
        let nodes = (1.0 / digits).ln() / (2.0 * 3.2f64.ln()) + 2.0;
        let nodes = nodes.ceil() as usize;
        let zero =
            Polynomials { order, half_widths, coefficients: vec![0.0; functions * order.pow(3)] };
        let has_constant = decay.constant_is_finite();
        let (mut sums, mut constants) =
            (vec![zero.coefficients.clone()], vec![vec![0.0; functions]]);
        let mut best: Option<(f64, Vec<f64>, Vec<f64>)> = None;
        let mut before: Option<(Vec<f64>, Vec<f64>)> = None;
        let mut reach = self.lattice.near;
        for number in 0..MOST_SHELLS {
            let images = shell(reach, is_periodic, nodes);
            let own = self.shell_order(reach, order, number, digits);
            let (coefficients, constant) = self.shell_sum(&images, own, half_widths, signs)?;
            reach = next(reach, is_periodic);
            sums.push(added(&sums[number], order, &coefficients, own));
            let sum = constants[number].iter().zip(&constant).map(|(a, b)| a + b).collect();
            constants.push(sum);

            let found = (
                extrapolated(&sums, &decay.exponents(1)),
                extrapolated(&constants, &decay.exponents(0)),
            );
            if let Some((sum, constant)) = before {
                let mut change = difference(&found.0, &sum, order, decay.depends_on_shape());
                if has_constant {
                    change = change.max(l2_norm(found.1.iter().zip(&constant).map(|(a, b)| a - b)));
                }
                if best.as_ref().is_none_or(|(least, ..)| change < *least) {
                    best = Some((change, found.0.clone(), found.1.clone()));
                }
                if change <= 0.02 * error {
                    break;
                }
            }
            before = Some(found);
        }
        let Some((change, coefficients, constant)) = best else {
            return Err(Error::DivergentImages);
        };
        if change.is_nan() || change > error {
            return Err(refusal(tolerance, change / error));
        }
        Ok((Polynomials { coefficients, ..zero }, has_constant.then_some(constant)))
    }

    /// How many polynomials the field of a shell takes, which is beyond a block of that reach.
    fn shell_order(&self, reach: [usize; 3], most: usize, number: usize, digits: f64) -> usize {
        if number == 0 {
            return most;
        }
        let longest = self.lattice.half_widths.iter().fold(0.0f64, |a, &h| a.max(2.0 * h));
        let gap = (0..3).filter_map(|k| Some(reach[k] as f64 * self.lattice.periods[k]?));
        let gap = gap.fold(f64::INFINITY, f64::min) / longest;
        // Singularities lie that far off to the side, in complex numbers.
        let decay = gap + (gap * gap + 1.0).sqrt();
        let size = 9f64.powi(number as i32) / digits;
        ((size.ln() / decay.ln()).ceil() as usize + 1).min(most)
    }
}

/// For a sum whose error is so many times what it may be.
fn refusal(requested: f64, excess: f64) -> Error {
    let reachable = requested * excess;
    if reachable < CONVERGENT {
        Error::UnreachableTolerance { requested, reachable }
    } else {
        Error::DivergentImages
    }
}

/// Coefficients with those of fewer polynomials added.
fn added(sum: &[f64], order: usize, more: &[f64], own: usize) -> Vec<f64> {
    let mut sum = sum.to_vec();
    for (k, value) in more.iter().enumerate() {
        let (f, k) = (k / own.pow(3), k % own.pow(3));
        let place = [k / (own * own), k / own % own, k % own];
        sum[f * order.pow(3) + (place[0] * order + place[1]) * order + place[2]] += value;
    }
    sum
}

/// The root mean square of a difference of polynomials; without those of degree 2 and less if they are not to count.
fn difference(a: &[f64], b: &[f64], order: usize, without_few: bool) -> f64 {
    let squares = a.iter().zip(b).enumerate().map(|(k, (a, b))| {
        let k = k % order.pow(3);
        let degree = k / (order * order) + k / order % order + k % order;
        if without_few && degree <= 2 { 0.0 } else { (a - b) * (a - b) }
    });
    squares.sum::<f64>().sqrt()
}
