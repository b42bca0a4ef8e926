//! How large the error of an application is, from direct sums at sampled targets.

pub(crate) mod reference;
pub(crate) mod sampling;

use std::collections::HashMap;

use num_traits::Float;

use crate::certificate::reference::{Reference, ReferenceSum};
use crate::certificate::sampling::{Sampling, WeightedTargets, upper_mean};
use crate::error::Error;
use crate::expansion::{ChargeOf, Expansion, RealOf, ValueOf};
use crate::numbers::random::Random;
use crate::numbers::traits::{Numbers, Real, l2_norm};
use crate::parallel;
use crate::parallel::watch::Watch;
use crate::plan::fmm::{Fmm, check_values};

/// How far a sum is from the exact one over all targets, by direct sums at some of them.
///
/// All errors are relative to ‖u‖, the l2 norm of the exact values. *Exact* means: each K(x, y) q as the
/// kernel rounds it at full accuracy, their sum in twice the working precision, over the pairs that
/// count. Which those are is taken from the plan, so that a mask is not asked again; pairs that
/// count in part, by what the mask says of them or of [their cells](crate::Coverage::Eighths), are taken by
/// their share.
///
/// What a tolerance can't promise: expansions and near field err relative to Σ_j ‖K(x, y_j) q_j‖. Where
/// the terms of a sum cancel, u is smaller than that by the [condition number](Self::condition), and
/// the error relative to u grows by as much. [`backward_error`](Self::backward_error) is what is left
/// of it when cancellation is taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Certificate {
    /// With probability [`confidence`](Self::confidence) at least, ‖error‖ / ‖u‖ over *all* targets is
    /// no more than this. Infinite if the values are no larger than their errors may be.
    pub relative_l2: f64,
    /// The estimate of ‖error‖ / ‖u‖ that the bound stands on.
    pub estimate: f64,
    /// The probability with which the bound holds; 1 if every target was summed directly.
    pub confidence: f64,
    /// How many direct sums the bound stands on.
    pub samples: usize,
    /// The number of targets.
    pub targets: usize,
    /// The largest error seen at a target, relative to the root mean square of all values. Targets that
    /// were not seen may err more.
    pub max_relative: f64,
    /// The estimate of the near field's part: digits that the tolerance lets the kernel drop, and
    /// rounding. The two parts may cancel in their sum.
    pub near: f64,
    /// The estimate of the expansions' part: what they cut off, and rounding.
    pub far: f64,
    /// The estimate of the condition number ‖Σ_j ‖K(x, y_j) q_j‖‖ / ‖u‖, 1 or more: how far the sums
    /// cancel (Higham, *Accuracy and Stability of Numerical Algorithms*, section 4.1).
    pub condition: f64,
    /// What the direct sums may be off by themselves; contained in [`relative_l2`](Self::relative_l2).
    pub round_off: f64,
}

impl Certificate {
    /// The error relative to the sums of magnitudes ‖Σ_j ‖K(x, y_j) q_j‖‖.
    pub fn backward_error(&self) -> f64 {
        if self.relative_l2 > 0.0 { self.relative_l2 / self.condition } else { 0.0 }
    }
}

impl<E: Expansion> Fmm<E> {
    /// The same sums as [`apply`](Self::apply), to the bit, and how far they are from the exact ones, by
    /// direct sums at a few hundred targets, drawn by the [default](Sampling::default) rule. O(N) per
    /// draw.
    ///
    /// ```
    /// use farfield::{Fmm, from_fn};
    /// use glam::DVec3;
    ///
    /// let points: Vec<DVec3> = (0..3000).map(|i| DVec3::new(0.8, 0.6, 0.5) * f64::from(i)).map(|p| p.fract()).collect();
    /// let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
    /// let fmm = Fmm::builder(kernel).tolerance(1e-4).build(&points, &points)?;
    ///
    /// let (potentials, certificate) = fmm.apply_certified(&vec![1.0; points.len()])?;
    /// assert!(certificate.relative_l2 < 1e-4 && certificate.confidence >= 0.99);
    /// assert_eq!(potentials, fmm.apply(&vec![1.0; points.len()])?);
    /// # Ok::<(), farfield::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`apply`](Self::apply).
    pub fn apply_certified(
        &self,
        charges: &[ChargeOf<E>],
    ) -> Result<(Vec<ValueOf<E>>, Certificate), Error> {
        self.apply_certified_by(charges, &Sampling::default())
    }

