//! Translations of expansions by any vector: turn it onto the z axis, shift along z, turn back.
//!
//! A turn by a vector's azimuth φ and polar angle θ is Z(−φ), then P Z(θ) P, with Z a rotation about
//! z and P the exchange of y and z. Work per translation: O(p³) for λ = ½; otherwise O(p⁴) for the
//! turns and p⁵/40 for the shift along z, which is less than the turns' up to p ≈ 16.

use farfield::{Numbers, Point, Real, Vector};

use super::basis::powers;
use super::shift::{AxialShell, AxialShift};
use super::solid::{cosine, sine};
use super::swap::product;
use super::{Harmonic, MAX_ORDER};

/// Working memory of translations, to be reused from one to the next.
#[derive(Clone, Debug)]
pub struct Scratch<C> {
    terms: [Vec<C>; 2],
    columns: [Vec<C>; 2],
}

impl<C: Numbers> Scratch<C> {
    /// Working memory for `harmonic` with terms of type `C`.
    pub fn new<T: Real>(harmonic: &Harmonic<T>) -> Self {
        let terms = vec![C::zero(); harmonic.len];
        let columns = vec![C::zero(); harmonic.shells.len()];
        Self { terms: [terms.clone(), terms], columns: [columns.clone(), columns] }
    }
}

impl<T: Real> Harmonic<T> {
    /// M2M: adds to `to` the moments M'_k = Σ_j R_k(s y_j + t) q_j, given M_k = Σ_j R_k(y_j) q_j in
    /// `from`. Exact: the R_k(s y + t) are combinations of the R_k'(y) of no higher degree.
    ///
    /// For a child's moments t is its centre as seen from its parent in the parent's half-widths,
    /// (±½, ±½, ±½), and s = ½.
    ///
    /// # Panics
    /// If a length isn't [`len`](Self::len), or `scratch` is for another number of terms.
    pub fn m2m<C: Numbers<Real = T>>(
        &self,
        shift: Point<T>,
        scale: T,
        from: &[C],
        to: &mut [C],
        scratch: &mut Scratch<C>,
    ) {
        let one = T::from_f64(1.0);
        let direction = Direction::<T>::new(shift);
        let factors = [powers(one, scale), powers(one, one)];
        let lengths = powers(one, direction.length);
        self.translate(&direction, factors, from, to, scratch, |axial, from, to| {
            let mut row = &axial.regular[..];
            for (i, (target, to)) in axial.shells.iter().zip(to).enumerate() {
                let (entries, rest) = row.split_at(i + 1);
                row = rest;
                *to = C::zero();
                for ((&a, source), from) in entries.iter().zip(&axial.shells).zip(from) {
                    to.add_scaled(a * lengths[target.n - source.n], from);
                }
            }
        });
    }

    /// L2L: adds to `to` the terms L' with Σ_k L'_k R_k(x) = s^2λ Σ_k L_k R_k(s x + t), given L in
    /// `from`. Exact.
    ///
    /// For a child t and s are as in [`m2m`](Self::m2m). The factor s^2λ keeps each cell's expansion
    /// in units of its own half-width, in which the kernel's values are (half-width)^2λ times those
    /// in scene units.
    ///
    /// # Panics
    /// If a length isn't [`len`](Self::len), or `scratch` is for another number of terms.
    pub fn l2l<C: Numbers<Real = T>>(
        &self,
        shift: Point<T>,
        scale: T,
        from: &[C],
        to: &mut [C],
        scratch: &mut Scratch<C>,
    ) {
        let one = T::from_f64(1.0);
        let direction = Direction::<T>::new(shift);
        let units = scale.powf(T::from_f64(2.0 * self.lambda));
        let factors = [powers(one, one), powers(units, scale)];
        let lengths = powers(one, direction.length);
        self.translate(&direction, factors, from, to, scratch, |axial, from, to| {
            let mut row = &axial.regular[..];
            to.fill(C::zero());
            for (i, (source, from)) in axial.shells.iter().zip(from).enumerate() {
                let (entries, rest) = row.split_at(i + 1);
                row = rest;
                for ((&a, target), to) in entries.iter().zip(&axial.shells).zip(to.iter_mut()) {
                    to.add_scaled(a * lengths[source.n - target.n], from);
                }
            }
        });
    }

