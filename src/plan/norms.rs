//! How strongly pairs of points act, level by level, beside whole sums.
//!
//! A relative tolerance speaks of whole sums, near field included. What that allows the expansions of a level
//! follows from magnitudes of the kernel at sampled targets, and from the charges.

use std::ops::Range;

use crate::expansion::geometry::Strength;
use crate::expansion::{Expansion, SourceOf, TargetOf};
use crate::interaction::lists::Lists;
use crate::interpolation::scale::FEW;
use crate::kernel::slopes::write_slopes;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Located, Numbers, Real, Scalar, l2_norm};
use crate::octree::shape::Shape;
use crate::octree::trees::Trees;
use crate::parallel;
use crate::plan::tuning::{
    ISOLATED_SHARE, LIKE_SIZES, NEAR_PARTS, NORM_TARGETS, ONE_SIGN, PART_POINTS,
};

/// Values of the kernel at sampled targets, and what follows from them for charges of one size.
#[derive(Debug)]
pub(crate) struct Norms {
    targets: Vec<Target>,
    levels: usize,
    /// For charges of one size, level by level: of values and of derivatives. None for a level without pairs.
    pub(crate) usual: Vec<[Option<Strength>; 2]>,
}

/// What acts on a target.
#[derive(Debug)]
struct Target {
    parts: Vec<Part>,
    /// The mean of G, and of ∂G/∂x, over each part: one matrix after the other.
    means: [Vec<f64>; 2],
}

/// Sources that act on a target alike.
#[derive(Debug)]
struct Part {
    /// The level of the expansion that carries them, if one does.
    level: Option<usize>,
    sources: Sources,
    /// The root mean square of |G| and of |∂G/∂x|.
    magnitudes: [f64; 2],
}

#[derive(Clone, Debug)]
enum Sources {
    /// Those of a cell, with their number.
    Cell(usize, usize),
    /// Places in tree order.
    Run(Range<usize>),
}

/// Sizes of charges, and for each cell Σ |q| and (Σ |q|²)^½.
pub(crate) struct ChargeSums {
    sizes: Vec<f64>,
    cells: Vec<[f64; 2]>,
}

/// What comes through a level at a target if every pair is off by 1, for charges of one sign and of any: sources
/// of one cell err alike, and add up if the charges have one sign; those of several cells don't.
type Errors = [f64; 2];

impl Norms {
    /// Samples the targets of a plan with these lists and no mask. O(levels), whatever the number of points.
    pub(crate) fn sample<E: Expansion>(
        kernel: &E::Kernel,
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        lists: &Lists,
    ) -> Self {
        let leaves = &trees.target_tree.shape.leaves;
        let count = leaves.len().min(NORM_TARGETS);
        let sampled = |k: usize| {
            let leaf = leaves[(2 * k + 1) * leaves.len() / (2 * count)] as usize;
            Target::new::<E>(kernel, trees, lists, leaf)
        };
        let targets = parallel::map(count, &sampled);
        let mut norms = Self { targets, levels: trees.levels(), usual: Vec::new() };
        norms.usual = norms.strengths(None);
        norms
    }

    /// The strengths for some charges. Where no sampled target meets a level, pairs count by their own size.
    pub(crate) fn strengths_for(&self, charges: &ChargeSums) -> Vec<[Option<Strength>; 2]> {
        let actual = self.strengths(Some(charges));
        let of_level = |(actual, usual): ([Option<Strength>; 2], &[Option<Strength>; 2])| {
            [0, 1].map(|channel| {
                let usual = usual[channel]?;
                let own = actual[channel].filter(|own| own.size < f64::INFINITY);
                let alone = Strength { size: usual.pair, through: usual.pair, ..usual };
                let Strength { size, through, .. } = own.unwrap_or(alone);
                // A level without pairs stays one.
                let unmet = usual.size == f64::INFINITY;
                Some(if unmet { usual } else { Strength { size, through, ..usual } })
            })
        };
        actual.into_iter().zip(&self.usual).map(of_level).collect()
    }

    /// Whether there may be charges for which an expansion whose errors are relative to `sizes` makes too
    /// large an error.
    pub(crate) fn depend_on_charges(&self, sizes: impl Fn(usize) -> [f64; 2]) -> bool {
        // Whatever the charges, sums over some pairs are no smaller than if all were the weakest of them.
        let too_weak = |part: &Part| {
            let Some(level) = part.level else { return false };
            let sizes = sizes(level);
            (0..2).any(|channel| sizes[channel] > LIKE_SIZES * part.magnitudes[channel])
        };
        self.targets.iter().flat_map(|target| &target.parts).any(too_weak)
    }

    fn strengths(&self, charges: Option<&ChargeSums>) -> Vec<[Option<Strength>; 2]> {
        let [values, slopes] = [0, 1].map(|channel| self.strengths_of(channel, charges));
        values.into_iter().zip(slopes).map(|(value, slope)| [value, slope]).collect()
    }