    /// As [`apply_certified`](Self::apply_certified), drawn by another rule.
    ///
    /// # Errors
    /// As [`apply`](Self::apply), or if `sampling` is not what its fields ask for.
    pub fn apply_certified_by(
        &self,
        charges: &[ChargeOf<E>],
        sampling: &Sampling,
    ) -> Result<(Vec<ValueOf<E>>, Certificate), Error> {
        self.apply_certified_watched(charges, sampling, &Watch::default())
    }

    /// As [`apply_certified_by`](Self::apply_certified_by), but `watch` can stop it.
    ///
    /// # Errors
    /// As [`apply_certified_by`](Self::apply_certified_by), or [`Error::Stopped`].
    pub fn apply_certified_watched(
        &self,
        charges: &[ChargeOf<E>],
        sampling: &Sampling,
        watch: &Watch,
    ) -> Result<(Vec<ValueOf<E>>, Certificate), Error> {
        sampling.check()?;
        self.check_charges(charges)?;
        let ready = self.plan_for(charges, watch)?;
        let plan = &ready.plan;
        ready.with_workspace(|workspace| {
            let far = plan.run_parted(charges, workspace, watch);
            watch.check()?;
            let values = plan.in_callers_order(workspace);
            check_values(&values)?;
            let reference = Reference { plan, charges: &workspace.charges, watch };
            let sample = Sample::new(reference, &workspace.values, &far);
            Ok((values, sample.certificate(sampling)?))
        })
    }
}

/// Targets drawn at first: if 1 in 100 errs far more than the others, one of those is among them with
/// a probability of 0.994.
const FIRST: usize = 512;

/// An application and its errors at the targets looked at; places are those of tree order.
struct Sample<'a, E: Expansion> {
    reference: Reference<'a, E>,
    values: &'a [ValueOf<E>],
    far: &'a [ValueOf<E>],
    /// ‖v‖ over all values.
    norm: f64,
    /// What magnitudes are counted in, so that their squares stay in the range of numbers: the norm, or
    /// 1 where that is zero.
    unit: f64,
    weighted: WeightedTargets,
    known: HashMap<usize, Squares>,
}

/// Squared magnitudes at one target, or sums of them, in units of the values.
#[derive(Clone, Copy, Debug, Default)]
struct Squares {
    error: f64,
    near: f64,
    far: f64,
    absolute: f64,
    exact: f64,
}

impl Squares {
    fn add(&mut self, weight: f64, other: &Self) {
        self.error += weight * other.error;
        self.near += weight * other.near;
        self.far += weight * other.far;
        self.absolute += weight * other.absolute;
        self.exact += weight * other.exact;
    }
}

impl<'a, E: Expansion> Sample<'a, E> {
    fn new(reference: Reference<'a, E>, values: &'a [ValueOf<E>], far: &'a [ValueOf<E>]) -> Self {
        let norm = l2_norm(values.iter().cloned());
        let unit = if norm > 0.0 { norm } else { 1.0 };
        let squares: Vec<[f64; 2]> = parallel::map(values.len(), &|i| {
            let mut near = values[i].clone();
            near.subtract(&far[i]);
            [&near, &far[i]].map(|part| (part.norm() / unit).powi(2))
        });
        Self {
            reference,
            values,
            far,
            norm,
            unit,
            weighted: WeightedTargets::new(&squares),
            known: HashMap::new(),
        }
    }

    fn certificate(mut self, sampling: &Sampling) -> Result<Certificate, Error> {
        let (targets, max) = (self.values.len(), sampling.max_samples);
        let mut random = Random::new(sampling.seed);
        let mut draws: Vec<usize> = Vec::new();
        let mut size = FIRST.min(max);
        // Every look has its share of the probability of being wrong.
        let looks = 1.0 + (max as f64 / size as f64).log2().floor();
        let risk = (1.0 - sampling.confidence) / looks;
        loop {
            if targets <= max.min(2 * size) {
                return self.complete();
            }
            draws.extend(self.weighted.draw(size - draws.len(), &mut random));
            self.look_at(&draws)?;
            let certificate = self.bounded(&draws, risk, sampling.confidence);
            let Certificate { relative_l2, estimate, .. } = certificate;
            if relative_l2 <= sampling.tightness * estimate || 2 * size > max {
                return Ok(certificate);
            }
            size *= 2;
        }
    }

