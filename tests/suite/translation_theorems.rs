//! The four theorems of the harmonic expansion against direct evaluation: random centres, points,
//! orders and exponents, with error bounds that are proved, not fitted.
//!
//! |x − y|^(−2λ) = Σ_n |y|^n |x|^(−n−2λ) C_n^λ(cos γ) with Gegenbauer's polynomials, which for λ > 0
//! are at most C_n^λ(1) = (2λ)_n / n!. What a truncated expansion leaves out is at most the tail of
//! the series of these maxima, whose terms fall by the ratio of the radii.

use farfield_potentials::harmonic::{Harmonic, Scratch};
use glam::{DQuat, DVec3};
use proptest::prelude::*;

/// Writes functions and their gradients.
type Basis<'a> = dyn Fn(&mut [f64], &mut [[f64; 3]]) + 'a;

/// Rounding errors, relative to the sum of the moduli of all that is added.
const ROUNDING: f64 = 1e-13;

fn direction() -> impl Strategy<Value = DVec3> {
    prop_oneof![
        8 => (-1.0..1.0f64, 0.0..std::f64::consts::TAU).prop_map(|(z, phi)| {
            let across = (1.0 - z * z).sqrt();
            DVec3::new(across * phi.cos(), across * phi.sin(), z)
        }),
        // Where angles degenerate.
        1 => prop::sample::select(DVec3::AXES.to_vec()),
        1 => prop::sample::select(DVec3::AXES.map(|axis| -axis).to_vec()),
    ]
}

/// A point of the unit ball.
fn inside() -> impl Strategy<Value = DVec3> {
    (direction(), 0.0..1.0f64).prop_map(|(d, volume)| d * volume.cbrt())
}

/// Points of the unit ball with charges of both signs.
fn cloud() -> impl Strategy<Value = Vec<(DVec3, f64)>> {
    let charge = prop_oneof![0.1..1.0, -1.0..-0.1];
    prop::collection::vec((inside(), charge), 1..8)
}

fn positive_lambda() -> impl Strategy<Value = f64> {
    prop_oneof![4 => prop::sample::select(vec![0.5, 1.0, 2.0]), 1 => 0.1..3.0]
}

fn any_lambda() -> impl Strategy<Value = f64> {
    prop_oneof![4 => positive_lambda(), 1 => prop::sample::select(vec![-1.0, -0.5, -2.0])]
}

fn rotation() -> impl Strategy<Value = DQuat> {
    (direction(), 0.0..std::f64::consts::TAU)
        .prop_map(|(axis, angle)| DQuat::from_axis_angle(axis, angle))
}

/// u(x) = Σ_j |x − y_j|^(−2λ) q_j
fn direct(lambda: f64, cloud: &[(DVec3, f64)], x: DVec3) -> f64 {
    cloud.iter().map(|&(y, q)| x.distance_squared(y).powf(-lambda) * q).sum()
}

/// The same cloud, with y replaced by s y + t.
fn moved(cloud: &[(DVec3, f64)], scale: f64, shift: DVec3) -> Vec<(DVec3, f64)> {
    cloud.iter().map(|&(y, q)| (y * scale + shift, q)).collect()
}

fn total(cloud: &[(DVec3, f64)]) -> f64 {
    cloud.iter().map(|(_, q)| q.abs()).sum()
}

/// Σ_{n > p} (2λ)_n/n! w_n ρ^n, w_n a weight; from n = 0 if `p` is none.
fn tail(lambda: f64, p: Option<usize>, rho: f64, weight: impl Fn(f64) -> f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 0.0;
    for n in 0..600 {
        if p.is_none_or(|p| n > p) {
            sum += term * weight(n as f64);
        }
        term *= (2.0 * lambda + n as f64) / (n + 1) as f64 * rho;
    }
    sum
}

/// The part of (1 − a − b)^(−2λ) with a degree above p in a or in b. The part of degree (N, n) in y
/// and x of |t + x − y|^(−2λ), a symmetric multilinear form, is at most the part of degree (N, n) in
/// a = |y|/|t|, b = |x|/|t| of |t|^(−2λ) (1 − a − b)^(−2λ) (Banach 1938).
fn double_tail(lambda: f64, p: usize, a: f64, b: f64) -> f64 {
    let mut sum = 0.0;
    let mut first = 1.0;
    for big_n in 0..300 {
        let beyond = (big_n <= p).then_some(p);
        sum += first * tail(lambda + 0.5 * big_n as f64, beyond, b, |_| 1.0);
        first *= (2.0 * lambda + big_n as f64) / (big_n + 1) as f64 * a;
    }
    sum
}

