//! The double contour integral behind form factors, edge by edge.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

use glam::DVec3;

/// ∫∫ ln |x − y| dx·dy over two straight edges, x on the first and y on the second, which may share a
/// corner, lie on one line or be the same. For lengths of at most one, with the error that `care` allows.
///
/// The inner integral is known; the outer one is smooth but where the first edge comes closest to the
/// second, and to its ends: there it is cut.
pub(crate) fn contour_integral([a, b]: [DVec3; 2], [c, d]: [DVec3; 2], care: Care) -> f64 {
    let (along, length) = (b - a, a.distance(b));
    let inner = Inner::new(c, d);
    let cosine = along.dot(inner.direction);
    if inner.length == 0.0 || cosine.abs() <= f64::EPSILON * length {
        return 0.0;
    }
    let position = |p: DVec3| (p - a).dot(along) / along.length_squared();
    let mut cuts = [0.0, position(c), position(d), closest(a, along, &inner), 1.0];
    cuts.iter_mut().for_each(|cut| *cut = cut.clamp(0.0, 1.0));
    cuts.sort_unstable_by(f64::total_cmp);
    let pieces = cuts.windows(2).filter(|piece| piece[1] > piece[0]);
    let sum: f64 = pieces
        .map(|piece| {
            let (start, step) = (a + along * piece[0], along * (piece[1] - piece[0]));
            // Pieces end where the edges are closest, so an end is as close as any point.
            let gap = inner.distance(start).min(inner.distance(start + step));
            let f = |t: f64| inner.at(start + step * t);
            let smooth_enough = gap >= care.gap * step.length();
            let integral = if smooth_enough { smooth(f) } else { singular(f, care.settled) };
            integral * (piece[1] - piece[0])
        })
        .sum();
    sum * cosine
}

/// How carefully to integrate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Care {
    /// Gauss's rule is good enough where the edges keep a distance of so many lengths of a piece.
    gap: f64,
    /// Refinements of the double-exponential rule that change an integral by no more are the last.
    settled: f64,
}

impl Care {
    /// As precise as it gets.
    pub(crate) fn full() -> Self {
        Self::within(1e-12)
    }

    /// For errors of about this size.
    pub(crate) fn within(error: f64) -> Self {
        let error = error.max(1e-12);
        // A singularity at that distance from the end of [−1, 1] leaves ten points of Gauss an error of
        // ρ^−20, where ρ is the sum of the half-axes of the ellipse through it.
        let rho = error.powf(-0.05);
        let gap = 0.25 * (rho + rho.recip()) - 0.5;
        // Each refinement nearly doubles the digits.
        Self { gap, settled: 0.1 * error.powf(0.8) }
    }
}

/// ∫ ln |x − y| dy along an edge.
struct Inner {
    start: DVec3,
    /// A unit vector.
    direction: DVec3,
    length: f64,
}

impl Inner {
    fn new(start: DVec3, end: DVec3) -> Self {
        let length = start.distance(end);
        Self { start, direction: (end - start).normalize_or_zero(), length }
    }

    /// The integral at x, which lies h off the line of the edge and s along it:
    /// (L − s) ln |x − y_1| + s ln |x − y_0| − L + h φ, with φ the angle under which x sees the edge.
    fn at(&self, x: DVec3) -> f64 {
        let (length, from_start) = (self.length, x - self.start);
        let s = from_start.dot(self.direction);
        let h2 = (from_start - self.direction * s).length_squared();
        let h = h2.sqrt();
        let rest = length - s;
        // s ln r vanishes with s; r is never less than |s|.
        let term = |s: f64| if s == 0.0 { 0.0 } else { 0.5 * s * (s * s + h2).ln() };
        let angle = (length * h).atan2(h2 - s * rest);
        term(rest) + term(s) - length + h * angle
    }

    /// How far x is from the edge.
    fn distance(&self, x: DVec3) -> f64 {
        let s = (x - self.start).dot(self.direction).clamp(0.0, self.length);
        x.distance(self.start + self.direction * s)
    }
}

/// Where the line a + t `along` comes closest to that of the other edge; 0 for parallel ones.
fn closest(a: DVec3, along: DVec3, inner: &Inner) -> f64 {
    let u = inner.direction;
    let across = along - u * along.dot(u);
    let from_line = a - inner.start;
    let from_line = from_line - u * from_line.dot(u);
    let squared = across.length_squared();
    if squared > 0.0 { -across.dot(from_line) / squared } else { 0.0 }
}

/// ∫_0^1 f for an f without singularities nearby: Gauss's rule.
fn smooth(f: impl Fn(f64) -> f64) -> f64 {
    GAUSS.iter().map(|(x, w)| w * (f(0.5 - 0.5 * x) + f(0.5 + 0.5 * x))).sum::<f64>() * 0.5
}

