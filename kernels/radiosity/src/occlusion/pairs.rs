//! Visibility of many pairs of surfels at once, in packets of segments.
//!
//! Code with wide registers must be inlined into the function that `pulp` compiles for the machine:
//! hence `#[inline(always)]` throughout, and loops over indices.

#![expect(clippy::needless_range_loop, reason = "closures of iterators may not be inlined")]

use farfield::{Real, Vector, dispatch};
use pulp::{Simd, WithSimd};

use crate::elements::{CLOSEST, Projections, Surfel};
use crate::occlusion::facet::Facet;
use crate::occlusion::packet::{LANES, Packet};
use crate::occlusion::shapes::Shape;
use crate::occlusion::sights::{Segment, Sights, is_weak, rays};

/// All pairs of two groups of surfels.
pub(crate) struct AllPairs<'a, T: Real> {
    pub(crate) sights: &'a Sights<'a>,
    pub(crate) xs: (&'a [Surfel<T>], &'a [Shape]),
    pub(crate) ys: (&'a [Surfel<T>], &'a [Shape]),
    /// Is told of every pair that faces each other, which share of it is unhidden.
    pub(crate) answer: &'a mut dyn FnMut(usize, usize, f64),
}

impl<T: Real> AllPairs<'_, T> {
    /// Asks for all pairs with the best instructions that the machine has; returns the number of rays.
    pub(crate) fn run(self) -> usize {
        dispatch(self)
    }
}

impl<T: Real> WithSimd for AllPairs<'_, T> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> usize {
        let Self { sights, xs: (xs, x_shapes), ys: (ys, y_shapes), answer } = self;
        let packs: Vec<Pack<T>> = ys.chunks(LANES).map(Pack::new).collect();
        let mut last = None;
        let mut count = 0;
        let mut facing = Vec::with_capacity(ys.len());
        let mut segments = Vec::with_capacity(ys.len());
        for (i, x) in xs.iter().enumerate() {
            facing.clear();
            segments.clear();
            for (p, pack) in packs.iter().enumerate() {
                let lanes = pack.facing(x);
                for lane in 0..LANES {
                    if lanes[lane] {
                        let j = LANES * p + lane;
                        let weak = is_weak(&Projections::new(x, &ys[j]));
                        let faces = [x.face, ys[j].face];
                        let rays = rays([&x_shapes[i], &y_shapes[j]], weak);
                        for &ends in rays.iter() {
                            segments.push(Segment { ends, faces });
                        }
                        facing.push((j, rays.len(), 0));
                    }
                }
            }
            count += segments.len();
            // Which pair the next ray belongs to, and how many rays of it are behind.
            let (mut pair, mut behind) = (0, 0);
            for segments in segments.chunks(LANES) {
                let mut packet = Packet::new(sights.occluders, segments);
                packet.trace(&mut last);
                for lane in 0..segments.len() {
                    let (_, rays, passed) = &mut facing[pair];
                    *passed += usize::from(packet.unhidden[lane]);
                    behind += 1;
                    if behind == *rays {
                        (pair, behind) = (pair + 1, 0);
                    }
                }
            }
            for &(j, rays, passed) in &facing {
                answer(i, j, passed as f64 / rays as f64);
            }
        }
        count
    }
}

/// Some pairs of two groups of surfels, [`LANES`] at most, each by one ray.
pub(crate) struct SomePairs<'a, 'b, T: Real> {
    pub(crate) sights: &'a Sights<'a>,
    pub(crate) xs: (&'b [Surfel<T>], &'b [Shape]),
    pub(crate) ys: (&'b [Surfel<T>], &'b [Shape]),
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
        let Self { sights, xs: (xs, x_shapes), ys: (ys, y_shapes), pairs, last } = self;
        let mut segments = Vec::with_capacity(LANES);
        for &(i, j) in pairs {
            let faces = [xs[i].face, ys[j].face];
            for &ends in rays([&x_shapes[i], &y_shapes[j]], true).iter() {
                segments.push(Segment { ends, faces });
            }
        }
        let mut packet = Packet::new(sights.occluders, &segments);
        packet.trace(last);
        let mut unhidden = 0;
        for lane in 0..pairs.len() {
            unhidden |= u16::from(packet.unhidden[lane]) << lane;
        }
        unhidden
    }
}

