//! Kernels that are closures.

use std::fmt;
use std::marker::PhantomData;

use crate::kernel::pair_loop::PairLoop;
use crate::kernel::traits::{Kernel, Outcome};
use crate::kernel::with_gradient::WithGradient;
use crate::numbers::traits::{Located, Numbers, Point, Scalar};

/// A kernel given by its formula alone: a closure from (target, source) to a real or complex number.
///
/// Charges and values have the type that the closure returns; see
/// [`charges`](FnKernel::charges) for several right-hand sides at once, and
/// [`gradient`](FnKernel::gradient) for the gradient of the sum. The formula is evaluated at
/// coincident points too, and what it gives there counts unless
/// [`skip_coincident`](FnKernel::skip_coincident) is asked for.
///
/// A closure is called pair by pair, in the precision of its points. Elementary functions of the module
/// [`math`](crate::math), such as `math::exp(-r)`, let the compiler work on several pairs at once, where calls of
/// the standard library don't. A [`Formula`](crate::Formula) is evaluated for several pairs side by side in any
/// case, and derives its own gradient.
///
/// ```
/// use farfield::glam::DVec3;
/// let kernel = farfield::from_fn(|x: DVec3, y: DVec3| (-x.distance(y)).exp());
/// let sum = farfield::direct(&kernel, &[DVec3::ZERO], &[2.0], &[DVec3::ZERO, DVec3::X])?;
/// assert_eq!(sum, [2.0, 2.0 * f64::exp(-1.0)]);
/// # Ok::<(), farfield::Error>(())
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

/// The kernel made by [`FnKernel::gradient`]: `G` is the closure of the gradient.
#[derive(Clone, Copy)]
pub struct FnGradient<F, G, P, V, C = V> {
    kernel: FnKernel<F, P, V, C>,
    gradient: G,
}

impl<F, P, V, C> FnKernel<F, P, V, C> {
    /// Pairs at the same position contribute nothing: the usual choice for singular kernels. The
    /// formula is evaluated there all the same, so that it needs no branch; what it gives is dropped.
    pub fn skip_coincident(self) -> Self {
        Self { skip_coincident: true, ..self }
    }

    /// The same kernel for charges of another type, such as `[f64; 3]` for three right-hand sides.
    pub fn charges<D>(self) -> FnKernel<F, P, V, D> {
        FnKernel { f: self.f, skip_coincident: self.skip_coincident, types: PhantomData }
    }

    /// The same kernel with the gradient of its sum as part of the [value](WithGradient). The closure
    /// gives ∂K/∂x, its derivatives with respect to the target, as a vector or an array.
    ///
    /// ```
    /// use farfield::glam::DVec3;
    /// let kernel = farfield::from_fn(|x: DVec3, y: DVec3| x.distance_squared(y))
    ///     .gradient(|x: DVec3, y: DVec3| 2.0 * (x - y));
    /// let sum = farfield::direct(&kernel, &[DVec3::X], &[3.0], &[DVec3::ZERO])?;
    /// assert_eq!((sum[0].value, sum[0].gradient), (3.0, [-6.0, 0.0, 0.0]));
    /// # Ok::<(), farfield::Error>(())
    /// ```
    pub fn gradient<G, W>(self, gradient: G) -> FnGradient<F, G, P, V, C>
    where
        G: Fn(P, P) -> W + Send + Sync,
        W: Into<[V; 3]>,
    {
        FnGradient { kernel: self, gradient }
    }
}

impl<F, P, V, C> fmt::Debug for FnKernel<F, P, V, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FnKernel").field("skip_coincident", &self.skip_coincident).finish()
    }
}

impl<F, G, P, V, C> fmt::Debug for FnGradient<F, G, P, V, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FnGradient").field("kernel", &self.kernel).finish_non_exhaustive()
    }
}

impl<F, P, V, C> FnKernel<F, P, V, C>
where
    F: Fn(P, P) -> V,
    V: Scalar,
    P: Copy + PartialEq,
    C: Numbers<Real = V::Real>,
{
    /// Adds what one pair contributes.
    #[inline(always)]
    fn add_pair(&self, x: &P, y: &P, q: &C, u: &mut C) {
        let k = (self.f)(*x, *y);
        let skip = self.skip_coincident && x == y;
        u.add_scaled(if skip { <V as Numbers>::zero() } else { k }, q);
    }
}

