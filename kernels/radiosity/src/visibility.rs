//! The visibility mask: facing and not hidden.

use std::sync::atomic::{AtomicU64, Ordering};

use farfield::{CellView, Columns, Coverage, Mask, Real};

use crate::bvh::Occluders;
use crate::facet::{Facet, ordered};
use crate::facing::facing;
use crate::kernel::Irradiance;
use crate::shaft::{Shaft, position};
use crate::surfel::{Projections, Surfel};

/// The mask V(x, y): a pair counts if the two surfels [face each other](Projections::facing) and no
/// occluder [hides](Occluders::blocked) them from each other. Symmetric, bit for bit.
///
/// Between cells that certainly face each other, a shaft of the occluders' hierarchy certifies that
/// all pairs see each other; where it can't, the pairs are asked for one by one, down to the leaves.
#[derive(Debug)]
pub struct Visibility<'a> {
    occluders: &'a Occluders,
    facing_away: Tally,
    hidden: Tally,
    unhidden: Tally,
    certified: Tally,
}

/// How the pairs of surfels that a [`Visibility`] was asked about fell out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PairCounts {
    /// Pairs that don't face each other.
    pub facing_away: u64,
    /// Pairs that face each other but are hidden by an occluder, found by a segment query each.
    pub hidden: u64,
    /// Pairs that see each other, found by a segment query each.
    pub unhidden: u64,
    /// Pairs that see each other, found cell by cell without a query of their own.
    pub certified: u64,
}

impl PairCounts {
    /// Segment queries made.
    pub fn segments(&self) -> u64 {
        self.hidden + self.unhidden
    }

    /// All pairs.
    pub fn total(&self) -> u64 {
        self.facing_away + self.hidden + self.unhidden + self.certified
    }
}

impl<'a> Visibility<'a> {
    /// The mask of a scene with these occluders.
    pub fn new(occluders: &'a Occluders) -> Self {
        let [facing_away, hidden, unhidden, certified] = Default::default();
        Self { occluders, facing_away, hidden, unhidden, certified }
    }

    /// The pairs asked about so far. Those of cells that were found [`Coverage::Partial`] count when
    /// their parts are asked about.
    pub fn counts(&self) -> PairCounts {
        PairCounts {
            facing_away: self.facing_away.total(),
            hidden: self.hidden.total(),
            unhidden: self.unhidden.total(),
            certified: self.certified.total(),
        }
    }
}

impl<T: Real, C: Columns<T>> Mask<Irradiance<T, C>> for Visibility<'_> {
    fn cells(
        &self,
        targets: CellView<'_, Surfel<T>>,
        sources: CellView<'_, Surfel<T>>,
    ) -> Coverage {
        let pairs = targets.points.len() as u64 * sources.points.len() as u64;
        match facing(targets.points, sources.points) {
            Coverage::Empty => {
                self.facing_away.add(pairs);
                Coverage::Empty
            }
            Coverage::Full
                if Shaft::new(targets.points, sources.points).is_clear(self.occluders) =>
            {
                self.certified.add(pairs);
                Coverage::Full
            }
            _ => Coverage::Partial,
        }
    }

    fn pair(&self, x: &Surfel<T>, y: &Surfel<T>) -> bool {
        if !Projections::new(x, y).facing() {
            self.facing_away.add(1);
            return false;
        }
        let hidden = self.occluders.blocked(position(x), position(y), [x.face, y.face]);
        if hidden {
            self.hidden.add(1)
        } else {
            self.unhidden.add(1)
        }
        !hidden
    }

    fn pairs(
        &self,
        targets: CellView<'_, Surfel<T>>,
        sources: CellView<'_, Surfel<T>>,
        count: &mut dyn FnMut(usize, usize),
    ) {
        let margin = self.occluders.margin();
        let mut candidates = Shaft::new(targets.points, sources.points).candidates(self.occluders);
        let (mut facing, mut visible) = (0, 0);
        for (i, x) in targets.points.iter().enumerate() {
            for (j, y) in sources.points.iter().enumerate() {
                if !Projections::new(x, y).facing() {
                    continue;
                }
                facing += 1;
                let (from, to) = ordered(position(x), position(y));
                let blocks = |facet: &Facet| facet.blocks(from, to, [x.face, y.face], margin);
                match candidates.iter().position(blocks) {
                    // What hides one pair is likely to hide the next.
                    Some(k) => candidates.swap(0, k),
                    None => {
                        visible += 1;
                        count(i, j);
                    }
                }
            }
        }
        let all = targets.points.len() as u64 * sources.points.len() as u64;
        self.facing_away.add(all - facing);
        self.hidden.add(facing - visible);
        self.unhidden.add(visible);
    }

    fn is_mirrored(&self, targets: &[Surfel<T>], sources: &[Surfel<T>]) -> bool {
        targets == sources
    }
}

/// A counter that many threads can add to at full speed: each to a cache line of its own.
#[derive(Debug, Default)]
struct Tally([Lane; 16]);

/// One cache line of a [`Tally`].
#[derive(Debug, Default)]
#[repr(align(128))]
struct Lane(AtomicU64);

impl Tally {
    fn add(&self, n: u64) {
        let lane = rayon::current_thread_index().unwrap_or(0) % self.0.len();
        self.0[lane].0.fetch_add(n, Ordering::Relaxed);
    }

