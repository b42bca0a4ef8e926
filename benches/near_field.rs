//! Measures how many pairs a second one core sums directly: in bare loops over large arrays and in blocks of
//! the size of leaves, by built-in kernels and by formulas. Accuracy is asserted before any measurement.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use farfield::{Kernel, Numbers, Point, Real, formula, from_fn, math, relative_l2_error};
use farfield_benches::clouds;
use farfield_potentials::InverseDistance;
use glam::{DVec3, Vec3};

const TOLERANCES: [f64; 4] = [0.0, 1e-9, 1e-6, 1e-3];

/// Targets and sources of a sum, and how many of each make a block.
struct Shape {
    name: &'static str,
    points: usize,
    targets: usize,
    sources: usize,
}

const SHAPES: [Shape; 2] = [
    Shape { name: "large", points: 4096, targets: 4096, sources: 4096 },
    Shape { name: "leaves", points: 4096, targets: 32, sources: 64 },
];

/// Every pair once, block by block.
fn sum<K: Kernel>(
    kernel: &K,
    shape: &Shape,
    tolerance: f64,
    points: (&[K::Target], &[K::Source]),
    charges: &[K::Charge],
    values: &mut [K::Value],
) {
    for (xs, us) in points.0.chunks(shape.targets).zip(values.chunks_mut(shape.targets)) {
        for (ys, qs) in points.1.chunks(shape.sources).zip(charges.chunks(shape.sources)) {
            kernel.add_block(xs, ys, qs, tolerance, us);
        }
    }
}

fn double_loop<K: Kernel>(
    kernel: &K,
    (xs, ys): (&[K::Target], &[K::Source]),
    qs: &[K::Charge],
    us: &mut [K::Value],
) {
    for (x, u) in xs.chunks(1).zip(us.chunks_mut(1)) {
        for (y, q) in ys.chunks(1).zip(qs.chunks(1)) {
            kernel.add_block(x, y, q, 0.0, u);
        }
    }
}

fn measure<K: Kernel>(
    criterion: &mut Criterion,
    name: &str,
    kernel: &K,
    points: (&[K::Target], &[K::Source]),
    charges: &[K::Charge],
    (tolerances, rounding): (&[f64], f64),
) {
    let mut exact = vec![K::Value::zero(); points.0.len()];
    double_loop(kernel, points, charges, &mut exact);
    let mut group = criterion.benchmark_group(name);
    group.throughput(Throughput::Elements((points.0.len() * points.1.len()) as u64));
    group.sample_size(10);
    for shape in SHAPES {
        for &tolerance in tolerances {
            let mut values = vec![K::Value::zero(); shape.points];
            sum(kernel, &shape, tolerance, points, charges, &mut values);
            let error = relative_l2_error(&values, &exact);
            assert!(error <= tolerance + rounding, "{name}, {tolerance:e}: {error:e}");
            let id = BenchmarkId::new(shape.name, format!("{tolerance:e}"));
            group.bench_function(id, |b| {
                b.iter(|| {
                    sum(kernel, &shape, tolerance, points, black_box(charges), &mut values);
                });
            });
        }
    }
    group.bench_function("double loop", |b| {
        b.iter(|| double_loop(kernel, points, black_box(charges), &mut exact));
    });
    group.finish();
}

/// Formulas that are evaluated side by side, with the functions that kernels are made of.
fn formulas<T: Real>(
    criterion: &mut Criterion,
    precision: &str,
    points: (&[Point<T>], &[Point<T>]),
    charges: &[T],
    rounding: f64,
) {
    macro_rules! measure {
        ($($name:literal |$d:ident| $entry:expr;)*) => {$(
            let kernel = formula!(|$d| $entry).skip_coincident();
            let name = format!("formula {}, {precision}", $name);
            measure(criterion, &name, &kernel, points, charges, (&TOLERANCES[..1], rounding));
        )*};
    }
    measure! {
        "1/r" |d| d.length().recip();
        "exp(-5r)/r" |d| (d.length() * -5.0).exp() / d.length();
        "exp(-5r²)" |d| (d.length_squared() * -5.0).exp();
        "cos(3r)/r" |d| (d.length() * 3.0).cos() / d.length();
        "ln r" |d| d.length().ln();
        "r^0.7" |d| d.length().powf(0.7);
        "erfc(r)/r" |d| d.length().erfc() / d.length();
        "tanh r" |d| d.length().tanh();
    }
}

fn near_field(criterion: &mut Criterion) {
    let points = clouds::even(2 * SHAPES[0].points);
    let (xs, ys) = points.split_at(SHAPES[0].points);
    let charges: Vec<f64> = ys.iter().map(|y| y.x + y.y).collect();
    let f64s = (xs, ys);
    let (all, none) = ((&TOLERANCES[..], 1e-14), (&TOLERANCES[..1], 1e-14));

    let inverse = InverseDistance::<f64>::new();
    measure(criterion, "1/r, f64", &inverse, f64s, &charges, all);
    measure(criterion, "1/r and gradient, f64", &inverse.with_gradient(), f64s, &charges, all);
    let columns: Vec<[f64; 3]> = charges.iter().map(|q| [*q, 1.0, 2.0 * q]).collect();
    measure(criterion, "1/r, 3 columns, f64", &inverse.charges(), f64s, &columns, all);
    let formula = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
    measure(criterion, "closure 1/r, f64", &formula, f64s, &charges, none);
    let yukawa = from_fn(|x: DVec3, y: DVec3| {
        let r = x.distance(y);
        (-r).exp() / r
    });
    measure(criterion, "closure exp(-r)/r, f64", &yukawa, f64s, &charges, none);
    let yukawa = from_fn(|x: DVec3, y: DVec3| {
        let r = x.distance(y);
        math::exp(-r) / r
    });
    measure(criterion, "closure math::exp(-r)/r, f64", &yukawa, f64s, &charges, none);
    formulas::<f64>(criterion, "f64", f64s, &charges, 1e-14);

    let single = |points: &[DVec3]| points.iter().map(|p| p.as_vec3()).collect::<Vec<_>>();
    let (xs, ys) = (single(xs), single(ys));
    let charges: Vec<f32> = charges.iter().map(|q| *q as f32).collect();
    let f32s = (&xs[..], &ys[..]);
    let (all, none) = ((&TOLERANCES[..], 1e-5), (&TOLERANCES[..1], 1e-5));
    let inverse = InverseDistance::<f32>::new();
    measure(criterion, "1/r, f32", &inverse, f32s, &charges, all);
    measure(criterion, "1/r and gradient, f32", &inverse.with_gradient(), f32s, &charges, all);
    let formula = from_fn(|x: Vec3, y: Vec3| 1.0 / x.distance(y)).skip_coincident();
    measure(criterion, "closure 1/r, f32", &formula, f32s, &charges, none);
    formulas::<f32>(criterion, "f32", f32s, &charges, 1e-5);
}

criterion_group!(benches, near_field);
criterion_main!(benches);