/// Surfels side by side; those that fill up the last lanes face nothing.
struct Pack<T> {
    position: [[T; LANES]; 3],
    normal: [[T; LANES]; 3],
    area: [T; LANES],
}

impl<T: Real> Pack<T> {
    #[inline(always)]
    fn new(surfels: &[Surfel<T>]) -> Self {
        let zero = [[T::from_f64(0.0); LANES]; 3];
        let mut pack = Self { position: zero, normal: zero, area: [T::from_f64(0.0); LANES] };
        for (lane, surfel) in surfels.iter().enumerate() {
            let (position, normal) = (surfel.position.to_array(), surfel.normal.to_array());
            for k in 0..3 {
                pack.position[k][lane] = position[k];
                pack.normal[k][lane] = normal[k];
            }
            pack.area[lane] = surfel.area;
        }
        pack
    }

    /// [`Projections::facing`](crate::Projections::facing), rounded alike.
    #[inline(always)]
    fn facing(&self, x: &Surfel<T>) -> [bool; LANES] {
        let (at, normal) = (x.position.to_array(), x.normal.to_array());
        let (zero, epsilon, closest) = (T::from_f64(0.0), T::epsilon(), T::from_f64(CLOSEST));
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
            let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let (threshold, other) = (epsilon * square, self.area[lane]);
            let area = if x.area > other { x.area } else { other };
            facing[lane] = (square > closest * area)
                & (receiver > zero)
                & (source > zero)
                & (receiver * receiver > threshold)
                & (source * source > threshold);
        }
        facing
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Occluders;
    use crate::elements::{Projections, Triangle};
    use crate::occlusion::occluders::tests::{perhaps_on_lattice, triangles};
    use crate::occlusion::position;
    use farfield_testing::clouds::Random;
    use glam::DVec3;

    const NO_FACE: u32 = Surfel::<f64>::NO_FACE;

    /// Asks for all pairs at once, and holds every answer against that for the pair alone.
    fn check<T: Real>(occluders: &Occluders, xs: &[Surfel<T>], ys: &[Surfel<T>]) -> usize {
        let sights = &Sights::of_points(occluders);
        let mut found = Vec::new();
        let answer = &mut |i, j, share| found.push((i, j, share == 1.0));
        let [x_shapes, y_shapes] = [xs, ys].map(|group| sights.shapes_of(group));
        AllPairs { sights, xs: (xs, &x_shapes), ys: (ys, &y_shapes), answer }.run();
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

    /// Up to 39 surfels on a lattice that the triangles share, and between; of their faces, and of none.
    fn surfels(random: &mut Random) -> Vec<Surfel> {
        let surfel = |random: &mut Random| {
            let position = perhaps_on_lattice(random, 0.25);
            let along = [DVec3::X, DVec3::Y, DVec3::Z][random.below(3)];
            let axis = if random.below(2) == 0 { along } else { -along };
            let normal = if random.below(2) == 0 { axis } else { random.direction() };
            let face = [0, 1, 2, 3, NO_FACE, NO_FACE][random.below(6)];
            Surfel { position, normal, area: 1.0, face }
        };
        (0..random.below(40)).map(|_| surfel(random)).collect()
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

    #[test]
    fn packets_answer_as_single_rays_do() {
        for seed in 0..1000 {
            let random = &mut Random::new(seed);
            let (triangles, groups) = (triangles(random), [surfels(random), surfels(random)]);
            // Exact shifts and scales: ties stay ties.
            let far = random.below(4) as i32;
            let (shift, scale) = (DVec3::splat(f64::from(far) * 64.0), 0.5f64.powi(far * 40 - 60));
            let moved = |p: DVec3| (p + shift) * scale;
            let triangles: Vec<_> = triangles
                .iter()
                .map(|t| Triangle { vertices: t.vertices.map(moved), ..*t })
                .collect();
            let [xs, ys] = groups.map(|group| -> Vec<Surfel> {
                group
                    .into_iter()
                    .map(|s| Surfel { position: moved(s.position), area: scale * scale * 0.1, ..s })
                    .collect()
            });
            check(&Occluders::new(&triangles).unwrap(), &xs, &ys);
        }
    }
}
