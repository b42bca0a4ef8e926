//! Looking at a kernel from outside: what holds is measured on sample points, never declared.

use num_traits::Float;

use crate::interpolation::entries::{Entries, PointOf, zero};
use crate::interpolation::tuning::{PROBE_PAIRS, SAMPLED_REACH, SCALED_PAIRS};
use crate::numbers::traits::{Point, Real, Scalar, Vector, l2_norm};
use crate::octree::geometry::Cube;

/// Whether K(x + s, y + s) = K(x, y) to round-off for sample pairs and shifts within `root`.
pub(crate) fn translation_invariant<S: Scalar>(
    kernel: &Entries<'_, S>,
    root: &Cube<S::Real>,
) -> bool {
    let h = root.half_width();
    let tolerance = <S::Real as Float>::epsilon().as_f64().sqrt();
    (0..PROBE_PAIRS).all(|i| {
        let [x, y, shift] = [3 * i, 3 * i + 1, 3 * i + 2].map(|k| sample::<S::Real>(k) * h);
        let (x, y) = (root.centre() + x, root.centre() + y);
        agree(&kernel.at(x, y), &kernel.at(x + shift, y + shift), tolerance)
    })
}

/// The degree α with K(s x, s y) = s^α K(x, y), to round-off, if there is one: for sample pairs of a root of
/// half-width `h`, of all sizes from that for which operators are built to the root's diameter, and of those of the
/// `levels`. Assumes translation invariance.
pub(crate) fn homogeneity<S: Scalar>(
    kernel: &Entries<'_, S>,
    h: S::Real,
    levels: impl IntoIterator<Item = S::Real>,
) -> Option<f64> {
    let from = reference(h);
    let to = h + h;
    let norm_of =
        |size: S::Real| norm(&kernel.at(sample::<S::Real>(0) * size, PointOf::<S>::default()));
    let degree = (norm_of(h) / norm_of(h * S::Real::from_f64(0.5))).log2();
    // Degrees of formulas are simple fractions; the nearest one has no rounding of its own.
    let degree = (degree * 840.0).round() / 840.0;
    if !degree.is_finite() {
        return None;
    }
    let own = levels.into_iter().flat_map(|size| (0..PROBE_PAIRS).map(move |i| (i, size)));
    // Where the kernel is another one for a few pairs only, it takes many to meet one: half of them are anywhere,
    // and half of any size.
    let range = (to / from).as_f64().log2();
    let between = |i: usize| {
        let part = (0.618_033_988_749_895 * i as f64).fract();
        from * S::Real::from_f64((range * part).exp2())
    };
    let all = (0..SCALED_PAIRS).map(|i| (i, if i % 2 == 0 { to } else { between(i) }));
    let pairs: Vec<(usize, S::Real)> = own.chain(all).collect();
    let values = |size: &dyn Fn(usize) -> S::Real| {
        let points: Vec<PointOf<S>> =
            (0..pairs.len()).map(|k| sample::<S::Real>(pairs[k].0) * size(k)).collect();
        let mut values = vec![zero::<S>(); points.len() * kernel.fields * kernel.densities];
        kernel.write(&points, PointOf::<S>::default(), &mut values);
        values
    };
    let (mut scaled, there) = (values(&|_| from), values(&|k| pairs[k].1));
    let len = kernel.fields * kernel.densities;
    let holds = |(k, (scaled, there)): (usize, (&mut [S], &[S]))| {
        let factor = (pairs[k].1 / from).as_f64().powf(degree);
        scaled.iter_mut().for_each(|g| *g *= S::from_real(S::Real::from_f64(factor)));
        agree(scaled, there, round_off::<S>())
    };
    let both = scaled.chunks_exact_mut(len).zip(there.chunks_exact(len));
    both.enumerate().all(holds).then_some(degree)
}

/// The half-width of the cells for which operators of a homogeneous kernel are built, within a root of half-width `h`: a
/// power of two, so that lengths in this unit round like others. None of the sources they are asked for is farther
/// away than the root's edge: beyond it, the kernel may be another one.
pub(crate) fn reference<T: Real>(h: T) -> T {
    power_of_two(h * T::from_f64(2.0 / (SAMPLED_REACH + 1.0)))
}

