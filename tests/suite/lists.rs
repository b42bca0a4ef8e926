//! The four lists partition all pairs, under any mask.

use farfield::conformance::Counting;
use farfield::{
    Cell, CellView, Costs, Coverage, Error, Expansion, Fmm, Geometry, Located, Mask, Outcome,
    Scheme, Stats, direct, direct_masked, relative_l2_error,
};
use farfield_testing::clouds::{self, Random};
use glam::DVec3;
use proptest::prelude::*;

use crate::engine::SCHEMES;

/// Pairs on the same side of a plane count; how eagerly whole cells are certified varies.
#[derive(Clone, Copy, Debug)]
struct SameSide {
    normal: DVec3,
    offset: f64,
    certify: bool,
}

impl SameSide {
    fn side(&self, p: &impl Located<Real = f64>) -> bool {
        self.normal.dot(p.position()) > self.offset
    }

    /// The side of a set of points, if it is one.
    fn one_side(&self, points: &[DVec3]) -> Option<bool> {
        let side = self.side(&points[0]);
        points.iter().all(|p| self.side(p) == side).then_some(side)
    }
}

impl Mask<Counting<f64>> for SameSide {
    fn cells(&self, targets: CellView<'_, DVec3>, sources: CellView<'_, DVec3>) -> Coverage {
        match (self.one_side(targets.points), self.one_side(sources.points)) {
            (Some(t), Some(s)) if self.certify && t == s => Coverage::Full,
            (Some(t), Some(s)) if self.certify && t != s => Coverage::Empty,
            _ => Coverage::Partial,
        }
    }

    fn pair(&self, x: &DVec3, y: &DVec3) -> f64 {
        f64::from(self.side(x) == self.side(y))
    }
}

/// The counting kernel with prices for M2P and P2L that are known only once it is prepared.
#[derive(Clone, Copy, Debug)]
struct Priced {
    count: Counting<f64>,
    prices: [usize; 2],
    prepared: bool,
    /// What pairs count that expansions carry.
    far: f64,
}

impl Priced {
    /// With the prices of M2P at a target and of P2L of a source, in pairs.
    fn new(prices: [usize; 2]) -> Self {
        Self { count: Counting::new(), prices, prepared: false, far: 1.0 }
    }

    fn price(&self, operator: usize) -> usize {
        if self.prepared { self.prices[operator] } else { 0 }
    }
}

impl Expansion for Priced {
    type Kernel = Counting<f64>;
    type MultipoleTerm = f64;
    type LocalTerm = f64;

    fn kernel(&self) -> &Counting<f64> {
        &self.count
    }
    fn multipole_len(&self, level: usize) -> usize {
        self.count.multipole_len(level)
    }
    fn local_len(&self, level: usize) -> usize {
        self.count.local_len(level)
    }
    fn prepare(&mut self, _: &Geometry<f64>) -> Result<(), Error> {
        self.prepared = true;
        Ok(())
    }
    fn costs(&self, _: usize) -> Costs {
        Costs { m2p_pairs: self.price(0), p2l_pairs: self.price(1), ..Costs::new(1, 1) }
    }
    fn p2m(&self, _: &Cell<f64>, _: &[DVec3], charges: &[f64], multipole: &mut [f64]) {
        multipole[0] += self.far * charges.iter().sum::<f64>();
    }
    fn m2m(&self, child: &Cell<f64>, parent: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.count.m2m(child, parent, from, to);
    }
    fn m2l(&self, source: &Cell<f64>, target: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.count.m2l(source, target, from, to);
    }
    fn l2l(&self, parent: &Cell<f64>, child: &Cell<f64>, from: &[f64], to: &mut [f64]) {
        self.count.l2l(parent, child, from, to);
    }
    fn l2p(&self, cell: &Cell<f64>, local: &[f64], targets: &[DVec3], values: &mut [f64]) {
        self.count.l2p(cell, local, targets, values);
    }
    fn m2p(&self, cell: &Cell<f64>, m: &[f64], targets: &[DVec3], values: &mut [f64]) -> Outcome {
        self.count.m2p(cell, m, targets, values)
    }
    fn p2l(&self, _: &Cell<f64>, _: &[DVec3], q: &[f64], local: &mut [f64]) -> Outcome {
        assert!(self.price(1) < NEVER, "P2L where it never pays");
        local[0] += self.far * q.iter().sum::<f64>();
        Outcome::Done
    }
}

/// The price of an operator that never pays.
const NEVER: usize = usize::MAX;

