//! What an application allocates. A program of its own, so that no other test allocates meanwhile.

use std::alloc::System;
use std::sync::Mutex;

use farfield::{Fmm, conformance::Counting, from_fn};
use glam::DVec3;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, Stats, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// One test at a time.
static ALONE: Mutex<()> = Mutex::new(());

#[test]
fn a_warm_plan_allocates_nothing_but_its_result() {
    let _alone = ALONE.lock().unwrap_or_else(|e| e.into_inner());
    let step = DVec3::new(0.754_877, 0.569_840, 0.430_160);
    // Warped: leaves of many levels, so that every list is used.
    let points: Vec<DVec3> =
        (0..100_000).map(|i| (step * f64::from(i)).fract().powf(2.5)).collect();
    let charges = vec![1.0; points.len()];
    let plan = Fmm::with_expansion(Counting::<f64>::new()).leaf_size(8);
    let fmm = plan.build(&points, &points).unwrap();
    assert!(fmm.report().stats.cell_pairs.iter().all(|&pairs| pairs > 0));

    let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
    pool.install(|| {
        for _ in 0..5 {
            fmm.apply(&charges).unwrap();
        }
        let mut values = vec![0.0; points.len()];
        // A few short lists, a number for each level.
        let few = |change: &Stats| change.allocations <= 4 && change.reallocations == 0;
        let within = least(|| fmm.apply_into(&charges, &mut values).unwrap());
        assert!(few(&within) && within.bytes_allocated <= 1 << 10, "{within:?}");
        let new = least(|| assert_eq!(fmm.apply(&charges).unwrap(), values));
        let beside = new.bytes_allocated.checked_sub(size_of_val(&charges[..]));
        assert!(few(&new) && beside.is_some_and(|bytes| bytes <= 1 << 10), "{new:?}");
    });
}

/// What the most frugal of several calls allocated. Now and then the thread pool's queues grow, or more threads than
/// ever before work at once and each keeps its buffers: but not every time.
fn least(mut call: impl FnMut()) -> Stats {
    let calls = (0..10).map(|_| {
        let region = Region::new(ALLOCATOR);
        call();
        region.change()
    });
    calls.min_by_key(|change| change.bytes_allocated).unwrap_or_default()
}

#[test]
fn a_thousand_applications_and_a_hundred_plans_leave_nothing_behind() {
    let _alone = ALONE.lock().unwrap_or_else(|e| e.into_inner());
    let step = DVec3::new(0.754_877, 0.569_840, 0.430_160);
    let points: Vec<DVec3> = (0..1000).map(|i| (step * f64::from(i)).fract()).collect();
    let charges = vec![1.0; points.len()];
    let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / (0.1 + x.distance_squared(y)).sqrt());
    let build = || Fmm::builder(kernel).order(3).leaf_size(20).build(&points, &points).unwrap();

    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    pool.install(|| {
        let fmm = build();
        // Now and then the thread pool's queues grow, or more threads than ever before work at once and
        // each keeps its buffers: but not every time.
        let left_by = |times: usize, work: &dyn Fn()| {
            let left = |_| {
                let region = Region::new(ALLOCATOR);
                (0..times).for_each(|_| work());
                let change = region.change();
                change.bytes_allocated.saturating_sub(change.bytes_deallocated)
            };
            (0..20).for_each(|_| work());
            (0..3).map(left).min().unwrap_or(0)
        };
        let slack = 64 << 10;
        let by_applying = left_by(1000, &|| drop(fmm.apply(&charges).unwrap()));
        assert!(by_applying <= slack, "{by_applying} bytes");
        let by_planning = left_by(100, &|| drop(build().apply(&charges).unwrap()));
        assert!(by_planning <= slack, "{by_planning} bytes");
        println!(
            "left behind: {by_applying} bytes by 1,000 applications, {by_planning} by 100 plans"
        );
    });
}