/// One order and exponent, with vectors allocated as needed.
struct Theorems {
    harmonic: Harmonic<f64>,
    scratch: Scratch<f64>,
}

impl Theorems {
    fn new(lambda: f64, order: usize) -> Self {
        let harmonic = Harmonic::new(lambda, order).unwrap();
        let scratch = Scratch::new(&harmonic);
        Self { harmonic, scratch }
    }

    fn regular(&self, x: DVec3) -> Vec<f64> {
        let mut out = vec![f64::NAN; self.harmonic.len()];
        self.harmonic.regular(x, &mut out);
        out
    }

    fn singular(&self, x: DVec3) -> Vec<f64> {
        let mut out = vec![f64::NAN; self.harmonic.len()];
        self.harmonic.singular(x, &mut out);
        out
    }

    fn p2m(&self, cloud: &[(DVec3, f64)]) -> Vec<f64> {
        self.sum(cloud, |y| self.regular(y))
    }

    fn p2l(&self, cloud: &[(DVec3, f64)]) -> Vec<f64> {
        self.sum(cloud, |y| self.singular(y))
    }

    fn sum(&self, cloud: &[(DVec3, f64)], basis: impl Fn(DVec3) -> Vec<f64>) -> Vec<f64> {
        let mut sum = vec![0.0; self.harmonic.len()];
        for &(y, q) in cloud {
            for (sum, f) in sum.iter_mut().zip(basis(y)) {
                *sum += f * q;
            }
        }
        sum
    }

    fn m2p(&self, multipole: &[f64], x: DVec3) -> f64 {
        dot(multipole, &self.singular(x))
    }

    fn l2p(&self, local: &[f64], x: DVec3) -> f64 {
        dot(local, &self.regular(x))
    }

    fn m2m(&mut self, shift: DVec3, scale: f64, from: &[f64]) -> Vec<f64> {
        let mut to = vec![0.0; from.len()];
        self.harmonic.m2m(shift, scale, from, &mut to, &mut self.scratch);
        to
    }

    fn m2l(&mut self, shift: DVec3, from: &[f64]) -> Vec<f64> {
        let mut to = vec![0.0; from.len()];
        self.harmonic.m2l(shift, from, &mut to, &mut self.scratch);
        to
    }

    fn l2l(&mut self, shift: DVec3, scale: f64, from: &[f64]) -> Vec<f64> {
        let mut to = vec![0.0; from.len()];
        self.harmonic.l2l(shift, scale, from, &mut to, &mut self.scratch);
        to
    }