    fn strengths_of(&self, channel: usize, charges: Option<&ChargeSums>) -> Vec<Option<Strength>> {
        let mut wholes = [Vec::new(), Vec::new()];
        // Of each level at each target; and what its pairs carry.
        let mut errors = vec![vec![Errors::default(); self.targets.len()]; self.levels];
        let mut carried = vec![[0.0f64; 2]; self.levels];
        let mut joint = vec![0.0f64; self.levels];
        for (i, target) in self.targets.iter().enumerate() {
            let means = target.means[channel].chunks_exact(target.len(channel));
            let (mut sum, mut any_sign) = (vec![0.0; target.len(channel)], 0.0f64);
            let mut linear = vec![0.0; self.levels];
            for (part, mean) in target.parts.iter().zip(means) {
                let [q, norm] = part.sources.charges(charges);
                let received = part.magnitudes[channel] * norm;
                any_sign = any_sign.hypot(received);
                sum.iter_mut().zip(mean).for_each(|(sum, g)| *sum += g * q);
                if let Some(level) = part.level {
                    let error = &mut errors[level][i];
                    *error = [error[0].hypot(q), error[1].hypot(norm)];
                    linear[level] += q;
                    carried[level] =
                        [carried[level][0].hypot(received), carried[level][1].hypot(norm)];
                }
            }
            joint.iter_mut().zip(linear).for_each(|(joint, q)| *joint = joint.hypot(q));
            wholes[0].push(l2_norm(sum.into_iter()).max(any_sign));
            wholes[1].push(any_sign);
        }
        let wholes = wholes.map(floored);
        // Between few cells, errors of all levels may have one sign as well.
        let met = carried.iter().filter(|carried| carried[1] > 0.0).count() as f64;
        let size = |errors: &[Errors], cells: f64| {
            let of_kind = |kind: usize| {
                let each = || errors.iter().map(|error| error[kind]);
                let relative = each()
                    .zip(&wholes[kind])
                    .map(|(error, whole)| if error == 0.0 { 0.0 } else { error / whole });
                let relative: Vec<f64> = relative.collect();
                let own = l2_norm(relative.iter().copied()) / (errors.len() as f64).sqrt();
                let all = l2_norm(each()) / l2_norm(wholes[kind].iter().copied());
                own.max(all)
            };
            let alike = if cells < FEW { ONE_SIGN * met.sqrt() } else { ONE_SIGN };
            (alike * of_kind(0)).max(of_kind(1)).recip()
        };
        let mut through = vec![Errors::default(); self.targets.len()];
        let mut strengths = Vec::new();
        for (level, errors) in errors.iter().enumerate() {
            for (sum, own) in through.iter_mut().zip(errors) {
                *sum = [sum[0].hypot(own[0]), sum[1].hypot(own[1])];
            }
            let [received, norm] = carried[level];
            let cells = (joint[level] / l2_norm(errors.iter().map(|error| error[0]))).powi(2);
            let [pair, cells] =
                [received / norm, cells].map(|number| if norm > 0.0 { number } else { 0.0 });
            let [size, through] = [size(errors, cells), size(&through, cells)];
            let strength = Strength { pair, cells, size, through };
            let known = charges.is_some() || strength.through > 0.0;
            strengths.push((known && strength.through.is_finite()).then_some(strength));
        }
        strengths
    }
}

/// Whether an expansion whose errors are relative to `sizes` is too coarse for charges with these strengths.
pub(crate) fn forbid(
    strengths: &[[Option<Strength>; 2]],
    sizes: impl Fn(usize) -> [f64; 2],
) -> bool {
    (0..2).any(|channel| {
        let relative = strengths.iter().enumerate().map(|(level, strengths)| {
            let size = sizes(level)[channel];
            strengths[channel].map_or(0.0, |own| if size > 0.0 { size / own.size } else { 0.0 })
        });
        relative.map(|error| error * error).sum::<f64>() > LIKE_SIZES * LIKE_SIZES
    })
}

impl ChargeSums {
    /// The sums of charges that are given in the caller's order; none if all are zero. O(N).
    pub(crate) fn new<Q: Numbers>(charges: &[Q], shape: &Shape) -> Option<Self> {
        let order = &shape.order;
        let sizes: Vec<f64> = parallel::map(order.len(), &|i| charges[order[i] as usize].norm());
        let largest = sizes.iter().fold(0.0, |a: f64, &b| a.max(b));
        if largest == 0.0 {
            return None;
        }
        let sizes: Vec<f64> = sizes.into_iter().map(|size| size / largest).collect();
        let mut cells = vec![[0.0; 2]; shape.nodes.len()];
        // Children come after their parents.
        for (c, node) in shape.nodes.iter().enumerate().rev() {
            let children = node.children();
            cells[c] = if children.is_empty() {
                let own = &sizes[node.points()];
                [own.iter().sum(), l2_norm(own.iter().copied())]
            } else {
                let own = &cells[children];
                [own.iter().map(|sums| sums[0]).sum(), l2_norm(own.iter().map(|sums| sums[1]))]
            };
        }
        Some(Self { sizes, cells })
    }
}