/// Whether G(x, y) = G(y, x)ᵀ to round-off for sample pairs. Assumes translation invariance.
pub(crate) fn symmetric<S: Scalar>(kernel: &Entries<'_, S>, half_width: S::Real) -> bool {
    kernel.fields == kernel.densities
        && differences::<S>(half_width).all(|d| {
            let origin = PointOf::<S>::default();
            agree(&kernel.at(d, origin), &kernel.transpose().at(d, origin), round_off::<S>())
        })
}

/// How a kernel behaves under the reflections of the axes.
///
/// Bit a of `fields[i]` ⊕ `densities[j]` tells whether entry (i, j) changes its sign when both points are
/// reflected along axis a.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Parities {
    pub(crate) fields: Vec<u8>,
    pub(crate) densities: Vec<u8>,
}

/// The parities of a kernel whose entries change nothing but their signs under reflections, to
/// round-off for sample pairs. Assumes translation invariance.
pub(crate) fn parities<S: Scalar>(
    kernel: &Entries<'_, S>,
    half_width: S::Real,
) -> Option<Parities> {
    let mut parities =
        Parities { fields: vec![0; kernel.fields], densities: vec![0; kernel.densities] };
    for axis in 0..3 {
        let signs = signs_under_reflection(kernel, half_width, axis)?;
        let Parities { fields, densities } = &mut parities;
        split_signs(&signs, axis, fields, densities)?;
    }
    Some(parities)
}

/// For each entry, whether it changes sign; none where it vanishes everywhere.
fn signs_under_reflection<S: Scalar>(
    kernel: &Entries<'_, S>,
    half_width: S::Real,
    axis: usize,
) -> Option<Vec<Option<bool>>> {
    let mut signs = vec![None; kernel.fields * kernel.densities];
    for d in differences::<S>(half_width) {
        let mut reflected = d.to_array();
        reflected[axis] = -reflected[axis];
        let here = kernel.at(d, PointOf::<S>::default());
        let there = kernel.at(PointOf::<S>::from_array(reflected), PointOf::<S>::default());
        let size = norm(&here);
        for ((sign, &a), &b) in signs.iter_mut().zip(&here).zip(&there) {
            let small = |deviation: S| norm(&[deviation]) <= round_off::<S>() * size;
            let changes = match (small(a - b), small(a + b)) {
                (true, true) => continue,
                (true, false) => false,
                (false, true) => true,
                (false, false) => return None,
            };
            if sign.replace(changes).is_some_and(|before| before != changes) {
                return None;
            }
        }
    }
    Some(signs)
}

/// Writes signs f_i ⊕ g_j into bit `axis` of fields and densities, if they are of that form.
fn split_signs(
    signs: &[Option<bool>],
    axis: usize,
    fields: &mut [u8],
    densities: &mut [u8],
) -> Option<()> {
    let (rows, columns) = (fields.len(), densities.len());
    let mut known: Vec<Option<bool>> = vec![None; rows + columns];
    for start in 0..rows + columns {
        if known[start].is_some() {
            continue;
        }
        known[start] = Some(false);
        let mut open = vec![start];
        while let Some(a) = open.pop() {
            let others = if a < rows { rows..rows + columns } else { 0..rows };
            for b in others {
                let (i, j) = (a.min(b), a.max(b) - rows);
                let Some(changes) = signs[i * columns + j] else { continue };
                let implied = known[a].is_some_and(|sign| sign != changes);
                match known[b] {
                    Some(sign) if sign != implied => return None,
                    Some(_) => {}
                    None => {
                        known[b] = Some(implied);
                        open.push(b);
                    }
                }
            }
        }
    }
    for (parity, sign) in fields.iter_mut().chain(densities).zip(known) {
        *parity |= u8::from(sign == Some(true)) << axis;
    }
    Some(())
}

