//! Formulas that are written once: in one line, with their derivatives, in complex numbers, of positions.

use farfield::{
    Coordinates, Difference, Fmm, Formula, Number, Numbers, Positions, direct, formula, from_fn,
    from_formula, relative_l2_error,
};
use farfield_testing::clouds;
use glam::{DVec3, Vec3};
use num_complex::Complex;

use crate::plain;

pub(crate) const N: usize = 3000;

pub(crate) fn cloud() -> (Vec<DVec3>, Vec<f64>) {
    (clouds::cube(N, 1), clouds::charges(N, 2))
}

#[test]
fn one_line_is_a_kernel() {
    let (points, charges) = cloud();
    let kappa = 3.0;
    let kernel = formula!(|d; kappa| (-d.length() * kappa).exp() / d.length()).skip_coincident();
    let closure = plain(|x, y| (-3.0 * x.distance(y)).exp() / x.distance(y)).skip_coincident();
    let exact = direct(&closure, &points, &charges, &points).unwrap();
    let sums = direct(&kernel, &points, &charges, &points).unwrap();
    assert!(relative_l2_error(&sums, &exact) < 1e-14);
    let fmm = Fmm::builder(&kernel).tolerance(1e-5).leaf_size(30).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-5);
    // The same formula in single precision.
    let single: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
    let numbers: Vec<f32> = charges.iter().map(|&q| q as f32).collect();
    let kernel = formula!(|d; kappa| (-d.length() * kappa).exp() / d.length()).skip_coincident();
    let sums = direct(&kernel, &single, &numbers, &single).unwrap();
    let sums: Vec<f64> = sums.into_iter().map(f64::from).collect();
    assert!(relative_l2_error(&sums, &exact) < 1e-5);
}

/// (0.1 + r²)^(−1/2), smooth everywhere.
#[derive(Clone, Copy)]
pub(crate) struct Softened;

impl Formula for Softened {
    type Of = Difference;
    type Entry<N: Number> = N;

    fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [N]) {
        g[0] = (d.length_squared() + 0.1).sqrt().recip();
    }
}

fn softened(x: DVec3, y: DVec3) -> f64 {
    (0.1 + x.distance_squared(y)).powf(-0.5)
}

#[test]
fn gradients_of_formulas_and_of_closures_agree() {
    let (points, charges) = cloud();
    let by_hand = from_fn(softened).gradient(|x: DVec3, y: DVec3| (y - x) * softened(x, y).powi(3));
    let kernel = from_formula(Softened).gradient();
    let exact = direct(&by_hand, &points, &charges, &points).unwrap();
    let sums = direct(&kernel, &points, &charges, &points).unwrap();
    assert!(relative_l2_error(&sums, &exact) < 1e-14);
    let fmm = Fmm::builder(kernel).order(7).leaf_size(30).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-3);
    let fmm = Fmm::builder(by_hand).order(7).leaf_size(30).build(&points, &points).unwrap();
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-3);
}

#[test]
fn second_derivatives_are_those_of_the_sum() {
    let (points, charges) = cloud();
    let kernel = from_formula(Softened).hessian();
    let sums = direct(&kernel, &points, &charges, &points).unwrap();
    // ∂²/∂a∂b (s + r²)^(−1/2) = 3 d_a d_b K⁵ − δ_ab K³
    let by_hand = |x: DVec3| {
        let mut sum = [0.0; 6];
        for (y, q) in points.iter().zip(&charges) {
            let (d, k) = (x - *y, softened(x, *y));
            let axes = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];
            for (sum, [a, b]) in sum.iter_mut().zip(axes) {
                let diagonal = if a == b { k.powi(3) } else { 0.0 };
                *sum += q * (3.0 * d[a] * d[b] * k.powi(5) - diagonal);
            }
        }
        sum
    };
    let exact: Vec<[f64; 6]> = points[..50].iter().map(|&x| by_hand(x)).collect();
    let found: Vec<[f64; 6]> = sums[..50].iter().map(|u| u.hessian).collect();
    assert!(relative_l2_error(&found, &exact) < 1e-13);
    let fmm = Fmm::builder(kernel).tolerance(1e-4).leaf_size(40).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &sums) < 1e-4);
}

/// e^{ikr}/(1 + r²).
pub(crate) struct Wave;

impl Formula for Wave {
    type Of = Difference;
    type Entry<N: Number> = Complex<N>;

    fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [Complex<N>]) {
        let (r, size) = (d.length(), (d.length_squared() + 1.0).recip());
        g[0] = Complex { re: (r * 2.0).cos() * size, im: (r * 2.0).sin() * size };
    }
}

