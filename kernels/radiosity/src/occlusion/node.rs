//! Nodes of a bounding-volume hierarchy, and how they are built.

use crate::occlusion::bounds::Bounds;
use crate::occlusion::facet::Facet;

/// One node; the first child of an inner node is the node after it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    /// A box around its triangles, grown by the margin.
    pub(crate) bounds: Bounds<f64>,
    /// First facet of a leaf, second child of an inner node.
    pub(crate) first: u32,
    /// How many facets a leaf holds; 0 for inner nodes.
    pub(crate) count: u32,
}

/// A leaf with so few triangles is not split further.
const LEAF_SIZE: usize = 2;

/// Candidates per axis for the split of a node.
const BINS: usize = 16;

/// Beyond this depth nodes are halved by count, so that no path is longer than [`MAX_DEPTH`].
const HALVING_DEPTH: usize = 32;

/// A bound on the depth: each halving of fewer than 2³² triangles takes one level.
pub(crate) const MAX_DEPTH: usize = HALVING_DEPTH + 32;

/// Appends the subtree over `facets`, which start at index `first` of the whole array, and reorders
/// them so that every leaf's are consecutive.
pub(crate) fn build(
    nodes: &mut Vec<Node>,
    facets: &mut [Facet],
    first: usize,
    margin: f64,
    depth: usize,
) {
    let bounds = bounds_of(facets).grown(margin);
    let at = nodes.len();
    nodes.push(Node { bounds, first: first as u32, count: facets.len() as u32 });
    if facets.len() <= LEAF_SIZE {
        return;
    }
    let middle = split(facets, depth);
    let (left, right) = facets.split_at_mut(middle);
    build(nodes, left, first, margin, depth + 1);
    nodes[at] = Node { bounds, first: nodes.len() as u32, count: 0 };
    build(nodes, right, first + middle, margin, depth + 1);
}

/// Reorders `facets` into two parts, neither empty, and returns where the second begins.
fn split(facets: &mut [Facet], depth: usize) -> usize {
    let middle = facets.len() / 2;
    let centroids = Bounds::of(facets.iter().map(Facet::centroid));
    let widths: [f64; 3] = std::array::from_fn(|k| centroids.high[k] - centroids.low[k]);
    let axis =
        (0..3).max_by(|&i, &j| widths[i].total_cmp(&widths[j])).expect("there are three axes");
    if widths[axis] > 0.0 && widths[axis].is_finite() && depth < HALVING_DEPTH {
        let bin_of = |facet: &Facet| {
            let fraction = (facet.centroid()[axis] - centroids.low[axis]) / widths[axis];
            ((fraction * BINS as f64) as usize).min(BINS - 1)
        };
        let boundary = cheapest_boundary(facets, &bin_of);
        let mut count = 0;
        for i in 0..facets.len() {
            if bin_of(&facets[i]) < boundary {
                facets.swap(i, count);
                count += 1;
            }
        }
        return count;
    }
    facets.select_nth_unstable_by(middle, |a, b| a.centroid()[axis].total_cmp(&b.centroid()[axis]));
    middle
}

/// The bin at which the second part of the cheapest split begins: the sum of surface area times
/// count over both parts is least. The first and the last bin are never empty, so neither part is.
fn cheapest_boundary(facets: &[Facet], bin_of: &impl Fn(&Facet) -> usize) -> usize {
    let mut bins = [(Bounds::empty(), 0usize); BINS];
    for facet in facets {
        let (bounds, count) = &mut bins[bin_of(facet)];
        *bounds = bounds.union(&facet.bounds());
        *count += 1;
    }
    let cost = |part: &[(Bounds<f64>, usize)]| {
        let bounds = part.iter().fold(Bounds::empty(), |all, (bounds, _)| all.union(bounds));
        bounds.half_area() * part.iter().map(|&(_, count)| count as f64).sum::<f64>()
    };
    let costs = (1..BINS).map(|b| (b, cost(&bins[..b]) + cost(&bins[b..])));
    costs.min_by(|a, b| a.1.total_cmp(&b.1)).expect("there are several bins").0
}

/// The box around all facets.
pub(crate) fn bounds_of(facets: &[Facet]) -> Bounds<f64> {
    facets.iter().fold(Bounds::empty(), |bounds, facet| bounds.union(&facet.bounds()))
}
