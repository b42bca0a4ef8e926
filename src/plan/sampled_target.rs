//! What acts on a target, by the lists.

use std::ops::Range;

use crate::expansion::weights::Weights;
use crate::expansion::{Expansion, SourceOf, TargetOf};
use crate::interaction::lists::Lists;
use crate::kernel::slopes::write_slopes;
use crate::kernel::traits::Kernel;
use crate::numbers::traits::{Located, Numbers, Real, Scalar, l2_norm};
use crate::octree::trees::Trees;
use crate::plan::charge_sums::ChargeSums;
use crate::plan::tuning::{NEAR_PARTS, PART_POINTS};

/// What acts on a target.
#[derive(Debug)]
pub(crate) struct Target {
    pub(crate) parts: Vec<Part>,
    /// The mean of G, and of ∂G/∂x, over each part: one matrix after the other, with two numbers for an entry.
    pub(crate) means: [Vec<f64>; 2],
    /// The root mean squares of their numbers, likewise.
    sizes: [Vec<f64>; 2],
    /// Fields and densities.
    shape: [usize; 2],
}

/// Sources that act on a target alike.
#[derive(Debug)]
pub(crate) struct Part {
    /// How they come to the target.
    pub(crate) way: Way,
    pub(crate) sources: Sources,
    /// The root mean square of |G| and of |∂G/∂x|.
    pub(crate) magnitudes: [f64; 2],
}

/// Components of a matrix: all, those of a field, or those of a density.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Components {
    All,
    Field(usize),
    Density(usize),
}

/// How what sources send comes to a target.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Way {
    /// It is summed directly.
    Near,
    /// Through the expansions of a level.
    Through(usize),
    /// It is left out.
    LeftOut,
}

#[derive(Clone, Debug)]
pub(crate) enum Sources {
    /// Those of a cell, with their places in tree order.
    Cell(usize, Range<usize>),
    /// Places in tree order.
    Run(Range<usize>),
}

impl Sources {
    /// Σ |q| and (Σ |q|²)^½; of charges of one size if none are given.
    pub(crate) fn charges(&self, charges: Option<&ChargeSums>) -> [f64; 2] {
        match (self, charges) {
            (Self::Cell(cell, _), Some(sums)) => sums.cells[*cell],
            (Self::Run(run), Some(sums)) => {
                let own = &sums.sizes[run.clone()];
                [own.iter().sum(), l2_norm(own.iter().copied())]
            }
            (_, None) => [self.places().len() as f64, (self.places().len() as f64).sqrt()],
        }
    }

    fn places(&self) -> &Range<usize> {
        match self {
            Self::Cell(_, places) | Self::Run(places) => places,
        }
    }

    /// Some of the places, spread over all.
    fn samples(&self) -> impl ExactSizeIterator<Item = usize> {
        let Range { start, end } = *self.places();
        let count = (end - start).min(PART_POINTS);
        (0..count).map(move |k| start + (2 * k + 1) * (end - start) / (2 * count))
    }
}

impl Target {
    /// What acts on a target of a leaf.
    pub(crate) fn new<E: Expansion>(
        (kernel, weights): (&E::Kernel, &Weights),
        trees: &Trees<SourceOf<E>, TargetOf<E>>,
        lists: &Lists,
        leaf: usize,
    ) -> Self {
        let points = trees.target_tree.shape.nodes[leaf].points();
        let x = trees.targets[points.start + points.len() / 2].position();
        let (target_cells, source_cells) = (&trees.target_tree.shape, &trees.source_tree.shape);
        let mut parts = Vec::new();
        let near = lists.near.of(leaf);
        let sources: usize = near.iter().map(|run| (run.last - run.first) as usize).sum();
        let together = sources.div_ceil(NEAR_PARTS).max(1);
        for run in near {
            let run = run.first as usize..run.last as usize;
            let starts = run.clone().step_by(together);
            let cut = |start| Sources::Run(start..run.end.min(start + together));
            parts.extend(starts.map(|start| (Way::Near, cut(start))));
        }
        let cell = |way: Way, s: u32| {
            let points = source_cells.nodes[s as usize].points();
            (way, Sources::Cell(s as usize, points))
        };
        let through = |s: u32| Way::Through(source_cells.nodes[s as usize].level());
        parts.extend(lists.m2p.of(leaf).iter().map(|&s| cell(through(s), s)));
        for t in target_cells.path_to_root(leaf) {
            let through = Way::Through(target_cells.nodes[t].level());
            let met = lists.m2l.of(t).iter().chain(lists.p2l.of(t));
            parts.extend(met.map(|&s| cell(through, s)));
            parts.extend(lists.left_out.of(t).iter().map(|&s| cell(Way::LeftOut, s)));
        }

        let places = parts.iter().flat_map(|(_, sources)| sources.samples());
        let ys: Vec<_> = places.map(|place| trees.sources[place].position()).collect();
        let len = kernel.fields() * kernel.densities();
        let zero = <<E::Kernel as Kernel>::Entry as Numbers>::zero();
        let mut values = vec![zero; ys.len() * len];
        kernel.entries_block(&[x], &ys, &mut values);
        weights.apply(kernel.fields(), &mut values);
        let mut slopes = vec![zero; ys.len() * if kernel.needs_gradients() { 3 * len } else { 0 }];
        if !slopes.is_empty() {
            write_slopes(kernel, &[x], &ys, &mut slopes);
            weights.apply(3 * kernel.fields(), &mut slopes);
        }
        // A point may be singular to itself.
        let apart: Vec<bool> = ys.iter().map(|y| *y != x).collect();
        let (values, value_sizes) = means(&parts, &values, &apart);
        let (slopes, slope_sizes) = means(&parts, &slopes, &apart);
        let (means, sizes) = ([values, slopes], [value_sizes, slope_sizes]);
        let shape = [kernel.fields(), kernel.densities()];
        let mut own = Self { parts: Vec::new(), means, sizes, shape };
        let part = |(k, (way, sources))| {
            let magnitudes =
                [0, 1].map(|channel| own.size(channel, k, parts.len(), Components::All));
            Part { way, sources, magnitudes }
        };
        own.parts = parts.iter().cloned().enumerate().map(part).collect();
        own
    }

