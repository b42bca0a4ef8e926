//! Kernels: what is summed; and direct summation, the reference of everything else.

pub(crate) mod mask;
pub(crate) mod pair_loop;

use std::fmt;
use std::marker::PhantomData;

use crate::kernel::pair_loop::PairLoop;
use crate::numbers::bits::for_each_set_bit;
use crate::numbers::real::{Additive, Columns, Linear, Located, Point, Real, Scalar, l2_norm};
use crate::parallel;

/// The sum's kernel: u(x) += K(x, y) q, linear in q.
///
/// One method is required. Its one obligation beyond linearity: it must be finite wherever it is
/// called, also at x = y if a source and a target can coincide. Whether a point acts on itself is
/// the kernel's decision: one that is singular on its diagonal gives zero there.
pub trait Kernel: Send + Sync {
    /// Precision of the coordinates.
    type Real: Real;
    /// What acts: any type with a position.
    type Source: Located<Real = Self::Real>;
    /// What is acted upon: any type with a position.
    type Target: Located<Real = Self::Real>;
    /// What a source carries: a number, a vector, several right-hand sides in an array.
    type Charge: Linear<Self::Real>;
    /// What a target receives.
    type Value: Linear<Self::Real>;

    /// Adds K(x, y) q to `u`.
    fn add(&self, x: &Self::Target, y: &Self::Source, q: &Self::Charge, u: &mut Self::Value);

    /// Adds Σ_j K(x_i, y_j) q_j to `us[i]` for every target of a block: as many `us` as `xs`, as many
    /// `qs` as `ys`. Each K(x_i, y_j) may be off by the relative error `tolerance`; 0 asks for all
    /// digits.
    ///
    /// The default calls [`add`](Self::add) for each pair, several targets side by side, compiled for
    /// AVX2 where the machine has it. An `add` that inlines and doesn't branch (one that selects
    /// instead) then fills the registers. Override it to do better still; each target's sum must keep
    /// one fixed order of its own.
    fn add_block(
        &self,
        xs: &[Self::Target],
        ys: &[Self::Source],
        qs: &[Self::Charge],
        _tolerance: f64,
        us: &mut [Self::Value],
    ) {
        let add = |x: &_, y: &_, q: &_, u: &mut _| self.add(x, y, q, u);
        PairLoop { add, xs, ys, qs, us }.run();
    }

    /// Adds K(x_i, y_j) q_j to `us[i]` for the pairs of a block whose bit is set: bit i·n + j, counted
    /// through the words of `bits`, is that of the i-th target and the j-th of n sources. As
    /// [`add_block`](Self::add_block) otherwise.
    ///
    /// The default calls [`add`](Self::add) for one pair after the other.
    fn add_pairs(
        &self,
        xs: &[Self::Target],
        ys: &[Self::Source],
        qs: &[Self::Charge],
        bits: &[u64],
        _tolerance: f64,
        us: &mut [Self::Value],
    ) {
        for (i, (x, u)) in xs.iter().zip(us).enumerate() {
            for_each_set_bit(bits, i, ys.len(), |j| self.add(x, &ys[j], &qs[j], u));
        }
    }
}

/// A kernel that factors through a bare-point kernel G, with attributes applied on either side:
///
/// K(x, y) q = R_x [ G(x, y) · S_y q ]
///
/// S_y turns a charge into densities, G is a small matrix of numbers, R_x turns fields into a value.
/// This is all the black-box [`Interpolation`](crate::Interpolation) asks for.
///
/// Densities and fields are the *components* that G mixes. Independent right-hand sides (colours,
/// several charge vectors) are *columns*: they ride along inside [`Column`](Self::Column) and never
/// enlarge G.
pub trait PointKernel: Kernel {
    /// The number type of G's entries: real or complex.
    type Entry: Scalar<Real = Self::Real>;
    /// One component of all right-hand sides together: `T`, `[T; 3]`, `Complex<T>`, …
    type Column: Columns<Self::Entry>;
    /// Columns of G: how many densities a source has.
    const DENSITIES: usize;
    /// Rows of G: how many fields a target sees.
    const FIELDS: usize;
    /// Whether [`value`](Self::value) needs the fields' derivatives with respect to x.
    const GRADIENT: bool = false;

