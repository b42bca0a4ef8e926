//! How strongly pairs of points act, level by level, beside whole sums.
//!
//! A relative tolerance speaks of whole sums, near field included. What that allows the expansions of a level
//! follows from magnitudes of the kernel at sampled targets, and from the charges.

use crate::expansion::geometry::Strength;
use crate::expansion::weights::Weights;
use crate::expansion::{Expansion, SourceOf, TargetOf};
use crate::interaction::lists::Lists;
use crate::numbers::traits::l2_norm;
use crate::octree::trees::Trees;
use crate::parallel;
use crate::plan::charge_sums::ChargeSums;
use crate::plan::sampled_target::{Components, Part, Target, Way};
use crate::plan::tuning::{ISOLATED_SHARE, LIKE_SIZES, NORM_TARGETS, ONE_SIGN};

/// Values of the kernel at sampled targets, and what follows from them for charges of one size.
#[derive(Debug)]
pub(crate) struct Norms {
    targets: Vec<Target>,
    levels: usize,
    /// For charges of one size, level by level: of values and of derivatives. None for a level without pairs.
    pub(crate) usual: Vec<Strengths>,
    /// Of each field and each density with its share of the errors, and of all; those of all are the least of these.
    each: Vec<(Components, Vec<Strengths>)>,
}

/// Of a level's values and derivatives.
pub(crate) type Strengths = [Option<Strength>; 2];

/// What comes through a level at a target if every pair is off by 1, for charges of one sign and of any: sources
/// of one cell err alike, and add up if the charges have one sign; those of several cells don't.
type Errors = [f64; 2];

/// What passes through a level.
#[derive(Clone)]
struct Passing {
    /// At each target.
    errors: Vec<Errors>,
    /// Σ |q| at each target.
    joint: Vec<f64>,
    /// (Σ |G|² |q|²)^½ over all targets.
    received: f64,
    /// (Σ |q|²)^½ over all targets.
    charges: f64,
}

impl Norms {
    /// Samples the targets of a plan of a kernel under some weights, with these lists and no mask. O(levels), whatever
    /// the number of points.
    pub(crate) fn sample<E: Expansion>(
        weighted: (&E::Kernel, &Weights),
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        lists: &Lists,
    ) -> Self {
        let leaves = &trees.target_tree.shape.leaves;
        let count = leaves.len().min(NORM_TARGETS);
        let sampled = |k: usize| {
            let leaf = leaves[(2 * k + 1) * leaves.len() / (2 * count)] as usize;
            Target::new::<E>(weighted, trees, lists, leaf)
        };
        let targets = parallel::map(count, &sampled);
        let levels = trees.levels();
        let mut norms = Self { targets, levels, usual: Vec::new(), each: Vec::new() };
        norms.each = norms.strengths(None);
        let strengths = norms.each.iter().map(|(_, strengths)| strengths.clone());
        norms.usual = strengths.reduce(least).unwrap_or_else(|| vec![[None; 2]; levels]);
        norms
    }

    /// What errors at a level may be taken relative to: of each field, and of what each density sends.
    pub(crate) fn sizes(&self, level: usize) -> [Vec<f64>; 2] {
        let mut sizes = [Vec::new(), Vec::new()];
        for (entries, strengths) in &self.each {
            let size = strengths[level][0].map_or(f64::INFINITY, |own| own.size);
            match entries {
                Components::Field(_) => sizes[0].push(size),
                Components::Density(_) => sizes[1].push(size),
                Components::All => {}
            }
        }
        sizes
    }

    /// The strengths for some charges. Where no sampled target meets a level, pairs count by their own size.
    pub(crate) fn strengths_for(&self, charges: &ChargeSums) -> Vec<Strengths> {
        let mut passing = [f64::INFINITY; 2];
        let of_level = |(actual, usual): (Strengths, &Strengths)| {
            [0, 1].map(|channel| {
                let usual = usual[channel]?;
                let [size, through] = actual[channel]
                    .map_or([f64::INFINITY; 2], |actual| [actual.size, actual.through]);
                // A level without pairs is met by none.
                let is_met = size < f64::INFINITY || usual.size == f64::INFINITY;
                let size = if is_met { size } else { usual.pair };
                passing[channel] = passing[channel].min(through).min(size);
                Some(Strength { size, through: passing[channel], ..usual })
            })
        };
        self.all_for(charges).into_iter().zip(&self.usual).map(of_level).collect()
    }

