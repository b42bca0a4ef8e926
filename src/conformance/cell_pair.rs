//! The laws on one pair of hand-placed cells.

use crate::conformance::samples::Samples;
use crate::conformance::violation::Violation;
use crate::expansion::{ChargeOf, Expansion, RealOf, SourceOf, TargetOf, ValueOf};
use crate::kernel::direct::{direct, relative_l2_error};
use crate::kernel::traits::Outcome;
use crate::numbers::traits::{Numbers, Point, Real, Vector, l2_norm};
use crate::octree::geometry::{Cell, Cube};

/// Level of the cells between which M2L acts; their children hold the points.
pub(super) const LEVEL: usize = 4;

/// Coordinates of the source cell.
const SOURCE_CELL: i32 = 8;

/// From source to target cell: barely separated, in the 316 of an unmasked tree, and beyond.
pub(super) const OFFSETS: [[i32; 3]; 6] =
    [[2, 0, 0], [-2, 1, 0], [0, -2, -1], [2, 2, 1], [-3, 3, -3], [5, 0, -4]];

/// An offset for which `prepare` was not asked.
pub(super) const UNANNOUNCED: [[i32; 3]; 1] = [[-4, 6, 1]];

/// Points per cell.
pub(super) const POINTS: usize = 12;

/// The i-th of a scattered sequence of points in [−1, 1]³.
pub(super) fn scatter<T: Real>(i: usize) -> Point<T> {
    let i = i as f64 + 1.0;
    Point::<T>::from_array(
        [0.754_877, 0.569_840, 0.362_719]
            .map(|step: f64| T::from_f64(2.0 * (step * i).fract() - 1.0)),
    )
}

/// One source and one target cell with points in a child of each.
pub(super) struct CellPair<'a, E: Expansion> {
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

impl<'a, E: Expansion> CellPair<'a, E> {
    pub(super) fn new<S, X, Q>(
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
        let cell = |level, c: [i32; 3]| Cell::new(root, level, c.map(|c| c as u64));
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
    pub(super) fn chains(&self, bound: f64) -> Result<(), Violation> {
        let charges = &self.charges[0];
        let exact = direct(self.expansion.kernel(), &self.sources, charges, &self.targets)?;
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

    /// Additivity of every operator, into clean and into used outputs: to round-off, or to half
    /// the tolerance, since no expansion need carry more digits than are asked for.
    pub(super) fn operators(&self, tolerance: f64) -> Result<(), Violation> {
        let round_off = 1e4 * <RealOf<E> as num_traits::Float>::epsilon().as_f64();
        let bound = round_off.max(0.5 * tolerance);
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
fn unless_declined<V: Numbers>(
    operator: &'static str,
    outcome: Outcome,
    out: Vec<V>,
) -> Result<Option<Vec<V>>, Violation> {
    match outcome {
        Outcome::Done => Ok(Some(out)),
        Outcome::Declined if out.iter().all(|v| v.norm() == 0.0) => Ok(None),
        Outcome::Declined => Err(Violation::DeclinedWithOutput { operator }),
    }
}

/// Applies an operator to a, b and a + b, and to b once more on top of its result for a. Returns the
/// first three results. `like` has the length of the output.
fn additive<I, O: Numbers>(
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
        let size = l2_norm(results.iter().flatten().cloned());
        let deviation = l2_norm(found.iter().zip(&expected).map(|(a, b)| difference(a, b)));
        let deviation = if deviation == 0.0 { 0.0 } else { deviation / size };
        if deviation <= bound {
            return Ok(());
        }
        Err(Violation::Operator { operator, fault, deviation, bound })
    };
    hold("is not additive in its input", &results[2])?;
    hold("does not add to its output", &onto)?;
    Ok(results)
}

fn difference<V: Numbers>(a: &V, b: &V) -> V {
    let mut difference = a.clone();
    difference.subtract(b);
    difference
}

fn zeros<V: Numbers>(len: usize) -> Vec<V> {
    vec![V::zero(); len]
}

fn added<V: Numbers>(a: &[V], b: &[V]) -> Vec<V> {
    let mut sum = a.to_vec();
    for (s, b) in sum.iter_mut().zip(b) {
        s.accumulate(b);
    }
    sum
}
