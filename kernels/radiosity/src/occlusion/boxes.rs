//! The boxes of a hierarchy in single precision, for packets of rays.

use glam::DVec3;

use crate::occlusion::bounds::Bounds;
use crate::occlusion::node::Node;

/// The nodes of [`Occluders`](crate::Occluders) in single precision, around the centre of all.
#[derive(Clone, Debug)]
pub(crate) struct Boxes {
    pub(crate) centre: DVec3,
    /// From scene units to ones in which no coordinate is beyond one: a power of two.
    pub(crate) scale: f64,
    pub(crate) nodes: Vec<SmallNode>,
}

/// A node in the order of the others. Its box may be too small by rounding.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SmallNode {
    pub(crate) low: [f32; 3],
    pub(crate) high: [f32; 3],
    /// As in [`Node`].
    pub(crate) first: u32,
    pub(crate) count: u32,
}

impl Boxes {
    pub(crate) fn new(nodes: &[Node]) -> Self {
        let Some(Node { bounds: Bounds { low, high }, .. }) = nodes.first() else {
            return Self { centre: DVec3::ZERO, scale: 1.0, nodes: Vec::new() };
        };
        let (low, high) = (DVec3::from_array(*low), DVec3::from_array(*high));
        let centre = low.midpoint(high);
        let extent = (high - low).max_element();
        let scale = if extent > 0.0 { (-extent.log2().ceil()).exp2() } else { 1.0 };
        let around =
            |p: [f64; 3]| ((DVec3::from_array(p) - centre) * scale).to_array().map(|c| c as f32);
        let small = |&Node { bounds, first, count }: &Node| SmallNode {
            low: around(bounds.low),
            high: around(bounds.high),
            first,
            count,
        };
        Self { centre, scale, nodes: nodes.iter().map(small).collect() }
    }
}
