//! The laws that every kernel and expansion must obey, as callable checks, and two kernels on which
//! every operator is exact.
//!
//! A new implementation is tested by calling [`check`] with samples of its points and charges:
//!
//! ```
//! use farfield::conformance::{Samples, check};
//! use farfield::{Interpolation, from_fn};
//! use glam::DVec3;
//!
//! let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y));
//! let samples = Samples { source: |p, _| p, target: |p, _| p, charge: |i| 1.0 + i as f64 };
//! check(Interpolation::new(kernel).order(6), &samples, 1e-3)?;
//! # Ok::<(), farfield::conformance::Violation>(())
//! ```

use crate::error::Error;
use crate::expansion::{ChargeOf, Expansion, Geometry, Level, RealOf, SourceOf, TargetOf, ValueOf};
use crate::geometry::{Cell, Cube};
use crate::kernel::{Outcome, PointKernel, direct, relative_l2_error};
use crate::real::{Additive, Linear, Located, Point, Real, Vector};

pub use crate::exact::{Counting, RankOne};

/// How to make the points and charges of a kernel: each closure is given an index, so that
/// attributes can vary from point to point.
#[derive(Clone, Copy, Debug)]
pub struct Samples<S, X, Q> {
    /// A source at a point.
    pub source: S,
    /// A target at a point.
    pub target: X,
    /// A charge.
    pub charge: Q,
}

/// A law that does not hold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Violation {
    /// The expansion could not be prepared.
    #[error("prepare: {0}")]
    Prepare(#[from] Error),
    /// An operator is not additive in its input or overwrites its output.
    #[error("{operator} {fault}: relative deviation {deviation:e}, expected at most {bound:e}")]
    Operator {
        /// The operator.
        operator: &'static str,
        /// What it does wrong.
        fault: &'static str,
        /// By how much.
        deviation: f64,
        /// The largest deviation allowed.
        bound: f64,
    },
    /// A chain of operators does not reproduce direct summation.
    #[error(
        "{chain} at offset {offset:?}: relative l2 error {error:e} against direct summation, \
         expected at most {bound:e}"
    )]
    Chain {
        /// The operators, in order.
        chain: &'static str,
        /// From source to target cell, in cells.
        offset: [i32; 3],
        /// The error.
        error: f64,
        /// The largest error allowed.
        bound: f64,
    },
    /// An operator that declined has changed its output.
    #[error("{operator} declined but changed its output")]
    DeclinedWithOutput {
        /// The operator.
        operator: &'static str,
    },
}

/// Checks an expansion on hand-placed cells, before any tree: every operator adds to what it finds
/// and is additive in what it reads; P2M → M2M → M2L → L2L → L2P, P2M → M2P and P2L → L2P agree with
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
    let levels = [LEVEL, LEVEL + 1].map(|level| Level {
        level,
        half_width: Cell::new(&root, level, [0; 3]).half_width(),
        offsets: OFFSETS.to_vec(),
    });
    expansion.prepare(&Geometry { root, levels: levels.to_vec() })?;
    for offset in OFFSETS.into_iter().chain(UNANNOUNCED) {
        let bench = Bench::new(&expansion, samples, &root, offset);
        bench.operators()?;
        bench.chains(tolerance)?;
    }
    Ok(())
}