fn check(
    sources: &[DVec3],
    targets: &[DVec3],
    mask: SameSide,
    leaf_size: usize,
    scheme: Scheme,
    prices: [usize; 2],
) {
    let kernel = Counting::<f64>::new();
    let charges: Vec<f64> = (0..sources.len()).map(|i| (i % 7) as f64 - 2.0).collect();
    let fmm = Fmm::with_expansion(Priced::new(prices))
        .mask(&mask)
        .leaf_size(leaf_size)
        .scheme(scheme)
        .build(sources, targets)
        .unwrap();
    let exact = direct_masked(&kernel, &mask, sources, &charges, targets).unwrap();
    assert_eq!(fmm.apply(&charges).unwrap(), exact);

    let ones = vec![1.0; sources.len()];
    let counts = direct_masked(&kernel, &mask, sources, &ones, targets).unwrap();
    let stats = fmm.report().stats;
    let pairs = stats.expansion_pairs + stats.direct_pairs;
    assert_eq!(pairs as f64, counts.iter().sum::<f64>(), "pairs taken, of all that count");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn no_pair_is_lost_or_taken_twice(
        seed in any::<u64>(),
        sources in 0usize..400,
        targets in 0usize..400,
        shared in any::<bool>(),
        leaf_size in 1usize..40,
        scheme in 0usize..4,
        certify in any::<bool>(),
        warp in 0.2f64..4.0,
        prices in prop::array::uniform2(prop_oneof![0usize..40, Just(NEVER)]),
    ) {
        let mut random = Random::new(seed);
        let mut cloud = |n| -> Vec<DVec3> {
            (0..n).map(|_| random.in_cube().powf(warp)).collect()
        };
        let sources = cloud(sources);
        let targets = if shared { sources.clone() } else { cloud(targets) };
        let mask = SameSide { normal: DVec3::new(1.0, 0.3, -0.2), offset: 0.3, certify };
        check(&sources, &targets, mask, leaf_size, SCHEMES[scheme], prices);
    }
}

/// The sums of a plan whose far pairs count a thousand times as much, from the pairs that it says are near.
fn check_near(points: &[DVec3], fmm: &Fmm<Priced>, counts: impl Fn(usize, usize) -> bool) {
    let n = points.len();
    let charges: Vec<f64> = (0..n).map(|i| (i * i % 31) as f64 - 9.0).collect();
    let mut is_near = vec![false; n * n];
    for block in fmm.near_pairs() {
        assert_eq!(block.share, 1.0);
        for &i in block.targets {
            for &j in block.sources {
                let pair = i as usize * n + j as usize;
                assert!(!std::mem::replace(&mut is_near[pair], true), "{i} {j} twice");
                assert!(counts(i as usize, j as usize), "{i} {j} does not count");
            }
        }
    }
    let stats = fmm.report().stats;
    let near = is_near.iter().filter(|&&near| near).count() as u64;
    assert_eq!(near, stats.direct_pairs, "{stats:?}");
    let sum = |i: usize| -> f64 {
        let weight = |j: usize| if is_near[i * n + j] { 1.0 } else { 1000.0 };
        (0..n).filter(|&j| counts(i, j)).map(|j| weight(j) * charges[j]).sum()
    };
    assert_eq!(fmm.apply(&charges).unwrap(), (0..n).map(sum).collect::<Vec<f64>>());
}

#[test]
fn every_pair_is_either_near_or_far() {
    let points = clouds::plummer(700, 3);
    for scheme in SCHEMES {
        let expansion = Priced { far: 1000.0, ..Priced::new([1, 1]) };
        let builder = || Fmm::with_expansion(expansion).leaf_size(6).scheme(scheme);
        let fmm = builder().build(&points, &points).unwrap();
        let is_direct = scheme == Scheme::Direct;
        assert_eq!(fmm.report().stats.expansion_pairs == 0, is_direct);
        check_near(&points, &fmm, |_, _| true);

        let mask = SameSide { normal: DVec3::new(1.0, 0.3, -0.2), offset: 0.01, certify: true };
        let fmm = builder().mask(&mask).build(&points, &points).unwrap();
        check_near(&points, &fmm, |i, j| mask.side(&points[i]) == mask.side(&points[j]));
    }
}

