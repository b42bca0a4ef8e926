//! How strongly pairs of points act, level by level, beside whole sums.
//!
//! A relative tolerance speaks of whole sums, near field included. What that allows the expansions of a level
//! follows from magnitudes of the kernel at sampled targets, and from the charges.

use std::ops::Range;

use crate::expansion::geometry::Strength;
use crate::expansion::{Expansion, SourceOf, TargetOf};
use crate::interaction::lists::Lists;
use crate::kernel::slopes::write_slopes;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Located, Numbers, l2_norm};
use crate::octree::trees::Trees;
use crate::parallel;
use crate::plan::tuning::{ISOLATED_SHARE, LIKE_SIZES, NEAR_PARTS, NORM_TARGETS, PART_POINTS};

/// Magnitudes of the kernel at sampled targets.
#[derive(Debug)]
pub(crate) struct Norms {
    /// What acts on each target.
    targets: Vec<Vec<Part>>,
    /// What magnitudes of values and of derivatives are multiplied by.
    units: [f64; 2],
    levels: usize,
}

/// Sources that act on a target alike.
#[derive(Debug)]
struct Part {
    /// The level of the expansion that carries them, if one does.
    level: Option<usize>,
    /// Places in tree order.
    sources: Range<usize>,
    /// The root mean square of |G| and of |∂G/∂x|.
    magnitudes: [f64; 2],
}

/// Sums of |q| and |q|² over the charges before each place in tree order, relative to the largest |q|.
pub(crate) struct ChargeSums([Vec<f64>; 2]);