    /// Writes G(x, y) into `g`, row after row: [`FIELDS`](Self::FIELDS) ×
    /// [`DENSITIES`](Self::DENSITIES) entries. Only asked for at x ≠ y.
    fn entries(&self, x: Point<Self::Real>, y: Point<Self::Real>, g: &mut [Self::Entry]);

    /// Writes ∂G(x, y)/∂x into `g`, in the same order. Never wrong to decline.
    fn entry_gradients(
        &self,
        _x: Point<Self::Real>,
        _y: Point<Self::Real>,
        _g: &mut [[Self::Entry; 3]],
    ) -> Outcome {
        Outcome::Declined
    }

    /// Writes S_y q into `d`: [`DENSITIES`](Self::DENSITIES) columns.
    fn density(&self, y: &Self::Source, q: &Self::Charge, d: &mut [Self::Column]);

    /// Adds R_x f to `u`. `gradients` holds ∂f/∂x per field if [`GRADIENT`](Self::GRADIENT) is set
    /// and is empty otherwise.
    fn value(
        &self,
        x: &Self::Target,
        fields: &[Self::Column],
        gradients: &[[Self::Column; 3]],
        u: &mut Self::Value,
    );
}

/// Whether an optional operator did its work. One that declines must leave its output untouched;
/// the engine then sums directly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Outcome {
    /// The result has been added.
    Done,
    /// Nothing has been added.
    Declined,
}

/// A kernel given by its formula alone: a closure from (target, source) to a real or complex number.
///
/// Charges and values have the type that the closure returns; see
/// [`columns`](FnKernel::columns) for several right-hand sides at once. The formula is evaluated at
/// coincident points too, and what it gives there counts unless
/// [`skip_coincident`](FnKernel::skip_coincident) is asked for.
///
/// ```
/// use glam::DVec3;
/// let kernel = farfield::from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp());
/// let sum = farfield::direct(&kernel, &[DVec3::ZERO], &[2.0], &[DVec3::ZERO, DVec3::X]);
/// assert_eq!(sum, [2.0, 2.0 * f64::exp(-1.0)]);
/// ```
pub fn from_fn<F, P, V>(f: F) -> FnKernel<F, P, V>
where
    F: Fn(P, P) -> V + Send + Sync,
    P: Located<Real = V::Real>,
    V: Scalar,
{
    FnKernel { f, skip_coincident: false, types: PhantomData }
}

/// The kernel made by [`from_fn`]: points of type `P`, entries of type `V`, right-hand sides `C`.
#[derive(Clone, Copy)]
pub struct FnKernel<F, P, V, C = V> {
    f: F,
    skip_coincident: bool,
    types: PhantomData<fn(P) -> (V, C)>,
}

impl<F, P, V, C> FnKernel<F, P, V, C> {
    /// Pairs at the same position contribute nothing: the usual choice for singular kernels. The
    /// formula is evaluated there all the same, so that it needs no branch; what it gives is dropped.
    pub fn skip_coincident(self) -> Self {
        Self { skip_coincident: true, ..self }
    }

    /// The same kernel for charges of another type, such as `[f64; 3]` for three right-hand sides.
    pub fn columns<D>(self) -> FnKernel<F, P, V, D> {
        FnKernel { f: self.f, skip_coincident: self.skip_coincident, types: PhantomData }
    }
}

impl<F, P, V, C> fmt::Debug for FnKernel<F, P, V, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FnKernel").field("skip_coincident", &self.skip_coincident).finish()
    }
}

impl<F, P, V, C> Kernel for FnKernel<F, P, V, C>
where
    F: Fn(P, P) -> V + Send + Sync,
    V: Scalar<Real: Real<Vector = P>>,
    P: Located<Real = V::Real> + Copy + PartialEq,
    C: Linear<V> + Linear<V::Real>,
{
    type Real = V::Real;
    type Source = P;
    type Target = P;
    type Charge = C;
    type Value = C;

    #[inline(always)]
    fn add(&self, x: &P, y: &P, q: &C, u: &mut C) {
        let k = (self.f)(*x, *y);
        let skip = self.skip_coincident && x == y;
        u.add_scaled(if skip { <V as Additive>::zero() } else { k }, q);
    }
}

