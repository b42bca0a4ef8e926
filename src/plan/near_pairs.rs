//! Which pairs a plan sums directly, for whoever sums them in another way.

use std::ops::Range;

use crate::expansion::Expansion;
use crate::interaction::lists::{ALL, Run};
use crate::numbers::bits::for_each_set_bit;
use crate::plan::Plan;
use crate::plan::fmm::Fmm;

/// Pairs of points that a plan sums directly: every one of some targets with every one of some sources.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct NearBlock<'a> {
    /// Indices of the targets in the caller's order, no two alike.
    pub targets: &'a [u32],
    /// Indices of the sources in the caller's order, no two alike.
    pub sources: &'a [u32],
    /// By which share the pairs count: 1, or what a [mask](crate::Mask) said of them, more than 0.
    pub share: f64,
}

impl<E: Expansion> Fmm<E> {
    /// The near field of the plan: all pairs that it sums directly, in blocks. Every pair of a target and a source is
    /// in one block, or is carried by expansions, or left out because it is [within the
    /// tolerance](crate::Stats::left_out_pairs), or does not count.
    ///
    /// For boundary elements, whose near interactions take a quadrature of their own: what
    /// [`apply`](Self::apply) gives, less the direct sums over these pairs, is the far part of a sum. A target is in the
    /// blocks of one leaf of the tree, which follow each other; their order is that of the tree.
    ///
    /// Going through all blocks costs O(cells), and O(pairs) where a mask lets some pairs of leaves count; their pairs
    /// are counted by [`Stats::direct_pairs`](crate::Stats::direct_pairs).
    ///
    /// ```
    /// use farfield::{Fmm, formula, relative_l2_error};
    ///
    /// let points: Vec<[f64; 3]> = (0..4000).map(|i| [0.755, 0.570, 0.362].map(|s| (s * f64::from(i)).fract())).collect();
    /// let near = |x: [f64; 3], y: [f64; 3]| (0.01 + (0..3).map(|k| (x[k] - y[k]).powi(2)).sum::<f64>()).sqrt().recip();
    /// let fmm = Fmm::builder(formula!(|d| (d.length_squared() + 0.01).sqrt().recip()))
    ///     .tolerance(1e-4)
    ///     .leaf_size(40)
    ///     .build(&points, &points)?;
    ///
    /// // The sums without their near part.
    /// let mut far = fmm.apply(&vec![1.0; points.len()])?;
    /// let mut pairs = 0;
    /// for block in fmm.near_pairs() {
    ///     for &i in block.targets {
    ///         far[i as usize] -= block.sources.iter().map(|&j| near(points[i as usize], points[j as usize])).sum::<f64>();
    ///     }
    ///     pairs += (block.targets.len() * block.sources.len()) as u64;
    /// }
    /// assert_eq!(pairs, fmm.report().stats.direct_pairs);
    /// assert!(far.iter().all(|&u| u > 0.0) && pairs < 4000 * 4000);
    /// # Ok::<(), farfield::Error>(())
    /// ```
    pub fn near_pairs(&self) -> impl Iterator<Item = NearBlock<'_>> {
        let plan = &self.usual.plan;
        let leaves = plan.target_tree.shape.leaves.iter();
        leaves.flat_map(|&leaf| blocks(plan, leaf as usize))
    }
}

/// The blocks of a target leaf.
fn blocks<E: Expansion>(plan: &Plan<E>, leaf: usize) -> Vec<NearBlock<'_>> {
    let Plan { source_tree, target_tree, lists, .. } = plan;
    let (sources, targets) = (&source_tree.shape.order[..], &target_tree.shape.order[..]);
    let own = &targets[target_tree.shape.nodes[leaf].points()];
    let mut blocks = Vec::new();
    for run in lists.near.of(leaf) {
        let ys = &sources[run.first as usize..run.last as usize];
        if run.bits == ALL {
            blocks.push(NearBlock { targets: own, sources: ys, share: 1.0 });
        } else {
            add_stretches(&lists.bits, run, own, ys, &mut blocks);
        }
    }
    blocks.extend(lists.shares_of(leaf).iter().map(|pair| {
        let [target, source] = [pair.target, pair.source].map(|place| place as usize);
        let (targets, sources) = (&targets[target..=target], &sources[source..=source]);
        NearBlock { targets, sources, share: pair.share }
    }));
    blocks
}

/// Adds what counts of a run that is partly masked, target by target, in stretches of sources.
fn add_stretches<'a>(
    bits: &[u64],
    run: &Run,
    targets: &'a [u32],
    sources: &'a [u32],
    blocks: &mut Vec<NearBlock<'a>>,
) {
    let bits = &bits[run.bits as usize..];
    for i in 0..targets.len() {
        let mut add = |stretch: Range<usize>| {
            if !stretch.is_empty() {
                let (targets, sources) = (&targets[i..=i], &sources[stretch]);
                blocks.push(NearBlock { targets, sources, share: 1.0 });
            }
        };
        let mut stretch = 0..0;
        for_each_set_bit(bits, i, sources.len(), |j| {
            if j != stretch.end {
                add(std::mem::replace(&mut stretch, j..j));
            }
            stretch.end = j + 1;
        });
        add(stretch);
    }
}
