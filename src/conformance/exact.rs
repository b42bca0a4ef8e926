//! Two kernels on which every operator is exact: what is wrong with a sum is then the tree's fault.

use std::marker::PhantomData;

use crate::expansion::Expansion;
use crate::kernel::traits::{Kernel, Outcome};
use crate::numbers::traits::{Located, Point, Real, Vector};
use crate::octree::geometry::Cell;

/// K ≡ 1: every sum is the total charge, an integer if the charges are. A pair that is counted twice
/// or missed shows as a wrong integer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counting<T>(PhantomData<T>);

/// K(x, y) = exp(Σ_k x_k − Σ_k y_k): rank one, sensitive to every sign and every shift of centre.
#[derive(Clone, Copy, Debug, Default)]
pub struct RankOne<T>(PhantomData<T>);

impl<T: Real> Counting<T> {
    /// The kernel, which is its own expansion.
    pub fn new() -> Self {
        Self(PhantomData)
    }
}

impl<T: Real> RankOne<T> {
    /// The kernel, which is its own expansion.
    pub fn new() -> Self {
        Self(PhantomData)
    }
}

/// A kernel of one term, exp(s·Σ_k x_k) · exp(−s·Σ_k y_k).
trait OneTerm<T: Real>: Send + Sync {
    /// exp(s·Σ_k d_k).
    fn factor(d: Point<T>) -> T;
}

impl<T: Real> OneTerm<T> for Counting<T> {
    fn factor(_: Point<T>) -> T {
        T::from_f64(1.0)
    }
}

impl<T: Real> OneTerm<T> for RankOne<T> {
    fn factor(d: Point<T>) -> T {
        let [x, y, z] = d.to_array();
        (x + y + z).exp()
    }
}

macro_rules! one_term {
    ($kernel:ident) => {
        impl<T: Real> Kernel for $kernel<T> {
            type Real = T;
            type Source = Point<T>;
            type Target = Point<T>;
            type Charge = T;
            type Value = T;
            type Entry = T;

            fn entries(&self, x: Point<T>, y: Point<T>, g: &mut [T]) {
                g[0] = Self::factor(x - y);
            }
        }

        /// Multipole term: Σ_j K(centre, y_j) q_j. Local term: u(centre).
        impl<T: Real> Expansion for $kernel<T> {
            type Kernel = Self;
            type MultipoleTerm = T;
            type LocalTerm = T;

            fn kernel(&self) -> &Self {
                self
            }

            fn multipole_len(&self, _: usize) -> usize {
                1
            }

            fn local_len(&self, _: usize) -> usize {
                1
            }

            fn p2m(&self, cell: &Cell<T>, sources: &[Point<T>], charges: &[T], m: &mut [T]) {
                for (y, &q) in sources.iter().zip(charges) {
                    m[0] += Self::factor(-cell.relative(y.position())) * q;
                }
            }

            fn m2m(&self, child: &Cell<T>, parent: &Cell<T>, from: &[T], to: &mut [T]) {
                to[0] += Self::factor(-parent.relative(child.centre())) * from[0];
            }

            fn m2l(&self, source: &Cell<T>, target: &Cell<T>, from: &[T], to: &mut [T]) {
                to[0] += Self::factor(source.relative(target.centre())) * from[0];
            }

            fn l2l(&self, parent: &Cell<T>, child: &Cell<T>, from: &[T], to: &mut [T]) {
                to[0] += Self::factor(parent.relative(child.centre())) * from[0];
            }

            fn l2p(&self, cell: &Cell<T>, local: &[T], targets: &[Point<T>], values: &mut [T]) {
                for (x, u) in targets.iter().zip(values) {
                    *u += Self::factor(cell.relative(x.position())) * local[0];
                }
            }

            fn m2p(
                &self,
                cell: &Cell<T>,
                multipole: &[T],
                targets: &[Point<T>],
                values: &mut [T],
            ) -> Outcome {
                self.l2p(cell, multipole, targets, values);
                Outcome::Done
            }

            fn p2l(
                &self,
                cell: &Cell<T>,
                sources: &[Point<T>],
                charges: &[T],
                local: &mut [T],
            ) -> Outcome {
                self.p2m(cell, sources, charges, local);
                Outcome::Done
            }
        }
    };
}

one_term!(Counting);
one_term!(RankOne);