    /// M2L: adds to `to` the terms L with Σ_k L_k R_k(x) ≈ Σ_k S_k(x + t) M_k, given M in `from`: the
    /// field of a multipole expansion around a point at `shift` from its centre, in half-widths.
    ///
    /// # Panics
    /// If a length isn't [`len`](Self::len), or `scratch` is for another number of terms.
    pub fn m2l<C: Numbers<Real = T>>(
        &self,
        shift: Point<T>,
        from: &[C],
        to: &mut [C],
        scratch: &mut Scratch<C>,
    ) {
        let direction = Direction::<T>::new(shift);
        let inverse = direction.length.recip();
        let units = inverse.powf(T::from_f64(2.0 * self.lambda));
        let factors = [powers(units, inverse), powers(T::from_f64(1.0), inverse)];
        self.translate(&direction, factors, from, to, scratch, |axial, from, to| {
            product(&axial.singular, from, to);
        });
    }

    /// Turns `from` so that the direction lies on z, applies `shift` to the terms of each m, turns
    /// back and adds to `to`. `factors` holds what terms of degree n are multiplied by, before and
    /// after.
    fn translate<C: Numbers<Real = T>>(
        &self,
        direction: &Direction<T>,
        [before, after]: [[T; MAX_ORDER + 1]; 2],
        from: &[C],
        to: &mut [C],
        scratch: &mut Scratch<C>,
        shift: impl Fn(&AxialShift<T>, &[C], &mut [C]),
    ) {
        self.check(from.len());
        self.check(to.len());
        self.check(scratch.terms[0].len());
        let ones = [T::from_f64(1.0); MAX_ORDER + 1];
        let [a, b] = &mut scratch.terms;
        let [phi, theta] = [&direction.phi, &direction.theta];

        self.turn(phi, -1.0, &before, from, a);
        self.exchange(a, b);
        self.turn(theta, 1.0, &ones, b, a);
        self.exchange(a, b);

        let [column, shifted] = &mut scratch.columns;
        for axial in &self.axial {
            let column = &mut column[..axial.shells.len()];
            let shifted = &mut shifted[..axial.shells.len()];
            let positions: [fn(&AxialShell) -> usize; 2] = [|s| s.cosine, |s| s.sine];
            for position in &positions[..if axial.m == 0 { 1 } else { 2 }] {
                for (entry, shell) in column.iter_mut().zip(&axial.shells) {
                    *entry = b[position(shell)].clone();
                }
                shift(axial, column, shifted);
                for (entry, shell) in shifted.iter().zip(&axial.shells) {
                    a[position(shell)] = entry.clone();
                }
            }
        }

        self.exchange(a, b);
        self.turn(theta, -1.0, &ones, b, a);
        self.exchange(a, b);
        self.turn(phi, 1.0, &after, b, a);
        for (to, a) in to.iter_mut().zip(a) {
            to.accumulate(a);
        }
    }

    /// `to` = Z(±α) `from`, the terms as seen after a rotation about z, times `factors` by degree.
    fn turn<C: Numbers<Real = T>>(
        &self,
        multiples: &[[T; 2]; MAX_ORDER + 1],
        sense: f64,
        factors: &[T; MAX_ORDER + 1],
        from: &[C],
        to: &mut [C],
    ) {
        let (zero, sense) = (T::from_f64(0.0), T::from_f64(sense));
        for shell in &self.shells {
            let factor = factors[shell.n];
            let from = &from[shell.start..][..2 * shell.l + 1];
            let to = &mut to[shell.start..][..2 * shell.l + 1];
            let middle = cosine(shell.l, 0);
            to[middle] = combined(factor, &from[middle], zero, &from[middle]);
            for (m, &[c, s]) in multiples.iter().enumerate().take(shell.l + 1).skip(1) {
                let (i, j) = (cosine(shell.l, m), sine(shell.l, m));
                let (c, s) = (factor * c, factor * sense * s);
                to[i] = combined(c, &from[i], -s, &from[j]);
                to[j] = combined(s, &from[i], c, &from[j]);
            }
        }
    }

    /// `to` = the terms `from` with the axes y and z exchanged.
    fn exchange<C: Numbers<Real = T>>(&self, from: &[C], to: &mut [C]) {
        for shell in &self.shells {
            let terms = shell.start..shell.start + 2 * shell.l + 1;
            self.swap.apply(shell.l, &from[terms.clone()], &mut to[terms]);
        }
    }
}