/// A power of two of about the size of the kernel between well-separated cells of the given half-widths,
/// so that squares of the kernel over it stay in the range of numbers.
pub(crate) fn unit<S: Scalar>(
    kernel: &Entries<'_, S>,
    half_widths: impl IntoIterator<Item = S::Real>,
) -> S::Real {
    let of_size =
        |half_width| differences::<S>(half_width).map(|d| kernel.at(d, PointOf::<S>::default()));
    let entries = half_widths.into_iter().flat_map(of_size).flatten();
    let parts = entries.flat_map(|entry| entry.parts()).map(|part| part.abs());
    power_of_two(parts.fold(S::Real::from_f64(0.0), Float::max))
}

/// A power of two of about this size, whose inverse is finite; 1 for zero and what is not finite.
pub(crate) fn power_of_two<T: Real>(size: T) -> T {
    if !(size > T::from_f64(0.0) && size < T::infinity()) {
        return T::from_f64(1.0);
    }
    size.log2().floor().exp2().max(T::min_positive_value() * T::from_f64(4.0))
}

/// Differences between points of well-separated cells.
fn differences<S: Scalar>(half_width: S::Real) -> impl Iterator<Item = PointOf<S>> {
    let far = PointOf::<S>::from_array([5.0, -3.0, 4.0].map(S::Real::from_f64));
    (0..PROBE_PAIRS).map(move |i| {
        let signs: [f64; 3] = std::array::from_fn(|k| if i >> k & 1 == 0 { 1.0 } else { -1.0 });
        let d = (far + sample::<S::Real>(i)).to_array();
        let d: [S::Real; 3] = std::array::from_fn(|k| d[k] * S::Real::from_f64(signs[k]));
        PointOf::<S>::from_array(d) * half_width
    })
}

/// The i-th point of a low-discrepancy sequence in [−1, 1]³ (Roberts' R₃).
pub(crate) fn sample<T: Real>(i: usize) -> Point<T> {
    const STEPS: [f64; 3] =
        [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_3];
    Point::<T>::from_array(
        STEPS.map(|a| T::from_f64(2.0 * (0.5 + a * (i + 1) as f64).fract() - 1.0)),
    )
}

/// What a short formula may lose to rounding.
fn round_off<S: Scalar>() -> f64 {
    <S::Real as Float>::epsilon().as_f64().powf(0.8)
}

fn agree<S: Scalar>(a: &[S], b: &[S], tolerance: f64) -> bool {
    let difference: Vec<S> = a.iter().zip(b).map(|(&a, &b)| a - b).collect();
    norm(&difference) <= tolerance * norm(a).hypot(norm(b))
}

