//! The same bits whatever ran before, beside or instead.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use farfield::{Fmm, OperatorStore};
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use farfield_testing::clouds::{self, charges};
use glam::DVec3;
use rayon::prelude::*;

use crate::table::row;
use crate::{Formula, build, plain};

fn inverse(x: DVec3, y: DVec3) -> f64 {
    1.0 / x.distance(y)
}

fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

#[test]
fn plans_have_the_same_bits_whoever_builds_and_applies_them() {
    let points = clouds::plummer(3000, 1);
    let charges = charges(3000, 2);
    let [one, three] =
        [1, 3].map(|threads| with_threads(threads, || build(inverse, 1e-4, &points, &points)));
    let (one, three) = (one.unwrap(), three.unwrap());
    let expected = with_threads(1, || one.apply(&charges).unwrap());
    for threads in [1, 2, 5] {
        for fmm in [&one, &three] {
            assert_eq!(with_threads(threads, || fmm.apply(&charges).unwrap()), expected);
        }
    }
    // Several applications of one plan at once, on a pool that they share.
    let same = (0..6).into_par_iter().all(|_| one.apply(&charges).unwrap() == expected);
    assert!(same);
    let expansion = HarmonicExpansion::new(InverseDistance::<f64>::new(), 5).unwrap();
    let harmonic = Fmm::with_expansion(expansion).leaf_size(20).build(&points, &points).unwrap();
    let [one_thread, two, three_threads] =
        [1, 2, 3].map(|threads| with_threads(threads, || harmonic.apply(&charges).unwrap()));
    assert!(one_thread == two && two == three_threads);
    // The plan that all operators come from is dropped, and they are forgotten.
    drop((one, three));
    OperatorStore::of_process().clear();
    let again = with_threads(2, || build(inverse, 1e-4, &points, &points).unwrap());
    assert_eq!(again.apply(&charges).unwrap(), expected);

    // A sum by as many threads as there are, as one writes it at first.
    let naive = |threads| {
        with_threads(threads, || {
            let near: Vec<f64> = points.par_iter().map(|p| inverse(*p, DVec3::ONE)).collect();
            let share = near.len().div_ceil(threads);
            near.par_chunks(share)
                .map(|part| part.iter().sum::<f64>())
                .collect::<Vec<_>>()
                .iter()
                .sum::<f64>()
        })
    };
    let naive: f64 = (2..9).map(|threads| (naive(threads) - naive(1)).abs()).fold(0.0, f64::max);
    assert!(naive > 0.0);
    row(
        "Numbers of threads, concurrent applies, dropped plans",
        "sums are formed in the order in which threads come",
        format!("differs by {naive:.0e}"),
        "the same bits for 1, 2, 3, 5 threads, 6 applies at once, and after 30 other kernels",
    );
}

const FAULT: &str = "a kernel's own fault";

/// What a panic says.
fn text(payload: &(dyn Any + Send)) -> &str {
    let owned = payload.downcast_ref::<String>().map(String::as_str);
    owned.or(payload.downcast_ref::<&str>().copied()).unwrap_or_default()
}

#[test]
fn a_panic_in_a_kernel_reaches_the_caller_and_nobody_else() {
    static BROKEN: AtomicBool = AtomicBool::new(false);
    let fragile: Formula = |x, y| {
        assert!(!BROKEN.load(Relaxed) || x.x < 0.9, "{FAULT}");
        1.0 / (0.01 + x.distance(y))
    };
    let points = clouds::cube(3000, 3);
    let charges = charges(3000, 4);
    let fmm = build(fragile, 1e-3, &points, &points).unwrap();
    let expected = fmm.apply(&charges).unwrap();
    // Expected, a hundred times over.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if text(info.payload()) != FAULT {
            hook(info);
        }
    }));
    BROKEN.store(true, Relaxed);
    let broken = catch_unwind(AssertUnwindSafe(|| fmm.apply(&charges)));
    // Where the pace of the kernel is measured, too.
    let many = clouds::cube(5000, 5);
    let plan = || Fmm::builder(plain(fragile)).tolerance(1.1e-2).build(&many, &many);
    let unbuilt = catch_unwind(|| plan().map(|_| ()));
    BROKEN.store(false, Relaxed);
    let lock = Mutex::new(());
    let poisoned = catch_unwind(AssertUnwindSafe(|| {
        let _guard = lock.lock();
        panic!("{FAULT}");
    }));

    let message = broken.unwrap_err();
    assert_eq!(text(&*message), FAULT);
    assert!(unbuilt.is_err() && poisoned.is_err());
    // The plan, the pool of threads and the operators that are remembered are as they were.
    assert_eq!(fmm.apply(&charges).unwrap(), expected);
    assert_eq!(build(fragile, 1e-3, &points, &points).unwrap().apply(&charges).unwrap(), expected);
    assert!(plan().is_ok_and(|fmm| fmm.apply(&vec![1.0; 5000]).is_ok()));
    row(
        "A panic in a user's kernel",
        "locks are poisoned, buffers are half written",
        format!("next call: {}", lock.lock().map(|_| "fine").unwrap_err()),
        "the caller gets the panic; the plan then gives the same bits as before",
    );
}
