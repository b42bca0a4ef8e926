//! Which elements are so close to one that size matters.

use glam::DVec3;

use crate::elements::Element;
use crate::occlusion::Bounds;

/// A tree over the centroids of elements; each node knows the largest radius in it.
pub(crate) struct Neighbours {
    nodes: Vec<Node>,
    /// Index, centroid and radius of every element, leaf after leaf.
    spheres: Vec<Sphere>,
}

/// A sphere around an element.
#[derive(Clone, Copy)]
struct Sphere {
    index: u32,
    centre: DVec3,
    radius: f64,
}

/// One node; the first child of an inner node is the node after it.
struct Node {
    bounds: Bounds<f64>,
    radius: f64,
    /// The spheres of a leaf; the second child of an inner node at `start`, if `end` is 0.
    start: usize,
    end: usize,
}

/// Spheres of a leaf.
const LEAF_SIZE: usize = 8;

impl Neighbours {
    /// The tree of some elements. O(N log N).
    pub(crate) fn new(elements: &[Element]) -> Self {
        let sphere = |(index, element): (usize, &Element)| Sphere {
            index: index as u32,
            centre: element.surfel().position,
            radius: element.radius(),
        };
        let mut spheres: Vec<Sphere> = elements.iter().enumerate().map(sphere).collect();
        let mut nodes = Vec::new();
        if !spheres.is_empty() {
            build(&mut nodes, &mut spheres, 0);
        }
        Self { nodes, spheres }
    }

    /// Calls `visit(j)` for every element j with d² ≤ κ (r² + r_j²), d the distance of its centroid
    /// from `centre` and r_j its radius, in an order that depends on the elements alone.
    pub(crate) fn for_each(
        &self,
        centre: DVec3,
        radius: f64,
        kappa: f64,
        mut visit: impl FnMut(usize),
    ) {
        let reach = |other: f64| kappa * (radius * radius + other * other);
        let mut open = if self.nodes.is_empty() { vec![] } else { vec![0] };
        while let Some(at) = open.pop() {
            let node = &self.nodes[at];
            let centre_of_box = |k: usize| centre[k].clamp(node.bounds.low[k], node.bounds.high[k]);
            let nearest = DVec3::from_array(std::array::from_fn(centre_of_box));
            if nearest.distance_squared(centre) > reach(node.radius) {
                continue;
            }
            if node.end == 0 {
                open.extend([node.start, at + 1]);
                continue;
            }
            for sphere in &self.spheres[node.start..node.end] {
                if sphere.centre.distance_squared(centre) <= reach(sphere.radius) {
                    visit(sphere.index as usize);
                }
            }
        }
    }
}

/// Appends the subtree over `spheres`, which start at index `start` of the whole array.
fn build(nodes: &mut Vec<Node>, spheres: &mut [Sphere], start: usize) {
    let bounds = Bounds::of(spheres.iter().map(|sphere| sphere.centre.to_array()));
    let radius = spheres.iter().map(|sphere| sphere.radius).fold(0.0, f64::max);
    let at = nodes.len();
    nodes.push(Node { bounds, radius, start, end: start + spheres.len() });
    if spheres.len() <= LEAF_SIZE {
        return;
    }
    let width = |k: usize| bounds.high[k] - bounds.low[k];
    let axis = (0..3).max_by(|&i, &j| width(i).total_cmp(&width(j))).unwrap_or(0);
    let middle = spheres.len() / 2;
    spheres.select_nth_unstable_by(middle, |a, b| {
        a.centre[axis].total_cmp(&b.centre[axis]).then(a.index.cmp(&b.index))
    });
    let (left, right) = spheres.split_at_mut(middle);
    build(nodes, left, start);
    nodes[at].start = nodes.len();
    nodes[at].end = 0;
    build(nodes, right, start + middle);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::Surfel;
    use std::collections::BTreeSet;

    #[test]
    fn the_tree_finds_what_a_search_of_all_finds() {
        let element = |i: usize| {
            let position =
                DVec3::new(0.819, 0.671, 0.549).map(|step| (step * i as f64).fract() * 10.0);
            let area = if i.is_multiple_of(50) { 3.0 } else { 0.02 };
            let face = Surfel::<f64>::NO_FACE;
            Element::disk(Surfel { position, normal: DVec3::Z, area, face })
        };
        let elements: Vec<Element> = (0..700).map(element).collect();
        let tree = Neighbours::new(&elements);
        for kappa in [0.5, 4.0, 100.0] {
            let mut found_some = 0;
            for one in &elements {
                let (centre, radius) = (one.surfel().position, one.radius());
                let mut found = BTreeSet::new();
                tree.for_each(centre, radius, kappa, |j| assert!(found.insert(j)));
                let near = |other: &Element| {
                    let reach = radius.powi(2) + other.radius().powi(2);
                    other.surfel().position.distance_squared(centre) <= kappa * reach
                };
                assert!(found.iter().copied().eq((0..700).filter(|&j| near(&elements[j]))));
                found_some += found.len();
            }
            assert!(found_some > 700 || kappa < 1.0);
        }
        Neighbours::new(&[]).for_each(DVec3::ZERO, 1.0, 1e9, |_| panic!("there is nothing"));
    }
}
