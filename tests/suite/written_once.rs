//! Formulas that are written once: in one line, with their derivatives, in complex numbers, of positions,
//! with sizes that are known only at run time.

use farfield::{
    Coordinates, Difference, Fmm, Formula, Kernel, Number, Positions, direct, formula, from_fn,
    from_formula, relative_l2_error, rows_as_points,
};
use farfield_testing::clouds;
use glam::{DVec3, Vec3};
use ndarray::{Array2, ShapeBuilder};
use num_complex::Complex;

use crate::plain;

const N: usize = 3000;

fn cloud() -> (Vec<DVec3>, Vec<f64>) {
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
struct Softened;

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
struct Wave;

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

/// A matrix kernel whose sizes are known only at run time, as those of a kernel read from a text are:
/// G_ab(d) = (c_ab + |d|²)^(−1/2), `side` × `side`, for `columns` right-hand sides.
struct Table {
    side: usize,
    columns: usize,
    offsets: Vec<f64>,
    /// How many blocks of entries were asked for.
    blocks: std::sync::atomic::AtomicUsize,
}

impl Kernel for Table {
    type Real = f64;
    type Source = DVec3;
    type Target = DVec3;
    type Charge = Vec<f64>;
    type Value = Vec<f64>;
    type Entry = f64;

    fn fields(&self) -> usize {
        self.side
    }

    fn densities(&self) -> usize {
        self.side
    }

    fn columns(&self) -> usize {
        self.columns
    }

    fn entries(&self, x: DVec3, y: DVec3, g: &mut [f64]) {
        self.entries_block(&[x], &[y], g);
    }

    fn entries_block(&self, xs: &[DVec3], ys: &[DVec3], g: &mut [f64]) {
        self.blocks.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let pairs = xs.iter().flat_map(|x| ys.iter().map(move |y| x.distance_squared(*y)));
        for (r2, g) in pairs.zip(g.chunks_exact_mut(self.offsets.len())) {
            for (entry, offset) in g.iter_mut().zip(&self.offsets) {
                *entry = 1.0 / (offset + r2).sqrt();
            }
        }
    }
}

#[test]
fn sizes_may_be_known_at_run_time_only() {
    let points = clouds::cube(800, 1);
    let (side, columns) = (3, 5);
    let offsets: Vec<f64> = (0..side * side).map(|k| 0.5 + 0.1 * k as f64).collect();
    let table = Table { side, columns, offsets, blocks: Default::default() };
    let numbers = clouds::charges(points.len() * side * columns, 3);
    let charges: Vec<Vec<f64>> = numbers.chunks(side * columns).map(<[f64]>::to_vec).collect();
    let sums = direct(&table, &points, &charges, &points[..60]).unwrap();
    for (x, sums) in points.iter().zip(&sums) {
        for field in 0..side {
            for column in 0..columns {
                let mut exact = 0.0;
                for (y, q) in points.iter().zip(&charges) {
                    for density in 0..side {
                        let offset = table.offsets[field * side + density];
                        let entry = 1.0 / (offset + x.distance_squared(*y)).sqrt();
                        exact += entry * q[density * columns + column];
                    }
                }
                let found = sums[field * columns + column];
                assert!((found - exact).abs() < 1e-11, "field {field}, column {column}");
            }
        }
    }
    let fmm = Fmm::builder(&table).tolerance(1e-4).leaf_size(20).build(&points, &points).unwrap();
    assert!(fmm.report().stats.expansion_pairs > 0);
    let before = table.blocks.load(std::sync::atomic::Ordering::Relaxed);
    let values = fmm.apply(&charges).unwrap();
    assert!(relative_l2_error(&values[..60], &sums) < 1e-4);
    let asked = table.blocks.load(std::sync::atomic::Ordering::Relaxed) - before;
    let pairs = fmm.report().stats.direct_pairs as usize;
    assert!(asked > 0 && 10 * asked < pairs, "blocks, not pairs: {asked} of {pairs}");
}

#[test]
fn points_may_be_arrays_vectors_or_rows() {
    let (points, charges) = cloud();
    let arrays: Vec<[f64; 3]> = points.iter().map(|p| p.to_array()).collect();
    let rows = Array2::from_shape_vec((N, 3), arrays.concat()).unwrap();
    let mut columns = Array2::zeros((N, 3).f());
    columns.assign(&rows);
    let sum = |points: &[[f64; 3]]| {
        let kernel = from_formula(Softened);
        let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(50).build(points, points).unwrap();
        fmm.apply(&charges).unwrap()
    };
    let kernel = from_formula(Softened);
    let fmm = Fmm::builder(kernel).tolerance(1e-3).leaf_size(50).build(&points, &points).unwrap();
    let expected = fmm.apply(&charges).unwrap();
    assert_eq!(sum(&arrays), expected);
    assert_eq!(sum(&rows_as_points(rows.view()).unwrap()), expected);
    assert_eq!(sum(&rows_as_points(columns.view()).unwrap()), expected);
}