impl<F, P, V, C> PointKernel for FnKernel<F, P, V, C>
where
    F: Fn(P, P) -> V + Send + Sync,
    V: Scalar<Real: Real<Vector = P>>,
    P: Located<Real = V::Real> + Copy + PartialEq,
    C: Columns<V> + Linear<V::Real>,
{
    type Entry = V;
    type Column = C;
    const DENSITIES: usize = 1;
    const FIELDS: usize = 1;

    fn entries(&self, x: P, y: P, g: &mut [V]) {
        g[0] = (self.f)(x, y);
    }

    fn density(&self, _y: &P, q: &C, d: &mut [C]) {
        d[0] = *q;
    }

    fn value(&self, _x: &P, fields: &[C], _gradients: &[[C; 3]], u: &mut C) {
        u.accumulate(&fields[0]);
    }
}

/// Direct summation u_i = Σ_j K(x_i, y_j) q_j over all pairs, in parallel over targets, each sum in
/// the order of the sources. O(N·M): the reference that every fast path is held against.
///
/// # Panics
/// If `sources` and `charges` differ in length.
pub fn direct<K: Kernel>(
    kernel: &K,
    sources: &[K::Source],
    charges: &[K::Charge],
    targets: &[K::Target],
) -> Vec<K::Value> {
    assert_eq!(sources.len(), charges.len(), "one charge per source");
    let mut values = vec![K::Value::zero(); targets.len()];
    parallel::for_each_piece(&mut values, DIRECT_BLOCK, &|block, us| {
        let xs = &targets[DIRECT_BLOCK * block..][..us.len()];
        for (ys, qs) in sources.chunks(DIRECT_RUN).zip(charges.chunks(DIRECT_RUN)) {
            kernel.add_block(xs, ys, qs, 0.0, us);
        }
    });
    values
}

/// Targets per parallel task of a direct sum.
const DIRECT_BLOCK: usize = 64;
/// Sources per block of a direct sum: they stay in the first-level cache while the targets pass.
const DIRECT_RUN: usize = 1024;

/// Relative l2 error ‖a − b‖ / ‖b‖ of `values` against `reference`; the absolute one where the
/// reference vanishes.
///
/// # Panics
/// If the lengths differ.
pub fn relative_l2_error<V: Additive>(values: &[V], reference: &[V]) -> f64 {
    assert_eq!(values.len(), reference.len(), "one reference per value");
    let differences = values.iter().zip(reference).map(|(value, exact)| {
        let mut difference = *value;
        difference.subtract(exact);
        difference
    });
    let (error, norm) = (l2_norm(differences), l2_norm(reference.iter().copied()));
    if norm > 0.0 { error / norm } else { error }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn coincident_pairs_are_evaluated_unless_skipped() {
        let at = [DVec3::X];
        let inverse = |x: DVec3, y: DVec3| 1.0 / x.distance(y);
        assert_eq!(direct(&from_fn(inverse), &at, &[1.0], &at), [f64::INFINITY]);
        assert_eq!(direct(&from_fn(inverse).skip_coincident(), &at, &[1.0], &at), [0.0]);
    }

    #[test]
    fn columns_share_the_formula() {
        let kernel = from_fn(|x: DVec3, y: DVec3| x.distance(y)).columns::<[f64; 2]>();
        let sum = direct(&kernel, &[DVec3::ZERO], &[[1.0, -3.0]], &[DVec3::Y * 2.0]);
        assert_eq!(sum, [[2.0, -6.0]]);
    }

    #[test]
    fn the_error_of_a_vanishing_reference_is_absolute() {
        assert_eq!(relative_l2_error::<f64>(&[3.0, 4.0], &[0.0, 0.0]), 5.0);
        assert_eq!(relative_l2_error::<f64>(&[1.0, 3.0], &[1.0, 2.0]), 1.0 / 5f64.sqrt());
    }

    #[test]
    fn errors_of_any_size_of_values_are_seen() {
        for unit in [1e-300, 1e-160, 1e160, 1e300] {
            let error = relative_l2_error::<f64>(&[unit, 3.0 * unit], &[unit, 2.0 * unit]);
            assert!((error - 1.0 / 5f64.sqrt()).abs() < 1e-12, "{unit:e}: {error:e}");
        }
        assert!(relative_l2_error(&[f64::NAN, 1.0], &[1.0, 1.0]).is_nan());
    }
}
