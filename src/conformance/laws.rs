//! The laws of kernels and expansions.

use crate::conformance::samples::Samples;
use crate::conformance::violation::Violation;
use crate::expansion::geometry::{Geometry, Level};
use crate::expansion::{ChargeOf, Expansion, RealOf, SourceOf, TargetOf};
use crate::kernel::direct::relative_l2_error;
use crate::kernel::traits::{Kernel, Outcome, add_by_entries};
use crate::numbers::traits::{Located, Numbers, Point, Real, Scalar, Vector};
use crate::octree::geometry::{Cell, Cube};

use crate::conformance::cell_pair::{CellPair, LEVEL, OFFSETS, POINTS, UNANNOUNCED, scatter};

/// Checks an expansion on hand-placed cells, before any tree: every operator adds to what it finds
/// and is additive in what it reads (to half the tolerance); P2M → M2M → M2L → L2L → L2P, P2M → M2P and P2L → L2P agree with
/// direct summation to the relative l2 error `tolerance`, near and far.
///
/// The kernel is sampled between well-separated points only, so it may be singular.
///
/// # Errors
/// The first law that does not hold.
pub fn check<E, S, X, Q>(
    mut expansion: E,
    samples: &Samples<S, X, Q>,
    tolerance: f64,
) -> Result<(), Violation>
where
    E: Expansion,
    S: Fn(Point<RealOf<E>>, usize) -> SourceOf<E>,
    X: Fn(Point<RealOf<E>>, usize) -> TargetOf<E>,
    Q: Fn(usize) -> ChargeOf<E>,
{
    let root = Cube::new(Point::<RealOf<E>>::default(), RealOf::<E>::from_f64(1.0));
    let levels = [LEVEL, LEVEL + 1].map(|level| {
        Level::new(level, Cell::new(&root, level, [0; 3]).half_width(), OFFSETS.to_vec())
    });
    expansion.prepare(&Geometry::new(root, levels.to_vec()))?;
    for offset in OFFSETS.into_iter().chain(UNANNOUNCED) {
        let cells = CellPair::new(&expansion, samples, &root, offset);
        cells.operators(tolerance)?;
        cells.chains(tolerance)?;
    }
    Ok(())
}

/// Checks that a kernel's methods agree with each other: [`add_block`](Kernel::add_block) and [`add_pairs`](Kernel::add_pairs) give what density, entries and
/// value give together, and [`entries_block`](Kernel::entries_block) gives the entries of each pair; all
/// to the relative l2 error `tolerance`, at well-separated points. Gradients are held against differences.
///
/// # Errors
/// The first method that differs.
pub fn check_kernel<K, S, X, Q>(
    kernel: &K,
    samples: &Samples<S, X, Q>,
    tolerance: f64,
) -> Result<(), Violation>
where
    K: Kernel,
    S: Fn(Point<K::Real>, usize) -> K::Source,
    X: Fn(Point<K::Real>, usize) -> K::Target,
    Q: Fn(usize) -> K::Charge,
{
    let apart = Point::<K::Real>::from_array([K::Real::from_f64(4.0); 3]);
    let source = |j| (samples.source)(scatter::<K::Real>(j), j);
    let target = |i| (samples.target)(scatter::<K::Real>(i + POINTS) + apart, i);
    let (ys, xs): (Vec<_>, Vec<_>) =
        ((0..POINTS).map(source).collect(), (0..POINTS).map(target).collect());
    let qs: Vec<K::Charge> = (0..POINTS).map(&samples.charge).collect();
    let zeros = || vec![K::Value::zero(); POINTS];

    let mut factored = zeros();
    add_by_entries(kernel, &xs, &ys, &qs, &mut factored);
    let mut by_block = zeros();
    kernel.add_block(&xs, &ys, &qs, 0.0, &mut by_block);
    let deviation = relative_l2_error(&by_block, &factored);
    agree("add_block", "differs from value ∘ entries ∘ density", deviation, tolerance)?;

    // Two of three pairs count.
    let counts = |pair: usize| pair % 3 != 1;
    let mut bits = vec![0u64; (POINTS * POINTS).div_ceil(64)];
    for pair in (0..POINTS * POINTS).filter(|&pair| counts(pair)) {
        bits[pair / 64] |= 1 << (pair % 64);
    }
    let (mut by_bits, mut by_pairs) = (zeros(), zeros());
    kernel.add_pairs(&xs, &ys, &qs, &bits, 0.0, &mut by_bits);
    for pair in (0..POINTS * POINTS).filter(|&pair| counts(pair)) {
        let (i, j) = (pair / POINTS, pair % POINTS);
        kernel.add_block(&xs[i..=i], &ys[j..=j], &qs[j..=j], 0.0, &mut by_pairs[i..=i]);
    }
    let deviation = relative_l2_error(&by_bits, &by_pairs);
    agree("add_pairs", "differs from add_block of its pairs", deviation, tolerance)?;

    let [xs, ys] = [
        xs.iter().map(Located::position).collect::<Vec<_>>(),
        ys.iter().map(Located::position).collect::<Vec<_>>(),
    ];
    let len = kernel.fields() * kernel.densities();
    let mut block = vec![<K::Entry as Numbers>::zero(); POINTS * POINTS * len];
    let mut pairs = block.clone();
    kernel.entries_block(&xs, &ys, &mut block);
    for (pair, g) in pairs.chunks_exact_mut(len).enumerate() {
        kernel.entries(xs[pair / POINTS], ys[pair % POINTS], g);
    }
    let deviation = relative_l2_error(&block, &pairs);
    agree("entries_block", "differs from entries", deviation, tolerance)?;
    if kernel.needs_gradients() { check_gradients(kernel, &xs, &ys, tolerance) } else { Ok(()) }
}

