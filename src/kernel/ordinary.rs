//! Squared distances over which a formula's numbers neither overflow nor vanish on the way.

use num_traits::Float;

use crate::error::Error;
use crate::kernel::traits::Kernel;
use crate::numbers::extended::Extended;
use crate::numbers::traits::{Located, Point, Real, Vector};

/// The squared distances at which a formula is known to give the digits of its precision.
///
/// A formula of r can overflow or vanish on its way to a result that does not: r² does so long before r. Whoever
/// evaluates one for a block of pairs keeps an eye on their r². Where they leave the range that is known so far, the
/// two outermost pairs are held against [`Extended`] numbers. If plain ones agree, the range
/// [widens](Self::widen); otherwise the block is evaluated in extended ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrdinaryDistances<T> {
    least: T,
    greatest: T,
}

/// Numbers that differ by no more than this many units in the last place are the same but for rounding.
const ROUNDING: f64 = 64.0;

impl<T: Real> OrdinaryDistances<T> {
    /// Those at which eighth powers of r, or of 1/r, stay within the range of numbers.
    pub fn new() -> Self {
        let greatest = T::max_value().sqrt().sqrt();
        Self { least: greatest.recip(), greatest }
    }

    /// None at all, so that every block is looked at.
    pub fn none() -> Self {
        Self { least: T::infinity(), greatest: T::from_f64(0.0) }
    }

    /// Whether all r² between two are among them.
    #[inline(always)]
    pub fn hold(&self, least: T, greatest: T) -> bool {
        (self.least <= least) & (greatest <= self.greatest)
    }

    /// Adds all r² between two. An r² that vanished or overflowed says nothing of others, and is not added.
    pub fn widen(&mut self, least: T, greatest: T) {
        if least > T::from_f64(0.0) {
            self.least = self.least.min(least);
        }
        if greatest < T::infinity() {
            self.greatest = self.greatest.max(greatest);
        }
    }

    /// |x − y|, which neither vanishes nor overflows where its square does.
    pub fn between(x: [T; 3], y: [T; 3]) -> f64 {
        (0..3).fold(0.0, |r: f64, k| r.hypot((x[k] - y[k]).as_f64()))
    }

    /// Whether a plain number has the digits of the extended one that it stands for.
    pub fn agree(plain: T, extended: Extended<T>) -> bool {
        let exact = extended.rounded();
        let rounding = T::from_f64(ROUNDING) * T::epsilon();
        // What is not a number in both ways is not a matter of range.
        !extended.left()
            || plain == exact
            || plain.is_nan() && exact.is_nan()
            || (plain - exact).abs() <= rounding * exact.abs() + T::min_positive_value()
    }
}

impl<T: Real> Default for OrdinaryDistances<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// d = x − y, r² = |d|² and whether the points coincide.
#[inline(always)]
pub(super) fn square_of<T: Real>(x: [T; 3], y: [T; 3]) -> (T, bool) {
    let [a, b, c] = [x[0] - y[0], x[1] - y[1], x[2] - y[2]];
    (a * a + b * b + c * c, (x[0] == y[0]) & (x[1] == y[1]) & (x[2] == y[2]))
}

/// A target and a source.
type Pair<T> = ([T; 3], [T; 3]);

/// Of some pairs that don't coincide, the nearest and the farthest.
pub(super) fn outermost<T: Real>(pairs: impl Iterator<Item = Pair<T>>) -> Option<[Pair<T>; 2]> {
    let mut found: Option<[(f64, Pair<T>); 2]> = None;
    for (x, y) in pairs {
        let r = OrdinaryDistances::between(x, y);
        if r > 0.0 {
            let [nearest, farthest] = found.get_or_insert([(r, (x, y)); 2]);
            if r < nearest.0 {
                *nearest = (r, (x, y));
            }
            if r > farthest.0 {
                *farthest = (r, (x, y));
            }
        }
    }
    found.map(|both| both.map(|(_, pair)| pair))
}

/// Targets and sources that are looked at before a sum.
const SAMPLES: usize = 16;
/// What keeps shares of the smallest numbers from becoming 0.
const LIFT: f64 = 1e30;
/// Sources among which the nearest one is looked for.
const NEIGHBOURS: usize = 4096;

/// Refuses points so far apart, or so near each other, that what the kernel gives between them has no digits in its
/// precision, and sums of it neither. Looks at some pairs if the points are, and at none otherwise. O(N).
pub(crate) fn check_range<K: Kernel>(
    kernel: &K,
    sources: &[K::Source],
    targets: &[K::Target],
) -> Result<(), Error> {
    let extent = extent::<K>(sources, targets);
    let limit = K::Real::max_value().as_f64().powf(0.125);
    if (limit.recip()..=limit).contains(&extent) || sources.is_empty() {
        return Ok(());
    }
    let mut means = [0.0; 2];
    for x in some(targets, SAMPLES) {
        let x = x.position();
        let size = |y: Point<K::Real>| OrdinaryDistances::between(x.to_array(), y.to_array());
        let others = some(sources, NEIGHBOURS).map(Located::position).filter(|&y| size(y) > 0.0);
        let nearest = others.min_by(|&a, &b| size(a).total_cmp(&size(b)));
        // The sums of this target, of which the nearest source is one and the others stand for all.
        let single = nearest.into_iter().map(|y| (1.0, y));
        let each = sources.len() as f64 / SAMPLES.min(sources.len()) as f64;
        let all = some(sources, SAMPLES).map(|y| (each, y.position()));
        for (weight, y) in single.chain(all) {
            let Some(sizes) = kernel.sizes(x, y) else { return Ok(()) };
            for (mean, size) in means.iter_mut().zip(sizes) {
                *mean += weight * (LIFT * size) / (sources.len() * SAMPLES) as f64;
            }
        }
    }
    let least = LIFT * K::Real::min_positive_value().as_f64();
    if means.iter().any(|&mean| mean > 0.0 && mean < least) {
        let precision = if size_of::<K::Real>() == size_of::<f32>() { "f32" } else { "f64" };
        return Err(Error::KernelOutOfRange { extent, precision });
    }
    Ok(())
}

/// Some of the items, spread over all of them.
fn some<V>(items: &[V], count: usize) -> impl Iterator<Item = &V> {
    items.iter().step_by(items.len().div_ceil(count).max(1))
}

/// The largest edge of the bounding box of all points.
fn extent<K: Kernel>(sources: &[K::Source], targets: &[K::Target]) -> f64 {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let places = sources.iter().map(Located::position).chain(targets.iter().map(Located::position));
    for place in places {
        for (k, c) in place.to_array().into_iter().enumerate() {
            low[k] = low[k].min(c.as_f64());
            high[k] = high[k].max(c.as_f64());
        }
    }
    (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max)
}
