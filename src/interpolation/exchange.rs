//! What blocks of sources send in one direction, and what blocks of targets receive from it.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use pulp::{Arch, Simd, WithSimd};

use crate::interpolation::directions::Direction;
use crate::probe::zero;
use crate::real::Scalar;

/// A pair of cells of one level.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pair {
    pub(crate) source: u32,
    /// Counted from the task's first target.
    pub(crate) target: u16,
    /// Its core, counted over all directions.
    pub(crate) core: u32,
}

/// What products of one precision write to in passing.
#[derive(Debug, Default)]
pub(crate) struct Work<R> {
    /// What goes into a product, and what comes out.
    pub(crate) x: Vec<R>,
    pub(crate) z: Vec<R>,
    /// What targets receive from one direction, for those in `targets`.
    pub(crate) received: Vec<R>,
    pub(crate) targets: Vec<u16>,
    /// For each target of the task, where it stands in `targets`.
    pub(crate) columns: Vec<u16>,
    /// The multipoles of a block of sources.
    pub(crate) multipoles: Vec<R>,
}

/// Sources whose coordinates are computed together.
pub(crate) const BLOCK: usize = 128;

/// A target that has received nothing yet.
const NONE: u16 = u16::MAX;

/// Neighbouring sources.
pub(crate) struct Block<'a, S> {
    pub(crate) multipoles: &'a [S],
    /// A bit per source for each direction.
    pub(crate) wanted: &'a [AtomicU32],
    pub(crate) from_len: usize,
    /// Right-hand sides.
    pub(crate) columns: usize,
}

impl<S: Scalar> Block<'_, S> {
    /// The block's multipoles, if anyone needs them in these digits.
    pub(crate) fn enter<R>(&self, to: &mut Vec<R>, enter: impl Fn(S) -> R, coordinates: usize) {
        to.clear();
        if coordinates > 0 {
            to.extend(self.multipoles.iter().map(|&m| enter(m)));
        }
    }

    /// y = Qᴴ m of the sources that are asked for.
    pub(crate) fn send<R: Scalar>(
        &self,
        number: usize,
        direction: &Direction<R>,
        Work { x, z, multipoles, .. }: &mut Work<R>,
        sent: &mut [R],
    ) {
        let len = direction.collect.rows * self.columns;
        let asked = |i: &usize| self.wanted[*i].load(Relaxed) >> number & 1 == 1;
        let count = (0..self.wanted.len()).filter(asked).count();
        if count == 0 || len == 0 {
            return;
        }
        // A few in vain cost less than picking out the others.
        if 4 * count >= 3 * self.wanted.len() {
            let sent = &mut sent[..self.wanted.len() * len];
            return R::product(&direction.collect, multipoles, false, sent);
        }
        x.clear();
        for i in (0..self.wanted.len()).filter(asked) {
            x.extend_from_slice(&multipoles[i * self.from_len..][..self.from_len]);
        }
        z.resize(count * len, zero::<R>());
        R::product(&direction.collect, x, false, z);
        for (i, y) in (0..self.wanted.len()).filter(asked).zip(z.chunks_exact(len)) {
            sent[i * len..][..len].copy_from_slice(y);
        }
    }
}

/// The coordinates of all sources in one direction.
pub(crate) struct Coordinates<'a, R> {
    pub(crate) all: &'a [R],
    pub(crate) start: usize,
    /// Right-hand sides; all coordinates of a block; terms of a local expansion.
    pub(crate) lens: [usize; 3],
}