    /// What the target receives of some entries in ways that count, from charges of one sign and of any.
    pub(crate) fn received(
        &self,
        channel: usize,
        entries: Components,
        charges: Option<&ChargeSums>,
        counts: impl Fn(Way) -> bool,
    ) -> [f64; 2] {
        let means = self.means[channel].chunks_exact(self.len(channel));
        let (mut sum, mut any_sign) = (vec![0.0; self.len(channel)], 0.0f64);
        let parts = self.parts.iter().enumerate().zip(means);
        for ((k, part), mean) in parts.filter(|((_, part), _)| counts(part.way)) {
            let [q, norm] = part.sources.charges(charges);
            any_sign = any_sign.hypot(self.magnitude(channel, k, entries) * norm);
            sum.iter_mut().zip(mean).for_each(|(sum, g)| *sum += g * q);
        }
        let own = sum.into_iter().enumerate().filter(|(k, _)| self.is_of(channel, *k, entries));
        [l2_norm(own.map(|(_, sum)| sum)).max(any_sign), any_sign]
    }

    /// The root mean square of some entries of G, or ∂G/∂x, over the k-th part.
    pub(crate) fn magnitude(&self, channel: usize, k: usize, entries: Components) -> f64 {
        match entries {
            Components::All => self.parts[k].magnitudes[channel],
            some => self.size(channel, k, self.parts.len(), some),
        }
    }

    /// The fields and the densities by themselves, and how many there are of each; only all of them together where
    /// there is one.
    pub(crate) fn each(&self) -> impl Iterator<Item = (Components, usize)> {
        let [fields, densities] = self.shape;
        let alone = |count: usize| if count > 1 { count } else { 0 };
        let of_fields = (0..alone(fields)).map(move |i| (Components::Field(i), fields));
        let of_densities = (0..alone(densities)).map(move |j| (Components::Density(j), densities));
        of_fields.chain(of_densities).chain([(Components::All, 1)])
    }

    fn size(&self, channel: usize, k: usize, parts: usize, entries: Components) -> f64 {
        let len = self.sizes[channel].len() / parts.max(1);
        let own = self.sizes[channel][k * len..][..len].iter().enumerate();
        let own = own.filter(|(k, _)| self.is_of(channel, *k, entries));
        l2_norm(own.map(|(_, size)| *size))
    }

    /// Whether the k-th number of a matrix is of some entries.
    fn is_of(&self, channel: usize, k: usize, entries: Components) -> bool {
        let (entry, densities) = (k / 2, self.shape[1]);
        let rows = if channel == 0 { 1 } else { 3 };
        match entries {
            Components::All => true,
            Components::Field(i) => entry / densities / rows == i,
            Components::Density(j) => entry % densities == j,
        }
    }

    /// How many numbers make up a matrix.
    pub(crate) fn len(&self, channel: usize) -> usize {
        (self.means[channel].len() / self.parts.len().max(1)).max(1)
    }
}

/// The mean over the samples of each part, and the root mean square, of the numbers of matrices that are given for all
/// samples one after the other; only those count that are between points apart.
fn means<S: Scalar>(
    parts: &[(Way, Sources)],
    entries: &[S],
    apart: &[bool],
) -> (Vec<f64>, Vec<f64>) {
    let len = entries.len() / apart.len().max(1);
    let (mut means, mut sizes, mut at) = (Vec::new(), Vec::new(), 0);
    for (_, sources) in parts {
        let samples = at..at + sources.samples().len();
        let count = samples.len() as f64;
        at = samples.end;
        let (mut mean, mut size) = (vec![0.0; 2 * len], vec![0.0f64; 2 * len]);
        for k in samples.filter(|&k| apart[k]) {
            let numbers = entries[k * len..][..len].iter().flat_map(|g| g.parts());
            let numbers: Vec<f64> = numbers.map(Real::as_f64).collect();
            // What is infinite between points apart, sums will tell.
            if numbers.iter().all(|number| number.is_finite()) {
                for ((mean, size), g) in mean.iter_mut().zip(&mut size).zip(numbers) {
                    *mean += g / count;
                    *size = size.hypot(g);
                }
            }
        }
        means.extend(mean);
        sizes.extend(size.into_iter().map(|size| size / count.sqrt()));
    }
    (means, sizes)
}