/// Holds gradients against central differences of entries, to `tolerance` or what differences can tell.
fn check_gradients<K: Kernel>(
    kernel: &K,
    xs: &[Point<K::Real>],
    ys: &[Point<K::Real>],
    tolerance: f64,
) -> Result<(), Violation> {
    let zero = <K::Entry as Numbers>::zero();
    let epsilon = <K::Real as num_traits::Float>::epsilon().as_f64();
    // Truncation costs step², rounding ε/step; the points are some units apart.
    let step = epsilon.cbrt();
    let len = kernel.fields() * kernel.densities();
    let (mut exact, mut found) = (Vec::new(), Vec::new());
    let mut slopes = vec![[zero; 3]; len];
    let [mut after, mut before] = [vec![zero; len], vec![zero; len]];
    for (&x, &y) in xs.iter().zip(ys) {
        if kernel.entry_gradients(x, y, &mut slopes) == Outcome::Declined {
            return Ok(());
        }
        for axis in 0..3 {
            let mut along = [K::Real::from_f64(0.0); 3];
            along[axis] = K::Real::from_f64(step);
            let h = Point::<K::Real>::from_array(along);
            kernel.entries(x + h, y, &mut after);
            kernel.entries(x - h, y, &mut before);
            let per_length = K::Entry::from_real(K::Real::from_f64(0.5 / step));
            exact.extend(after.iter().zip(&before).map(|(&a, &b)| (a - b) * per_length));
            found.extend(slopes.iter().map(|slope| slope[axis]));
        }
    }
    let bound = tolerance.max(100.0 * epsilon.cbrt().powi(2));
    agree(
        "entry_gradients",
        "differs from differences of entries",
        relative_l2_error(&found, &exact),
        bound,
    )
}

