//! Operators that are kept, saved and loaded: the same bits as if they had been built, and none of another kernel.

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use farfield::{
    Fmm, FnKernel, Interpolation, Kernel, OperatorStore, Outcome, Point, Scheme, StoreError,
    direct, from_fn, relative_l2_error,
};
use farfield_testing::clouds::cube;
use glam::DVec3;

use crate::plain;

/// A function of the distance that counts how often it is evaluated, and says what it is if it is told to.
struct Counting<'a> {
    formula: FnKernel<fn(DVec3, DVec3) -> f64, DVec3, f64>,
    evaluations: &'a AtomicUsize,
    identity: Option<&'static str>,
}

impl Kernel for Counting<'_> {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = f64;
    type Value = f64;
    type Entry = f64;

    fn entries(&self, x: Point<f64>, y: Point<f64>, g: &mut [f64]) {
        self.evaluations.fetch_add(1, Relaxed);
        self.formula.entries(x, y, g);
    }

    fn add_block(&self, xs: &[DVec3], ys: &[DVec3], qs: &[f64], tolerance: f64, us: &mut [f64]) {
        self.formula.add_block(xs, ys, qs, tolerance, us);
    }

    fn entry_gradients(&self, _x: DVec3, _y: DVec3, _g: &mut [[f64; 3]]) -> Outcome {
        Outcome::Declined
    }

    fn identity(&self) -> Option<String> {
        self.identity.map(str::to_owned)
    }
}

fn softened(x: DVec3, y: DVec3) -> f64 {
    (-x.distance(y)).exp() / (0.1 + x.distance(y))
}

/// The softened kernel, but for a bump that few samples meet.
fn bumpy(x: DVec3, y: DVec3) -> f64 {
    let bump = if (x.distance(y) - 0.75).abs() < 2e-5 { 1e-3 } else { 0.0 };
    softened(x, y) + bump
}

/// A plan's sums, and how often the formula was evaluated to build it.
fn sums(
    formula: fn(DVec3, DVec3) -> f64,
    identity: Option<&'static str>,
    store: &OperatorStore,
) -> (Vec<f64>, usize) {
    let points = cube(4000, 1);
    let charges: Vec<f64> = (0..points.len()).map(|i| (i as f64).sin()).collect();
    let evaluations = &AtomicUsize::new(0);
    let kernel = Counting { formula: plain(formula), evaluations, identity };
    let fmm = Fmm::builder(kernel)
        .tolerance(1e-4)
        .leaf_size(40)
        .operator_store(store)
        .build(&points, &points)
        .expect("a smooth kernel");
    assert!(fmm.report().stats.expansion_pairs > 0);
    let built = evaluations.load(Relaxed);
    (fmm.apply(&charges).expect("finite"), built)
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("farfield-{name}-{}", std::process::id()));
    drop(fs::remove_dir_all(&folder));
    folder
}

#[test]
fn what_was_loaded_sums_to_the_same_bits() {
    for (identity, most) in [(None, 0.5), (Some("softened 1 0.1"), 0.1)] {
        let folder = folder("loaded");
        let first = OperatorStore::new(1 << 30);
        let (expected, built) = sums(softened, identity, &first);
        assert_eq!(first.save(&folder).expect("writable"), 1);
        // What is there already is left as it is.
        assert_eq!(first.save(&folder).expect("writable"), 1);

        let second = OperatorStore::new(1 << 30);
        assert_eq!(second.load(&folder).expect("whole"), 1);
        let (found, again) = sums(softened, identity, &second);
        assert_eq!(found, expected);
        assert!((again as f64) < most * built as f64, "{identity:?}: {again} of {built}");
        assert_eq!(second.len(), 1);
        assert!(second.bytes() > 10_000, "{second:?}");
        fs::remove_dir_all(&folder).expect("removable");
    }
}

#[test]
fn another_kernel_gets_operators_of_its_own() {
    let store = OperatorStore::new(1 << 30);
    let (_, built) = sums(softened, None, &store);
    let (_, other) = sums(bumpy, None, &store);
    assert!(other > built / 2, "{other} evaluations, {built} for the first");
    let (_, stated) = sums(softened, Some("softened"), &store);
    assert!(stated < built, "all values are the same: {stated}");
}

#[test]
fn a_store_keeps_what_it_has_room_for() {
    let store = OperatorStore::new(1 << 30);
    sums(softened, None, &store);
    let bytes = store.bytes();
    let (small, room_for_one) = (OperatorStore::new(bytes / 2), OperatorStore::new(3 * bytes / 2));
    sums(softened, None, &small);
    assert!(small.is_empty());
    for formula in [softened, bumpy, softened] {
        sums(formula, None, &room_for_one);
        assert_eq!(room_for_one.len(), 1, "{room_for_one:?}");
    }
    room_for_one.clear();
    assert_eq!((room_for_one.len(), room_for_one.bytes()), (0, 0));
}