/// Checks that density, G and value together are the kernel's own `add`, to the relative l2 error
/// `tolerance`, at well-separated points. Kernels whose value needs gradients have them checked
/// through [`check`] alone.
///
/// # Errors
/// If they differ.
pub fn check_point_kernel<K, S, X, Q>(
    kernel: &K,
    samples: &Samples<S, X, Q>,
    tolerance: f64,
) -> Result<(), Violation>
where
    K: PointKernel,
    S: Fn(Point<K::Real>, usize) -> K::Source,
    X: Fn(Point<K::Real>, usize) -> K::Target,
    Q: Fn(usize) -> K::Charge,
{
    if K::GRADIENT {
        return Ok(());
    }
    let apart = Point::<K::Real>::from_array([K::Real::from_f64(4.0); 3]);
    let mut g = vec![<K::Entry as Additive>::zero(); K::FIELDS * K::DENSITIES];
    let mut density = vec![K::Column::zero(); K::DENSITIES];
    let (mut factored, mut added) = (Vec::new(), Vec::new());
    for i in 0..POINTS {
        let y = (samples.source)(scatter::<K::Real>(i), i);
        let x = (samples.target)(scatter::<K::Real>(i + POINTS) + apart, i);
        let q = (samples.charge)(i);
        let mut u = K::Value::zero();
        kernel.add(&x, &y, &q, &mut u);
        added.push(u);

        kernel.density(&y, &q, &mut density);
        kernel.entries(x.position(), y.position(), &mut g);
        let mut fields = vec![K::Column::zero(); K::FIELDS];
        for (k, &entry) in g.iter().enumerate() {
            fields[k / K::DENSITIES].add_scaled(entry, &density[k % K::DENSITIES]);
        }
        let mut u = K::Value::zero();
        kernel.value(&x, &fields, &[], &mut u);
        factored.push(u);
    }
    let deviation = relative_l2_error(&factored, &added);
    if deviation <= tolerance {
        return Ok(());
    }
    let (operator, fault) = ("value ∘ G ∘ density", "differs from add");
    Err(Violation::Operator { operator, fault, deviation, bound: tolerance })
}

/// Level of the cells between which M2L acts; their children hold the points.
const LEVEL: usize = 4;

/// Coordinates of the source cell.
const SOURCE_CELL: i32 = 8;

/// From source to target cell: barely separated, in the 316 of an unmasked tree, and beyond.
const OFFSETS: [[i32; 3]; 6] =
    [[2, 0, 0], [-2, 1, 0], [0, -2, -1], [2, 2, 1], [-3, 3, -3], [5, 0, -4]];

/// An offset for which `prepare` was not asked.
const UNANNOUNCED: [[i32; 3]; 1] = [[-4, 6, 1]];

/// Points per cell.
const POINTS: usize = 12;

/// The i-th of a scattered sequence of points in [−1, 1]³.
fn scatter<T: Real>(i: usize) -> Point<T> {
    let i = i as f64 + 1.0;
    Point::<T>::from_array(
        [0.754_877, 0.569_840, 0.362_719]
            .map(|step: f64| T::from_f64(2.0 * (step * i).fract() - 1.0)),
    )
}

/// One source and one target cell with points in a child of each.
struct Bench<'a, E: Expansion> {
    expansion: &'a E,
    offset: [i32; 3],
    source: Cell<RealOf<E>>,
    source_child: Cell<RealOf<E>>,
    target: Cell<RealOf<E>>,
    target_child: Cell<RealOf<E>>,
    sources: Vec<SourceOf<E>>,
    targets: Vec<TargetOf<E>>,
    /// Two sets of charges, and their sum.
    charges: [Vec<ChargeOf<E>>; 3],
}

impl<'a, E: Expansion> Bench<'a, E> {
    fn new<S, X, Q>(
        expansion: &'a E,
        samples: &Samples<S, X, Q>,
        root: &Cube<RealOf<E>>,
        offset: [i32; 3],
    ) -> Self
    where
        S: Fn(Point<RealOf<E>>, usize) -> SourceOf<E>,
        X: Fn(Point<RealOf<E>>, usize) -> TargetOf<E>,
        Q: Fn(usize) -> ChargeOf<E>,
    {
        let cell = |level, c: [i32; 3]| Cell::new(root, level, c.map(|c| c as u32));
        let child = |c: [i32; 3], octant: [i32; 3]| -> [i32; 3] {
            std::array::from_fn(|k| 2 * c[k] + octant[k])
        };
        let source_at = [SOURCE_CELL; 3];
        let target_at = offset.map(|o| SOURCE_CELL + o);
        let source_child = cell(LEVEL + 1, child(source_at, [1, 0, 1]));
        let target_child = cell(LEVEL + 1, child(target_at, [0, 0, 1]));
        let place =
            |cell: &Cell<RealOf<E>>, i| cell.centre() + scatter::<RealOf<E>>(i) * cell.half_width();
        let charges =
            |from: usize| -> Vec<_> { (from..from + POINTS).map(&samples.charge).collect() };
        let (a, b) = (charges(0), charges(POINTS));
        let sum = added(&a, &b);
        Self {
            expansion,
            offset,
            sources: (0..POINTS).map(|i| (samples.source)(place(&source_child, i), i)).collect(),
            targets: (0..POINTS)
                .map(|i| (samples.target)(place(&target_child, i + POINTS), i))
                .collect(),
            source: cell(LEVEL, source_at),
            source_child,
            target: cell(LEVEL, target_at),
            target_child,
            charges: [a, b, sum],
        }
    }

