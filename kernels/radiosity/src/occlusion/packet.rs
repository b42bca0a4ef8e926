//! Segments side by side in wide registers, and what hides their ends from each other.
//!
//! What is computed here in single precision only rules facets out. Whatever may hide a pair is asked
//! [exactly](Facet::blocks), so that the answers are those of single rays to the bit.
//!
//! Code with wide registers must be inlined into the function that `pulp` compiles for the machine:
//! hence `#[inline(always)]` throughout, and loops over indices.

#![expect(clippy::needless_range_loop, reason = "closures of iterators may not be inlined")]

use glam::DVec3;

use crate::elements::Surfel;
use crate::occlusion::boxes::SmallNode;
use crate::occlusion::facet::{Facet, ordered};
use crate::occlusion::node::MAX_DEPTH;
use crate::occlusion::occluders::Occluders;
use crate::occlusion::sights::Segment;

/// Rays side by side: 512 bits of `f32`.
pub(crate) const LANES: usize = 16;

const NO_FACE: u32 = Surfel::<f64>::NO_FACE;

/// By how much single precision may be off, relative to the largest numbers that enter a result: some
/// ten roundings.
const SLACK: f32 = 1e-6;

/// Segments between points of faces.
pub(crate) struct Packet<'a> {
    occluders: &'a Occluders,
    ends: [[DVec3; LANES]; 2],
    faces: [[u32; LANES]; 2],
    /// Where the segments start, from the centre of the occluders; this and all below in units of their
    /// extent.
    from: [[f32; LANES]; 3],
    /// Where they start, from the start of the first.
    apart: [[f32; LANES]; 3],
    /// From there to their ends.
    direction: [[f32; LANES]; 3],
    length: [f32; LANES],
    inverse: [[f32; LANES]; 3],
    /// 1 where a segment is still looked at, else −1: how far along it to look.
    end: [f32; LANES],
    /// A bound on all coordinates.
    reach: f32,
    /// The square of a bound on what the starts are apart.
    spread: f32,
    pub(crate) unhidden: [bool; LANES],
}

impl<'a> Packet<'a> {
    #[inline(always)]
    pub(crate) fn new(occluders: &'a Occluders, segments: &[Segment]) -> Self {
        let boxes = occluders.boxes();
        let mut packet = Self {
            occluders,
            ends: [[boxes.centre; LANES]; 2],
            faces: [[0; LANES]; 2],
            from: [[0.0; LANES]; 3],
            apart: [[0.0; LANES]; 3],
            direction: [[0.0; LANES]; 3],
            length: [0.0; LANES],
            inverse: [[0.0; LANES]; 3],
            end: [-1.0; LANES],
            reach: 0.0,
            spread: 0.0,
            unhidden: [true; LANES],
        };
        for (lane, segment) in segments.iter().enumerate() {
            for end in 0..2 {
                packet.ends[end][lane] = segment.ends[end];
                packet.faces[end][lane] = segment.faces[end];
            }
            packet.end[lane] = 1.0;
        }
        let first = packet.ends[0][0];
        let (mut reach, mut spread) = (1.0, 0.0);
        for lane in 0..segments.len() {
            let [from, to] = [packet.ends[0][lane], packet.ends[1][lane]];
            let [apart, d, from] =
                [from - first, to - from, from - boxes.centre].map(|p| p * boxes.scale);
            for k in 0..3 {
                packet.from[k][lane] = from[k] as f32;
                packet.apart[k][lane] = apart[k] as f32;
                packet.direction[k][lane] = d[k] as f32;
            }
            packet.length[lane] = d.length() as f32;
            let bound = from.abs().max(d.abs()).max_element() as f32;
            reach = if bound > reach { bound } else { reach };
            let bound = apart.length_squared() as f32;
            spread = if bound > spread { bound } else { spread };
        }
        for k in 0..3 {
            for lane in 0..LANES {
                packet.inverse[k][lane] = 1.0 / packet.direction[k][lane];
            }
        }
        packet.reach = reach;
        packet.spread = spread;
        packet
    }