#[test]
fn damaged_and_foreign_files_are_refused() {
    let folder = folder("damaged");
    let store = OperatorStore::new(1 << 30);
    assert!(matches!(store.load(&folder), Err(StoreError::Io { .. })));
    sums(softened, None, &store);
    store.save(&folder).expect("writable");
    let path = fs::read_dir(&folder).expect("there").next().expect("a file").expect("named").path();
    let whole = fs::read(&path).expect("readable");

    let load = |bytes: &[u8]| {
        fs::write(&path, bytes).expect("writable");
        let store = OperatorStore::new(1 << 30);
        let loaded = store.load(&folder);
        assert!(store.is_empty() || loaded.is_ok());
        loaded
    };
    for at in (0..whole.len()).step_by(whole.len() / 50) {
        let mut changed = whole.clone();
        changed[at] ^= 4;
        let error = load(&changed).expect_err("a bit is wrong");
        assert!(matches!(error, StoreError::Damaged { .. }), "{error}");
        assert!(load(&whole[..at]).is_err());
    }
    let long: Vec<u8> = whole.iter().copied().chain([0; 9]).collect();
    assert!(load(&long).is_err());
    assert_eq!(load(&whole).expect("whole"), 1);

    // Files of other versions and levels, and anything else, are left alone; unless one has the name of ours.
    fs::write(folder.join("0-other.operators"), "of another version").expect("writable");
    fs::write(folder.join("notes.txt"), "anything").expect("writable");
    assert_eq!(OperatorStore::new(1 << 30).load(&folder).expect("whole"), 1);
    fs::remove_dir_all(&folder).expect("removable");
}

#[test]
fn kernels_behind_pointers_are_told_apart() {
    type Chosen = Box<
        dyn Kernel<
                Real = f64,
                Source = DVec3,
                Target = DVec3,
                Charge = f64,
                Value = f64,
                Entry = f64,
            >,
    >;
    // One type of plan for both, and neither has parameters.
    let smooth = || -> Chosen { Box::new(from_fn(softened)) };
    let rough = || -> Chosen { Box::new(from_fn(bumpy)) };
    let points = cube(4000, 1);
    let charges: Vec<f64> = (0..points.len()).map(|i| (i as f64).sin()).collect();
    let sums = |kernel: Chosen, store: &OperatorStore| {
        let builder = Fmm::builder(kernel).tolerance(1e-4).leaf_size(40).operator_store(store);
        let fmm = builder.build(&points, &points).expect("a smooth kernel");
        assert!(fmm.report().stats.expansion_pairs > 0);
        fmm.apply(&charges).expect("finite")
    };
    let (own, shared) = (OperatorStore::new(1 << 30), OperatorStore::new(1 << 30));
    let exact = direct(&smooth(), &points, &charges, &points).expect("finite");
    assert!(relative_l2_error(&sums(smooth(), &shared), &exact) < 1e-4);
    assert_eq!(sums(rough(), &shared), sums(rough(), &own));
}

#[test]
fn operators_are_not_recognised_for_more_than_sums_take() {
    let waves: fn(DVec3, DVec3) -> f64 = |x, y| {
        let r = x.distance(y);
        (30.0 * r).cos() / (0.1 + r)
    };
    let points = cube(6000, 1);
    let planned = |applications: usize, store: &OperatorStore| {
        let evaluations = &AtomicUsize::new(0);
        let kernel = Counting { formula: plain(waves), evaluations, identity: None };
        let builder = Fmm::builder(kernel).tolerance(1e-4).operator_store(store);
        let fmm = builder.applications(applications).build(&points, &points).expect("smooth");
        (fmm.report().stats.scheme, evaluations.load(Relaxed))
    };
    let store = OperatorStore::new(1 << 30);
    let (often, _) = planned(10_000, &store);
    let (once, asked) = planned(1, &store);
    assert_eq!([often, once], [Scheme::Fmm, Scheme::Direct]);
    assert!(asked < 6000 * 6000 / 100, "{asked}");
}

#[test]
fn an_expansion_names_its_store_as_well() {
    let store = OperatorStore::new(1 << 30);
    let points = cube(3000, 2);
    let expansion = Interpolation::new(plain(softened)).tolerance(1e-3).operator_store(&store);
    Fmm::with_expansion(expansion).leaf_size(40).build(&points, &points).expect("smooth");
    assert_eq!(store.len(), 1);
}
