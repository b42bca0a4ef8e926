//! Whole sums, plan and application apart, beside direct summation. Accuracy is asserted before
//! anything is measured.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use farfield::{Fmm, Scheme, direct, from_fn, relative_l2_error};
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use glam::DVec3;

const TOLERANCE: f64 = 1e-4;

fn cloud(n: usize) -> (Vec<DVec3>, Vec<f64>) {
    // Steps of a low-discrepancy sequence: uniform, and the same on every machine.
    let point = |i| (DVec3::new(0.819_173, 0.671_044, 0.549_700) * f64::from(i)).fract();
    let points: Vec<DVec3> = (1..=n as u32).map(point).collect();
    let charges = points.iter().map(|p| p.x - p.y).collect();
    (points, charges)
}

fn sums(criterion: &mut Criterion) {
    let formula = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
    for n in [2_000, 20_000] {
        let (points, charges) = cloud(n);
        let mut group = criterion.benchmark_group("inverse distance");
        group.throughput(Throughput::Elements(n as u64)).sample_size(10);
        let exact = direct(&formula, &points, &charges, &points);

        let plan = || {
            Fmm::builder(formula)
                .tolerance(TOLERANCE)
                .scheme(Scheme::Fmm)
                .build(&points, &points)
                .unwrap()
        };
        let fmm = plan();
        let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
        assert!(error < TOLERANCE, "interpolation: {error:e}");
        group.bench_function(BenchmarkId::new("interpolation, plan", n), |b| b.iter(plan));
        group.bench_function(BenchmarkId::new("interpolation, apply", n), |b| {
            b.iter(|| fmm.apply(black_box(&charges)).unwrap());
        });

        for (name, scheme) in [("fmm", Scheme::Fmm), ("treecode", Scheme::Treecode { m2m: true })] {
            let kernel = InverseDistance::<f64>::new();
            let expansion = HarmonicExpansion::with_tolerance(kernel, TOLERANCE).unwrap();
            let fmm = Fmm::with_expansion(expansion).scheme(scheme).build(&points, &points);
            let fmm = fmm.unwrap();
            let error = relative_l2_error(&fmm.apply(&charges).unwrap(), &exact);
            assert!(error < TOLERANCE, "harmonics, {name}: {error:e}");
            group.bench_function(BenchmarkId::new(format!("harmonics, {name}"), n), |b| {
                b.iter(|| fmm.apply(black_box(&charges)).unwrap());
            });
        }

        let kernel = InverseDistance::<f64>::new();
        group.bench_function(BenchmarkId::new("direct", n), |b| {
            b.iter(|| direct(&kernel, &points, black_box(&charges), &points));
        });
        group.finish();
    }
}

criterion_group!(benches, sums);
criterion_main!(benches);