    /// Finds out which are hidden; `last` is what hid another most lately.
    #[inline(always)]
    pub(crate) fn trace(&mut self, last: &mut Option<&'a Facet>) {
        if let Some(facet) = *last {
            self.ask(facet, last);
        }
        let occluders = self.occluders;
        let nodes = &occluders.boxes().nodes;
        // Boxes grow by what rounding may take from them.
        let slack = SLACK * self.reach;
        let mut stack = [0u32; MAX_DEPTH + 1];
        let mut height = usize::from(!nodes.is_empty());
        while height > 0 {
            height -= 1;
            let mut at = stack[height] as usize;
            loop {
                let node = &nodes[at];
                if node.count > 0 {
                    for facet in occluders.facets_of(node) {
                        self.ask(facet, last);
                    }
                    break;
                }
                // Both children at once: neither has to wait for the other's result.
                let second = node.first as usize;
                let one = self.meets(&nodes[at + 1], slack);
                let other = self.meets(&nodes[second], slack);
                if other {
                    stack[height] = node.first;
                    height += 1;
                }
                if one {
                    at += 1;
                } else if other {
                    height -= 1;
                    at = second;
                } else {
                    break;
                }
            }
        }
    }

    /// Whether some segment that is still looked at may meet a node's box; see `Slabs`.
    #[inline(always)]
    fn meets(&self, node: &SmallNode, slack: f32) -> bool {
        let low = [node.low[0] - slack, node.low[1] - slack, node.low[2] - slack];
        let high = [node.high[0] + slack, node.high[1] + slack, node.high[2] + slack];
        let mut any = 0u32;
        for lane in 0..LANES {
            let (mut enter, mut leave) = (0.0f32, self.end[lane]);
            for k in 0..3 {
                let low = (low[k] - self.from[k][lane]) * self.inverse[k][lane];
                let high = (high[k] - self.from[k][lane]) * self.inverse[k][lane];
                let (near, far) = if low < high { (low, high) } else { (high, low) };
                enter = if near > enter { near } else { enter };
                leave = if far < leave { far } else { leave };
            }
            any |= u32::from(enter <= leave);
        }
        any != 0
    }

    /// Looks at who is hidden by a facet.
    #[inline(always)]
    fn ask(&mut self, facet: &'a Facet, last: &mut Option<&'a Facet>) {
        let first = self.ends[0][0];
        let scale = self.occluders.boxes().scale;
        let vertices = facet.vertices.map(|v| ((v - first) * scale).to_array().map(|c| c as f32));
        let normal = facet.normal.to_array().map(|c| c as f32);
        let slack = SLACK * self.reach;
        let mut maybe = [0u32; LANES];
        let mut any = 0;
        for lane in 0..LANES {
            let o = [self.apart[0][lane], self.apart[1][lane], self.apart[2][lane]];
            let d = [self.direction[0][lane], self.direction[1][lane], self.direction[2][lane]];
            let (a, b, c) =
                (minus(&vertices[0], &o), minus(&vertices[1], &o), minus(&vertices[2], &o));
            let volume = |p: &[f32; 3], q: &[f32; 3]| dot(&d, &cross(p, q));
            let (u, v, w) = (volume(&b, &c), volume(&c, &a), volume(&a, &b));
            let squares = dot(&a, &a) + dot(&b, &b) + dot(&c, &c) + self.spread;
            let sides = SLACK * self.length[lane] * squares;
            let (start, rise) = (-dot(&normal, &a), dot(&normal, &d));
            // Each way round, so that what overflows rules nothing out.
            let outside = ((u < -sides) | (v < -sides) | (w < -sides))
                & ((u > sides) | (v > sides) | (w > sides));
            let aside = ((start > slack) & (start + rise > slack))
                | ((start < -slack) & (start + rise < -slack));
            // Most segments start and end on a facet of their own.
            let own = (facet.face == self.faces[0][lane]) | (facet.face == self.faces[1][lane]);
            let counts = (!own | (facet.face == NO_FACE)) & (self.end[lane] > 0.0);
            maybe[lane] = u32::from(!outside & !aside & counts);
            any |= maybe[lane];
        }
        if any == 0 {
            return;
        }
        let margin = self.occluders.margin();
        for lane in 0..LANES {
            if maybe[lane] == 0 {
                continue;
            }
            let (from, to) = ordered(self.ends[0][lane], self.ends[1][lane]);
            if facet.blocks(from, to, [self.faces[0][lane], self.faces[1][lane]], margin) {
                self.unhidden[lane] = false;
                self.end[lane] = -1.0;
                *last = Some(facet);
            }
        }
    }
}

#[inline(always)]
fn minus(a: &[f32; 3], b: &[f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn dot(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: &[f32; 3], b: &[f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