#[test]
fn entries_may_be_complex() {
    let (points, charges) = cloud();
    let waves: Vec<Complex<f64>> = charges.iter().map(|&q| Complex::new(q, 0.5 - q)).collect();
    let closure = from_fn(|x: DVec3, y: DVec3| {
        Complex::from_polar(1.0 / (1.0 + x.distance_squared(y)), 2.0 * x.distance(y))
    });
    let exact = direct(&closure, &points, &waves, &points).unwrap();
    let kernel = from_formula(Wave);
    assert!(relative_l2_error(&direct(&kernel, &points, &waves, &points).unwrap(), &exact) < 1e-13);
    let fmm = Fmm::builder(kernel).tolerance(1e-4).leaf_size(40).build(&points, &points).unwrap();
    assert!(relative_l2_error(&fmm.apply(&waves).unwrap(), &exact) < 1e-4);
}

/// (1 + x₁)/(1 + r): it matters where the target is.
#[derive(Clone, Copy)]
struct Drifting;

impl Formula for Drifting {
    type Of = Positions;
    type Entry<N: Number> = N;

    fn entries<N: Number>(&self, (x, y): (Coordinates<N>, Coordinates<N>), g: &mut [N]) {
        g[0] = (x.x + 1.0) / ((x - y).length() + 1.0);
    }
}

#[test]
fn formulas_of_positions_have_derivatives_with_respect_to_the_target() {
    let (points, charges) = cloud();
    let value = |x: DVec3, y: DVec3| (1.0 + x.x) / (1.0 + x.distance(y));
    let by_hand = from_fn(value).skip_coincident().gradient(move |x: DVec3, y: DVec3| {
        let (d, r) = (x - y, x.distance(y));
        DVec3::X / (1.0 + r) - d / r * value(x, y) / (1.0 + r)
    });
    let exact = direct(&by_hand, &points, &charges, &points).unwrap();
    let kernel = from_formula(Drifting).skip_coincident().gradient();
    let sums = direct(&kernel, &points, &charges, &points).unwrap();
    assert!(relative_l2_error(&sums, &exact) < 1e-14);
}

/// A matrix formula of two fields and three densities: G_ab = (a + 1 + b d₁)/(1 + r²).
#[derive(Clone, Copy)]
pub(crate) struct Matrix;

impl Formula for Matrix {
    type Of = Difference;
    type Entry<N: Number> = N;

    fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [N]) {
        let size = (d.length_squared() + 1.0).recip();
        for (k, entry) in g.iter_mut().enumerate() {
            let (a, b) = (k / 3, k % 3);
            *entry = (d.x * b as f64 + (a + 1) as f64) * size;
        }
    }

    fn fields(&self) -> usize {
        2
    }

    fn densities(&self) -> usize {
        3
    }
}

/// Two right-hand sides of the matrix formula, pair by pair: values, and their derivatives along an axis.
fn matrix_sums(x: DVec3, points: &[DVec3], charges: &[[[f64; 2]; 3]]) -> [[f64; 2]; 2] {
    let mut sums = [[0.0; 2]; 2];
    for (y, q) in points.iter().zip(charges) {
        let d = x - *y;
        for (a, sums) in sums.iter_mut().enumerate() {
            for (b, q) in q.iter().enumerate() {
                let entry = ((a + 1) as f64 + b as f64 * d.x) / (1.0 + d.length_squared());
                (0..2).for_each(|column| sums[column] += entry * q[column]);
            }
        }
    }
    sums
}

#[test]
fn matrices_have_derivatives_in_every_column() {
    let points = clouds::cube(300, 1);
    let numbers = clouds::charges(300 * 6, 2);
    let charges: Vec<[[f64; 2]; 3]> =
        numbers.chunks(6).map(|q| [0, 1, 2].map(|b| [q[2 * b], q[2 * b + 1]])).collect();
    let kernel = from_formula::<_, DVec3, [[f64; 2]; 3]>(Matrix).values::<[[f64; 2]; 2]>();
    let sums = direct(&kernel, &points, &charges, &points[..20]).unwrap();
    let slopes = direct(&kernel.gradient(), &points, &charges, &points[..20]).unwrap();
    let curves = direct(&kernel.hessian(), &points, &charges, &points[..20]).unwrap();
    let h = 1e-4;
    for (i, &x) in points[..20].iter().enumerate() {
        let at = |x: DVec3| matrix_sums(x, &points, &charges);
        let close = |found: [[f64; 2]; 2], exact: [[f64; 2]; 2], bound: f64| {
            let error = relative_l2_error(&[found], &[exact]);
            assert!(error < bound, "{error:e}");
        };
        close(sums[i], at(x), 1e-13);
        close(slopes[i].value, at(x), 1e-13);
        close(curves[i].value, at(x), 1e-13);
        let combined = |terms: &[(f64, DVec3)]| {
            let mut sum = [[0.0; 2]; 2];
            terms.iter().for_each(|&(scale, moved)| sum.add_scaled(scale, &at(x + moved)));
            sum
        };
        for (axis, step) in DVec3::AXES.into_iter().enumerate() {
            let step = step * h;
            let slope = combined(&[(0.5 / h, step), (-0.5 / h, -step)]);
            close(slopes[i].gradient[axis], slope, 1e-6);
            close(curves[i].gradient[axis], slope, 1e-6);
            let second = h.powi(-2);
            let curve = combined(&[(second, step), (second, -step), (-2.0 * second, DVec3::ZERO)]);
            close(curves[i].hessian[[0, 3, 5][axis]], curve, 1e-4);
        }
    }
    let fmm = Fmm::builder(kernel).tolerance(1e-4).leaf_size(10).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap()[..20], &sums) < 1e-4);
}