/// Refuses a deviation that is more than the bound, or not a number.
fn agree(
    operator: &'static str,
    fault: &'static str,
    deviation: f64,
    bound: f64,
) -> Result<(), Violation> {
    if deviation <= bound {
        return Ok(());
    }
    Err(Violation::Operator { operator, fault, deviation, bound })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::exact::{Counting, RankOne};
    use crate::interpolation::black_box::Interpolation;
    use crate::kernel::closure::from_fn;
    use crate::kernel::traits::Outcome;
    use glam::{DVec3, Vec3};
    use num_complex::Complex;

    /// Points and charges of any kernel on bare points in double precision.
    macro_rules! plain {
        () => {
            Samples {
                source: |p: DVec3, _| p,
                target: |p: DVec3, _| p,
                charge: |i| (i as f64 + 0.5).sin(),
            }
        };
    }

    #[test]
    fn exact_kernels_pass_at_round_off() {
        check(Counting::<f64>::new(), &plain!(), 1e-14).unwrap();
        check(RankOne::<f64>::new(), &plain!(), 1e-13).unwrap();
        let single =
            Samples { source: |p: Vec3, _| p, target: |p: Vec3, _| p, charge: |i| i as f32 + 1.0 };
        check(RankOne::<f32>::new(), &single, 1e-5).unwrap();
    }

    #[test]
    fn interpolation_passes_for_real_complex_and_many_columns() {
        let inverse = |x: DVec3, y: DVec3| 1.0 / x.distance(y);
        let kernel = from_fn(inverse);
        check_kernel(&kernel, &plain!(), 1e-15).unwrap();
        check(Interpolation::new(kernel).order(6), &plain!(), 1e-3).unwrap();
        // The sample charges nearly cancel, and one pair of cells has no near field to set against.
        check(Interpolation::new(kernel).tolerance(1e-5), &plain!(), 1e-4).unwrap();

        let columns = Samples {
            source: |p: DVec3, _| p,
            target: |p: DVec3, _| p,
            charge: |i| [1.0, i as f64, -0.5],
        };
        let kernel = from_fn(inverse).charges::<[f64; 3]>();
        check(Interpolation::new(kernel).tolerance(1e-4), &columns, 1e-4).unwrap();

        let waves = Samples {
            source: |p: DVec3, _| p,
            target: |p: DVec3, _| p,
            charge: |i| Complex::new(i as f64, 1.0),
        };
        let kernel =
            from_fn(|x: DVec3, y: DVec3| Complex::cis(3.0 * x.distance(y)) / x.distance(y));
        check(Interpolation::new(kernel).tolerance(1e-6), &waves, 2e-6).unwrap();
    }

    #[test]
    fn a_kernel_without_translation_invariance_passes() {
        let kernel = from_fn(|x: DVec3, y: DVec3| (1.0 + x.x * x.x) / x.distance(y));
        check(Interpolation::new(kernel).order(5), &plain!(), 1e-2).unwrap();
    }

    #[test]
    fn too_low_an_order_is_found_out() {
        let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y));
        let violation = check(Interpolation::new(kernel).order(2), &plain!(), 1e-4).unwrap_err();
        assert!(matches!(violation, Violation::Chain { .. }), "{violation}");
    }

    /// The counting kernel with one operator broken.
    struct Broken(Counting<f64>, &'static str);

    impl Expansion for Broken {
        type Kernel = Counting<f64>;
        type MultipoleTerm = f64;
        type LocalTerm = f64;

        fn kernel(&self) -> &Counting<f64> {
            &self.0
        }
        fn multipole_len(&self, _: usize) -> usize {
            1
        }
        fn local_len(&self, _: usize) -> usize {
            1
        }
        fn p2m(&self, c: &Cell<f64>, ys: &[DVec3], qs: &[f64], m: &mut [f64]) {
            self.0.p2m(c, ys, qs, m);
        }
        fn m2m(&self, c: &Cell<f64>, p: &Cell<f64>, from: &[f64], to: &mut [f64]) {
            if self.1 == "m2m overwrites" {
                to[0] = 0.0;
            }
            self.0.m2m(c, p, from, to);
        }
        fn m2l(&self, s: &Cell<f64>, t: &Cell<f64>, from: &[f64], to: &mut [f64]) {
            self.0.m2l(s, t, from, to);
            if self.1 == "m2l is affine" {
                to[0] += 1.0;
            }
        }
        fn l2l(&self, p: &Cell<f64>, c: &Cell<f64>, from: &[f64], to: &mut [f64]) {
            self.0.l2l(p, c, from, to);
            if self.1 == "l2l doubles" {
                self.0.l2l(p, c, from, to);
            }
        }
        fn l2p(&self, c: &Cell<f64>, l: &[f64], xs: &[DVec3], us: &mut [f64]) {
            self.0.l2p(c, l, xs, us);
        }
        fn m2p(&self, _: &Cell<f64>, _: &[f64], _: &[DVec3], us: &mut [f64]) -> Outcome {
            if self.1 == "m2p writes" {
                us[0] = 1.0;
            }
            Outcome::Declined
        }
    }

    #[test]
    fn broken_operators_are_found_out() {
        let verdict = |fault| check(Broken(Counting::new(), fault), &plain!(), 1e-12);
        verdict("none").unwrap();
        let operator = |fault| match verdict(fault) {
            Err(Violation::Operator { operator, .. }) => operator,
            other => panic!("{fault}: {other:?}"),
        };
        assert_eq!(operator("m2m overwrites"), "m2m");
        assert_eq!(operator("m2l is affine"), "m2l");
        assert!(matches!(verdict("l2l doubles"), Err(Violation::Chain { .. })));
        assert_eq!(verdict("m2p writes"), Err(Violation::DeclinedWithOutput { operator: "m2p" }));
    }
}
