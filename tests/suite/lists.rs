//! The four lists partition all pairs, under any mask.

use farfield::conformance::Counting;
use farfield::{CellView, Coverage, Fmm, Located, Mask, Scheme, direct_masked};
use glam::DVec3;
use proptest::prelude::*;

use crate::clouds::{self, Random};
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

    fn pair(&self, x: &DVec3, y: &DVec3) -> bool {
        self.side(x) == self.side(y)
    }
}

fn check(sources: &[DVec3], targets: &[DVec3], mask: SameSide, leaf_size: usize, scheme: Scheme) {
    let kernel = Counting::<f64>::new();
    let charges: Vec<f64> = (0..sources.len()).map(|i| (i % 7) as f64 - 2.0).collect();
    let fmm = Fmm::with_expansion(kernel)
        .mask(&mask)
        .leaf_size(leaf_size)
        .scheme(scheme)
        .build(sources, targets)
        .unwrap();
    let exact = direct_masked(&kernel, &mask, sources, &charges, targets);
    assert_eq!(fmm.apply(&charges).unwrap(), exact);

    let ones = vec![1.0; sources.len()];
    let counts = direct_masked(&kernel, &mask, sources, &ones, targets);
    let stats = fmm.stats();
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
    ) {
        let mut random = Random::new(seed);
        let mut cloud = |n| -> Vec<DVec3> {
            (0..n).map(|_| random.in_cube().powf(warp)).collect()
        };
        let sources = cloud(sources);
        let targets = if shared { sources.clone() } else { cloud(targets) };
        let mask = SameSide { normal: DVec3::new(1.0, 0.3, -0.2), offset: 0.3, certify };
        check(&sources, &targets, mask, leaf_size, SCHEMES[scheme]);
    }
}

#[test]
fn masked_sums_use_the_far_field_and_offsets_beyond_three() {
    let points = clouds::cube(6000, 1);
    let mask = SameSide { normal: DVec3::X, offset: 0.5001, certify: true };
    for scheme in SCHEMES {
        check(&points, &points, mask, 12, scheme);
    }
    let fmm = Fmm::with_expansion(Counting::<f64>::new()).mask(mask).leaf_size(12);
    let fmm = fmm.build(&points, &points).unwrap();
    let stats = fmm.stats();
    let unmasked = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(12);
    let unmasked = unmasked.build(&points, &points).unwrap();
    assert!(stats.expansion_pairs > 10_000_000, "{stats:?}");
    assert!(stats.mask_bytes > 0 && unmasked.stats().mask_bytes == 0);
}