#[test]
fn complex_formulas_have_gradients() {
    let (points, charges) = cloud();
    let waves: Vec<Complex<f64>> = charges.iter().map(|&q| Complex::new(q, 1.0)).collect();
    // Sources and targets apart: |d| has no derivative at zero.
    let targets: Vec<DVec3> = points[..40].iter().map(|p| *p + DVec3::X * 1.5).collect();
    let sums = |moved: DVec3| {
        let targets: Vec<DVec3> = targets.iter().map(|p| *p + moved).collect();
        direct(&from_formula(Wave), &points, &waves, &targets).unwrap()
    };
    let kernel = from_formula(Wave).gradient();
    let found = direct(&kernel, &points, &waves, &targets).unwrap();
    let h = 1e-5;
    for (axis, step) in DVec3::AXES.into_iter().enumerate() {
        let (after, before) = (sums(step * h), sums(step * -h));
        let differences = after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * h));
        let slopes: Vec<Complex<f64>> = found.iter().map(|u| u.gradient[axis]).collect();
        assert!(relative_l2_error(&slopes, &differences.collect::<Vec<_>>()) < 1e-7);
    }
}

#[test]
fn formulas_of_positions_are_expanded() {
    // So many in large leaves that direct sums would take longer.
    let points = clouds::cube(16_000, 1);
    // Of one sign: the tolerance is relative to Σ|K||q|, and little of a sum of both signs is left.
    let charges: Vec<f64> = clouds::charges(16_000, 2).iter().map(|q| q.abs()).collect();
    let kernel = from_formula(Drifting);
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(300).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    assert!(relative_l2_error(&fmm.apply(&charges).unwrap(), &exact) < 1e-3);
}

#[test]
fn gradients_in_single_precision() {
    let (points, charges) = cloud();
    let kernel = from_formula(Softened).gradient();
    let exact = direct(&kernel, &points, &charges, &points).unwrap();
    let single: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
    let numbers: Vec<f32> = charges.iter().map(|&q| q as f32).collect();
    let kernel = from_formula(Softened).gradient();
    let sums = direct(&kernel, &single, &numbers, &single).unwrap();
    let wide: Vec<[f64; 4]> = sums
        .iter()
        .map(|u| [u.value, u.gradient[0], u.gradient[1], u.gradient[2]].map(f64::from))
        .collect();
    let exact: Vec<[f64; 4]> =
        exact.iter().map(|u| [u.value, u.gradient[0], u.gradient[1], u.gradient[2]]).collect();
    assert!(relative_l2_error(&wide, &exact) < 1e-5);
}

/// Formulas of angles up to 1e9, real and complex, against closures.
#[test]
fn angles_of_any_size_are_right() {
    let (points, charges) = cloud();
    let (points, charges) = (&points[..300], &charges[..300]);
    for scale in [10.0, 1e6, 1e9] {
        let wave = formula!(|d; scale| (d.length() * scale).sin() + (d.length() * scale).cos());
        let closure = from_fn(move |x: DVec3, y: DVec3| {
            let (sin, cos) = (x.distance(y) * scale).sin_cos();
            sin + cos
        });
        let sums = direct(&wave, points, charges, points).unwrap();
        let exact = direct(&closure, points, charges, points).unwrap();
        assert!(relative_l2_error(&sums, &exact) < 1e-14, "{scale:e}");
        let sums = direct(&wave.skip_coincident().gradient(), points, charges, points).unwrap();
        let values: Vec<f64> = sums.iter().map(|u| u.value).collect();
        let exact = direct(&closure.skip_coincident(), points, charges, points).unwrap();
        assert!(relative_l2_error(&values, &exact) < 1e-14, "{scale:e}");

        let spiral = from_formula(Spiral { scale });
        let closure = from_fn(move |x: DVec3, y: DVec3| Complex::cis(x.distance(y) * scale));
        let charges: Vec<Complex<f64>> = charges.iter().map(|q| Complex::new(*q, -q)).collect();
        let sums = direct(&spiral, points, &charges, points).unwrap();
        let exact = direct(&closure, points, &charges, points).unwrap();
        assert!(relative_l2_error(&sums, &exact) < 1e-14, "{scale:e}");
    }
}

/// e^(ikr)
#[derive(Clone, Copy)]
struct Spiral {
    scale: f64,
}

impl Formula for Spiral {
    type Of = Difference;
    type Entry<N: Number> = Complex<N>;

    #[inline(always)]
    fn entries<N: Number>(&self, d: Coordinates<N>, g: &mut [Complex<N>]) {
        let angle = d.length() * self.scale;
        g[0] = Complex { re: angle.cos(), im: angle.sin() };
    }
}