    /// Whether there may be charges for which an expansion whose errors are relative to `sizes` makes too
    /// large an error.
    pub(crate) fn depend_on_charges(&self, sizes: impl Fn(usize) -> [f64; 2]) -> bool {
        // Whatever the charges, sums over some pairs are no smaller than if all were the weakest of them.
        let too_weak = |part: &Part| match part.way {
            Way::Near => false,
            Way::Through(level) => {
                let sizes = sizes(level);
                (0..2).any(|channel| sizes[channel] > LIKE_SIZES * part.magnitudes[channel])
            }
            Way::LeftOut => true,
        };
        self.targets.iter().flat_map(|target| &target.parts).any(too_weak)
    }

    /// What is left out of sums with these charges, relative to whole sums: of values or of derivatives,
    /// whichever is more.
    pub(crate) fn left_out(&self, charges: &ChargeSums) -> f64 {
        let share = |channel: usize, kind: usize| {
            let received = |counts: fn(Way) -> bool| -> Vec<f64> {
                let at = |target: &Target| {
                    target.received(channel, Components::All, Some(charges), counts)[kind]
                };
                self.targets.iter().map(at).collect()
            };
            let left_out = received(|way| matches!(way, Way::LeftOut));
            relative(&left_out, &floored(received(|_| true)))
        };
        [share(0, 0), share(0, 1), share(1, 0), share(1, 1)].into_iter().fold(0.0, f64::max)
    }

    /// The strengths of all for some charges: the usual ones, but for as much as those of any field or density are less
    /// than they usually are.
    fn all_for(&self, charges: &ChargeSums) -> Vec<Strengths> {
        let mut actual = self.strengths(Some(charges));
        if actual.len() < 2 {
            return actual.pop().map_or_else(|| vec![[None; 2]; self.levels], |(_, all)| all);
        }
        let of_level = |level: usize| {
            [0, 1].map(|channel| {
                let usual = self.usual[level][channel]?;
                let ratio = |of: fn(&Strength) -> f64| {
                    let both = actual.iter().zip(&self.each);
                    let ratios = both.filter_map(|((_, own), (_, usual))| {
                        let [own, usual] = [own, usual].map(|all| all[level][channel].as_ref());
                        let ratio = of(own?) / of(usual?);
                        (!ratio.is_nan()).then_some(ratio)
                    });
                    ratios.fold(f64::INFINITY, f64::min)
                };
                let size = usual.size * ratio(|own| own.size);
                Some(Strength { size, through: usual.through * ratio(|own| own.through), ..usual })
            })
        };
        (0..self.levels).map(of_level).collect()
    }

    /// The strengths of each field and each density with its share of the errors, and of all.
    fn strengths(&self, charges: Option<&ChargeSums>) -> Vec<(Components, Vec<Strengths>)> {
        let each = self.targets.first().into_iter().flat_map(Target::each);
        let of_some = |(entries, count): (Components, usize)| {
            let share = (count as f64).sqrt();
            let shared = |own: Option<Strength>| {
                // Where a field is zero everywhere, there is nothing to be relative to.
                let own = own.filter(|own| count == 1 || own.through > 0.0);
                own.map(|own| Strength {
                    size: share * own.size,
                    through: share * own.through,
                    ..own
                })
            };
            let [values, slopes] =
                [0, 1].map(|channel| self.strengths_of(channel, entries, charges));
            let both = values.into_iter().zip(slopes);
            (entries, both.map(|(value, slope)| [shared(value), shared(slope)]).collect())
        };
        each.map(of_some).collect()
    }