    /// Sums directly at those of `targets` that have not been looked at.
    fn look_at(&mut self, targets: &[usize]) -> Result<(), Error> {
        let mut new: Vec<usize> =
            targets.iter().copied().filter(|t| !self.known.contains_key(t)).collect();
        new.sort_unstable();
        new.dedup();
        let sums = self.reference.sums(&new);
        self.reference.watch.check()?;
        for (&t, sum) in new.iter().zip(sums) {
            if !sum.all.high.is_finite() {
                let index = self.reference.plan.target_tree.shape.order[t] as usize;
                return Err(Error::NonFiniteValue { index, value: sum.all.high.to_f64s() });
            }
            self.known.insert(t, self.squares(t, &sum));
        }
        Ok(())
    }

    /// What is known about the target at place `t`.
    fn squares(&self, t: usize, sum: &ReferenceSum<ValueOf<E>>) -> Squares {
        let error = sum.all.subtracted_from(&self.values[t]);
        let mut exact_far = sum.all.clone();
        exact_far.subtract(&sum.near);
        let far_error = exact_far.subtracted_from(&self.far[t]);
        let mut near_error = error.clone();
        near_error.subtract(&far_error);
        let squared = |magnitude: f64| (magnitude / self.unit).powi(2);
        Squares {
            error: squared(error.norm()),
            near: squared(near_error.norm()),
            far: squared(far_error.norm()),
            absolute: squared(sum.absolute),
            exact: squared(sum.all.high.norm()),
        }
    }

    /// The certificate if all targets are looked at.
    fn complete(mut self) -> Result<Certificate, Error> {
        let targets: Vec<usize> = (0..self.values.len()).collect();
        self.look_at(&targets)?;
        let mut total = Squares::default();
        targets.iter().for_each(|t| total.add(1.0, &self.known[t]));
        // As everywhere, errors are absolute where the reference vanishes.
        let norm = if total.exact > 0.0 { total.exact.sqrt() } else { 1.0 / self.unit };
        let bound = |error: f64| error / norm;
        Ok(self.of(&total, norm, total.error, 1.0, bound))
    }

    /// The certificate from independent draws, wrong with a probability of `risk`.
    fn bounded(&self, draws: &[usize], risk: f64, confidence: f64) -> Certificate {
        let weighed = |&t: &usize| (1.0 / self.weighted.probability(t), &self.known[&t]);
        let mut mean = Squares::default();
        let share = 1.0 / draws.len() as f64;
        draws.iter().map(weighed).for_each(|(weight, at)| mean.add(share * weight, at));
        let errors: Vec<f64> = draws.iter().map(weighed).map(|(w, at)| w * at.error).collect();
        let upper = upper_mean(&errors, risk);
        let norm = self.norm / self.unit;
        // ‖u‖ is ‖v‖ less ‖error‖ at least.
        let bound = |error: f64| match error {
            0.0 => 0.0,
            _ if error < norm => error / (norm - error),
            _ => f64::INFINITY,
        };
        let norm = if norm > 0.0 { norm } else { 1.0 };
        self.of(&mean, norm, upper, confidence, bound)
    }

    /// The certificate for estimated totals and an upper bound `upper` of the squared error.
    fn of(
        &self,
        totals: &Squares,
        norm: f64,
        upper: f64,
        confidence: f64,
        bound: impl Fn(f64) -> f64,
    ) -> Certificate {
        let targets = self.values.len();
        let unit_round_off = 0.5 * <RealOf<E> as Float>::epsilon().as_f64();
        let absolute = totals.absolute.sqrt();
        let round_off =
            2.0 * self.reference.charges.len() as f64 * unit_round_off.powi(2) * absolute;
        let largest = self.known.values().map(|at| at.error).fold(0.0, f64::max);
        Certificate {
            relative_l2: bound(upper.sqrt() + round_off),
            estimate: totals.error.sqrt() / norm,
            confidence,
            samples: self.known.len(),
            targets,
            max_relative: (largest * targets as f64).sqrt() / norm,
            near: totals.near.sqrt() / norm,
            far: totals.far.sqrt() / norm,
            condition: (absolute / norm).max(1.0),
            round_off: round_off / norm,
        }
    }
}