fn norm<S: Scalar>(g: &[S]) -> f64 {
    l2_norm(g.iter().copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::interpolation::entries::pairwise;
    use glam::DVec3;

    /// Asks a question about a scalar formula.
    fn ask<R>(
        f: impl Fn(DVec3, DVec3) -> f64 + Sync,
        question: impl FnOnce(&Entries<'_, f64>) -> R,
    ) -> R {
        let block = pairwise(1, |x, y, g: &mut [f64]| g[0] = f(x, y));
        question(&Entries::new(1, 1, &block))
    }

    fn inverse(x: DVec3, y: DVec3) -> f64 {
        1.0 / x.distance(y)
    }

    fn skew(x: DVec3, y: DVec3) -> f64 {
        let d = x - y;
        (-(d.length_squared() + 0.3 * d.x * d.y + 0.1 * d.z)).exp()
    }

    #[test]
    fn invariance_is_seen_and_its_absence_too() {
        let root = Cube::new(DVec3::new(3.0, 0.0, -1.0), 2.0);
        assert!(ask(|x, y| (x - y).x.exp(), |k| translation_invariant(k, &root)));
        let variant = |x: DVec3, y: DVec3| (x - y).x.exp() * (1.0 + 1e-3 * x.y);
        assert!(!ask(variant, |k| translation_invariant(k, &root)));
    }

    #[test]
    fn homogeneity_is_seen_and_its_absence_too() {
        let degree = |k: &Entries<'_, f64>| homogeneity(k, 2.0, []);
        assert_eq!(ask(|x, y| (x - y).x / x.distance(y).powi(4), degree), Some(-3.0));
        assert_eq!(ask(|x, y| x.distance(y).powf(0.25), degree), Some(0.25));
        let yukawa = |x: DVec3, y: DVec3| (-1e-9 * x.distance(y)).exp() / x.distance(y);
        assert_eq!(ask(yukawa, degree), None);
        assert_eq!(ask(|_, _| 0.0, degree), None);
        // A scale that shows in the smallest cells alone.
        let softened = |x: DVec3, y: DVec3| 1.0 / (x.distance_squared(y) + 1e-19).sqrt();
        assert_eq!(ask(softened, degree), Some(-1.0));
        assert_eq!(ask(softened, |k| homogeneity(k, 2.0, [0.1, 1e-6])), None);
    }

    #[test]
    fn nothing_is_asked_of_a_kernel_outside_of_the_root() {
        for h in [1e-3, 0.25, 3.0] {
            let within = |x: DVec3, y: DVec3| {
                let most = (x - y).abs().max_element();
                assert!(most <= 2.0 * h, "{most} beyond the edge of {h}");
                inverse(x, y)
            };
            assert_eq!(ask(within, |k| homogeneity(k, h, [0.25 * h, 0.01 * h])), Some(-1.0));
            // A law that holds but for few pairs, or but for the largest of them.
            let shell = |x: DVec3, y: DVec3| {
                let r = x.distance(y);
                r.recip() + if (r - 1.7 * h).abs() < 2e-3 * h { 5.0 / h } else { 0.0 }
            };
            assert_eq!(ask(shell, |k| homogeneity(k, h, [0.25 * h])), None);
            let bounded = |x: DVec3, y: DVec3| x.distance(y).min(2.9 * h);
            assert_eq!(ask(bounded, |k| homogeneity(k, h, [0.25 * h])), None);
        }
    }

    #[test]
    fn symmetry_is_seen_and_its_absence_too() {
        assert!(ask(inverse, |k| symmetric(k, 0.3)));
        assert!(!ask(skew, |k| symmetric(k, 0.3)));
        let one_sided = pairwise(3, |x, y, g| g.copy_from_slice((x - y).as_ref()));
        assert!(!symmetric(&Entries::new(3, 1, &one_sided), 0.3));
    }

    #[test]
    fn parities_are_seen_and_their_absence_too() {
        let even = Some(Parities { fields: vec![0], densities: vec![0] });
        assert_eq!(ask(inverse, |k| parities(k, 0.3)), even);
        assert_eq!(ask(skew, |k| parities(k, 0.3)), None);
        let odd_in_x = ask(|x, y| (x - y).x / x.distance(y), |k| parities(k, 0.3)).unwrap();
        assert_eq!(odd_in_x.fields[0] ^ odd_in_x.densities[0], 0b001);
        let tensor = pairwise(9, |x, y, g| {
            let d = x - y;
            for (k, g) in g.iter_mut().enumerate() {
                *g = d[k / 3] * d[k % 3];
            }
        });
        let found = parities(&Entries::new(3, 3, &tensor), 0.3).unwrap();
        for (i, f) in found.fields.iter().enumerate() {
            for (j, d) in found.densities.iter().enumerate() {
                assert_eq!(f ^ d, 1 << i ^ 1 << j);
            }
        }
    }

    #[test]
    fn the_transpose_swaps_points_and_components() {
        let entries = pairwise(6, |x, y, g| g.copy_from_slice(&[x.x, x.y, y.x, y.y, x.z, y.z]));
        let kernel = Entries::new(2, 3, &entries);
        let (x, y) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0));
        assert_eq!(kernel.at(y, x), [4.0, 5.0, 1.0, 2.0, 6.0, 3.0]);
        assert_eq!(kernel.transpose().at(x, y), [4.0, 2.0, 5.0, 6.0, 1.0, 3.0]);
    }
}