    fn strengths_of(
        &self,
        channel: usize,
        entries: Components,
        charges: Option<&ChargeSums>,
    ) -> Vec<Option<Strength>> {
        let mut wholes = [Vec::new(), Vec::new()];
        let mut levels = vec![Passing::new(self.targets.len()); self.levels];
        for (i, target) in self.targets.iter().enumerate() {
            for (k, part) in target.parts.iter().enumerate() {
                if let Way::Through(level) = part.way {
                    let sizes = part.sources.charges(charges);
                    let magnitude = target.magnitude(channel, k, entries);
                    levels[level].add(i, sizes, magnitude * sizes[1]);
                }
            }
            let received = target.received(channel, entries, charges, |_| true);
            wholes.iter_mut().zip(received).for_each(|(wholes, own)| wholes.push(own));
        }
        let wholes = wholes.map(floored);
        let size = |errors: &[Errors]| {
            let [one_sign, any_sign] = [0, 1].map(|kind| {
                let errors: Vec<f64> = errors.iter().map(|error| error[kind]).collect();
                relative(&errors, &wholes[kind])
            });
            (ONE_SIGN * one_sign).max(any_sign).recip()
        };
        let mut through = vec![Errors::default(); self.targets.len()];
        let strength = |own: &Passing| {
            for (sum, own) in through.iter_mut().zip(&own.errors) {
                *sum = [sum[0].hypot(own[0]), sum[1].hypot(own[1])];
            }
            let (pair, cells) = own.pair_and_cells();
            let [size, through] = [size(&own.errors), size(&through)];
            // Where all sums are zero there is nothing to be relative to.
            let known = through.is_finite() && (charges.is_some() || through > 0.0);
            known.then_some(Strength { pair, cells, size, through })
        };
        levels.iter().map(strength).collect()
    }
}

impl Passing {
    fn new(targets: usize) -> Self {
        let errors = vec![Errors::default(); targets];
        Self { errors, joint: vec![0.0; targets], received: 0.0, charges: 0.0 }
    }

    /// Adds a part that acts on the i-th target.
    fn add(&mut self, i: usize, [q, norm]: [f64; 2], received: f64) {
        let error = &mut self.errors[i];
        *error = [error[0].hypot(q), error[1].hypot(norm)];
        self.joint[i] += q;
        self.received = self.received.hypot(received);
        self.charges = self.charges.hypot(norm);
    }

    /// The root mean square of |G|, and how many cells share what a target receives.
    fn pair_and_cells(&self) -> (f64, f64) {
        if self.charges == 0.0 {
            return (0.0, 0.0);
        }
        let apart = l2_norm(self.errors.iter().map(|error| error[0]));
        let cells = (l2_norm(self.joint.iter().copied()) / apart).powi(2);
        (self.received / self.charges, cells)
    }
}

/// The least of both, with the pairs and cells of the latter.
fn least(some: Vec<Strengths>, own: Vec<Strengths>) -> Vec<Strengths> {
    let least = |some: Option<Strength>, own: Option<Strength>| match (some, own) {
        (Some(some), Some(own)) => {
            let through = own.through.min(some.through);
            Some(Strength { size: own.size.min(some.size), through, ..own })
        }
        (some, own) => own.or(some),
    };
    let both = some.into_iter().zip(own);
    both.map(|(some, own)| [0, 1].map(|channel| least(some[channel], own[channel]))).collect()
}

/// Errors relative to whole sums: the root mean square of the quotients, or the quotient of the norms, whichever
/// is larger.
fn relative(errors: &[f64], wholes: &[f64]) -> f64 {
    let quotient = |(&error, &whole): (&f64, &f64)| if error == 0.0 { 0.0 } else { error / whole };
    let quotients: Vec<f64> = errors.iter().zip(wholes).map(quotient).collect();
    let each = l2_norm(quotients.into_iter()) / (errors.len() as f64).sqrt();
    each.max(l2_norm(errors.iter().copied()) / l2_norm(wholes.iter().copied()))
}

/// Whether an expansion whose errors are relative to `sizes` is too coarse for charges with these strengths.
pub(crate) fn forbid(strengths: &[Strengths], sizes: impl Fn(usize) -> [f64; 2]) -> bool {
    (0..2).any(|channel| {
        let relative = strengths.iter().enumerate().map(|(level, strengths)| {
            let size = sizes(level)[channel];
            strengths[channel].map_or(0.0, |own| if size > 0.0 { size / own.size } else { 0.0 })
        });
        relative.map(|error| error * error).sum::<f64>() > LIKE_SIZES * LIKE_SIZES
    })
}

/// Whole sums, none less than a part of what is usual: targets with next to nothing can't ask for digits of it.
/// Usual is the root mean square of all but the largest tenth, which close pairs may have made large.
fn floored(mut sums: Vec<f64>) -> Vec<f64> {
    let mut sorted = sums.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let mean = |sums: &[f64]| l2_norm(sums.iter().copied()) / (sums.len().max(1) as f64).sqrt();
    let most = mean(&sorted[..(9 * sorted.len()).div_ceil(10)]);
    let usual = if most > 0.0 { most } else { mean(&sorted) };
    sums.iter_mut().for_each(|sum| *sum = sum.max(ISOLATED_SHARE * usual));
    sums
}