    /// Every chain of operators from sources to targets against direct summation.
    fn chains(&self, bound: f64) -> Result<(), Violation> {
        let charges = &self.charges[0];
        let exact = direct(self.expansion.kernel(), &self.sources, charges, &self.targets);
        let hold = |chain, values: &[ValueOf<E>]| {
            let error = relative_l2_error(values, &exact);
            if error <= bound {
                return Ok(());
            }
            Err(Violation::Chain { chain, offset: self.offset, error, bound })
        };
        let moments = self.m2m(&self.p2m(charges));
        let local = self.l2l(&self.m2l(&moments));
        hold("P2M → M2M → M2L → L2L → L2P", &self.l2p(&local))?;
        if let Some(values) = self.m2p(&moments)? {
            hold("P2M → M2M → M2P", &values)?;
        }
        if let Some(local) = self.p2l(charges)? {
            hold("P2L → L2L → L2P", &self.l2p(&self.l2l(&local)))?;
        }
        Ok(())
    }

    /// Additivity of every operator, into clean and into used outputs.
    fn operators(&self) -> Result<(), Violation> {
        let bound = 1e4 * <RealOf<E> as num_traits::Float>::epsilon().as_f64();
        let [qa, qb, q_sum] = &self.charges;
        let e = self.expansion;
        let (sources, targets) = (&self.sources, &self.targets);
        let moments = additive("p2m", bound, [qa, qb, q_sum], &self.p2m(qa), |q, out| {
            e.p2m(&self.source_child, sources, q, out);
        })?;
        let moments =
            additive("m2m", bound, moments.each_ref(), &self.m2m(&moments[0]), |m, out| {
                e.m2m(&self.source_child, &self.source, m, out);
            })?;
        let locals =
            additive("m2l", bound, moments.each_ref(), &self.m2l(&moments[0]), |m, out| {
                e.m2l(&self.source, &self.target, m, out);
            })?;
        if self.m2p(&moments[0])?.is_some() {
            additive("m2p", bound, moments.each_ref(), &self.values(), |m, out| {
                let _ = e.m2p(&self.source, m, targets, out);
            })?;
        }
        if let Some(local) = self.p2l(qa)? {
            additive("p2l", bound, [qa, qb, q_sum], &local, |q, out| {
                let _ = e.p2l(&self.target, sources, q, out);
            })?;
        }
        let locals = additive("l2l", bound, locals.each_ref(), &self.l2l(&locals[0]), |l, out| {
            e.l2l(&self.target, &self.target_child, l, out);
        })?;
        additive("l2p", bound, locals.each_ref(), &self.values(), |l, out| {
            e.l2p(&self.target_child, l, targets, out);
        })?;
        Ok(())
    }

    fn p2m(&self, charges: &[ChargeOf<E>]) -> Vec<E::MultipoleTerm> {
        let mut out = zeros(self.expansion.multipole_len(LEVEL + 1));
        self.expansion.p2m(&self.source_child, &self.sources, charges, &mut out);
        out
    }

    fn m2m(&self, from: &[E::MultipoleTerm]) -> Vec<E::MultipoleTerm> {
        let mut out = zeros(self.expansion.multipole_len(LEVEL));
        self.expansion.m2m(&self.source_child, &self.source, from, &mut out);
        out
    }

    fn m2l(&self, from: &[E::MultipoleTerm]) -> Vec<E::LocalTerm> {
        let mut out = zeros(self.expansion.local_len(LEVEL));
        self.expansion.m2l(&self.source, &self.target, from, &mut out);
        out
    }

    fn l2l(&self, from: &[E::LocalTerm]) -> Vec<E::LocalTerm> {
        let mut out = zeros(self.expansion.local_len(LEVEL + 1));
        self.expansion.l2l(&self.target, &self.target_child, from, &mut out);
        out
    }

    fn l2p(&self, local: &[E::LocalTerm]) -> Vec<ValueOf<E>> {
        let mut out = self.values();
        self.expansion.l2p(&self.target_child, local, &self.targets, &mut out);
        out
    }