impl<F, P, V, C> Kernel for FnKernel<F, P, V, C>
where
    F: Fn(P, P) -> V + Send + Sync,
    V: Scalar,
    P: Located<Real = V::Real> + From<Point<V::Real>> + Copy + PartialEq,
    C: Numbers<Real = V::Real>,
{
    type Real = V::Real;
    type Source = P;
    type Target = P;
    type Charge = C;
    type Value = C;
    type Entry = V;

    #[inline(always)]
    fn entries(&self, x: Point<V::Real>, y: Point<V::Real>, g: &mut [V]) {
        g[0] = (self.f)(x.into(), y.into());
    }

    fn has_parameters(&self) -> bool {
        size_of::<F>() > 0
    }

    fn add_block(&self, xs: &[P], ys: &[P], qs: &[C], _tolerance: f64, us: &mut [C]) {
        let add = |x: &P, y: &P, q: &C, u: &mut C| self.add_pair(x, y, q, u);
        PairLoop { add, xs, ys, qs, us }.run();
    }
}

impl<F, G, W, P, V, C> Kernel for FnGradient<F, G, P, V, C>
where
    F: Fn(P, P) -> V + Send + Sync,
    G: Fn(P, P) -> W + Send + Sync,
    W: Into<[V; 3]>,
    V: Scalar,
    P: Located<Real = V::Real> + From<Point<V::Real>> + Copy + PartialEq,
    C: Numbers<Real = V::Real>,
{
    type Real = V::Real;
    type Source = P;
    type Target = P;
    type Charge = C;
    type Value = WithGradient<C>;
    type Entry = V;

    #[inline(always)]
    fn entries(&self, x: Point<V::Real>, y: Point<V::Real>, g: &mut [V]) {
        self.kernel.entries(x, y, g);
    }

    fn value(&self, _: &P, fields: &[V], gradients: &[[V; 3]], u: &mut WithGradient<C>) {
        u.add(fields, gradients);
    }

    #[inline(always)]
    fn needs_gradients(&self) -> bool {
        true
    }

    #[inline(always)]
    fn entry_gradients(&self, x: Point<V::Real>, y: Point<V::Real>, g: &mut [[V; 3]]) -> Outcome {
        g[0] = (self.gradient)(x.into(), y.into()).into();
        Outcome::Done
    }

    fn has_parameters(&self) -> bool {
        size_of::<(F, G)>() > 0
    }

    fn add_block(&self, xs: &[P], ys: &[P], qs: &[C], _tolerance: f64, us: &mut [WithGradient<C>]) {
        let add = |x: &P, y: &P, q: &C, u: &mut WithGradient<C>| {
            self.kernel.add_pair(x, y, q, &mut u.value);
            let skip = self.kernel.skip_coincident && x == y;
            let slopes: [V; 3] = (self.gradient)(*x, *y).into();
            for (sum, slope) in u.gradient.iter_mut().zip(slopes) {
                sum.add_scaled(if skip { <V as Numbers>::zero() } else { slope }, q);
            }
        };
        PairLoop { add, xs, ys, qs, us }.run();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::direct::direct;
    use glam::DVec3;

    #[test]
    fn coincident_pairs_are_evaluated_unless_skipped() {
        let at = [DVec3::X];
        let inverse = |x: DVec3, y: DVec3| 1.0 / x.distance(y);
        assert_eq!(direct(&from_fn(inverse), &at, &[1.0], &at).unwrap(), [f64::INFINITY]);
        assert_eq!(direct(&from_fn(inverse).skip_coincident(), &at, &[1.0], &at).unwrap(), [0.0]);
        let slope = |x: DVec3, y: DVec3| (y - x) / x.distance(y).powi(3);
        let kernel = from_fn(inverse).skip_coincident().gradient(slope);
        assert_eq!(direct(&kernel, &at, &[1.0], &at).unwrap(), [WithGradient::default()]);
    }

    #[test]
    fn columns_share_the_formula() {
        let kernel = from_fn(|x: DVec3, y: DVec3| x.distance(y)).charges::<[f64; 2]>();
        let sum = direct(&kernel, &[DVec3::ZERO], &[[1.0, -3.0]], &[DVec3::Y * 2.0]).unwrap();
        assert_eq!(sum, [[2.0, -6.0]]);
    }

    #[test]
    fn points_may_be_arrays() {
        let kernel = from_fn(|[x, ..]: [f64; 3], [y, ..]: [f64; 3]| (x - y).abs());
        let sum = direct(&kernel, &[[1.0, 0.0, 0.0]], &[2.0], &[[4.0, 0.0, 0.0]]).unwrap();
        assert_eq!(sum, [6.0]);
    }
}
