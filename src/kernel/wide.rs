//! The numbers that formulas are evaluated in.

use crate::kernel::formula::Form;
use crate::numbers::dual::Dual;
use crate::numbers::extended::Extended;
use crate::numbers::lane::Lane;
use crate::numbers::number::{Coordinates, Number};
use crate::numbers::traits::Real;

/// The number that formulas are evaluated in, unless an angle of theirs is too large.
pub(super) type Near<T> = Lane<T, false>;
/// The number that formulas are evaluated in then.
pub(super) type Far<T> = Lane<T, true>;

/// Numbers that formulas are evaluated in: with derivatives or without.
pub(super) trait Wide<T: Real>: Number<Real = T> {
    /// 1, or 4 with derivatives.
    const PARTS: usize;
    /// The same for angles of any size.
    type Far: Wide<T>;
    /// The same for distances of any size.
    type Extended: Whole<T>;
    /// The argument of a formula.
    fn at<O: Form>(x: [T; 3], y: [T; 3]) -> O::At<Self>;
    /// The value, or a derivative.
    fn part(&self, part: usize) -> Near<T>;
}

impl<T: Real, const FAR: bool> Wide<T> for Lane<T, FAR> {
    const PARTS: usize = 1;
    type Far = Far<T>;
    type Extended = Extended<T>;
    #[inline(always)]
    fn at<O: Form>(x: [T; 3], y: [T; 3]) -> O::At<Self> {
        O::at(coordinates(x), coordinates(y))
    }
    #[inline(always)]
    fn part(&self, _: usize) -> Near<T> {
        Lane { value: self.value, wrong: self.wrong }
    }
}

impl<T: Real, const FAR: bool> Wide<T> for Dual<Lane<T, FAR>> {
    const PARTS: usize = 4;
    type Far = Dual<Far<T>>;
    type Extended = Dual<Extended<T>>;
    #[inline(always)]
    fn at<O: Form>(x: [T; 3], y: [T; 3]) -> O::At<Self> {
        O::with_derivatives(O::at(coordinates(x), coordinates(y)))
    }
    #[inline(always)]
    fn part(&self, part: usize) -> Near<T> {
        if part == 0 { self.value.part(0) } else { self.slope[part - 1].part(0) }
    }
}

/// Numbers that are right for all angles and distances.
pub(super) trait Whole<T: Real>: Wide<T> {
    /// The value, or a derivative, before it is rounded.
    fn whole(&self, part: usize) -> Extended<T>;
}

impl<T: Real> Wide<T> for Extended<T> {
    const PARTS: usize = 1;
    type Far = Self;
    type Extended = Self;
    fn at<O: Form>(x: [T; 3], y: [T; 3]) -> O::At<Self> {
        O::at(extended(x), extended(y))
    }
    fn part(&self, part: usize) -> Near<T> {
        Near::new(self.whole(part).rounded())
    }
}

impl<T: Real> Whole<T> for Extended<T> {
    fn whole(&self, _: usize) -> Self {
        *self
    }
}

impl<T: Real> Wide<T> for Dual<Extended<T>> {
    const PARTS: usize = 4;
    type Far = Self;
    type Extended = Self;
    fn at<O: Form>(x: [T; 3], y: [T; 3]) -> O::At<Self> {
        O::with_derivatives(O::at(extended(x), extended(y)))
    }
    fn part(&self, part: usize) -> Near<T> {
        Near::new(self.whole(part).rounded())
    }
}

impl<T: Real> Whole<T> for Dual<Extended<T>> {
    fn whole(&self, part: usize) -> Extended<T> {
        if part == 0 { self.value } else { self.slope[part - 1] }
    }
}

#[inline(always)]
fn coordinates<T: Real, const FAR: bool>(p: [T; 3]) -> Coordinates<Lane<T, FAR>> {
    let [x, y, z] = p.map(Lane::new);
    Coordinates { x, y, z }
}

fn extended<T: Real>(p: [T; 3]) -> Coordinates<Extended<T>> {
    let [x, y, z] = p.map(Extended::new);
    Coordinates { x, y, z }
}
