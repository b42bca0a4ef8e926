//! Sources and targets as differences from the middle of a chunk of sources, in single precision.

use farfield::{Numbers, Point, Real, Vector};
use pulp::Simd;

/// Sources that are rounded at a time.
pub(super) const CHUNK: usize = 256;
/// Points that the middle of a chunk is found from.
const MIDDLE: usize = 8;

/// A chunk of sources, as they were and rounded.
pub(super) struct Sources<'a, T: Real, C, const N: usize> {
    pub(super) ys: &'a [Point<T>],
    pub(super) qs: &'a [C],
    pub(super) rounded: &'a Rounded<N>,
    pub(super) centre: [f64; 3],
    /// The unit of each column.
    pub(super) charges: [f64; N],
}

/// Sources in single precision, coordinate by coordinate and column by column.
pub(super) struct Rounded<const N: usize> {
    pub(super) positions: [[f32; CHUNK]; 3],
    pub(super) charges: [[f32; CHUNK]; N],
}

impl<'a, T: Real, C: Numbers<Real = T>, const N: usize> Sources<'a, T, C, N> {
    /// At most a [`CHUNK`] of them.
    #[inline(always)]
    pub(super) fn round(
        scale: f64,
        ys: &'a [Point<T>],
        qs: &'a [C],
        rounded: &'a mut Rounded<N>,
    ) -> Self {
        let centre = middle::<T>(ys);
        let [a, b, c] = &mut rounded.positions;
        for (j, y) in ys.iter().take(CHUNK).enumerate() {
            [a[j], b[j], c[j]] = round::<T>(*y, centre, scale);
        }
        let mut units = [0.0; N];
        for n in 0..N {
            let mut greatest = 0;
            for q in qs {
                greatest = greatest.max(q.number(n).as_f64().abs().to_bits());
            }
            units[n] = power_of_two(f64::from_bits(greatest));
            let inverse = units[n].recip();
            for (q, rounded) in qs.iter().zip(&mut rounded.charges[n]) {
                *rounded = (q.number(n).as_f64() * inverse) as f32;
            }
        }
        Self { ys, qs, rounded, centre, charges: units }
    }
}

/// The mean of a few points, evenly chosen.
#[inline(always)]
fn middle<T: Real>(points: &[Point<T>]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for k in 0..MIDDLE {
        let p = points[k * points.len() / MIDDLE].to_array();
        for c in 0..3 {
            sum[c] += p[c].as_f64() * (1.0 / MIDDLE as f64);
        }
    }
    sum
}

/// (p − centre) · scale
#[inline(always)]
pub(super) fn round<T: Real>(p: Point<T>, centre: [f64; 3], scale: f64) -> [f32; 3] {
    let [a, b, c] = p.to_array();
    let [a, b, c] = [a.as_f64() - centre[0], b.as_f64() - centre[1], c.as_f64() - centre[2]];
    [(a * scale) as f32, (b * scale) as f32, (c * scale) as f32]
}

impl<const N: usize> Rounded<N> {
    /// Position and charges of source `j` in all places of registers.
    #[inline(always)]
    pub(super) fn splat<S: Simd>(&self, simd: S, j: usize) -> ([S::f32s; 3], [S::f32s; N]) {
        let [a, b, c] = &self.positions;
        let y = [simd.splat_f32s(a[j]), simd.splat_f32s(b[j]), simd.splat_f32s(c[j])];
        let mut q = [simd.splat_f32s(0.0); N];
        for n in 0..N {
            q[n] = simd.splat_f32s(self.charges[n][j]);
        }
        (y, q)
    }
}

/// The greatest power of two ≤ a, and the least in the normal range for smaller a.
#[inline(always)]
pub(super) fn power_of_two(a: f64) -> f64 {
    const EXPONENT: u64 = 0x7ff << 52;
    f64::from_bits(a.to_bits() & EXPONENT).max(f64::MIN_POSITIVE)
}

/// The greatest difference of a coordinate from that of `origin`; not finite if any isn't.
#[inline(always)]
pub(super) fn reach<T: Real>(points: &[Point<T>], origin: Point<T>) -> f64 {
    let origin = origin.to_array();
    // As integers, magnitudes have the same order, in which what isn't finite comes last.
    let mut greatest = 0;
    for p in points {
        let p = p.to_array();
        for c in 0..3 {
            greatest = greatest.max((p[c].as_f64() - origin[c].as_f64()).abs().to_bits());
        }
    }
    f64::from_bits(greatest)
}
