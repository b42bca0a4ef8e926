//! Visibility of many pairs of surfels at once: rays side by side in wide registers.
//!
//! What is computed here in single precision only rules facets out. Whatever may hide a pair is asked
//! [exactly](Facet::blocks), so that the answers are those of single rays to the bit.
//!
//! Code with wide registers must be inlined into the function that `pulp` compiles for the machine:
//! hence `#[inline(always)]` throughout, and loops over indices.

#![expect(clippy::needless_range_loop, reason = "closures of iterators may not be inlined")]

use farfield::{Real, Vector, dispatch};
use glam::DVec3;
use pulp::{Simd, WithSimd};

use crate::bvh::{MAX_DEPTH, Occluders, SmallNode};
use crate::facet::{Facet, ordered};
use crate::shaft::position;
use crate::surfel::Surfel;

/// Rays side by side: 512 bits of `f32`.
pub(crate) const LANES: usize = 16;

const NO_FACE: u32 = Surfel::<f64>::NO_FACE;

/// By how much single precision may be off, relative to the largest numbers that enter a result: some
/// ten roundings.
const SLACK: f32 = 1e-6;

/// All pairs of two groups of surfels.
pub(crate) struct AllPairs<'a, T: Real> {
    pub(crate) occluders: &'a Occluders,
    pub(crate) xs: &'a [Surfel<T>],
    pub(crate) ys: &'a [Surfel<T>],
    /// Is told of every pair that faces each other, whether it is unhidden.
    pub(crate) answer: &'a mut dyn FnMut(usize, usize, bool),
}

impl<T: Real> AllPairs<'_, T> {
    /// Asks for all pairs with the best instructions that the machine has.
    pub(crate) fn run(self) {
        dispatch(self)
    }
}

impl<T: Real> WithSimd for AllPairs<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self { occluders, xs, ys, answer } = self;
        let packs: Vec<Pack<T>> = ys.chunks(LANES).map(Pack::new).collect();
        let mut facing = Vec::with_capacity(xs.len() * ys.len());
        for (i, x) in xs.iter().enumerate() {
            for (p, pack) in packs.iter().enumerate() {
                let lanes = pack.facing(x);
                for lane in 0..LANES {
                    if lanes[lane] {
                        facing.push((i, LANES * p + lane));
                    }
                }
            }
        }
        let mut last = None;
        for pairs in facing.chunks(LANES) {
            let mut packet = Packet::new(occluders, xs, ys, pairs);
            packet.trace(&mut last);
            for (lane, &(i, j)) in pairs.iter().enumerate() {
                answer(i, j, packet.unhidden[lane]);
            }
        }
    }
}

/// Some pairs of two groups of surfels, [`LANES`] at most.
pub(crate) struct SomePairs<'a, 'b, T: Real> {
    pub(crate) occluders: &'a Occluders,
    pub(crate) xs: &'b [Surfel<T>],
    pub(crate) ys: &'b [Surfel<T>],
    pub(crate) pairs: &'b [(usize, usize)],
    /// What hid another pair most lately.
    pub(crate) last: &'b mut Option<&'a Facet>,
}

impl<T: Real> SomePairs<'_, '_, T> {
    /// Which of them are unhidden, a bit each.
    pub(crate) fn run(self) -> u16 {
        dispatch(self)
    }
}

impl<T: Real> WithSimd for SomePairs<'_, '_, T> {
    type Output = u16;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> u16 {
        let mut packet = Packet::new(self.occluders, self.xs, self.ys, self.pairs);
        packet.trace(self.last);
        let mut unhidden = 0;
        for lane in 0..self.pairs.len() {
            unhidden |= u16::from(packet.unhidden[lane]) << lane;
        }
        unhidden
    }
}

/// Surfels side by side; those that fill up the last lanes face nothing.
struct Pack<T> {
    position: [[T; LANES]; 3],
    normal: [[T; LANES]; 3],
}

impl<T: Real> Pack<T> {
    #[inline(always)]
    fn new(surfels: &[Surfel<T>]) -> Self {
        let zero = [[T::from_f64(0.0); LANES]; 3];
        let mut pack = Self { position: zero, normal: zero };
        for (lane, surfel) in surfels.iter().enumerate() {
            let (position, normal) = (surfel.position.to_array(), surfel.normal.to_array());
            for k in 0..3 {
                pack.position[k][lane] = position[k];
                pack.normal[k][lane] = normal[k];
            }
        }
        pack
    }

    /// [`Projections::facing`](crate::Projections::facing), rounded alike.
    #[inline(always)]
    fn facing(&self, x: &Surfel<T>) -> [bool; LANES] {
        let (at, normal) = (x.position.to_array(), x.normal.to_array());
        let (zero, epsilon) = (T::from_f64(0.0), T::epsilon());
        let mut facing = [false; LANES];
        for lane in 0..LANES {
            let d: [T; 3] = [
                at[0] - self.position[0][lane],
                at[1] - self.position[1][lane],
                at[2] - self.position[2][lane],
            ];
            let m = [self.normal[0][lane], self.normal[1][lane], self.normal[2][lane]];
            let receiver = -normal[0] * d[0] + -normal[1] * d[1] + -normal[2] * d[2];
            let source = m[0] * d[0] + m[1] * d[1] + m[2] * d[2];
            let threshold = epsilon * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
            facing[lane] = (receiver > zero)
                & (source > zero)
                & (receiver * receiver > threshold)
                & (source * source > threshold);
        }
        facing
    }
}

