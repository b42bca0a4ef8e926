//! How fast a kernel is summed directly, measured.

use std::any::type_name;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Mutex;
use std::time::Instant;

use crate::kernel::traits::Kernel;
use crate::numbers::traits::Numbers;
use crate::plan::tuning::{
    NOMINAL_SECONDS, PAIR_BUDGET, PAIR_REPETITIONS, PAIR_SAMPLE, WORTHWHILE,
};

/// Seconds per pair of [`Kernel::add_block`] at this `tolerance`, measured on some of the points.
///
/// The first measurement of a process for a kernel's type and tolerance holds until its end, so that
/// plans built alike are alike. Few points are not worth a measurement: they get a nominal value.
pub(crate) fn pair_seconds<K: Kernel>(
    kernel: &K,
    tolerance: f64,
    sources: &[K::Source],
    targets: &[K::Target],
) -> f64 {
    if sources.len().max(targets.len()) < WORTHWHILE || sources.is_empty() || targets.is_empty() {
        return NOMINAL_SECONDS;
    }
    static MEASURED: Mutex<BTreeMap<(&str, u64), f64>> = Mutex::new(BTreeMap::new());
    let measured = || MEASURED.lock().unwrap_or_else(|e| e.into_inner());
    let kind = (type_name::<K>(), tolerance.to_bits());
    if let Some(&seconds) = measured().get(&kind) {
        return seconds;
    }
    // Nothing is locked while the kernel runs: it may wait for another thread that plans as well.
    let seconds = measure(kernel, tolerance, &sample(sources), &sample(targets));
    *measured().entry(kind).or_insert(seconds)
}

/// Points from all over the set, in its order.
fn sample<P: Clone>(points: &[P]) -> Vec<P> {
    points.iter().step_by(points.len().div_ceil(PAIR_SAMPLE)).cloned().collect()
}

/// The shortest time per pair seen in blocks that grow from one pair as long as the budget lets
/// them.
fn measure<K: Kernel>(kernel: &K, tolerance: f64, ys: &[K::Source], xs: &[K::Target]) -> f64 {
    let qs = vec![K::Charge::zero(); ys.len()];
    let mut us = vec![K::Value::zero(); xs.len()];
    let start = Instant::now();
    let mut fastest = f64::INFINITY;
    let mut side = 1;
    let mut repetitions = 0;
    while repetitions < PAIR_REPETITIONS {
        let (rows, columns) = (side.min(xs.len()), side.min(ys.len()));
        let before = Instant::now();
        kernel.add_block(
            &xs[..rows],
            black_box(&ys[..columns]),
            &qs[..columns],
            tolerance,
            &mut us[..rows],
        );
        black_box(&us);
        let seconds = before.elapsed().as_secs_f64();
        fastest = fastest.min(seconds / (rows * columns) as f64);
        let next = if side < PAIR_SAMPLE { 2 * side } else { side };
        repetitions += usize::from(next == side);
        side = next;
        if start.elapsed().as_secs_f64() + fastest * (side * side) as f64 > PAIR_BUDGET {
            break;
        }
    }
    fastest.max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    fn points(n: usize) -> Vec<DVec3> {
        (0..n).map(|i| DVec3::splat(i as f64)).collect()
    }

    #[test]
    fn one_measurement_serves_a_process() {
        let calls = AtomicUsize::new(0);
        let kernel = crate::from_fn(|x: DVec3, y: DVec3| {
            calls.fetch_add(1, Relaxed);
            x.distance(y)
        });
        let few = points(WORTHWHILE - 1);
        assert_eq!(pair_seconds(&kernel, 0.0, &few, &few), NOMINAL_SECONDS);
        assert_eq!(calls.load(Relaxed), 0);

        let many = points(WORTHWHILE);
        let seconds = pair_seconds(&kernel, 0.0, &many, &many);
        let asked = calls.load(Relaxed);
        assert!(seconds > 0.0 && asked > 0);
        assert_eq!(pair_seconds(&kernel, 0.0, &many, &many), seconds);
        assert_eq!(calls.load(Relaxed), asked);
        pair_seconds(&kernel, 0.5, &many, &many);
        assert!(calls.load(Relaxed) > asked, "another tolerance is another pace");
        assert_eq!(pair_seconds(&kernel, 1.0, &many, &[]), NOMINAL_SECONDS);
    }

    #[test]
    fn a_slow_kernel_is_asked_for_few_pairs() {
        let calls = AtomicUsize::new(0);
        let kernel = crate::from_fn(|x: DVec3, y: DVec3| {
            calls.fetch_add(1, Relaxed);
            std::thread::sleep(std::time::Duration::from_millis(2));
            x.distance(y)
        });
        let seconds = measure(&kernel, 0.0, &points(PAIR_SAMPLE), &points(3));
        assert!(seconds >= 2e-3);
        assert_eq!(calls.load(Relaxed), 1);
    }
}