impl Sources {
    /// Σ |q| and (Σ |q|²)^½; of charges of one size if none are given.
    fn charges(&self, charges: Option<&ChargeSums>) -> [f64; 2] {
        match (self, charges) {
            (Self::Cell(cell, _), Some(sums)) => sums.cells[*cell],
            (Self::Run(run), Some(sums)) => {
                let own = &sums.sizes[run.clone()];
                [own.iter().sum(), l2_norm(own.iter().copied())]
            }
            (Self::Cell(_, count), None) => [*count as f64, (*count as f64).sqrt()],
            (Self::Run(run), None) => [run.len() as f64, (run.len() as f64).sqrt()],
        }
    }
}

impl Target {
    /// What acts on a target of a leaf, by the lists.
    fn new<E: Expansion>(
        kernel: &E::Kernel,
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        lists: &Lists,
        leaf: usize,
    ) -> Self {
        let (shape, cells) = (&trees.target_tree.shape, &trees.source_tree.shape.nodes);
        let points = shape.nodes[leaf].points();
        let x = trees.targets[points.start + points.len() / 2].position();
        let mut parts: Vec<(Option<usize>, Sources, Range<usize>)> = Vec::new();
        let near = lists.near.of(leaf);
        let sources: usize = near.iter().map(|run| (run.last - run.first) as usize).sum();
        let together = sources.div_ceil(NEAR_PARTS).max(1);
        for run in near {
            let run = run.first as usize..run.last as usize;
            parts.extend(run.clone().step_by(together).map(|start| {
                let run = start..run.end.min(start + together);
                (None, Sources::Run(run.clone()), run)
            }));
        }
        let far = |level: usize, s: u32| {
            let points = cells[s as usize].points();
            (Some(level), Sources::Cell(s as usize, points.len()), points)
        };
        parts.extend(lists.m2p.of(leaf).iter().map(|&s| far(cells[s as usize].level(), s)));
        for cell in shape.path_to_root(leaf) {
            let met = lists.m2l.of(cell).iter().chain(lists.p2l.of(cell));
            parts.extend(met.map(|&s| far(shape.nodes[cell].level(), s)));
        }

        let samples = |range: &Range<usize>| range.len().min(PART_POINTS);
        let place = |range: &Range<usize>, k: usize| {
            range.start + (2 * k + 1) * range.len() / (2 * samples(range))
        };
        let places =
            parts.iter().flat_map(|(_, _, range)| (0..samples(range)).map(|k| place(range, k)));
        let ys: Vec<_> = places.map(|place| trees.sources[place].position()).collect();
        let len = kernel.fields() * kernel.densities();
        let zero = <<E::Kernel as Kernel>::Entry as Numbers>::zero();
        let mut values = vec![zero; ys.len() * len];
        kernel.entries_block(&[x], &ys, &mut values);
        let mut slopes = vec![zero; ys.len() * if kernel.needs_gradients() { 3 * len } else { 0 }];
        if !slopes.is_empty() {
            write_slopes(kernel, &[x], &ys, &mut slopes);
        }
        let of_parts = |entries: &[<E::Kernel as Kernel>::Entry]| {
            let each = entries.len() / ys.len().max(1);
            let numbers = |g: &[<E::Kernel as Kernel>::Entry], y| -> Vec<f64> {
                let numbers: Vec<f64> =
                    g.iter().flat_map(|g| g.parts()).map(Real::as_f64).collect();
                // A point may be singular to itself; what is infinite elsewhere, sums will tell.
                let counts = x != y && numbers.iter().all(|number| number.is_finite());
                if counts { numbers } else { vec![0.0; numbers.len()] }
            };
            let (mut means, mut magnitudes, mut at) = (Vec::new(), Vec::new(), 0);
            for (_, _, range) in &parts {
                let count = samples(range);
                let mut mean = vec![0.0; 2 * each];
                let mut magnitude = 0.0f64;
                for k in at..at + count {
                    let numbers = numbers(&entries[k * each..][..each], ys[k]);
                    magnitude = magnitude.hypot(l2_norm(numbers.iter().copied()));
                    mean.iter_mut().zip(numbers).for_each(|(mean, g)| *mean += g / count as f64);
                }
                at += count;
                means.extend(mean);
                magnitudes.push(magnitude / (count as f64).sqrt());
            }
            (means, magnitudes)
        };
        let (values, value_sizes) = of_parts(&values);
        let (slopes, slope_sizes) = of_parts(&slopes);
        let part = |(k, (level, sources, _)): (usize, (_, Sources, _))| {
            let magnitudes = [value_sizes[k], slope_sizes[k]];
            Part { level, sources, magnitudes }
        };
        let parts = parts.into_iter().enumerate().map(part).collect();
        Self { parts, means: [values, slopes] }
    }

    /// How many numbers make up a matrix.
    fn len(&self, channel: usize) -> usize {
        (self.means[channel].len() / self.parts.len().max(1)).max(1)
    }
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