/// What comes through a level, summed over all sampled targets: for charges of one sign, and of either.
#[derive(Clone, Copy, Default)]
struct Total {
    /// Σ |G|² |q|².
    received: f64,
    /// (Σ |q|)².
    joint: f64,
    /// Σ over cells of (Σ |q|)², and Σ |q|²: the square of the error if each pair is off by 1. The errors of
    /// sources in one cell have much in common, so they add up if the charges have one sign; those of
    /// several cells don't.
    charges: [f64; 2],
    /// The same relative to the square of the target's whole sum.
    relative: [f64; 2],
}

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
            acting_on::<E>(kernel, trees, lists, leaf)
        };
        let targets = parallel::map(count, &sampled);
        let mut norms = Self { targets, units: [1.0; 2], levels: trees.levels() };
        // Squares stay in the range of numbers.
        for channel in 0..2 {
            let magnitudes = || norms.targets.iter().flatten().map(|part| part.magnitudes[channel]);
            let largest = magnitudes().fold(0.0, f64::max);
            if largest > 0.0 {
                norms.units[channel] = largest;
                let parts = norms.targets.iter_mut().flatten();
                parts.for_each(|part| part.magnitudes[channel] /= largest);
            }
        }
        norms
    }

    /// What each level's values and derivatives come to, under some charges or under charges of one size. None
    /// for a level that no sampled target meets.
    pub(crate) fn strengths(&self, charges: Option<&ChargeSums>) -> Vec<[Option<Strength>; 2]> {
        let [values, slopes] = [0, 1].map(|channel| self.strengths_of(channel, charges));
        values.into_iter().zip(slopes).map(|(value, slope)| [value, slope]).collect()
    }

    /// Whether there may be charges for which an expansion whose errors are relative to `sizes` makes too
    /// large an error.
    pub(crate) fn depend_on_charges(&self, sizes: impl Fn(usize) -> [f64; 2]) -> bool {
        // Whatever the charges, sums over some pairs are no smaller than if all were the weakest of them.
        let too_weak = |part: &Part| {
            let Some(level) = part.level else { return false };
            let sizes = sizes(level);
            (0..2).any(|channel| {
                sizes[channel] > LIKE_SIZES * part.magnitudes[channel] * self.units[channel]
            })
        };
        self.targets.iter().flatten().any(too_weak)
    }

    /// Whether an expansion whose errors are relative to `sizes` is too coarse for these charges.
    pub(crate) fn forbid(&self, charges: &ChargeSums, sizes: impl Fn(usize) -> [f64; 2]) -> bool {
        let strengths = self.strengths(Some(charges));
        (0..2).any(|channel| {
            let squares = strengths.iter().enumerate().map(|(level, strengths)| {
                strengths[channel].map_or(0.0, |own| (sizes(level)[channel] / own.size).powi(2))
            });
            squares.sum::<f64>() > LIKE_SIZES * LIKE_SIZES
        })
    }

    fn strengths_of(&self, channel: usize, charges: Option<&ChargeSums>) -> Vec<Option<Strength>> {
        let sums = |sources: &Range<usize>| {
            let count = sources.len() as f64;
            charges.map_or([count; 2], |sums| sums.of(sources.clone()))
        };
        // Σ |G| |q| and Σ |G|² |q|² at each target.
        let whole = |parts: &Vec<Part>| {
            parts.iter().fold([0.0; 2], |[one_sign, any_sign], part| {
                let ([q, squares], g) = (sums(&part.sources), part.magnitudes[channel]);
                [one_sign + g * q, any_sign + g * g * squares]
            })
        };
        let wholes: Vec<[f64; 2]> = self.targets.iter().map(whole).collect();
        let squares = [
            floored(wholes.iter().map(|whole| whole[0] * whole[0]).collect()),
            floored(wholes.iter().map(|whole| whole[1]).collect()),
        ];
        let means = squares.each_ref().map(|squares| squares.iter().sum::<f64>());
        let mut levels = vec![Total::default(); self.levels];
        for (i, parts) in self.targets.iter().enumerate() {
            let mut far = vec![0.0; self.levels];
            for Part { level, sources, magnitudes } in parts {
                let Some(level) = *level else { continue };
                far[level] += sums(sources)[0];
                let (total, [q, any_sign]) = (&mut levels[level], sums(sources));
                total.received += magnitudes[channel].powi(2) * any_sign;
                for (k, charges) in [q * q, any_sign].into_iter().enumerate() {
                    total.charges[k] += charges;
                    total.relative[k] += charges / squares[k][i];
                }
            }
            levels
                .iter_mut()
                .zip(far)
                .for_each(|(total, q): (&mut Total, f64)| total.joint += q * q);
        }
        let count = self.targets.len() as f64;
        let size = |total: &Total| {
            let error = |k: usize| (total.relative[k] / count).max(total.charges[k] / means[k]);
            self.units[channel] / error(0).max(error(1)).sqrt()
        };
        let mut through = Total::default();
        let strength = |own: Total| {
            through.add(&own);
            let pair = self.units[channel] * (own.received / own.charges[1]).sqrt();
            let met = own.charges[1] > 0.0;
            let [pair, cells] =
                [pair, own.joint / own.charges[0]].map(|number| if met { number } else { 0.0 });
            let strength = Strength { pair, cells, size: size(&own), through: size(&through) };
            (strength.through.is_finite() && strength.through > 0.0).then_some(strength)
        };
        levels.into_iter().map(strength).collect()
    }
}

impl Total {
    fn add(&mut self, other: &Self) {
        self.received += other.received;
        self.joint += other.joint;
        for k in 0..2 {
            self.charges[k] += other.charges[k];
            self.relative[k] += other.relative[k];
        }
    }
}

impl ChargeSums {
    /// The sums of charges whose places in the caller's order are given in tree order. O(N).
    pub(crate) fn new<Q: Numbers>(charges: &[Q], order: &[u32]) -> Self {
        let sizes: Vec<f64> = parallel::map(order.len(), &|i| charges[order[i] as usize].norm());
        let largest = sizes.iter().fold(0.0, |a: f64, &b| a.max(b));
        let unit = if largest > 0.0 { largest } else { 1.0 };
        Self([1, 2].map(|power| {
            let mut sum = 0.0;
            let sums = sizes.iter().map(|size| {
                sum += (size / unit).powi(power);
                sum
            });
            std::iter::once(0.0).chain(sums).collect()
        }))
    }

