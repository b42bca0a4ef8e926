//! What an application allocates. A program of its own, so that no other test allocates meanwhile.

use std::alloc::System;

use farfield::{Fmm, conformance::Counting};
use glam::DVec3;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn a_warm_plan_allocates_nothing_but_its_result() {
    let step = DVec3::new(0.754_877, 0.569_840, 0.430_160);
    // Warped: leaves of many levels, so that every list is used.
    let points: Vec<DVec3> =
        (0..100_000).map(|i| (step * f64::from(i)).fract().powf(2.5)).collect();
    let charges = vec![1.0; points.len()];
    let plan = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(8);
    let fmm = plan.build(&points, &points).unwrap();
    assert!(fmm.stats().cell_pairs.iter().all(|&pairs| pairs > 0));

    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    pool.install(|| {
        for _ in 0..5 {
            fmm.apply(&charges).unwrap();
        }
        let region = Region::new(ALLOCATOR);
        let values = fmm.apply(&charges).unwrap();
        let change = region.change();
        assert!(change.bytes_allocated >= size_of_val(&values[..]));
        // The thread pool's queues may grow now and then.
        let slack = 8 << 10;
        assert!(change.bytes_allocated <= size_of_val(&values[..]) + slack, "{change:?}");
        assert!(change.allocations + change.reallocations <= 8, "{change:?}");
    });
}