/// a x + b y
#[inline(always)]
fn combined<T: Real, C: Numbers<Real = T>>(a: T, x: &C, b: T, y: &C) -> C {
    let mut sum = C::zero();
    sum.add_scaled(a, x);
    sum.add_scaled(b, y);
    sum
}

/// A vector in spherical coordinates: its length and (cos mα, sin mα) for both angles.
struct Direction<T> {
    length: T,
    phi: [[T; 2]; MAX_ORDER + 1],
    theta: [[T; 2]; MAX_ORDER + 1],
}

impl<T: Real> Direction<T> {
    fn new(v: Point<T>) -> Self {
        let [x, y, z] = v.to_array();
        let across = x.hypot(y);
        let length = across.hypot(z);
        Self { length, phi: multiples(x, y, across), theta: multiples(z, across, length) }
    }
}

/// (cos mα, sin mα) for m = 0, …, [`MAX_ORDER`], where (x, y) = r (cos α, sin α); α = 0 if r = 0.
fn multiples<T: Real>(x: T, y: T, r: T) -> [[T; 2]; MAX_ORDER + 1] {
    let (zero, one) = (T::from_f64(0.0), T::from_f64(1.0));
    let [c, s] = if r > zero { [x / r, y / r] } else { [one, zero] };
    let mut next = [one, zero];
    std::array::from_fn(|_| {
        let now = next;
        next = [c * now[0] - s * now[1], c * now[1] + s * now[0]];
        now
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn regular(harmonic: &Harmonic<f64>, y: DVec3) -> Vec<f64> {
        let mut out = vec![0.0; harmonic.len()];
        harmonic.regular(y, &mut out);
        out
    }

    #[test]
    fn shifted_moments_are_those_about_the_new_centre() {
        let y = DVec3::new(0.3, -0.7, 0.5);
        for lambda in [0.5, 1.0, 2.0, -1.0, -0.5] {
            for order in [0, 1, 6, 20, 40] {
                let harmonic = Harmonic::new(lambda, order).unwrap();
                let mut scratch = Scratch::new(&harmonic);
                for (shift, scale) in [
                    (DVec3::new(0.5, -0.5, 0.5), 0.5),
                    (DVec3::new(0.1, 0.2, -0.4), 0.7),
                    (DVec3::Z * 0.3, 1.0),
                    (DVec3::NEG_Z * 0.3, 1.0),
                    (DVec3::ZERO, 1.0),
                    (DVec3::X * 1e-200, 1.0),
                ] {
                    let mut found = vec![0.0; harmonic.len()];
                    harmonic.m2m(shift, scale, &regular(&harmonic, y), &mut found, &mut scratch);
                    let expected = regular(&harmonic, y * scale + shift);
                    // R_nlm is at most √((2l+1)/4π) r^n, and so are the terms of its shift with
                    // r the sum of both lengths.
                    let r = y.length() * scale + shift.length();
                    let error = harmonic
                        .terms()
                        .zip(found.iter().zip(&expected))
                        .map(|(term, (a, b))| (a - b).abs() / r.powi(term.n as i32))
                        .fold(0.0, f64::max);
                    assert!(error < 5e-15, "λ = {lambda}, p = {order}, {shift}: {error:e}");
                }
            }
        }
    }

    #[test]
    fn m2l_is_symmetric_in_source_and_target() {
        // From K(x, y) = K(y, x): B_kk'(t) = (−1)^(n+n') B_k'k(t).
        for lambda in [0.5, 1.0, 2.0, -1.0, 0.8] {
            let harmonic = Harmonic::<f64>::new(lambda, 12).unwrap();
            for axial in &harmonic.axial {
                let size = axial.shells.len();
                for i in 0..size {
                    for k in 0..i {
                        let odd = (axial.shells[i].n + axial.shells[k].n) % 2 == 1;
                        let a = axial.singular[i * size + k];
                        let b = axial.singular[k * size + i] * if odd { -1.0 } else { 1.0 };
                        assert!((a - b).abs() < 1e-13 * a.abs().max(b.abs()).max(1.0), "{a} {b}");
                    }
                }
            }
        }
    }
}