/// l_t += leave(P Σ W y) for the pairs of one direction.
pub(crate) fn receive<S: Scalar, R: Scalar>(
    direction: &Direction<R>,
    first_core: usize,
    pairs: &[Pair],
    sent: &Coordinates<'_, R>,
    work: &mut Work<R>,
    to: &mut [S],
    leave: impl Fn(R) -> S,
) {
    let Direction { collect, spread, cores } = direction;
    let [columns, _, to_len] = sent.lens;
    let [y_len, z_len] = [collect.rows * columns, spread.columns * columns];
    if pairs.is_empty() || y_len == 0 || z_len == 0 {
        return;
    }
    let Work { x, z, received, targets, columns: places, .. } = work;
    targets.clear();
    places.clear();
    places.resize(to.len() / to_len, NONE);
    for pair in pairs {
        let place = &mut places[usize::from(pair.target)];
        if *place == NONE {
            *place = targets.len() as u16;
            targets.push(pair.target);
        }
    }
    received.clear();
    received.resize(targets.len() * z_len, zero::<R>());
    for pairs in pairs.chunk_by(|a, b| a.core == b.core) {
        x.resize(pairs.len() * y_len, zero::<R>());
        Arch::new().dispatch(Gather { sent, pairs, len: y_len, x });
        z.resize(pairs.len() * z_len, zero::<R>());
        R::product(&cores[pairs[0].core as usize - first_core], x, false, z);
        Arch::new().dispatch(Scatter { pairs, places, len: z_len, z, received });
    }
    z.resize(targets.len() * to_len, zero::<R>());
    R::product(spread, received, false, z);
    Arch::new().dispatch(Leave { targets, len: to_len, z, to, leave });
}

/// Brings the coordinates of pairs together: the right-hand side of a product.
struct Gather<'a, R> {
    sent: &'a Coordinates<'a, R>,
    pairs: &'a [Pair],
    len: usize,
    x: &'a mut [R],
}

impl<R: Scalar> WithSimd for Gather<'_, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { sent: Coordinates { all, start, lens }, pairs, len, x } = self;
        for (pair, x) in pairs.iter().zip(x.chunks_exact_mut(len)) {
            let s = pair.source as usize;
            x.copy_from_slice(&all[s / BLOCK * lens[1] + start + s % BLOCK * len..][..len]);
        }
    }
}

/// Adds the columns of a product to what targets receive.
struct Scatter<'a, R> {
    pairs: &'a [Pair],
    places: &'a [u16],
    len: usize,
    z: &'a [R],
    received: &'a mut [R],
}

impl<R: Scalar> WithSimd for Scatter<'_, R> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { pairs, places, len, z, received } = self;
        for (pair, z) in pairs.iter().zip(z.chunks_exact(len)) {
            let place = usize::from(places[usize::from(pair.target)]);
            let received = &mut received[place * len..][..len];
            received.iter_mut().zip(z).for_each(|(received, &z)| *received += z);
        }
    }
}

/// Adds the columns of a product to the locals of targets.
struct Leave<'a, S, R, F> {
    targets: &'a [u16],
    len: usize,
    z: &'a [R],
    to: &'a mut [S],
    leave: F,
}

impl<S: Scalar, R: Scalar, F: Fn(R) -> S> WithSimd for Leave<'_, S, R, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: Simd>(self, _: V) {
        let Self { targets, len, z, to, leave } = self;
        for (&target, z) in targets.iter().zip(z.chunks_exact(len)) {
            let l = &mut to[usize::from(target) * len..][..len];
            l.iter_mut().zip(z).for_each(|(l, &z)| *l += leave(z));
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::{Fmm, direct, from_fn, probe, relative_l2_error};

    #[test]
    fn all_sources_of_a_level_reach_all_their_targets() {
        let points: Vec<DVec3> = (0..1500).map(probe::sample::<f64>).collect();
        // Half of the space is empty, so that some blocks are asked for in few directions only.
        let points: Vec<DVec3> = points.into_iter().filter(|p| p.x + p.y < 0.3).collect();
        let charges: Vec<f64> = (0..points.len()).map(|i| (i as f64).sin()).collect();
        let kernel = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
        for tolerance in [1e-3, 1e-8] {
            let plan = Fmm::builder(kernel).tolerance(tolerance).leaf_size(8);
            let fmm = plan.build(&points, &points).unwrap();
            assert!(fmm.stats().cell_pairs[0] > 10_000);
            let values = fmm.apply(&charges).unwrap();
            let error = relative_l2_error(&values, &direct(&kernel, &points, &charges, &points));
            assert!(error <= tolerance, "{error:e} > {tolerance:e}");
        }
    }
}