    /// The largest difference of two sets of moments of charges of modulus `total` within `radius`,
    /// in units of what such moments can be.
    fn difference(&self, a: &[f64], b: &[f64], total: f64, radius: f64) -> f64 {
        self.harmonic
            .terms()
            .zip(a.iter().zip(b))
            .map(|(term, (a, b))| (a - b).abs() / (total * radius.powi(term.n as i32)))
            .fold(0.0, f64::max)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn multipole_expansion(
        lambda in positive_lambda(),
        order in 0..13usize,
        cloud in cloud(),
        towards in direction(),
        rho in 0.05..0.8f64,
    ) {
        let theorems = Theorems::new(lambda, order);
        let x = towards / rho;
        let error = (theorems.m2p(&theorems.p2m(&cloud), x) - direct(lambda, &cloud, x)).abs();
        let rounding = ROUNDING * tail(lambda, None, rho, |_| 1.0);
        let bound = tail(lambda, Some(order), rho, |_| 1.0) + rounding;
        let unit = total(&cloud) * rho.powf(2.0 * lambda);
        prop_assert!(error <= unit * bound, "{error:e} > {unit:e} · {bound:e}");
    }

    #[test]
    fn local_expansion(
        lambda in positive_lambda(),
        order in 0..13usize,
        cloud in cloud(),
        towards in direction(),
        x in inside(),
        rho in 0.05..0.8f64,
    ) {
        // All sources at least 1/ρ away from the centre.
        let theorems = Theorems::new(lambda, order);
        let cloud = moved(&cloud, 1.0, towards * (1.0 + 1.0 / rho));
        let error = (theorems.l2p(&theorems.p2l(&cloud), x) - direct(lambda, &cloud, x)).abs();
        let rounding = ROUNDING * tail(lambda, None, rho, |_| 1.0);
        let bound = tail(lambda, Some(order), rho, |_| 1.0) + rounding;
        let unit = total(&cloud) * rho.powf(2.0 * lambda);
        prop_assert!(error <= unit * bound, "{error:e} > {unit:e} · {bound:e}");
    }

    #[test]
    fn m2m_equals_moments_about_the_new_centre(
        lambda in any_lambda(),
        order in 0..21usize,
        cloud in cloud(),
        shift in inside(),
        scale in 0.1..1.5f64,
    ) {
        let mut theorems = Theorems::new(lambda, order);
        let child = theorems.p2m(&cloud);
        let found = theorems.m2m(shift, scale, &child);
        let expected = theorems.p2m(&moved(&cloud, scale, shift));
        let radius = scale + shift.length();
        let error = theorems.difference(&found, &expected, total(&cloud), radius);
        prop_assert!(error < ROUNDING, "{error:e}");
    }

    #[test]
    fn m2l(
        lambda in positive_lambda(),
        order in 0..13usize,
        cloud in cloud(),
        towards in direction(),
        distance in 2.0..40.0f64,
        x in inside(),
        [a, b] in [0.02..0.4f64, 0.02..0.4],
    ) {
        let mut theorems = Theorems::new(lambda, order);
        let cloud = moved(&cloud, a * distance, DVec3::ZERO);
        let (shift, x) = (towards * distance, x * (b * distance));
        let multipole = theorems.p2m(&cloud);
        let local = theorems.m2l(shift, &multipole);
        let error = (theorems.l2p(&local, x) - direct(lambda, &cloud, shift + x)).abs();
        let rounding = ROUNDING * (1.0 - a - b).powf(-2.0 * lambda);
        let bound = double_tail(lambda, order, a, b) + rounding;
        let unit = total(&cloud) * distance.powf(-2.0 * lambda);
        prop_assert!(error <= unit * bound, "{error:e} > {unit:e} · {bound:e}");
    }

    #[test]
    fn m2l_of_finite_expansions_is_exact(
        (lambda, least) in prop::sample::select(vec![(-1.0, 2), (-2.0, 4), (-3.0, 6)]),
        more in 0..4usize,
        cloud in cloud(),
        shift in inside(),
        x in inside(),
    ) {
        // Polynomials converge everywhere: the two balls overlap.
        let mut theorems = Theorems::new(lambda, least + more);
        let multipole = theorems.p2m(&cloud);
        let local = theorems.m2l(shift, &multipole);
        let error = (theorems.l2p(&local, x) - direct(lambda, &cloud, shift + x)).abs();
        prop_assert!(error < ROUNDING * total(&cloud) * 3f64.powf(-2.0 * lambda), "{error:e}");
    }

    #[test]
    fn l2l_is_the_same_field_about_the_new_centre(
        lambda in any_lambda(),
        order in 0..21usize,
        cloud in cloud(),
        towards in direction(),
        x in inside(),
        shift in inside(),
        scale in 0.1..1.0f64,
    ) {
        let mut theorems = Theorems::new(lambda, order);
        let parent = theorems.p2l(&moved(&cloud, 1.0, towards * 5.0));
        let child = theorems.l2l(shift, scale, &parent);
        let found = theorems.l2p(&child, x);
        let expected = scale.powf(2.0 * lambda) * theorems.l2p(&parent, x * scale + shift);
        // Sources 4 to 6 away, points within 2: the sum of the moduli of all terms is at most
        // Σ_n (2|λ|)_n/n! |y|^(−2λ) (2/|y|)^n = |y|^(−2λ) (1 − 2/|y|)^(−2|λ|).
        let most = if lambda > 0.0 { 2f64.powf(-2.0 * lambda) } else { 9f64.powf(-2.0 * lambda) };
        let unit = total(&cloud) * scale.powf(2.0 * lambda) * most;
        prop_assert!((found - expected).abs() < ROUNDING * unit, "{found:e} {expected:e} {unit:e}");
    }

    #[test]
    fn shifts_compose(
        lambda in any_lambda(),
        order in 0..15usize,
        cloud in cloud(),
        [first, second] in [inside(), inside()],
        [s, t] in [0.1..1.0f64, 0.1..1.0],
    ) {
        let mut theorems = Theorems::new(lambda, order);
        let moments = theorems.p2m(&cloud);
        let once = theorems.m2m(first, s, &moments);
        let twice = theorems.m2m(second, t, &once);
        let direct = theorems.m2m(first * t + second, s * t, &moments);
        let error = theorems.difference(&twice, &direct, total(&cloud), 3.0);
        prop_assert!(error < ROUNDING, "{error:e}");
    }

    #[test]
    fn l2l_is_the_transpose_of_m2m(
        lambda in any_lambda(),
        order in 0..15usize,
        sources in cloud(),
        targets in cloud(),
        shift in inside(),
        scale in 0.1..1.0f64,
    ) {
        let mut theorems = Theorems::new(lambda, order);
        let moments = theorems.p2m(&sources);
        let local = theorems.p2l(&moved(&targets, 1.0, DVec3::X * 5.0));
        let upward = theorems.m2m(shift, scale, &moments);
        let downward = theorems.l2l(shift, scale, &local);
        let error = scale.powf(2.0 * lambda) * dot(&local, &upward) - dot(&downward, &moments);
        let unit = total(&sources) * total(&targets) * 12f64.powf(2.0 * lambda.abs());
        prop_assert!(error.abs() < ROUNDING * unit, "{error:e} {unit:e}");
    }

    #[test]
    fn truncated_expansions_are_covariant_under_rotations(
        lambda in any_lambda(),
        order in 0..13usize,
        cloud in cloud(),
        towards in direction(),
        [x, shift] in [inside(), inside()],
        rotation in rotation(),
    ) {
        let mut theorems = Theorems::new(lambda, order);
        let mut field = |rotation: DQuat| {
            let cloud: Vec<_> = cloud.iter().map(|&(y, q)| (rotation * y, q)).collect();
            let child = theorems.p2m(&cloud);
            let parent = theorems.m2m(rotation * shift * 0.5, 0.5, &child);
            let local = theorems.m2l(rotation * towards * 4.0, &parent);
            let child = theorems.l2l(rotation * shift * 0.5, 0.5, &local);
            theorems.l2p(&child, rotation * x)
        };
        let error = (field(rotation) - field(DQuat::IDENTITY)).abs();
        let unit = total(&cloud) * 12f64.powf(2.0 * lambda.abs());
        prop_assert!(error < ROUNDING * unit, "{error:e} {unit:e}");
    }

    #[test]
    fn gradients_converge_too(
        lambda in positive_lambda(),
        order in 0..13usize,
        cloud in cloud(),
        towards in direction(),
        rho in 0.05..0.8f64,
    ) {
        let theorems = Theorems::new(lambda, order);
        let len = theorems.harmonic.len();
        let gradient = |basis: &Basis<'_>, terms: &[f64]| {
            let (mut values, mut gradients) = (vec![0.0; len], vec![[0.0; 3]; len]);
            basis(&mut values, &mut gradients);
            gradients.iter().zip(terms).map(|(g, t)| DVec3::from(*g) * *t).sum::<DVec3>()
        };
        let exact = |cloud: &[(DVec3, f64)], x: DVec3| {
            let pull = |(y, q): &(DVec3, f64)| {
                (x - *y) * (-2.0 * lambda * q * x.distance_squared(*y).powf(-lambda - 1.0))
            };
            cloud.iter().map(pull).sum::<DVec3>()
        };
        // A harmonic of degree ≤ n on a sphere changes by at most n times its maximum per radian
        // (Bernstein), and along the radius by its power of it.
        let slope = |n: f64| (n + 2.0 * lambda).hypot(n);
        let unit = total(&cloud) * rho.powf(2.0 * lambda + 1.0);
        let rounding = ROUNDING * tail(lambda, None, rho, slope);
        let bound = tail(lambda, Some(order), rho, slope) + rounding;

        let x = towards / rho;
        let outside = gradient(
            &|values, gradients| theorems.harmonic.singular_gradient(x, values, gradients),
            &theorems.p2m(&cloud),
        );
        let error = outside.distance(exact(&cloud, x));
        prop_assert!(error <= unit * bound, "{error:e} > {unit:e} · {bound:e}");

        // Seen from the point: a sphere of radius 1/ρ around it, all sources outside.
        let far = moved(&cloud, 1.0, towards * (1.0 + 1.0 / rho));
        let inside = gradient(
            &|values, gradients| theorems.harmonic.regular_gradient(towards, values, gradients),
            &theorems.p2l(&far),
        );
        let error = inside.distance(exact(&far, towards));
        let bound = bound / rho;
        prop_assert!(error <= unit * bound, "{error:e} > {unit:e} · {bound:e}");
    }
}