/// Segments between surfels.
struct Packet<'a> {
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
    unhidden: [bool; LANES],
}

impl<'a> Packet<'a> {
    #[inline(always)]
    fn new<T: Real>(
        occluders: &'a Occluders,
        xs: &[Surfel<T>],
        ys: &[Surfel<T>],
        pairs: &[(usize, usize)],
    ) -> Self {
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
        for (lane, &(i, j)) in pairs.iter().enumerate() {
            packet.ends[0][lane] = position(&xs[i]);
            packet.ends[1][lane] = position(&ys[j]);
            packet.faces[0][lane] = xs[i].face;
            packet.faces[1][lane] = ys[j].face;
            packet.end[lane] = 1.0;
        }
        let first = packet.ends[0][0];
        let (mut reach, mut spread) = (1.0, 0.0);
        for lane in 0..pairs.len() {
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
    fn trace(&mut self, last: &mut Option<&'a Facet>) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::triangles;
    use crate::facet::Triangle;
    use crate::surfel::Projections;
    use proptest::prelude::*;

    /// Asks for all pairs at once, and holds every answer against that for the pair alone.
    fn check<T: Real>(occluders: &Occluders, xs: &[Surfel<T>], ys: &[Surfel<T>]) -> usize {
        let mut found = Vec::new();
        let answer = &mut |i, j, sees| found.push((i, j, sees));
        AllPairs { occluders, xs, ys, answer }.run();
        let mut alone = Vec::new();
        for (i, x) in xs.iter().enumerate() {
            for (j, y) in ys.iter().enumerate() {
                if Projections::new(x, y).facing() {
                    let blocked = occluders.blocked(position(x), position(y), [x.face, y.face]);
                    alone.push((i, j, !blocked));
                }
            }
        }
        assert_eq!(found, alone);
        found.iter().filter(|(.., sees)| !sees).count()
    }

    /// Surfels on a lattice that the triangles share, and between; of their faces, and of none.
    fn surfels() -> impl Strategy<Value = Vec<Surfel>> {
        let lattice = prop::array::uniform3(-4i32..5).prop_map(|p| p.map(|c| f64::from(c) / 4.0));
        let any = prop::array::uniform3(-1.0f64..1.0);
        let normal = prop_oneof![
            any.clone(),
            (0usize..3, prop::bool::ANY).prop_map(|(k, up)| {
                let mut normal = [0.0; 3];
                normal[k] = if up { 1.0 } else { -1.0 };
                normal
            }),
        ];
        let surfel = (prop_oneof![lattice, any], normal, 0u32..6).prop_map(|(p, n, face)| Surfel {
            position: p.into(),
            normal: DVec3::from(n).try_normalize().unwrap_or(DVec3::Z),
            area: 1.0,
            face: if face > 3 { NO_FACE } else { face },
        });
        prop::collection::vec(surfel, 0..40)
    }

    #[test]
    fn pairs_across_a_mesh_are_answered_as_single_rays_are() {
        // A bumpy sheet of small triangles between two groups, off the origin by much.
        let origin = DVec3::new(1e3, -2e3, 5e2);
        let height = |i: usize, j: usize| 0.05 * ((i * 7 + j * 3) as f64).sin();
        let at = |i: usize, j: usize| {
            origin + DVec3::new(i as f64 / 20.0, j as f64 / 20.0, height(i, j))
        };
        let mut triangles = Vec::new();
        for (i, j) in (0..20).flat_map(|i| (0..20).map(move |j| (i, j))) {
            if (i + j) % 3 > 0 {
                let face = triangles.len() as u32;
                let vertices = [at(i, j), at(i + 1, j), at(i, j + 1)];
                triangles.push(Triangle { vertices, face });
            }
        }
        let occluders = Occluders::new(&triangles).unwrap();
        let group = |z: f64, up: f64| -> Vec<Surfel> {
            let place = |k: usize| DVec3::new((k % 9) as f64 / 9.0, (k / 9) as f64 / 9.0, z);
            let surfel = |k| Surfel {
                position: origin + place(k),
                normal: DVec3::Z * up,
                area: 0.01,
                face: NO_FACE,
            };
            (0..81).map(surfel).collect()
        };
        let (below, above) = (group(-0.5, 1.0), group(0.5, -1.0));
        let hidden = check(&occluders, &above, &below);
        assert!((1500..5500).contains(&hidden), "{hidden} of 6561");
        let single =
            |group: &[Surfel]| group.iter().map(Surfel::cast).collect::<Vec<Surfel<f32>>>();
        check(&occluders, &single(&above), &single(&below));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]
        #[test]
        fn packets_answer_as_single_rays_do(
            triangles in triangles(), xs in surfels(), ys in surfels(), far in 0i32..4,
        ) {
            // Exact shifts and scales: ties stay ties.
            let (shift, scale) = (DVec3::splat(f64::from(far) * 64.0), 0.5f64.powi(far * 40 - 60));
            let moved = |p: DVec3| (p + shift) * scale;
            let triangles: Vec<_> = triangles
                .iter()
                .map(|t| Triangle { vertices: t.vertices.map(moved), ..*t })
                .collect();
            let [xs, ys] = [xs, ys].map(|group| -> Vec<Surfel> {
                group.into_iter().map(|s| Surfel { position: moved(s.position), ..s }).collect()
            });
            check(&Occluders::new(&triangles).unwrap(), &xs, &ys);
        }
    }
}