    /// Σ |q| and Σ |q|².
    fn of(&self, sources: Range<usize>) -> [f64; 2] {
        [0, 1].map(|power| self.0[power][sources.end] - self.0[power][sources.start])
    }
}

/// What acts on a target of a leaf, by the lists.
fn acting_on<E: Expansion>(
    kernel: &E::Kernel,
    trees: &Trees<SourceOf<E>, TargetOf<E>>,
    lists: &Lists,
    leaf: usize,
) -> Vec<Part> {
    let (shape, cells) = (&trees.target_tree.shape, &trees.source_tree.shape.nodes);
    let points = shape.nodes[leaf].points();
    let x = &trees.targets[points.start + points.len() / 2];
    let mut parts = Vec::new();
    let near = lists.near.of(leaf);
    let sources: usize = near.iter().map(|run| (run.last - run.first) as usize).sum();
    let together = sources.div_ceil(NEAR_PARTS).max(1);
    for run in near {
        let run = run.first as usize..run.last as usize;
        let starts = run.clone().step_by(together);
        parts.extend(starts.map(|start| (None, start..run.end.min(start + together))));
    }
    let far = |level: usize, s: u32| (Some(level), cells[s as usize].points());
    parts.extend(lists.m2p.of(leaf).iter().map(|&s| far(cells[s as usize].level(), s)));
    for cell in shape.path_to_root(leaf) {
        let met = lists.m2l.of(cell).iter().chain(lists.p2l.of(cell));
        parts.extend(met.map(|&s| far(shape.nodes[cell].level(), s)));
    }

    let samples = |range: &Range<usize>| range.len().min(PART_POINTS);
    let place = |range: &Range<usize>, k: usize| {
        range.start + (2 * k + 1) * range.len() / (2 * samples(range))
    };
    let ys: Vec<_> = parts
        .iter()
        .flat_map(|(_, range)| (0..samples(range)).map(|k| place(range, k)))
        .map(|place| trees.sources[place].position())
        .collect();
    let (xs, len) = ([x.position()], kernel.fields() * kernel.densities());
    let zero = <<E::Kernel as Kernel>::Entry as Numbers>::zero();
    let sizes = |g: &[_], len: usize| -> Vec<f64> {
        let size = |(g, y): (&[_], _)| {
            let size = l2_norm(g.iter().copied());
            // A point may be singular to itself; what is infinite elsewhere, sums will tell.
            if xs[0] == y || !size.is_finite() { 0.0 } else { size }
        };
        g.chunks_exact(len).zip(ys.iter().copied()).map(size).collect()
    };
    let mut g = vec![zero; ys.len() * len];
    kernel.entries_block(&xs, &ys, &mut g);
    let values = sizes(&g, len);
    let slopes = if kernel.needs_gradients() {
        g = vec![zero; ys.len() * 3 * len];
        write_slopes(kernel, &xs, &ys, &mut g);
        sizes(&g, 3 * len)
    } else {
        vec![0.0; ys.len()]
    };
    let mut first = 0;
    let part = |(level, range): (Option<usize>, Range<usize>)| {
        let own = first..first + samples(&range);
        first = own.end;
        let mean = |sizes: &[f64]| l2_norm(sizes.iter().copied()) / (sizes.len() as f64).sqrt();
        let magnitudes = [&values, &slopes].map(|sizes| mean(&sizes[own.clone()]));
        Part { level, sources: range, magnitudes }
    };
    parts.into_iter().map(part).collect()
}

/// Squares of whole sums, none less than a part of what is usual: targets with next to nothing can't ask for
/// digits of it. Usual is the mean of all but the largest tenth, which close pairs may have made large.
fn floored(mut squares: Vec<f64>) -> Vec<f64> {
    let mut sorted = squares.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    let mean = |squares: &[f64]| squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    let most = mean(&sorted[..(9 * sorted.len()).div_ceil(10)]);
    let usual = if most > 0.0 { most } else { mean(&sorted) };
    squares.iter_mut().for_each(|square| *square = square.max(ISOLATED_SHARE.powi(2) * usual));
    squares
}