/// Abscissas and weights of ten points on [−1, 1] (Abramowitz and Stegun, table 25.4).
const GAUSS: [(f64, f64); 5] = [
    (0.148_874_338_981_631_2, 0.295_524_224_714_752_9),
    (0.433_395_394_129_247_2, 0.269_266_719_309_996_4),
    (0.679_409_568_299_024_4, 0.219_086_362_515_982_04),
    (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (0.973_906_528_517_171_7, 0.066_671_344_308_688_14),
];

/// ∫_0^1 f for an f with singularities at, or close to, the ends: the double-exponential rule, refined
/// until it changes by no more than `settled` (Takahasi and Mori, "Double exponential formulas for numerical integration",
/// Publ. RIMS 9, 1974).
fn singular(f: impl Fn(f64) -> f64, settled: f64) -> f64 {
    let mut before = f64::INFINITY;
    let mut sum = 0.0;
    for (level, points) in RULES.iter().enumerate() {
        // Points come in pairs about the middle, by their distance from the nearest end.
        sum += points.iter().map(|(x, w)| w * (f(*x) + f(1.0 - *x))).sum::<f64>();
        let integral = sum * 0.5f64.powi(level as i32);
        if (integral - before).abs() <= settled {
            return integral;
        }
        before = integral;
    }
    before
}

/// The points of each refinement that those before it don't have, with weights for a step of one.
static RULES: LazyLock<[Vec<(f64, f64)>; 6]> = LazyLock::new(|| {
    std::array::from_fn(|level| {
        let step = 0.5f64.powi(level as i32);
        let point = |t: f64| {
            // x = ½ (1 + tanh(π/2 sinh t)) for t < 0, without cancellation.
            let e = (-2.0 * FRAC_PI_2 * t.sinh()).exp();
            let x = e / (1.0 + e);
            (x, FRAC_PI_2 * t.cosh() * 2.0 * x / (1.0 + e))
        };
        let odd = (0..).map(|k| step * if level == 0 { k as f64 } else { (2 * k + 1) as f64 });
        let points = odd.take_while(|&t| t < 3.7).map(point);
        // The middle is a pair by itself.
        points.map(|(x, w)| if x == 0.5 { (x, 0.5 * w) } else { (x, w) }).collect()
    })
});

#[cfg(test)]
mod tests {
    use super::*;

    /// The outer integral by a fine midpoint rule.
    fn by_midpoints([a, b]: [DVec3; 2], [c, d]: [DVec3; 2], n: usize) -> f64 {
        let inner = Inner::new(c, d);
        let at = |i: usize| inner.at(a.lerp(b, (i as f64 + 0.5) / n as f64));
        (0..n).map(at).sum::<f64>() / n as f64 * (b - a).dot(inner.direction)
    }

    fn contour_integral(first: [DVec3; 2], second: [DVec3; 2]) -> f64 {
        super::contour_integral(first, second, Care::full())
    }

    #[test]
    fn edges_in_every_position() {
        let (zero, x, y, z) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
        let first = [zero, x];
        // ∫∫ ln |s − t| over two unit intervals is −3/2.
        assert!((contour_integral(first, first) + 1.5).abs() < 1e-11);
        assert!((contour_integral(first, [x, zero]) - 1.5).abs() < 1e-11);
        let seconds = [
            [x, x + x],
            [zero, y + 0.5 * x],
            [0.3 * x + z, 0.9 * x + z],
            [0.3 * x + 1e-3 * z, 0.9 * x + 1e-3 * z],
            // Crossing, at any height.
            [DVec3::new(0.3, -2.0, 0.2), DVec3::new(0.6, 2.0, 0.2)],
            [DVec3::new(0.3, -2.0, 1e-2), DVec3::new(0.6, 2.0, 1e-2)],
            [DVec3::new(-0.4, -1.0, 1e-5), DVec3::new(1.1, 2.0, 1e-5)],
            [5.0 * z, 5.0 * z + x + y],
        ];
        for second in seconds {
            let integral = contour_integral(first, second);
            let swapped = contour_integral(second, first);
            assert!((swapped - integral).abs() < 1e-11, "{second:?}: {swapped} {integral}");
            let summed = by_midpoints(first, second, 20_000);
            assert!((summed - integral).abs() < 2e-9, "{second:?}: {summed} {integral}");
            for error in [1e-3, 1e-5, 1e-7, 1e-9] {
                let rough = super::contour_integral(first, second, Care::within(error));
                let found = (rough - integral).abs();
                assert!(found < error, "{second:?}: {found:e} for {error:e}");
            }
        }
    }
}