    fn total(&self) -> u64 {
        self.0.iter().map(|lane| lane.0.load(Ordering::Relaxed)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::triangles;
    use crate::facet::Triangle;
    use farfield::{Cell, Cube};
    use glam::DVec3;
    use proptest::prelude::*;

    type Kernel = Irradiance<f64>;

    fn square(z: f64, side: f64, up: bool, face: u32) -> Vec<Surfel> {
        let normal = if up { DVec3::Z } else { DVec3::NEG_Z };
        let at =
            |k: usize| DVec3::new((k / 4) as f64 - 1.5, (k % 4) as f64 - 1.5, 0.0) * (side / 4.0);
        (0..16)
            .map(|k| Surfel {
                position: at(k) + DVec3::Z * z,
                normal,
                area: side * side / 16.0,
                face,
            })
            .collect()
    }

    fn screen(z: f64, side: f64, face: u32) -> [Triangle; 2] {
        let [a, b, c, d] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[x, y]| DVec3::new(x * side / 2.0, y * side / 2.0, z));
        [[a, b, c], [a, c, d]].map(|vertices| Triangle { vertices, face })
    }

    fn verdict(mask: &Visibility<'_>, t: &[Surfel], s: &[Surfel]) -> Coverage {
        let cell = Cell::new(&Cube::new(DVec3::ZERO, 4.0), 0, [0; 3]);
        let view = |points| CellView { cell: &cell, points };
        Mask::<Kernel>::cells(mask, view(t), view(s))
    }

    fn together(mask: &Visibility<'_>, t: &[Surfel], s: &[Surfel]) -> Vec<(usize, usize)> {
        let cell = Cell::new(&Cube::new(DVec3::ZERO, 4.0), 0, [0; 3]);
        let view = |points| CellView { cell: &cell, points };
        let mut found = Vec::new();
        Mask::<Kernel>::pairs(mask, view(t), view(s), &mut |i, j| found.push((i, j)));
        found
    }

    fn ask_all(mask: &Visibility<'_>, t: &[Surfel], s: &[Surfel]) -> usize {
        let pairs = t.iter().flat_map(|x| s.iter().map(move |y| (x, y)));
        pairs.filter(|(x, y)| Mask::<Kernel>::pair(mask, x, y)).count()
    }

    #[test]
    fn counts_tell_how_every_pair_fell_out() {
        let floor = square(0.0, 1.0, true, 0);
        let ceiling = square(1.0, 1.0, false, 1);
        let roof = square(1.0, 1.0, true, 1);
        let walls = [screen(0.0, 1.0, 0), screen(1.0, 1.0, 1)].concat();
        let open = Occluders::new(&walls).unwrap();
        let mask = Visibility::new(&open);
        assert_eq!(verdict(&mask, &ceiling, &floor), Coverage::Full);
        assert_eq!(verdict(&mask, &roof, &floor), Coverage::Empty);
        let counts = PairCounts { certified: 256, facing_away: 256, ..PairCounts::default() };
        assert_eq!(mask.counts(), counts);
        assert_eq!(ask_all(&mask, &ceiling, &floor), 256);
        assert_eq!(mask.counts(), PairCounts { unhidden: 256, ..counts });
    }

    #[test]
    fn a_screen_hides_and_is_never_overlooked() {
        let floor = square(0.0, 1.0, true, 0);
        let ceiling = square(1.0, 1.0, false, 1);
        // A segment passes the screen's plane at (i + j − 3)/8 along either axis, i and j in 0..4.
        for (side, hidden) in [(1.0, 16 * 16), (0.45, 10 * 10), (0.05, 4 * 4)] {
            let visible = 256 - hidden;
            let occluders = Occluders::new(&screen(0.5, side, 2)).unwrap();
            let mask = Visibility::new(&occluders);
            assert_eq!(verdict(&mask, &ceiling, &floor), Coverage::Partial);
            assert_eq!(ask_all(&mask, &ceiling, &floor), visible, "screen of side {side}");
            assert_eq!(ask_all(&mask, &floor, &ceiling), visible, "screen of side {side}");
            assert_eq!(mask.counts().total(), 512);
            assert_eq!(mask.counts().segments(), 512);
        }
    }

    proptest! {
        #[test]
        fn blocks_and_cells_answer_as_their_pairs_do(
            triangles in triangles(),
            lift in -1.0f64..1.0,
            tilt in prop::array::uniform3(-0.3f64..0.3),
        ) {
            let floor = square(-0.5, 1.0, true, 0);
            let shift = DVec3::new(tilt[0], tilt[1], lift);
            let normal = (DVec3::NEG_Z + DVec3::from(tilt) * 2.0).normalize();
            let other: Vec<Surfel> = square(0.0, 0.5, false, 1)
                .into_iter()
                .map(|s| Surfel { position: s.position + shift, normal, ..s })
                .collect();
            let occluders = Occluders::new(&triangles).unwrap();
            let masks: [_; 3] = std::array::from_fn(|_| Visibility::new(&occluders));
            let found = together(&masks[0], &other, &floor);
            for (i, x) in other.iter().enumerate() {
                for (j, y) in floor.iter().enumerate() {
                    let counts = Mask::<Kernel>::pair(&masks[1], x, y);
                    prop_assert_eq!(counts, found.contains(&(i, j)));
                }
            }
            prop_assert_eq!(masks[0].counts(), masks[1].counts());
            match verdict(&masks[2], &other, &floor) {
                Coverage::Full => prop_assert_eq!(found.len(), 256),
                Coverage::Empty => prop_assert!(found.is_empty()),
                Coverage::Partial => {}
            }
        }
    }
}
