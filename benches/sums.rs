//! Measures plans and applications of whole sums, and direct summation beside them. Accuracy is asserted
//! before any measurement.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use farfield::{Fmm, Scheme, direct, from_fn, relative_l2_error};
use farfield_benches::clouds;
use farfield_potentials::{HarmonicExpansion, InverseDistance};
use glam::DVec3;

const TOLERANCE: f64 = 1e-4;

fn sums(criterion: &mut Criterion) {
    let formula = from_fn(|x: DVec3, y: DVec3| 1.0 / x.distance(y)).skip_coincident();
    for n in [2_000, 20_000] {
        let points = clouds::even(n);
        let charges: Vec<f64> = points.iter().map(|p| p.x - p.y).collect();
        let mut group = criterion.benchmark_group("inverse distance");
        group.throughput(Throughput::Elements(n as u64)).sample_size(10);
        let exact = direct(&formula, &points, &charges, &points).unwrap();

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
            b.iter(|| direct(&kernel, &points, black_box(&charges), &points).unwrap());
        });
        group.finish();
    }
}

criterion_group!(benches, sums);
criterion_main!(benches);