#[test]
fn near_sums_of_ones_own_complete_the_far_part() {
    let kernel = crate::plain(|x, y| (0.03 + x.distance_squared(y)).sqrt().recip());
    let (sources, targets) = (clouds::cube(2500, 4), clouds::sphere(1500, 5));
    let charges = clouds::charges(2500, 6);
    let builder = Fmm::builder(kernel).tolerance(1e-6).leaf_size(30);
    let fmm = builder.build(&sources, &targets).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 1_000_000);
    // The near part is taken off, and brought back by another who sums it.
    let mut sums = fmm.apply(&charges).unwrap();
    let near = |sign: f64, sums: &mut [f64]| {
        for block in fmm.near_pairs() {
            let pick = |order: &[u32]| order.iter().map(|&j| sources[j as usize]).collect();
            let (ys, xs): (Vec<DVec3>, Vec<DVec3>) =
                (pick(block.sources), block.targets.iter().map(|&i| targets[i as usize]).collect());
            let qs: Vec<f64> = block.sources.iter().map(|&j| charges[j as usize]).collect();
            let own = direct(&kernel, &ys, &qs, &xs).unwrap();
            block.targets.iter().zip(own).for_each(|(&i, u)| sums[i as usize] += sign * u);
        }
    };
    let exact = direct(&kernel, &sources, &charges, &targets).unwrap();
    near(-1.0, &mut sums);
    assert!(relative_l2_error(&sums, &exact) > 1e-2, "there is a near part");
    near(1.0, &mut sums);
    assert!(relative_l2_error(&sums, &exact) < 1e-6);
}

#[test]
fn masked_sums_use_the_far_field_and_offsets_beyond_three() {
    let points = clouds::cube(6000, 1);
    let mask = SameSide { normal: DVec3::X, offset: 0.5001, certify: true };
    for scheme in SCHEMES {
        check(&points, &points, mask, 12, scheme, [1, 1]);
    }
    let fmm = Fmm::with_expansion(Counting::<f64>::new()).mask(mask).leaf_size(12);
    let fmm = fmm.build(&points, &points).unwrap();
    let stats = fmm.report().stats;
    let unmasked = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(12);
    let unmasked = unmasked.build(&points, &points).unwrap();
    assert!(stats.expansion_pairs > 10_000_000, "{stats:?}");
    assert!(stats.mask_bytes > 0 && unmasked.report().stats.mask_bytes == 0);
}

fn priced(sources: &[DVec3], targets: &[DVec3], scheme: Scheme, prices: [usize; 2]) -> Stats {
    let builder = Fmm::with_expansion(Priced::new(prices)).leaf_size(8).scheme(scheme);
    let fmm = builder.build(sources, targets).unwrap();
    let charges: Vec<f64> = (0..sources.len()).map(|i| (i % 7) as f64 - 2.0).collect();
    let total: f64 = charges.iter().sum();
    assert_eq!(fmm.apply(&charges).unwrap(), vec![total; targets.len()], "{prices:?}");
    let stats = fmm.report().stats;
    let pairs = (sources.len() * targets.len()) as u64;
    assert_eq!(stats.expansion_pairs + stats.direct_pairs, pairs, "{prices:?}");
    stats.clone()
}

#[test]
fn expansions_are_used_only_where_they_pay() {
    // Clouds so different that leaves of each meet smaller cells of the other.
    let (sources, targets) = (clouds::plummer(4000, 1), clouds::sphere(3000, 2));
    let stats = |prices| priced(&sources, &targets, Scheme::Fmm, prices);
    let [m2l, m2p, p2l] = stats([0, 0]).cell_pairs;
    assert!(m2p > 0 && p2l > 0);
    assert_eq!(stats([NEVER, 0]).cell_pairs, [m2l, 0, p2l]);
    assert_eq!(stats([0, NEVER]).cell_pairs, [m2l, m2p, 0]);
    assert_eq!(stats([NEVER, NEVER]).cell_pairs, [m2l, 0, 0]);
    let [_, some_m2p, some_p2l] = stats([8, 8]).cell_pairs;
    assert!(0 < some_m2p && some_m2p < m2p, "{some_m2p} of {m2p}");
    assert!(0 < some_p2l && some_p2l < p2l, "{some_p2l} of {p2l}");
    let direct = |prices| stats(prices).direct_pairs;
    assert!(direct([0, 0]) < direct([8, 8]) && direct([8, 8]) < direct([NEVER, NEVER]));
}

#[test]
fn treecodes_sum_small_cells_directly() {
    let points = clouds::plummer(3000, 1);
    for m2m in [false, true] {
        let stats = |price| priced(&points, &points, Scheme::Treecode { m2m }, [price, 0]);
        let [free, some, never] = [0, 20, NEVER].map(stats);
        assert_eq!(never.cell_pairs, [0; 3]);
        assert_eq!(never.expansion_pairs, 0);
        assert!(0 < some.cell_pairs[0] && some.cell_pairs[0] < free.cell_pairs[0]);
        assert_eq!(free.cell_pairs[2], 0, "without locals there is no P2L");
    }
}