    fn m2p(&self, moments: &[E::MultipoleTerm]) -> Result<Option<Vec<ValueOf<E>>>, Violation> {
        let mut out = self.values();
        let outcome = self.expansion.m2p(&self.source, moments, &self.targets, &mut out);
        unless_declined("m2p", outcome, out)
    }

    fn p2l(&self, charges: &[ChargeOf<E>]) -> Result<Option<Vec<E::LocalTerm>>, Violation> {
        let mut out = zeros(self.expansion.local_len(LEVEL));
        let outcome = self.expansion.p2l(&self.target, &self.sources, charges, &mut out);
        unless_declined("p2l", outcome, out)
    }

    fn values(&self) -> Vec<ValueOf<E>> {
        zeros(self.targets.len())
    }
}

/// The output of an optional operator, if it did its work.
fn unless_declined<V: Additive>(
    operator: &'static str,
    outcome: Outcome,
    out: Vec<V>,
) -> Result<Option<Vec<V>>, Violation> {
    match outcome {
        Outcome::Done => Ok(Some(out)),
        Outcome::Declined if out.iter().all(|v| v.norm_squared() == 0.0) => Ok(None),
        Outcome::Declined => Err(Violation::DeclinedWithOutput { operator }),
    }
}

/// Applies an operator to a, b and a + b, and to b once more on top of its result for a. Returns the
/// first three results. `like` has the length of the output.
fn additive<I, O: Additive>(
    operator: &'static str,
    bound: f64,
    inputs: [&Vec<I>; 3],
    like: &[O],
    apply: impl Fn(&[I], &mut [O]),
) -> Result<[Vec<O>; 3], Violation> {
    let results = inputs.map(|input| {
        let mut out = zeros(like.len());
        apply(input, &mut out);
        out
    });
    let expected = added(&results[0], &results[1]);
    let mut onto = results[0].clone();
    apply(inputs[1], &mut onto);
    let hold = |fault, found: &[O]| {
        let size: f64 = results.iter().flatten().map(Additive::norm_squared).sum();
        let deviation: f64 = found.iter().zip(&expected).map(|(a, b)| distance_squared(a, b)).sum();
        let deviation = if deviation == 0.0 { 0.0 } else { (deviation / size).sqrt() };
        if deviation <= bound {
            return Ok(());
        }
        Err(Violation::Operator { operator, fault, deviation, bound })
    };
    hold("is not additive in its input", &results[2])?;
    hold("does not add to its output", &onto)?;
    Ok(results)
}

fn distance_squared<V: Additive>(a: &V, b: &V) -> f64 {
    let mut difference = *a;
    difference.subtract(b);
    difference.norm_squared()
}

fn zeros<V: Additive>(len: usize) -> Vec<V> {
    vec![V::zero(); len]
}

fn added<V: Additive>(a: &[V], b: &[V]) -> Vec<V> {
    let mut sum = a.to_vec();
    for (s, b) in sum.iter_mut().zip(b) {
        s.accumulate(b);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::Interpolation;
    use crate::kernel::from_fn;
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
        check_point_kernel(&kernel, &plain!(), 1e-15).unwrap();
        check(Interpolation::new(kernel).order(6), &plain!(), 1e-3).unwrap();
        // The sample charges nearly cancel, and one pair of cells has no near field to set against.
        check(Interpolation::new(kernel).tolerance(1e-5), &plain!(), 1e-4).unwrap();

        let columns = Samples {
            source: |p: DVec3, _| p,
            target: |p: DVec3, _| p,
            charge: |i| [1.0, i as f64, -0.5],
        };
        let kernel = from_fn(inverse).columns::<[f64; 3]>();
        check(Interpolation::new(kernel).tolerance(1e-4), &columns, 1e-4).unwrap();

        let waves = Samples {
            source: |p: DVec3, _| p,
            target: |p: DVec3, _| p,
            charge: |i| Complex::new(i as f64, 1.0),
        };
        let kernel =
            from_fn(|x: DVec3, y: DVec3| Complex::cis(3.0 * x.distance(y)) / x.distance(y));
        check(Interpolation::new(kernel).tolerance(1e-6), &waves, 1e-6).unwrap();
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
